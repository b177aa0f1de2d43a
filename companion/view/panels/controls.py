"""What all controls have in common: a browser's change queues a call for the view thread, our own writing does not."""

from __future__ import annotations

import math
import re
import weakref
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from string import Template
from typing import Any, Literal

import viser

from companion.present import palette
from companion.view.state.trajectory import CameraMode

Key = Literal[
    "space", "arrowleft", "arrowright", "arrowup", "arrowdown", "pageup", "pagedown", "home", "end",
    "A", "B", "F", "I", "J", "L", "M", "O", "P", "V", "Z",
] | Literal["1", "2", "3", "4", "5", "6", "7", "8", "9"]  # fmt: skip
"""Keys that viser knows, of those that are used."""
CAMERAS: dict[str, tuple[Key, CameraMode]] = {
    "Fit all": ("F", "Free"),
    "Follow both": ("V", "Follow"),
    "Map": ("M", "Map"),
}
PHONE = "(max-width:36em)"
SIDE = 330  # width of either panel, pixels
NARROW = 284  # where the window is narrower than 75em and wider than a phone's: the picture keeps two fifths of it
NARROW_WINDOW = "@media (min-width:36.01em) and (max-width:75em)"
_EDGE = 4  # pixels that viser adds to a docked panel
_CUT = re.compile(r"/\*.*?\*/|\n", re.DOTALL)  # comments and ends of lines


def style(sheet: str, **values: object) -> str:
    """A style sheet of this folder as markup. values: what its `${names}` stand for."""
    css = (files("companion.view.panels") / sheet).read_text(encoding="utf-8")
    return f"<style>{Template(_CUT.sub('', css)).substitute(values, phone=PHONE, narrow_window=NARROW_WINDOW)}</style>"


_STYLE = style(
    "page.css",
    side=SIDE + _EDGE,
    narrow=NARROW + _EDGE,
    trouble=palette.css(palette.TROUBLE),
    trouble_on_dark=palette.css(palette.TROUBLE_ON_DARK),
)


Call = Callable[[], object]
Post = Callable[[Call], None]
"""Queues a call for the view thread, which makes one after the other before it draws. Does not block."""
InBrowser = Callable[[int], object]
"""A call that needs to know the number of the browser in which something was pressed."""
ChooseCamera = Callable[[CameraMode, int], object]
"""Moves the camera of one browser otherwise."""


@dataclass(slots=True)
class _Received:
    """What an input was set to last, as far as its listener and `write` know."""

    known: object
    missed: object = None  # what a browser had sent, and `write` has overwritten before the listener was called


_received: dict[int, _Received] = {}  # by the identity of the input: viser's cannot be hashed


class Controls:
    """Where controls are added (`gui`), and where their callbacks go: all of them run in the view thread."""

    def __init__(self, gui: viser.GuiApi, post: Post) -> None:
        self.gui, self._post = gui, post

    def on_change(self, handle: Any, do: Callable[[Any], object]) -> None:
        """Call `do` with the value that a browser gives an input; what this thread writes itself is no change.

        A browser may send anything. The handle has its value before its listener is called, and `write` may come
        between: then it is given back what the browser sent.
        """
        one = _received[id(handle)] = _Received(handle.value)
        weakref.finalize(handle, _received.pop, id(handle), None)

        async def changed(update: Any) -> None:
            if update.client_id is not None:
                if one.missed is not None and handle.value == one.known:
                    handle.value = one.missed
                one.known, one.missed = handle.value, None
                self._post(partial(do, handle.value))

        handle.on_update(changed)

    def on_click(self, button: Any, do: Call) -> None:
        """Call `do` when a button is pressed."""
        self.on_click_in(button, lambda _: do())

    def on_click_in(self, button: Any, do: InBrowser) -> None:
        """The same, with the number of the browser in which it is pressed."""
        self._listen(button.on_click, lambda: do)

    def row(self, label: str, buttons: Mapping[str, InBrowser], hint: str) -> None:
        """A row of buttons."""
        row = self.gui.add_button_group(label, tuple(buttons), hint=hint)
        self._listen(row.on_click, lambda: buttons.get(row.value))

    def command(self, name: str, key: Key, do: Call, *, shift: bool = False) -> None:
        """Keys go through the command palette, which lists them under Ctrl-K."""
        self.command_in(name, key, lambda _: do(), shift=shift)

    def command_in(self, name: str, key: Key, do: InBrowser, *, shift: bool = False) -> None:
        """The same, with the number of the browser."""
        command = self.gui.add_command(name, hotkey=key, modifier="shift" if shift else None)
        self._listen(command.on_trigger, lambda: do)

    def _listen(self, register: Callable[[Any], object], called: Callable[[], InBrowser | None]) -> None:
        """called: looks up what to call, as soon as something is pressed; None: nothing."""

        async def pressed(event: Any) -> None:
            do = called()
            if do is not None and event.client_id is not None:
                self._post(partial(do, event.client_id))

        register(pressed)


def write(handle: Any, value: object) -> None:
    """Set an input's value. Untyped, because viser declares the setter where mypy does not see it."""
    one, before = _received.get(id(handle)), handle.value
    handle.value = value
    if one is not None:
        if before not in (one.known, handle.value):
            one.missed = before
        one.known = handle.value


def bounded(value: object, low: float, default: float, high: float) -> float:
    """`value` within bounds, or `default` for what is no number: a browser may send anything."""
    if not isinstance(value, int | float) or not math.isfinite(value):
        return default
    return min(max(float(value), low), high)


def dock(gui: viser.GuiApi, side: viser.PanelHandle) -> None:
    """The main panel on the right, another on the left; on a phone one sheet as wide as it."""
    gui.add_html(_STYLE)
    for panel in (gui.main_panel, side):
        panel.set_width(SIDE)
    gui.main_panel.dock_right()
    side.dock_left()
    side.expand()  # on a phone, where panels are folded until somebody opens them


def key_of(options: Mapping[str, object], value: object) -> str:
    """What a value is called in a list of options. Raises StopIteration for one that is not in it."""
    return next(key for key, meaning in options.items() if meaning == value)
