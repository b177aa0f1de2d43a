"""What all controls have in common: a browser's change queues a call for the view thread, our own writing does not."""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import viser

from companion.present import palette
from companion.view.state.choice import CameraMode

Key = Literal[
    "space", "arrowleft", "arrowright", "arrowup", "arrowdown", "pageup", "pagedown", "home", "end",
    "A", "B", "F", "I", "J", "L", "M", "O", "P", "V",
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
_STYLE = (
    # viser 1.1 gives a phone a sheet 20em wide at the bottom right; this one is as wide as the phone.
    '<style>@media (max-width:36em){div[style*="width: 20em"]{width:100vw !important}}'
    # viser docks panels with one width for every window. Whoever drags an edge gets the width that he drags it to.
    f'{NARROW_WINDOW}{{div[style*="width: {SIDE + _EDGE}px"]{{width:{NARROW + _EDGE}px!important}}'
    f'div[style*="inset: 0px {SIDE + _EDGE}px;"]{{inset:0 {NARROW + _EDGE}px!important}}'
    f'div[style*="inset: 0px {SIDE + _EDGE}px 0px"]{{right:{NARROW + _EDGE}px!important}}'
    f'div[style*="inset: 0px 0px 0px {SIDE + _EDGE}px"]{{left:{NARROW + _EDGE}px!important}}'
    "table{font-size:0.72em!important}}"
    # The grips of panels and what folds them: the layout is this one. On a phone the heads of the sections stay.
    f'@media not all and {PHONE}{{div:is([style*="height: 1em; cursor: grab"],[style*="height: 0.9em; cursor: grab"])'
    "{display:none!important}}"
    # There the picture comes first, under the verdict; then time and findings, then the numbers and what can be set.
    f"@media {PHONE}{{div:has(>div>.mantine-Tabs-root){{display:flex;flex-direction:column}}"
    "div:has(>div>.mantine-Tabs-root)>div:has(>.mantine-Tabs-root){order:-1}}"
    # Labels are too pale for their size, and the chosen tab on dark: 4.5 to 1 is the least (WCAG 2.1, 1.4.3).
    ':root[data-mantine-color-scheme="light"]{--mantine-color-dimmed:#5a6169!important}'
    ':root[data-mantine-color-scheme="dark"]{--mantine-color-dimmed:#a9b1ba!important}'
    '[data-mantine-color-scheme="dark"] [role="tab"][aria-selected="true"] *{color:#d5dce4}'
    f':root[data-mantine-color-scheme="light"]{{--companion-trouble:{palette.css(palette.TROUBLE)}}}'
    f':root[data-mantine-color-scheme="dark"]{{--companion-trouble:{palette.css(palette.TROUBLE_ON_DARK)}}}'
    # viser's remark on a machine without a graphics card: small, in a corner, and gone by itself.
    '[class*="mantine-Notifications-root"]{top:auto!important;bottom:220px!important;'
    "--notifications-container-width:13em!important}"
    '[class*="mantine-Notification-root"]{animation:companion-leave 0s 6s forwards;padding:4px 8px!important}'
    '[class*="mantine-Notification-root"] [class*="description"]{display:none}'
    '[class*="mantine-Notification-title"]{font-size:11px!important}'
    "@keyframes companion-leave{to{display:none;visibility:hidden}}"
    '[data-mantine-color-scheme="dark"] button[data-variant="outline"]{color:#d5dce4!important}'
    '[class*="mantine-Slider-markLabel"]{color:inherit!important}'
    "@media (max-width:75em){.companion-words{display:none}}"  # of the timeline: they would lie on each other
    # A chart's legend has values where the pointer is, and "--" for each while there is none.
    ".uplot:not(:hover) .u-legend .u-value{visibility:hidden}"
    ".uplot:not(:hover) .u-legend th::after{content:none!important}"
    # The head of a panel that is folded is dimmed by viser to 2.8 to 1.
    'div[role="button"][aria-expanded="false"] p{opacity:0.8!important}'
    '[class*="mantine-Notification-description"]{color:inherit!important}</style>'
)


Call = Callable[[], object]
Post = Callable[[Call], None]
"""Queues a call for the view thread, which makes one after the other before it draws. Does not block."""
Row = Mapping[str, Call]


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

        async def pressed(_: object) -> None:
            self._post(do)

        button.on_click(pressed)

    def on_click_in(self, button: Any, do: Callable[[int], object]) -> None:
        """Call `do` with the number of the browser in which a button is pressed."""

        async def pressed(click: viser.GuiEvent[Any]) -> None:
            if click.client_id is not None:
                self._post(partial(do, click.client_id))

        button.on_click(pressed)

    def row(self, label: str, buttons: Row, hint: str) -> None:
        """A row of buttons."""
        row = self.gui.add_button_group(label, tuple(buttons), hint=hint)

        @row.on_click
        async def _(_: object) -> None:
            if row.value in buttons:
                self._post(buttons[row.value])

    def cameras(self, choose: Callable[[int, CameraMode], object]) -> None:
        """A row of buttons that move the camera of the browser in which they are pressed, and no other."""
        row = self.gui.add_button_group("View", tuple(CAMERAS), hint="In this browser alone. More cameras: Picture")

        @row.on_click
        async def _(click: viser.GuiEvent[Any]) -> None:
            if click.client_id is not None and row.value in CAMERAS:
                self._post(partial(choose, click.client_id, CAMERAS[row.value][1]))

    def command(self, name: str, key: Key, do: Call, *, shift: bool = False) -> None:
        """Keys go through the command palette, which lists them under Ctrl-K."""

        @self.gui.add_command(name, hotkey=key, modifier="shift" if shift else None).on_trigger
        async def _(_: object) -> None:
            self._post(do)

    def command_in(self, name: str, key: Key, do: Callable[[int], object]) -> None:
        """The same, with the number of the browser."""

        @self.gui.add_command(name, hotkey=key).on_trigger
        async def _(event: viser.CommandEvent) -> None:
            if event.client_id is not None:
                self._post(partial(do, event.client_id))


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
