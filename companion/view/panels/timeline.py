"""The timeline under the picture: play, scrub, step and jump, the marks of the flight, and the keys for all of it."""

from __future__ import annotations

from collections.abc import Sequence

import viser

from companion.view.panels.bands import HEIGHT, Bands, markup
from companion.view.panels.controls import (
    NARROW,
    NARROW_WINDOW,
    SIDE,
    Key,
    button_row,
    camera_row,
    command,
    listen,
    write,
)
from companion.view.state import events
from companion.view.state.marks import Mark, short, strip
from companion.view.state.player import Player

WIDTH = 600  # pixels: what the panels leave of a window 1280 wide, where the browser does not know `:has`
_STYLE = (
    # As wide as the panels leave it.
    f'<style>div[style*="width: {WIDTH}px"]:has(.companion-time){{width:calc(100vw - {2 * SIDE + 30}px)!important}}'
    f'{NARROW_WINDOW}{{div[style*="width: {WIDTH}px"]:has(.companion-time)'
    f"{{width:calc(100vw - {2 * NARROW + 30}px)!important;margin-left:{NARROW - SIDE}px}}}}"  # viser counts from SIDE
    # The slider is as high as the bands that lie under it: a click anywhere on them goes there.
    f"div:has(>.companion-time)+div .mantine-Slider-root{{height:{HEIGHT}px;padding:0!important}}"
    f"div:has(>.companion-time)+div .mantine-Slider-trackContainer{{height:{HEIGHT}px}}"
    f"div:has(>.companion-time)+div .mantine-Slider-track{{height:{HEIGHT}px}}"
    "div:has(>.companion-time)+div .mantine-Slider-track::before{background:none}"
    "div:has(>.companion-time)+div .mantine-Slider-bar{background:none}"
    "div:has(>.companion-time)+div :is(.mantine-Slider-mark,.mantine-Slider-markLabel){display:none}"
    "div:has(>.companion-time)+div .mantine-Slider-thumb{height:38px!important;width:4px!important}"
    # Play is there for the hand that looks for it, not the largest thing on the page.
    "div:has(>.companion-play)+div{max-width:9em}"
    "div:has(>.companion-play)+div button{height:26px}"
    "div:has(>.companion-play){position:relative}"
    ".companion-link{position:absolute;right:10px;top:2px;font:12px sans-serif;color:inherit;background:none;"
    "border:1px solid rgba(130,130,130,.6);border-radius:3px;padding:2px 8px;cursor:pointer}"
    "</style>"
)
SPEEDS = ("0.1×", "0.2×", "0.5×", "1×", "2×", "5×", "10×", "20×", "50×")
_LINK = (  # see page_head.js
    '<button type="button" class="companion-link" onclick="companionCopyLink(this)" '
    'title="The address of this instant, with the IMU that is integrated">copy link</button>'
)
STEPS: dict[str, events.Event] = {
    "Start": events.SeekShare(0.0),
    "−10": events.Step(-10.0),
    "−1": events.Step(-1.0),
    "‹ sample": events.StepSample(-1),
    "sample ›": events.StepSample(1),
    "+1": events.Step(1.0),
    "+10": events.Step(10.0),
    "End": events.SeekShare(1.0),
}
JUMPS: dict[str, events.Event] = {
    "‹ anchor": events.Jump("anchor", forward=False),
    "anchor ›": events.Jump("anchor", forward=True),
    "‹ event": events.Jump("mark", forward=False),
    "event ›": events.Jump("mark", forward=True),
}
PARTS: dict[str, events.Event] = {
    "from here": events.SetPart("from"),
    "to here": events.SetPart("to"),
    "whole": events.SetPart("whole"),
}
KEYS: list[tuple[str, Key, bool, events.Event]] = [  # name, key, with shift, what it does
    ("Play or pause", "space", False, events.Toggle()),
    ("Back 1 s", "arrowleft", False, events.Step(-1.0)),
    ("Forward 1 s", "arrowright", False, events.Step(1.0)),
    ("Back one IMU sample", "arrowleft", True, events.StepSample(-1)),
    ("Forward one IMU sample", "arrowright", True, events.StepSample(1)),
    ("Previous event", "arrowup", False, events.Jump("mark", forward=False)),
    ("Next event", "arrowdown", False, events.Jump("mark", forward=True)),
    ("Previous anchor", "pageup", False, events.Jump("anchor", forward=False)),
    ("Next anchor", "pagedown", False, events.Jump("anchor", forward=True)),
    ("To the start", "home", False, events.SeekShare(0.0)),
    ("To the end", "end", False, events.SeekShare(1.0)),
    ("Part: from here", "I", False, events.SetPart("from")),
    ("Part: to here", "O", False, events.SetPart("to")),
    ("Part: the whole", "B", False, events.SetPart("whole")),
]
TENTHS: tuple[Key, ...] = ("1", "2", "3", "4", "5", "6", "7", "8", "9")
NO_MARK = "choose an event"
MOST_ANCHORS = 100  # ticks; more than that is a grey bar
MOST_MARKS = 300  # in the list of events; a talkative vehicle says thousands of things


