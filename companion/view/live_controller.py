"""What stands behind the live page: where the vehicle is now, what is held of the past, what the browsers hear of it.

Everything here runs in the view thread, which alone writes to viser and alone looks at the feed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import viser

from companion.model import Array, DataError
from companion.present import vehicle_words
from companion.view.charts.live_charts import LiveCharts
from companion.view.panels.controls import dock
from companion.view.panels.live_panel import LivePanel
from companion.view.scene.cameras import frame
from companion.view.scene.live_trail import LiveTrails
from companion.view.scene.vehicle_shapes import drone_for
from companion.view.state import events
from companion.view.state.cadence import Cadence
from companion.view.state.feed import Feed, Seen
from companion.view.state.history import History, Past, free_errors, present
from companion.view.state.sample import Footage, Sample
from companion.view.viewport import Viewport

LOOK_HZ = 12.5
TURN_HZ = 13.7  # at most: a turn begins when something has arrived, which what is gathered for does 12.5 times a second
_LATE_S = 0.03  # longer than that nothing is waited for: a turn without anything new costs as much as one with it
ALONE_HZ = 4.0  # looks while no browser is open
_SUNK_M = 0.5  # below the ground before the ground gives way


class LiveController:
    """Built when the server is up, then turned over and over by the view thread."""

    def __init__(self, server: viser.ViserServer, feed: Feed, window_s: float, post: events.Post) -> None:
        self._feed = feed
        self._history = History(window_s, LOOK_HZ)
        self.newest = 0.0  # s, boot clock, of the pose that was written last
        self._stirred = True  # whether somebody looks otherwise than before
        self._shown: tuple[str, int] | None = None  # vehicle and boot
        self._introduced: tuple[str, bool, tuple[str, ...]] | None = None  # who, whether there is a position, all IMUs
        self._film: Footage | None = None  # the present
        self._free: tuple[tuple[float, ...], float, Array | None] | None = None  # errors, age s, position
        self._held: tuple[Past, float] | None = None  # what is looked back at, and where, s before its end
        self._trail = events.SetTrail(30.0)
        self._is_due = Cadence(look=ALONE_HZ, panel=4.0, trails=8.0, charts=2.0)
        self._panel = LivePanel(server.gui, feed, window_s, post)
        side = server.gui.add_panel()
        with side.add_tab("Charts", viser.Icon.CHART_LINE):
            self._charts = LiveCharts(server.gui, window_s, post)
        dock(server.gui, side)
        nowhere = frame(np.zeros((2, 3)))
        self.viewport = Viewport(server, self._panel.picture, drone_for("QUADROTOR"), nowhere, post, mode="Follow")
        self.viewport.scene.ground.load(nowhere, None, None)
        self.viewport.scene.imu.visible = self.viewport.scene.autopilot.visible = False  # until somebody is there
        self._live_trails = LiveTrails(server.scene, window_s)

    @property
    def held(self) -> bool:
        """Whether the picture is held while the recording goes on."""
        return self._held is not None

    def close(self) -> None:
        """Nothing works beside the view thread."""

    def wait(self) -> None:
        """Wait for what is about to arrive: it is shown at once, and not up to a turn later."""
        if self.viewport.browsers:
            self._feed.wait(_LATE_S)

    def turn(self, now: float, dt: float) -> None:  # noqa: ARG002  (the vehicle's clock counts here)
        """Look, and draw what is seen: at `now`, s of any steady clock."""
        if self.viewport.browsers or self._is_due("look", now):
            seen = self._feed.look()
            if seen is not None:
                self._take(seen)
        sample = self._sample()
        if sample is not None and (self._held is not None or self._stirred or sample.t != self.newest):
            self._stirred = False
            self.viewport.show(sample)
            self._live_trails.reach(sample.t, self._free_now()[2])
            self.newest = sample.t
        if self._is_due("panel", now):
            self._report(sample)
        if self._is_due("trails", now):
            self._trails()
        if self.viewport.to_lay_out(now) <= 0:
            self._charts.relayout()
            self.viewport.laid_out()
        elif self._is_due("charts", now):
            self._chart()

    def handle(self, event: events.Event) -> None:
        """Do what a control of a page asks for."""
        self._stirred = True
        match event:
            case events.Pause(paused):
                self._hold((0.0 if self._held is None else None) if paused is None else 0.0 if paused else None)
            case events.LookBack(seconds):
                self._hold(seconds)
            case events.StepBack(seconds):
                self._hold((self._held[1] if self._held else 0.0) + seconds)
            case events.Choose(choice):
                self._feed.choose(choice)
                self._hold(None)
            case events.SetReanchor(seconds):
                self._feed.reanchor_s = seconds
            case events.AnchorNow():
                self._feed.anchor_now()
            case events.PickVehicle(vehicle):
                if vehicle in self._feed.vehicles:
                    self._feed.pick(vehicle)
                    self._hold(None)
            case events.PickRun(free):
                self._charts.pick(free=free)
                self._is_due.at_once("charts")
            case events.SetTrail():
                self._trail = event
                self._is_due.at_once("trails")
            case events.SetCamera():
                self._fit()
                self.viewport.handle(event)
            case _ if isinstance(event, events.Look):
                self.viewport.handle(event)

    def _take(self, seen: Seen) -> None:
        """Keep what is seen now. Another vehicle or boot begins with nothing behind it."""
        try:
            film = present(seen.replay)
        except DataError:
            return  # it has diverged beyond what a screen can show: the next anchor mends it
        shown = (str(seen.flight.vehicle), seen.flight.boot)
        if shown != self._shown:
            self._shown = shown
            self._begin(seen)
        self._introduce(seen, film)
        self._film = film
        if film.replay.has_position:
            low = float(film.replay.position_ref[-1, 2])
            if low > self.viewport.framing.ground + _SUNK_M:
                self.viewport.framing = replace(self.viewport.framing, ground=low)
                self.viewport.scene.ground.sink(low)
        self._live_trails.add(film, seen.free)
        free = seen.free
        self._free = None
        if free is not None:
            position = free.state.position if film.replay.has_position else None
            self._free = (free_errors(free), film.end - free.anchor_s, position)
        self._history.add(seen.replay, free)

    def _begin(self, seen: Seen) -> None:
        self._history.clear()
        self._held, self._free, self._introduced = None, None, None
        self.viewport.drone = drone_for(seen.flight.vehicle.type)

    def _lay_out(self, seen: Seen, film: Footage) -> None:
        """The world of this vehicle; anew when its first position comes after its first attitude."""
        self._live_trails.clear()
        ground = np.array([*film.replay.position_ref[-1, :2], max(0.0, float(film.replay.position_ref[-1, 2]))])
        self.viewport.place(frame(np.vstack([seen.replay.position_ref, ground])))
        self.viewport.scene.load(film, self.viewport.framing, self.viewport.drone, whole=False)
        self.viewport.scene.imu.visible = self.viewport.scene.autopilot.visible = True
        self.viewport.reframe()

    def _introduce(self, seen: Seen, film: Footage) -> None:
        vehicle = seen.flight.vehicle
        who = f"{vehicle_words(vehicle)}, vehicle {vehicle}, boot {seen.flight.boot}, {seen.imu}"
        now = (who, seen.replay.has_position, tuple(seen.flight.imus))
        if now == self._introduced:
            return
        if self._introduced is None or self._introduced[1] != seen.replay.has_position:
            self._lay_out(seen, film)
        self._introduced, self._stirred = now, True
        self._panel.introduce(who, tuple(seen.flight.imus), has_position=seen.replay.has_position)
        self._is_due.at_once()  # the numbers of another IMU do not stand below its name

    def _fit(self) -> None:
        """A camera that is chosen now sees all that has been flown: with the ground where it is."""
        flown = self._history.positions()
        if flown is not None:
            ground = self.viewport.framing.ground
            self.viewport.place(replace(frame(*flown), ground=ground))

    def _hold(self, at: float | None) -> None:
        """Hold the picture at so many s before its end, or follow again."""
        if at is None or not len(self._history):
            self._held = None
        else:
            past = self._held[0] if self._held else self._history.past()
            self._held = (past, min(max(at, past.film.start), 0.0))
        self._panel.hold(self._held[1] if self._held else None, -self._held[0].film.start if self._held else 0.0)
        self._is_due.at_once()

    def _sample(self) -> Sample | None:
        """What is shown: the present, or the instant that is looked back at. Its time is on the boot clock."""
        if self._held is None:
            return self._film.last if self._film else None
        past, at = self._held
        sample = past.film.at(at)
        return replace(sample, t=sample.t + past.end)

    def _free_now(self) -> tuple[tuple[float, ...] | None, float, Array | None]:
        """Errors, age and position of the free run at the instant shown."""
        if self._held is None:
            return self._free if self._free else (None, 0.0, None)
        past, at = self._held
        row = int(np.clip(np.searchsorted(past.film.replay.t, at + 1e-6) - 1, 0, len(past.free) - 1))
        values = tuple(past.free[row].tolist())
        if not np.isfinite(values).all():
            return None, 0.0, None
        return values, at + past.end - float(past.free_anchor[row]), past.free_position[row]

    def _report(self, sample: Sample | None) -> None:
        if sample is not None and self._film is not None:
            self._live_trails.resize(self.viewport.annotate(sample))
            free, age, _ = self._free_now()
            silent = self._held is None and bool(self._feed.link.problem)
            self._panel.show(sample, free, age, has_position=self._film.replay.has_position, silent=silent)
        held_s = None if self._held is None or self._film is None or sample is None else self._film.end - sample.t
        self._panel.report(self._feed, held_s)

    def _trails(self) -> None:
        sample = self._sample()
        if sample is None:
            return
        since = -np.inf if self._trail.seconds is None else sample.t - self._trail.seconds
        self._live_trails.show(since, sample.t)

    def _chart(self) -> None:
        if self._held is not None:
            past, at = self._held
            self._charts.show(past.curves, at, self._feed.judgement)
        elif len(self._history) > 1 and self.viewport.browsers:
            self._charts.show(self._history.curves(), 0.0, self._feed.judgement)
