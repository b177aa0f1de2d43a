"""The viewer: one thread that owns the play clock and alone writes to the browser."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from types import TracebackType
from typing import assert_never

import numpy as np
import viser

from companion.errors import CompanionError, InputError
from companion.tracks import Array, Flight
from companion.view import events, palette
from companion.view.choice import Outcome, Recompute, Recomputer, ReplayChoice, attempt
from companion.view.framing import FIELD_OF_VIEW, CameraMode, Framing, camera, frame, readable_span, world
from companion.view.moment import Footage
from companion.view.panel import Panel
from companion.view.player import Player
from companion.view.plots import Plots
from companion.view.scene import Scene
from companion.view.server import close_server, find_address, open_server
from companion.view.shapes import drone_for

POSE_HZ, LABEL_HZ, TRAIL_HZ, PLOT_HZ = 30.0, 8.0, 8.0, 5.0


class Viewer:
    """A replay in the browser. A resource: close it, or use it in a `with` block.

    The first reckoning is done in the constructor, so that a flight that cannot be shown raises there
    (CompanionError), before anything is served.
    """

    def __init__(
        self,
        flights: Sequence[Flight],
        recompute: Recompute,
        *,
        flight: int = 0,
        choice: ReplayChoice | None = None,
        host: str = "127.0.0.1",
        port: int = 8080,
    ) -> None:
        if not flights:
            raise InputError("There is no flight to show.")
        self._flights = tuple(flights)
        self._flight = self._flights[flight]
        self._choice = _complete(choice or ReplayChoice(), self._flight)
        first = attempt(recompute, self._flight, self._choice)
        if isinstance(first, CompanionError):
            raise first
        self._film: Footage = first
        self._address = find_address(host, port)
        self._server = open_server(self._address)
        self._address = replace(self._address, port=self._server.get_port())
        self._events: queue.SimpleQueue[events.Event] = queue.SimpleQueue()
        self._recomputer = Recomputer(recompute)
        self._stopping = threading.Event()
        self._closed = False
        self._failure: BaseException | None = None

        self.player = Player(self._film.start, self._film.end)
        """The play clock. Read it from anywhere; only the view thread moves it."""
        self.pose_updates = 0
        """How often both poses have been written since the start."""
        self._mode: CameraMode = "Free"
        self._trail = events.SetTrail(None)
        self._size: float | None = 1.0
        self._due = dict.fromkeys(("labels", "trails", "plots"), 0.0)
        self._drone = drone_for(self._flight.vehicle.type)

        gui = self._server.gui
        self._theme(dark=False)
        self.scene = Scene(self._server.scene, self._drone)
        """The world; its drones' poses can be read from anywhere."""
        self._panel = Panel(gui, self._flights, self._events.put)
        side = gui.add_panel()
        with side.add_tab("Errors against time", viser.Icon.CHART_LINE):
            self._plots = Plots(gui, self._film, self._flight.start)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(330)
        side.dock_left()
        side.set_width(330)
        self._framing = self._load()
        self._thread = threading.Thread(target=self._loop, name="companion-view", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """The port that is really used."""
        return self._address.port

    @property
    def url(self) -> str:
        """What to open in a browser on this machine."""
        return self._address.url

    @property
    def warning(self) -> str | None:
        """A sentence for the user when others can reach the page, else None."""
        return self._address.warning

    def run(self) -> None:
        """Serve until `stop`, Ctrl-C, or an error in the view thread, which is raised here."""
        try:
            while not self._stopping.wait(0.5):
                pass
        except KeyboardInterrupt:
            pass
        finally:
            self.close()
        self._reraise()

    def stop(self) -> None:
        """Make `run` return; may be called from any thread."""
        self._stopping.set()

    def close(self) -> None:
        """Stop the view thread, the worker and the server. A second call does nothing."""
        self._stopping.set()
        if self._closed:
            return
        self._closed = True
        self._thread.join()
        self._recomputer.close()
        close_server(self._server)

    def __enter__(self) -> Viewer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
        if error is None:
            self._reraise()

    def post(self, event: events.Event) -> None:
        """Do what a control of the page would do."""
        self._events.put(event)

    def _reraise(self) -> None:
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure

    # Below: the view thread alone.

    def _loop(self) -> None:
        before = time.monotonic()
        try:
            while not self._stopping.is_set():
                now = time.monotonic()
                self._turn(now, now - before)
                before = now
                self._stopping.wait(max(0.0, 1.0 / POSE_HZ - (time.monotonic() - now)))
        except BaseException as error:  # noqa: BLE001 - handed to `run`, which raises it in the main thread
            self._failure = error
            self._stopping.set()

    def _turn(self, now: float, dt: float) -> None:
        """One turn of the loop: what was asked, what has been reckoned, the clock, the picture."""
        while not self._events.empty():
            self._handle(self._events.get())
        outcome = self._recomputer.poll()
        if outcome is not None:
            self._take(outcome)
        self.player.advance(dt)
        self._draw(now)

    def _handle(self, event: events.Event) -> None:
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
                    self._request(other, _complete(replace(self._choice, imu=None, start_s=None), other))
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
            self.scene.annotate(moment, self._span(pose.apply(moment.position_ref)))
            self._panel.show(moment, self.player, self._film.replay.has_position)
        if self._is_due("trails", TRAIL_HZ, now):
            since = -np.inf if self._trail.seconds is None else moment.t - self._trail.seconds
            self.scene.trails(since, np.inf if self._trail.ahead else moment.t)
        if self._is_due("plots", PLOT_HZ, now):
            self._plots.show(moment.t - self._flight.start)

    def _is_due(self, what: str, rate: float, now: float) -> bool:
        if now < self._due[what]:
            return False
        self._due[what] = now + 1.0 / rate
        return True

    def _span(self, target: Array) -> float:
        """How large to draw the drones: as the camera that moved last sees them, for they are one for all browsers."""
        if self._size is None:
            return self._drone.span_m
        eye = camera(self._mode, self._framing).position
        clients = self._server.get_clients().values()
        if clients:
            eye = max(clients, key=lambda client: client.camera.update_timestamp).camera.position
        return readable_span(float(np.linalg.norm(eye - target)), self._drone.span_m, self._size)

    def _theme(self, *, dark: bool) -> None:
        self._server.gui.configure_theme(
            dark_mode=dark, show_logo=False, show_share_button=False, brand_color=palette.CONTROLS
        )


def _complete(choice: ReplayChoice, flight: Flight) -> ReplayChoice:
    """`choice` with the flight's own IMU where none was named."""
    return choice if choice.imu is not None else replace(choice, imu=flight.default_imu)
