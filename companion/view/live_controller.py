"""What stands behind the live page: where the vehicle is now, what is kept of the past, what the browsers show of it.

Everything here runs in the view thread, which alone writes to viser and alone looks at the feed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar

import numpy as np
import viser

from companion.model import DataError
from companion.present import vehicle_words
from companion.view.controller import Controller
from companion.view.panels.chart_pages import LiveCharts
from companion.view.panels.controls import Controls, Post, bounded, dock
from companion.view.panels.live_panel import LivePanel, numbers
from companion.view.panels.replay_panel import flight_data
from companion.view.panels.strip import Bands, bands
from companion.view.scene.cameras import frame
from companion.view.scene.trail import LiveTrails
from companion.view.scene.vehicle_shapes import drone_for
from companion.view.state.live import Feed, FreeRun, History, Past, Seen, free_run, present
from companion.view.state.trajectory import CameraMode, DisplayTrajectory, ReplayChoice, Sample, TrailSpan

LOOK_HZ = 12.5
TURN_HZ = 13.7  # at most: a turn begins when something has arrived, which what is gathered for does 12.5 times a second
_LATE_S = 0.03  # longer than that nothing is waited for: a turn without anything new costs as much as one with it
ALONE_HZ = 4.0  # looks while no browser is open
TRAILS = {"Last 30 s": TrailSpan(30.0), "Last 2 minutes": TrailSpan(120.0), "Everything kept": TrailSpan(None)}
_SUNK_M = 0.5  # below the ground before the ground gives way


class LiveController(Controller):
    """Built when the server is up, then turned over and over by the view thread."""

    charts: LiveCharts
    trails = TRAILS
    rates: ClassVar = {"look": ALONE_HZ, "panel": 4.0, "charts": 2.0}
    mode = "Follow"

    def __init__(self, server: viser.ViserServer, feed: Feed, window_s: float, post: Post) -> None:
        self._feed = feed
        self._history = History(window_s, LOOK_HZ)
        self._newest = 0.0  # s, boot clock, of the pose that was written last
        self._present: tuple[Seen, DisplayTrajectory] | None = None  # what was seen last, and that ready for the eye
        self._introduced: tuple[object, ...] = ()  # vehicle, boot, whether there is a position, its words, all IMUs
        self._held: tuple[Past, float] | None = None  # what is looked back at, and where, s before its end
        controls = Controls(server.gui, post)
        panel = self._panel = LivePanel(controls, feed, window_s, self.change, self.choose_camera)
        controls.on_change(panel.back, lambda s: self.hold(bounded(s, -window_s, 0.0, 0.0)))
        controls.on_change(panel.vehicle, self._pick_vehicle)
        controls.on_click(panel.pause, self._hold_or_follow)
        controls.command("Pause, or live again", "space", self._hold_or_follow)
        controls.command("Live", "end", lambda: self.hold(None))
        controls.command("1 s back", "arrowleft", lambda: self._step(-1.0))
        controls.command("1 s on", "arrowright", lambda: self._step(1.0))
        nowhere = frame(np.zeros((2, 3)))
        super().__init__(server, controls, drone_for("QUADROTOR"), nowhere)
        side = server.gui.add_panel()
        with side.add_tab("Charts", viser.Icon.CHART_LINE):
            self.charts = LiveCharts(controls, window_s, lambda: self.is_due.at_once("charts"))
        dock(server.gui, side)
        self.scene.ground.load(nowhere, None, None)
        for drone in (self.scene.imu, self.scene.autopilot):
            drone.place.visible = False  # until somebody is there
        self._live_trails = LiveTrails(server.scene, window_s)

    def wait(self) -> None:
        """Wait for what is about to arrive: it is shown at once, and not up to a turn later."""
        if self.browsers:
            self._feed.wait(_LATE_S)

    def turn(self, now: float, dt: float) -> None:  # noqa: ARG002  (the vehicle's clock counts here)
        """Look, and draw what is seen: at `now`, s of any steady clock."""
        if self.browsers or self.is_due("look", now):
            seen = self._feed.look()
            if seen is not None:
                self._take(seen)
        sample, free = self._instant()
        if sample is not None and (self._held is not None or self.stale or sample.t != self._newest):
            self.stale = False
            self.draw(sample)
            self._live_trails.reach(sample.t, free)
            self._newest = sample.t
        if self.is_due("panel", now):
            self._report(sample, free)
        if sample is not None:
            self.draw_trails(now, sample, self._live_trails.show)
        self.draw_charts(now, self._chart)

    def hold(self, at: float | None) -> None:
        """Hold the picture at so many s before its end, or follow again."""
        self.stale = True
        if at is None or not len(self._history):
            self._held = None
        else:
            past = self._held[0] if self._held else self._history.past()
            self._held = (past, min(max(at, past.display.start), 0.0))
        self._panel.hold(self._held[1] if self._held else None, -self._held[0].display.start if self._held else 0.0)
        self.is_due.at_once()

    def _hold_or_follow(self) -> None:
        """Whichever it does not do now."""
        self.hold(0.0 if self._held is None else None)

    def _step(self, seconds: float) -> None:
        """Hold the picture and move by so many seconds."""
        self.hold((self._held[1] if self._held else 0.0) + seconds)

    def change(self, part: Callable[[ReplayChoice], ReplayChoice]) -> None:
        """Dead-reckon otherwise in one respect."""
        self._feed.choose(part(self._feed.choice))
        self.hold(None)

    def _pick_vehicle(self, vehicle: str) -> None:
        """Look at another vehicle of the link."""
        if vehicle in self._feed.status.vehicles:
            self._feed.pick(vehicle)
            self.hold(None)

    def choose_camera(self, mode: CameraMode, browser: int) -> None:
        """Move one browser's camera, so that it sees all that has been flown: with the ground where it is."""
        flown = self._history.positions()
        if flown is not None:
            self.browsers.place(replace(frame(*flown), ground=self.browsers.framing.ground))
        super().choose_camera(mode, browser)

    def _take(self, seen: Seen) -> None:
        """Keep what is seen now."""
        try:
            display = present(seen.replay)
        except DataError:
            return  # it has diverged beyond what a screen can show: the next anchor mends it
        self._introduce(seen, display)
        self._present = seen, display
        if display.replay.has_position:
            low = float(display.replay.position_ref[-1, 2])
            if low > self.browsers.framing.ground + _SUNK_M:
                self.browsers.framing = replace(self.browsers.framing, ground=low)
                self.scene.ground.sink(low)
        self._live_trails.add(display, seen.free)
        self._history.add(seen.replay, seen.free)

    def _lay_out(self, seen: Seen, display: DisplayTrajectory) -> None:
        """The world of this vehicle; anew when its first position comes after its first attitude."""
        self._live_trails.clear()
        ground = np.array([*display.replay.position_ref[-1, :2], max(0.0, float(display.replay.position_ref[-1, 2]))])
        self.browsers.place(frame(np.vstack([seen.replay.position_ref, ground])))
        self.scene.load(display, self.browsers.framing, self.drone, whole=False)
        for drone in (self.scene.imu, self.scene.autopilot):
            drone.place.visible = True
        self.browsers.reframe()

    def _introduce(self, seen: Seen, display: DisplayTrajectory) -> None:
        """Show who is seen, where that has changed. Another vehicle or boot begins with nothing behind it."""
        flight, has_position, imus = seen.flight, seen.replay.has_position, tuple(seen.flight.imus)
        who = f"{vehicle_words(flight.vehicle)}, vehicle {flight.vehicle}, boot {flight.boot}, {seen.imu}"
        before, now = self._introduced, (str(flight.vehicle), flight.boot, has_position, who, imus)
        if now == before:
            return
        if now[:2] != before[:2]:
            self.hold(None)
            self._history.clear()
            self.drone = drone_for(flight.vehicle.type)
        if now[:3] != before[:3]:
            self._lay_out(seen, display)
        self._introduced, self.stale = now, True
        self._panel.introduce(who, now[0], imus, self._feed.choice.imu, has_position=has_position)
        self.is_due.at_once()  # the numbers of another IMU do not stand below its name

    def _instant(self) -> tuple[Sample | None, FreeRun | None]:
        """What is shown, and the free run then: now, or where it is looked back at. Times are on the boot clock."""
        if self._held is not None:
            past, at = self._held
            sample = past.display.at(at)
            return replace(sample, t=sample.t + past.end), past.free_at(at)
        if self._present is None:
            return None, None
        seen, display = self._present
        return display.at(display.end), free_run(seen.free, display.end) if seen.free else None

    def _report(self, sample: Sample | None, free: FreeRun | None) -> None:
        status, held_s = self._feed.status, None
        if sample is not None and self._present is not None:
            seen, display = self._present
            self._live_trails.resize(self.annotate(sample))
            silent = self._held is None and bool(status.link.problem)
            has_position = display.replay.has_position
            self._panel.numbers.content = numbers(sample, free, has_position=has_position, silent=silent)
            # Of what was before the last seconds neither mode nor arming is kept.
            below = bands(seen.flight, display) if sample.t >= seen.flight.start else Bands()
            self._panel.flight.content = flight_data(
                sample, seen.flight, below, has_position=has_position, of_log=False
            )
            held_s = None if self._held is None else display.end - sample.t
        self._panel.report(status, held_s)

    def _chart(self) -> None:
        if self._held is not None:
            past, at = self._held
            self.charts.show(past.curves, at, self._feed.status.verdict)
        elif len(self._history) > 1 and self.browsers:
            self.charts.show(self._history.curves(), 0.0, self._feed.status.verdict)
