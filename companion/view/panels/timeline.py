"""The timeline under the picture: play, scrub, step and jump, the marks of the flight, and the keys for all of it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import viser

from companion.present import Rgb, palette
from companion.view.panels.controls import CAMERAS, Call, ChooseCamera, Controls, Key, style, write
from companion.view.panels.strip import GUTTER, HEIGHT, Bands, legend, markup, strip
from companion.view.state.moments import PLAYED_S, ErrorCurve, Mark, Moment, short
from companion.view.state.player import Player

WIDTH = 600  # pixels, where the browser does not know `:has`
TALL = 212  # pixels: what the panel covers of the window
_COLOURS = {"controls": palette.css(palette.CONTROLS), "brand": palette.css(palette.BRAND)}
_STYLE = style("timeline.css", width=WIDTH, tall=TALL, height=HEIGHT, gutter=GUTTER, **_COLOURS)
SPEEDS = ("0.1×", "0.2×", "0.5×", "1×", "2×", "5×", "10×", "20×", "50×")
TENTHS: tuple[Key, ...] = ("1", "2", "3", "4", "5", "6", "7", "8", "9")
NO_MARK = "choose an event"
MOST_ANCHORS = 100  # ticks; more than that is a grey bar
MOST_MARKS = 300  # in the list of events; a talkative vehicle sends thousands of texts
ZOOMED = 6.0  # times as long as what is pointed at, and more than that, is a log whose strip zooms in on it
LEAST_S = 60.0  # of a zoomed strip


class Timeline:
    """The controls of time. Built once; `load` fits them to a flight, `show` writes the instant into them."""

    def __init__(
        self, controls: Controls, panel: viser.PanelHandle, player: Player, choose_camera: ChooseCamera
    ) -> None:
        """`panel` becomes the timeline; what is set once and seldom changed goes into a folder where this is called."""
        gui, on = controls.gui, controls.on_change
        self._player = player
        self._span = self._near = player.whole  # what the strip shows; about what is pointed at
        self._moment: Moment | None = None
        self._played: tuple[float, float] | None = None
        self._actions = _actions(player, self.play, self.zoom)
        with panel.add_tab("Timeline", viser.Icon.TIMELINE):
            self._transport = gui.add_html(_STYLE)
            self._key = gui.add_html("")
            gui.add_html('<i class="companion-time"></i>')
            self._time = gui.add_slider("Time, s", 0.0, 1.0, 0.01, 0.0, hint="Seconds since the vehicle's boot")
            self._strip = gui.add_html("")
        panel.float(x=0, y=-1, width=WIDTH)
        with gui.add_folder("Playing", expand_by_default=False):
            speed = gui.add_dropdown("Speed", SPEEDS, initial_value="1×")
            self._backwards = gui.add_checkbox("Backwards", False)
            loop = gui.add_checkbox("Repeat", False, hint="Start again where the part ends")
            controls.row(
                "Part",
                {
                    "from here": lambda _: player.cut("from"),
                    "to here": lambda _: player.cut("to"),
                    "whole": lambda _: player.cut("whole"),
                },
                "Play and plot only a part of the flight. Keys: I, O, B",
            )
            self._event = gui.add_dropdown("Go to", (NO_MARK,))
        on(self._time, lambda t: player.seek(float(t)))
        on(speed, lambda name: setattr(player, "speed", float(name.rstrip("×"))))
        on(loop, partial(setattr, player, "loop"))
        on(self._backwards, partial(setattr, player, "backwards"))
        on(self._event, self._go_to)
        for one in self._actions:
            controls.command(one.name, one.key, one.do, shift=one.shift)
        for name, (key, mode) in CAMERAS.items():
            controls.command_in(name, key, partial(choose_camera, mode))
        for i, key in enumerate(TENTHS, start=1):
            controls.command(f"To {i} tenths", key, partial(player.seek_share, i / 10))

    def load(
        self, marks: Sequence[Mark], anchors: Sequence[float], bands: Bands, curve: ErrorCurve, colour: Rgb
    ) -> None:
        """Fit the controls to what is shown now. Values set here come back as no change.

        curve: the error that the strip shows, in the colour of its IMU.
        """
        self._marks, self._anchors, self._bands, self._curve, self._colour = marks, anchors, bands, curve, colour
        names = (f"{i}: {mark.t:.1f} s, {short(mark.label)}" for i, mark in enumerate(self._marks[:MOST_MARKS], 1))
        self._event.options = (NO_MARK, *names)
        self._show_span(*self._player.whole)

    def point(self, moment: Moment, curve: ErrorCurve, played: tuple[float, float]) -> None:
        """Show the error in which a stretch shows, with the stretch, closer in a long log; offer to play some of it."""
        self._moment, self._curve, self._played = moment, curve, played
        low, high = self._player.whole
        begin, end = min(moment.onset_s, played[0]), max(moment.end_s, played[1])
        wide = max(LEAST_S, ZOOMED / 2 * (end - begin))
        if wide < (high - low) / 2:
            middle = min(max((begin + end) / 2, low + wide / 2), high - wide / 2)
            low, high = middle - wide / 2, middle + wide / 2
        self._near = (low, high)
        self._show_span(*(self._near if moment.of_finding else self._player.whole))

    def forget(self) -> None:
        """Point at nothing."""
        self._moment = self._played = None
        self._near = self._player.whole
        self.choose_part()

    def zoom(self) -> None:
        """Show the whole time, or what is about the part that is pointed at, else about the instant."""
        player, (low, high) = self._player, self._near
        if self._span != player.whole:
            low, high = player.whole
        elif not low <= player.time <= high:
            wide = high - low
            low = min(max(player.time - wide / 2, player.first), player.last - wide)
            high = low + wide
        self._show_span(low, high)

    def play(self) -> None:
        """Play what is pointed at."""
        if self._played is not None:
            self._player.play(*self._played)

    def _show_span(self, low: float, high: float) -> None:
        """Show another part of the time: as long as the instant is within."""
        self._span = (low, high)
        low, high = round(low, 2), round(high, 2)
        # The bounds move one at a time and must never cross, and the value must always lie between them.
        self._time.max = max(high, self._time.max)
        self._time.min = min(low, self._time.min)
        write(self._time, round(min(max(self._player.time, low), high), 2))
        self._time.min, self._time.max = low, high
        self.choose_part()

    def choose_part(self) -> None:
        """Draw the strip with the part that is played."""
        player = self._player
        low, high = self._span
        shown = [t for t in self._anchors if low <= t <= high]
        anchors = [Mark(t, "the IMU restarts from the autopilot's state here", "anchor")
                   for t in (shown if len(shown) <= MOST_ANCHORS else ())]  # fmt: skip
        part = (max(player.start, low), min(player.end, high)) if player.part != player.whole else None
        self._key.content = (
            f'<div class="companion-key">{legend(self._bands, self._curve, self._colour, self._moment)}</div>'
        )
        # The strip lies under the slider's track, the marks below: beside it are the axes and the number.
        self._strip.content = (
            f'<div style="padding:0 calc(0.75em + 52px) 0 calc({GUTTER}em + 0.75em);'
            f'margin-top:calc(-{HEIGHT}px - 0.5em)">'
            f"{markup(self._bands, low, high, self._curve, self._colour, self._moment)}"
            f"{strip([*anchors, *self._marks[:MOST_MARKS]], low, high, part)}</div>"
        )

    def show(self) -> None:
        """Write the instant into the slider and the play button."""
        player = self._player
        low, high = self._span
        if not low - 0.01 <= player.time <= high + 0.01:
            self._show_span(*player.whole)
        write(self._time, round(player.time, 2))
        write(self._backwards, player.backwards)
        zoom = "" if self._near == player.whole else "Zoom in" if self._span == player.whole else "Whole flight"
        offered = self._played is not None
        self._transport.content = _STYLE + _transport(self._actions, zoom, playing=player.playing, offered=offered)

    def _go_to(self, name: str) -> None:
        """To the event of which an entry of the list begins with the number."""
        number = name.partition(":")[0]
        if number.isdecimal() and 0 < int(number) <= len(self._marks):
            self._player.go(self._marks[int(number) - 1].t)


def _icon(path: str) -> str:
    """Drawn here, for not every font has the signs."""
    return (
        '<svg viewBox="0 0 10 10" width="11" height="11" fill="currentColor" style="vertical-align:-1px">'
        f'<path d="{path}"/></svg>'
    )


_PLAY, _PAUSE = _icon("M1 0 10 5 1 10Z"), _icon("M1 0H4V10H1ZM6 0H9V10H6Z")
_START, _END = _icon("M0 0H2V10H0ZM10 0V10L2 5Z"), _icon("M8 0H10V10H8ZM0 0V10L8 5Z")


class Action(NamedTuple):
    """A button of the transport, which presses its key."""

    icon: str
    name: str
    key: Key
    do: Call
    kind: str = ""  # class of the button: "fine" is left out on a phone
    shift: bool = False


def _actions(player: Player, play: Call, zoom: Call) -> tuple[Action, ...]:
    """The buttons, from left to right, and their keys."""
    seek, step = player.seek_share, player.step
    back, on = partial(player.jump, forward=False), partial(player.jump, forward=True)
    return (
        Action(f"{_PLAY} Play these {PLAYED_S:g} s", f"Play these {PLAYED_S:g} s", "P", play, "main"),
        Action(_START, "To the start", "home", partial(seek, 0.0)),
        Action("‹ event", "Previous event", "arrowup", partial(back, "event")),
        Action("‹ anchor", "Previous anchor", "pageup", partial(back, "anchor"), "fine"),
        Action("−10", "Back 10 s", "J", partial(step, -10.0)),
        Action("−1", "Back 1 s", "arrowleft", partial(step, -1.0), "fine"),
        Action("‹", "Back one IMU sample", "arrowleft", partial(back, "sample"), "fine", shift=True),
        Action(_PLAY, "Play or pause", "space", player.toggle),
        Action("›", "Forward one IMU sample", "arrowright", partial(on, "sample"), "fine", shift=True),
        Action("+1", "Forward 1 s", "arrowright", partial(step, 1.0), "fine"),
        Action("+10", "Forward 10 s", "L", partial(step, 10.0)),
        Action("anchor ›", "Next anchor", "pagedown", partial(on, "anchor"), "fine"),
        Action("event ›", "Next event", "arrowdown", partial(on, "event")),
        Action(_END, "To the end", "end", partial(seek, 1.0)),
        Action("", "Zoom the strip", "Z", zoom),
        Action("", "Part: from here", "I", partial(player.cut, "from")),
        Action("", "Part: to here", "O", partial(player.cut, "to")),
        Action("", "Part: the whole", "B", partial(player.cut, "whole")),
    )


_KEYS = {"arrowleft": "←", "arrowright": "→", "arrowup": "↑", "arrowdown": "↓", "pageup": "Page up",
         "pagedown": "Page down", "home": "Home", "end": "End", "space": "space"}  # fmt: skip


def _transport(actions: Sequence[Action], zoom: str, *, playing: bool, offered: bool) -> str:
    """The row of buttons. Each presses a key of the page: see page_head.js. zoom: what its button says, "" for none."""
    buttons = []
    for one in actions:
        icon, name = zoom if one.key == "Z" else one.icon, one.name
        if not icon or (one.kind == "main" and not offered):
            continue
        if one.key == "space":
            icon, name = (_PAUSE, "Pause") if playing else (_PLAY, "Play")
        buttons.append(_button(icon, name, one.key, shift=one.shift, kind=one.kind))
    buttons.append('<span class="gap"></span>')
    buttons += [
        _button(name, name, key, kind="far" if i == 0 else "") for i, (name, (key, _)) in enumerate(CAMERAS.items())
    ]
    buttons.append(
        '<button type="button" class="companion-link" onclick="companionCopyLink(this)" '
        'title="The address of this instant, with the IMU that is integrated">Copy link</button>'
    )
    return f'<div class="companion-transport"><i class="companion-play"></i>{"".join(buttons)}</div>'


def _button(icon: str, name: str, key: Key, *, shift: bool = False, kind: str = "") -> str:
    keys = ("Shift " if shift else "") + _KEYS.get(key, key)
    return (
        f'<button type="button" class="{kind}" aria-label="{name}" title="{name} ({keys})" '
        f"onclick=\"companionKey('{key}',{str(shift).lower()})\">{icon}</button>"
    )
