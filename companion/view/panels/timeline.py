"""The timeline under the picture: play, scrub, step and jump, the marks of the flight, and the keys for all of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import viser

from companion.view.panels.bands import HEIGHT, Bands, markup, strip
from companion.view.panels.controls import NARROW, NARROW_WINDOW, SIDE, Call, Controls, Key, write
from companion.view.state.choice import CameraMode
from companion.view.state.marks import Mark, short
from companion.view.state.player import Player
from companion.view.state.sending import update

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
TENTHS: tuple[Key, ...] = ("1", "2", "3", "4", "5", "6", "7", "8", "9")
NO_MARK = "choose an event"
MOST_ANCHORS = 100  # ticks; more than that is a grey bar
MOST_MARKS = 300  # in the list of events; a talkative vehicle sends thousands of texts


class Timeline:
    """The controls of time. Built once; `load` fits them to a flight, `show` writes the instant into them."""

    def __init__(
        self,
        controls: Controls,
        panel: viser.PanelHandle,
        folder: viser.GuiFolderHandle,
        player: Player,
        choose_camera: Callable[[int, CameraMode], object],
    ) -> None:
        """`panel` becomes the timeline; `folder` takes what is set once and seldom changed."""
        gui, on = controls.gui, controls.on_change
        self._player = player
        rows = _rows(player)
        with panel.add_tab("Timeline", viser.Icon.TIMELINE):
            gui.add_html(f'{_STYLE}{_LINK}<i class="companion-play"></i>')
            self._play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY, hint="Space")
            gui.add_html('<i class="companion-time"></i>')
            self._time = gui.add_slider("Time, s", 0.0, 1.0, 0.01, 0.0, hint="Seconds since the vehicle's boot")
            self._strip = gui.add_html("")
            controls.cameras(choose_camera)
            for label in ("Step, s", "Jump"):
                controls.row(label, {button: do for button, *_, do in rows[label]}, _HINTS[label])
        panel.float(x=10, y=-10, width=WIDTH)
        with folder:
            speed = gui.add_dropdown("Speed", SPEEDS, initial_value="1×")
            backwards = gui.add_checkbox("Backwards", False)
            loop = gui.add_checkbox("Repeat", False, hint="Start again where the part ends")
            controls.row("Part", {button: do for button, *_, do in rows["Part"]}, _HINTS["Part"])
            self._event = gui.add_dropdown("Go to", (NO_MARK,))
        self._marks: list[Mark] = []
        self._anchors: Sequence[float] = ()
        self._bands = Bands()
        on(self._time, lambda t: player.seek(float(t)))
        on(speed, lambda name: setattr(player, "speed", float(name.rstrip("×"))))
        on(loop, partial(setattr, player, "loop"))
        on(backwards, partial(setattr, player, "backwards"))
        on(self._event, self._go_to)
        controls.on_click(self._play, player.toggle)
        controls.command("Play or pause", "space", player.toggle)
        for _, name, key, shift, do in (action for row in rows.values() for action in row):
            if key is not None:
                controls.command(name, key, do, shift=shift)
        for i, key in enumerate(TENTHS, start=1):
            controls.command(f"To {i} tenths", key, partial(player.seek_share, i / 10))

    def load(self, marks: Sequence[Mark], anchors: Sequence[float], bands: Bands) -> None:
        """Fit the controls to what is shown now. Values set here come back as no change."""
        player, self._marks, self._anchors, self._bands = self._player, list(marks), anchors, bands
        names = (f"{i}: {mark.t:.1f} s, {short(mark.label)}" for i, mark in enumerate(self._marks[:MOST_MARKS], 1))
        self._event.options = (NO_MARK, *names)
        low, high = round(player.first, 2), round(player.last, 2)
        # The bounds move one at a time and must never cross, and the value must always lie between them.
        self._time.max = max(high, self._time.max)
        self._time.min = min(low, self._time.min)
        write(self._time, round(player.time, 2))
        self._time.min, self._time.max = low, high
        self.choose_part()

    def choose_part(self) -> None:
        """Draw the strip of marks with the part that is played."""
        player = self._player
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

    def show(self) -> None:
        """Write the instant into the slider and the play button."""
        player = self._player
        write(self._time, round(player.time, 2))
        label, icon = ("Pause", viser.Icon.PLAYER_PAUSE) if player.playing else ("Play", viser.Icon.PLAYER_PLAY)
        update(self._play, label=label, icon=icon)

    def _go_to(self, name: str) -> None:
        """To the event of which an entry of the list begins with the number."""
        number = name.partition(":")[0]
        if number.isdecimal() and 0 < int(number) <= len(self._marks):
            self._player.go(self._marks[int(number) - 1].t)


Action = tuple[str, str, Key | None, bool, Call]
"""Button, command, its key, with shift, what it does."""
_HINTS = {
    "Step, s": "Arrow keys: 1 s, with Shift one sample; Home, End: the ends",
    "Jump": "Up and down: events; Page up and down: anchors; 1 to 9: tenths",
    "Part": "Play and plot only a part of the flight. Keys: I, O, B",
}


def _rows(player: Player) -> dict[str, tuple[Action, ...]]:
    """The rows of buttons, and their keys."""
    seek, step, cut = player.seek_share, player.step, player.cut
    back, on = partial(player.jump, forward=False), partial(player.jump, forward=True)
    return {
        "Step, s": (
            ("Start", "To the start", "home", False, partial(seek, 0.0)),
            ("−10", "Back 10 s", None, False, partial(step, -10.0)),
            ("−1", "Back 1 s", "arrowleft", False, partial(step, -1.0)),
            ("‹ sample", "Back one IMU sample", "arrowleft", True, partial(back, "sample")),
            ("sample ›", "Forward one IMU sample", "arrowright", True, partial(on, "sample")),
            ("+1", "Forward 1 s", "arrowright", False, partial(step, 1.0)),
            ("+10", "Forward 10 s", None, False, partial(step, 10.0)),
            ("End", "To the end", "end", False, partial(seek, 1.0)),
        ),
        "Jump": (
            ("‹ anchor", "Previous anchor", "pageup", False, partial(back, "anchor")),
            ("anchor ›", "Next anchor", "pagedown", False, partial(on, "anchor")),
            ("‹ event", "Previous event", "arrowup", False, partial(back, "event")),
            ("event ›", "Next event", "arrowdown", False, partial(on, "event")),
        ),
        "Part": (
            ("from here", "Part: from here", "I", False, partial(cut, "from")),
            ("to here", "Part: to here", "O", False, partial(cut, "to")),
            ("whole", "Part: the whole", "B", False, partial(cut, "whole")),
        ),
    }
