"""What stands behind the page: the flight shown, the clock, and the order in which the browser hears of a change.

Everything here runs in the view thread, which alone writes to viser.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import assert_never

import numpy as np
import viser

from companion.errors import CompanionError
from companion.tracks import Array, Flight
from companion.view import events, palette
from companion.view.choice import Outcome, Recompute, Recomputer, ReplayChoice
from companion.view.framing import FIELD_OF_VIEW, CameraMode, Framing, camera, frame, readable_span, screen_up, world
from companion.view.moment import Footage
from companion.view.panel import Panel
from companion.view.player import Player
from companion.view.plots import Plots
from companion.view.scene import Scene
from companion.view.shapes import drone_for

LABEL_HZ, TRAIL_HZ, PLOT_HZ = 8.0, 8.0, 5.0
APART = 0.4
"""s between a chart's new size and its new data: a slow page must not take them for one change (Plots.relayout)."""
SIDE = 330  # width of either panel, pixels


class Stage:
    """One session: built when the server is up, then turned over and over by the view thread."""

    def __init__(
        self,
        server: viser.ViserServer,
        flights: Sequence[Flight],
        recompute: Recompute,
        first: Outcome,
        film: Footage,
        post: events.Post,
    ) -> None:
        self._server, self._flights = server, flights
        self._flight, self._choice, self._film = first.flight, first.choice, film
        self._recomputer = Recomputer(recompute)
        self.player = Player(film.start, film.end)
        self.pose_updates = 0
        self._mode: CameraMode = "Free"
        self._trail = events.SetTrail(None)
        self._size: float | None = 1.0
        self._relayouts: list[float] = []
        self._due = dict.fromkeys(("labels", "trails", "plots"), 0.0)
        self._drone = drone_for(first.flight.vehicle.type)
        self._theme(dark=False)
        self.scene = Scene(server.scene, self._drone)
        self._panel = Panel(server.gui, flights, post)
        side = server.gui.add_panel()
        with side.add_tab("Errors against time", viser.Icon.CHART_LINE):
            self._plots = Plots(server.gui, film, first.flight.start)
        server.gui.main_panel.dock_right()
        server.gui.main_panel.set_width(SIDE)
        side.dock_left()
        side.set_width(SIDE)
        self._framing = self._load()

    def close(self) -> None:
        """End the worker."""
        self._recomputer.close()

    def turn(self, now: float, dt: float) -> None:
        """What has been reckoned, the clock, the picture: at `now`, s of any steady clock, `dt` after the last turn."""
        outcome = self._recomputer.poll()
        if outcome is not None:
            self._take(outcome)
        self.player.advance(dt)
        self._draw(now)

    def handle(self, event: events.Event) -> None:
        """Do what a control of a page asks for."""
        match event:
            case events.Toggle() | events.Seek() | events.SeekShare() | events.Step():
                self._seek(event)
            case events.SetSpeed(speed):
                self.player.speed = speed
            case events.SetLoop(loop):
                self.player.loop = loop
            case events.Choose(choice):
                self._request(self._flight, choice)
            case events.StartHere():
                self._request(self._flight, replace(self._choice, start_s=self.player.time))
            case events.PickFlight(index):
                if 0 <= index < len(self._flights):
                    other = self._flights[index]
                    self._request(other, replace(self._choice, imu=other.default_imu, start_s=None))
            case events.SetCamera() | events.SetTrail() | events.SetSize() | events.SetDark():
                self._look(event)
            case events.Joined():
                now = time.monotonic()
                self._relayouts = [now + 1.0, now + 2.5, now + 5.0]  # a page is laid out after 1 to 3 s
            case _:
                assert_never(event)

    def _seek(self, event: events.Toggle | events.Seek | events.SeekShare | events.Step) -> None:
        match event:
            case events.Toggle():
                self.player.toggle()
            case events.Seek(seconds):
                self.player.seek(self._flight.start + seconds)
            case events.SeekShare(share):
                self.player.seek(self.player.start + share * self.player.duration)
            case events.Step(seconds):
                self.player.step(seconds)

    def _look(self, event: events.SetCamera | events.SetTrail | events.SetSize | events.SetDark) -> None:
        match event:
            case events.SetCamera(mode):
                self._mode = mode
                self._stand()
            case events.SetTrail():
                self._trail = event
                self._due["trails"] = 0.0
            case events.SetSize(size):
                self._size = size
            case events.SetDark(dark):
                self._theme(dark=dark)
                self.scene.shade(dark=dark)

    def _request(self, flight: Flight, choice: ReplayChoice) -> None:
        self._recomputer.request(flight, choice)
        self._panel.status("Reckoning...")

    def _take(self, outcome: Outcome) -> None:
        if isinstance(outcome.result, CompanionError):
            self._panel.status(str(outcome.result), trouble=True)
            return
        other_flight = outcome.flight is not self._flight
        self._flight, self._choice, self._film = outcome.flight, outcome.choice, outcome.result
        self.player.load(self._film.start, self._film.end, None if other_flight else self.player.time)
        self._framing = self._load()
        if other_flight:
            self._stand()

    def _load(self) -> Framing:
        """Lay out everything that stays the same until the next reckoning."""
        replay = self._film.replay
        framing = frame(replay.position_ref, replay.position_imu)
        if not replay.has_position:
            framing = replace(framing, ground=0.5 * framing.radius)  # both hang in the air above the origin
        self.scene.load(self._film, framing)
        self._plots.load(self._film, self._flight.start)
        self._panel.load(self._flight, self._choice, self.player, framing.cell, replay.has_position)
        self._panel.status("")
        self._framing = framing
        view = camera(self._mode, framing)
        initial = self._server.initial_camera
        initial.position, initial.look_at = view.position, view.look_at
        initial.near, initial.far, initial.fov = view.near, view.far, float(FIELD_OF_VIEW)
        self._due = dict.fromkeys(self._due, 0.0)
        return framing

    def _stand(self) -> None:
        """Take every browser's camera to where its mode begins. From there on it is the user's."""
        view = camera(self._mode, self._framing)
        self._server.initial_camera.position, self._server.initial_camera.look_at = view.position, view.look_at
        for client in self._server.get_clients().values():
            client.camera.position = view.position
            client.camera.look_at = view.look_at

    def _draw(self, now: float) -> None:
        """Write the instant of the clock: poses every turn, the rest as often as it can be read."""
        moment = self._film.at(self.player.time)
        pose = world(self._mode, moment)
        with self._server.atomic():
            self.scene.show(moment, pose)
        self.pose_updates += 1
        if self._is_due("labels", LABEL_HZ, now):
            eye, target = self._eye(), pose.apply(moment.position_ref)
            apart = pose.apply(moment.position_imu) - target
            imu_above = float(apart @ screen_up(target - eye)) >= 0
            self.scene.annotate(moment, self._span(eye, target), imu_above=imu_above)
            self._panel.show(moment, self.player, self._film.replay.has_position)
        if self._is_due("trails", TRAIL_HZ, now):
            since = -np.inf if self._trail.seconds is None else moment.t - self._trail.seconds
            self.scene.trails(since, np.inf if self._trail.ahead else moment.t)
        if self._relayouts and now >= self._relayouts[0] - APART:
            self._due["plots"] = self._relayouts[0] + APART
            if now >= self._relayouts[0]:
                self._relayouts.pop(0)
                self._plots.relayout()
        elif self._is_due("plots", PLOT_HZ, now):
            self._plots.show(moment.t - self._flight.start)

    def _is_due(self, what: str, rate: float, now: float) -> bool:
        if now < self._due[what]:
            return False
        self._due[what] = now + 1.0 / rate
        return True

    def _eye(self) -> Array:
        """Where the camera that moved last is: sizes and labels are one for all browsers."""
        clients = self._server.get_clients().values()
        if not clients:
            return camera(self._mode, self._framing).position
        return max(clients, key=lambda client: client.camera.update_timestamp).camera.position

    def _span(self, eye: Array, target: Array) -> float:
        """How large to draw the drones at `target`, m."""
        if self._size is None:
            return self._drone.span_m
        return readable_span(float(np.linalg.norm(eye - target)), self._drone.span_m, self._size)

    def _theme(self, *, dark: bool) -> None:
        self._server.gui.configure_theme(
            dark_mode=dark, show_logo=False, show_share_button=False, brand_color=palette.CONTROLS
        )
