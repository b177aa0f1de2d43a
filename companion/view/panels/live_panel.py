"""What can be chosen and read beside the live picture. Nothing in here reaches the vehicle: anybody may press it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import viser

from companion.view.panels import live_text
from companion.view.panels.adjustments import PictureControls
from companion.view.panels.controls import Key, bounded, camera_row, command, key_of, listen, write
from companion.view.panels.reckoning_controls import INTEGRATORS, JOINED, MIDDLES
from companion.view.state import events
from companion.view.state.choice import ReplayChoice
from companion.view.state.feed import Feed
from companion.view.state.sample import Sample

BEST = "Automatic"
LONGEST_REANCHOR_S = 20.0
"""That the page offers; whoever keeps the messages keeps two such periods."""


class LivePanel:
    """The controls. Built once; only the view thread may call it."""

    def __init__(self, gui: viser.GuiApi, feed: Feed, window_s: float, post: events.Post) -> None:
        self._vehicles: tuple[str, ...] = ()
        self._imus: tuple[str, ...] = (BEST,)
        self._choice = feed.choice
        longest = max(LONGEST_REANCHOR_S, float(feed.reanchor_s))
        self._verdict = gui.add_html("")
        self._link = gui.add_html("")
        self._pause = gui.add_button("Pause", icon=viser.Icon.PLAYER_PAUSE)
        self._back = gui.add_slider(
            "Look back, s", -window_s, 0.0, 0.1, 0.0, hint="The picture is held while the recording goes on"
        )
        camera_row(gui, post)
        self._legend = gui.add_html("")
        self._numbers = gui.add_html("")
        with gui.add_folder("Dead reckoning"):
            self._vehicle = gui.add_dropdown("Vehicle", ("none",), visible=False)
            self._imu = gui.add_dropdown("IMU", (BEST,))
            self._method = gui.add_dropdown(
                "Integrator", tuple(INTEGRATORS), initial_value=key_of(INTEGRATORS, self._choice.how.method)
            )
            self._middle = gui.add_dropdown(
                "Interpolation", tuple(MIDDLES), initial_value=key_of(MIDDLES, self._choice.how.middle), hint=JOINED
            )
            self._period = gui.add_number(
                "Re-anchor, s",
                float(feed.reanchor_s),
                min=0.5,
                max=longest,
                step=0.5,
                hint="Restart from the autopilot's state at this interval",
            )
            self._anchor = gui.add_button("Anchor now", icon=viser.Icon.ANCHOR, hint="Also begins the free run again")
        with gui.add_folder("Verdict and drift so far"):
            self._drift = gui.add_html("")
        with gui.add_folder("Link"):
            self._health = gui.add_html("")
        with gui.add_folder("Said", expand_by_default=False):
            self._said = gui.add_html("")
        trails = {
            "Last 30 s": events.SetTrail(30.0),
            "Last 2 minutes": events.SetTrail(120.0),
            "Everything kept": events.SetTrail(None),
        }
        self._picture = PictureControls(gui, trails, post, expects=False)
        self._listen(gui, post, window_s, longest)

    @property
    def picture(self) -> viser.GuiFolderHandle:
        """The folder in which each browser finds its own camera."""
        return self._picture.folder

    def introduce(self, vehicle: str, imus: tuple[str, ...], *, has_position: bool) -> None:
        """Say who is shown, and which IMUs it has."""
        if self._imus != (BEST, *imus):
            self._imus = (BEST, *imus)
            self._imu.options = self._imus
            write(self._imu, self._choice.imu if self._choice.imu in imus else BEST)
        self._legend.content = live_text.legend(vehicle, has_position=has_position)

    def show(
        self, sample: Sample, free: Sequence[float] | None, free_age_s: float, *, has_position: bool, silent: bool
    ) -> None:
        """Write the instant into the numbers. silent: it is the last that was heard of, and not now."""
        self._numbers.content = live_text.numbers(sample, free, free_age_s, has_position=has_position, silent=silent)

    def report(self, feed: Feed, held_s: float | None) -> None:
        """Write how everything stands. held_s: how long ago the held picture was; None: live."""
        state = feed.link
        for handle, content in (
            (self._verdict, live_text.verdict(feed.judgement, state, feed.why_not)),
            (self._link, live_text.link(state, feed.why_not, held_s)),
            (self._health, live_text.health(state)),
            (self._drift, live_text.drift(feed.drift, feed.judgement)),
            (self._said, live_text.sentences(feed.said)),
        ):
            if handle.content != content:
                handle.content = content
        self._offer(tuple(feed.vehicles))

    def hold(self, at_s: float | None, duration_s: float) -> None:
        """The picture is held at so many s before its end (0 or less); None: it is live. duration_s: how far back."""
        paused = at_s is not None
        self._pause.label = "Live" if paused else "Pause"
        self._pause.icon = viser.Icon.PLAYER_PLAY if paused else viser.Icon.PLAYER_PAUSE
        low = -max(round(duration_s, 1), 0.1)
        if paused and self._back.min != low:
            self._back.min = low
        write(self._back, max(at_s or 0.0, low))

    def _read(self) -> ReplayChoice:
        """What the controls say. A browser may send anything: names are looked up."""
        before = self._choice
        how = replace(
            before.how,
            method=INTEGRATORS.get(self._method.value, before.how.method),
            middle=MIDDLES.get(self._middle.value, before.how.middle),
        )
        imu = self._imu.value if self._imu.value in self._imus[1:] else None
        self._choice = replace(before, imu=imu, how=how)
        return self._choice

    def _offer(self, vehicles: tuple[str, ...]) -> None:
        if vehicles != self._vehicles and vehicles:
            self._vehicles = vehicles
            self._vehicle.options = vehicles
            self._vehicle.visible = len(vehicles) > 1

    def _listen(self, gui: viser.GuiApi, post: events.Post, window_s: float, longest: float) -> None:
        listen(self._back, post, lambda: events.LookBack(bounded(self._back.value, -window_s, 0.0, 0.0)))
        for handle in (self._imu, self._method, self._middle):
            listen(handle, post, lambda: events.Choose(self._read()))
        listen(self._period, post, lambda: events.SetReanchor(bounded(self._period.value, 0.5, 10.0, longest)))
        listen(self._vehicle, post, lambda: events.PickVehicle(self._vehicle.value))

        @self._pause.on_click
        async def _(_: object) -> None:
            post(events.Pause())

        @self._anchor.on_click
        async def _(_: object) -> None:
            post(events.AnchorNow())

        keys: tuple[tuple[str, Key, events.Event], ...] = (
            ("Pause, or live again", "space", events.Pause()),
            ("Live", "end", events.Pause(paused=False)),
            ("1 s back", "arrowleft", events.StepBack(-1.0)),
            ("1 s on", "arrowright", events.StepBack(1.0)),
            ("Anchor now", "A", events.AnchorNow()),
        )
        for name, key, event in keys:
            command(gui, post, name, key, False, event)