class Timeline:
    """The controls of time. Built once; `load` fits them to a flight, `show` writes the instant into them."""

    def __init__(
        self, gui: viser.GuiApi, panel: viser.PanelHandle, folder: viser.GuiFolderHandle, post: events.Post
    ) -> None:
        """`panel` becomes the timeline; `folder` takes what is set once and seldom changed."""
        with panel.add_tab("Timeline", viser.Icon.TIMELINE):
            gui.add_html(f'{_STYLE}{_LINK}<i class="companion-play"></i>')
            self._play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY, hint="Space")
            gui.add_html('<i class="companion-time"></i>')
            self._time = gui.add_slider("Time, s", 0.0, 1.0, 0.01, 0.0, hint="Seconds since the vehicle's boot")
            self._strip = gui.add_html("")
            camera_row(gui, post)
            button_row(gui, "Step, s", STEPS, post, "Arrow keys: 1 s, with Shift one sample; Home, End: the ends")
            button_row(gui, "Jump", JUMPS, post, "Up and down: events; Page up and down: anchors; 1 to 9: tenths")
        panel.float(x=10, y=-10, width=WIDTH)
        with folder:
            self._speed = gui.add_dropdown("Speed", SPEEDS, initial_value="1×")
            self._backwards = gui.add_checkbox("Backwards", False)
            self._loop = gui.add_checkbox("Repeat", False, hint="Start again where the part ends")
            button_row(gui, "Part", PARTS, post, "Play and plot only a part of the flight. Keys: I, O, B")
            self._event = gui.add_dropdown("Go to", (NO_MARK,))
        self._marks: list[Mark] = []
        self._anchors: Sequence[float] = ()
        self._bands = Bands()
        listen(self._time, post, lambda: events.Seek(float(self._time.value)))
        listen(self._speed, post, lambda: events.SetSpeed(float(self._speed.value.rstrip("×"))))
        listen(self._loop, post, lambda: events.SetLoop(self._loop.value))
        listen(self._backwards, post, lambda: events.SetBackwards(self._backwards.value))
        listen(self._event, post, lambda: events.JumpToMark(_number(self._event.value) - 1))

        @self._play.on_click
        async def _(_: object) -> None:
            post(events.Toggle())

        for name, key, shift, event in KEYS:
            command(gui, post, name, key, shift, event)
        for i, key in enumerate(TENTHS, start=1):
            command(gui, post, f"To {i} tenths", key, False, events.SeekShare(i / 10))

    def load(self, player: Player, marks: Sequence[Mark], anchors: Sequence[float], bands: Bands) -> None:
        """Fit the controls to what is shown now. Values set here come back as no events."""
        self._marks, self._anchors, self._bands = list(marks), anchors, bands
        names = (f"{i}: {mark.t:.1f} s, {short(mark.label)}" for i, mark in enumerate(self._marks[:MOST_MARKS], 1))
        self._event.options = (NO_MARK, *names)
        low, high = round(player.first, 2), round(player.last, 2)
        # The bounds move one at a time and must never cross, and the value must always lie between them.
        self._time.max = max(high, self._time.max)
        self._time.min = min(low, self._time.min)
        write(self._time, round(player.time, 2))
        self._time.min, self._time.max = low, high
        self.choose_part(player)

    def choose_part(self, player: Player) -> None:
        """Draw the strip of marks with the part that is played."""
        low, high = player.first, player.last
        shown = self._anchors if len(self._anchors) <= MOST_ANCHORS else ()
        anchors = [Mark(t, "the IMU restarts from the autopilot's state here", "anchor") for t in shown]
        part = (player.start, player.end) if player.is_part else None
        # The bands lie under the slider's track, the marks below: beside it are the label and the number.
        self._strip.content = (
            f'<div style="padding:0 calc(0.75em + 52px) 0 calc(7.25em + 0.75em);margin-top:calc(-{HEIGHT}px - 0.5em)">'
            f"{markup(self._bands, low, high)}"
            f"{strip([*anchors, *self._marks[:MOST_MARKS]], low, high, part)}</div>"
        )

    def show(self, player: Player) -> None:
        """Write the instant into the slider and the play button."""
        write(self._time, round(player.time, 2))
        label = "Pause" if player.playing else "Play"
        if self._play.label != label:
            self._play.label = label
            self._play.icon = viser.Icon.PLAYER_PAUSE if player.playing else viser.Icon.PLAYER_PLAY


def _number(name: str) -> int:
    """What an entry of the list of events begins with; 0 for none."""
    number = name.partition(":")[0]
    return int(number) if number.isdecimal() else 0
