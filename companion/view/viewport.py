"""The world and who looks at it, as they wish to see it: what a replay and a live page have in common."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from typing import assert_never

import numpy as np
import viser

from companion.model import Array
from companion.present import palette
from companion.view.browsers import Browsers
from companion.view.scene.cameras import FIELD_OF_VIEW, Framing, camera, grid_cell, readable_span, screen_up
from companion.view.scene.scene import Scene
from companion.view.scene.vehicle_shapes import Drone
from companion.view.state import events
from companion.view.state.events import CameraMode
from companion.view.state.sample import Sample

_LAID_OUT = (1.0, 2.5, 5.0)  # s after it is opened: a page is laid out after 1 to 3 s


class Viewport:
    """Only the view thread may call it. folder: of the panel, where each browser's list of cameras goes."""

    def __init__(
        self,
        server: viser.ViserServer,
        folder: viser.GuiFolderHandle,
        drone: Drone,
        framing: Framing,
        post: events.Post,
        *,
        mode: CameraMode = "Free",
    ) -> None:
        self._server, self._mode = server, mode
        self._size: float | None = 1.0
        self.dark = False
        self.drone = drone
        self._theme()
        self.scene = Scene(server.scene, drone)
        self.browsers = Browsers(server, folder, post, mode=mode)
        self._laying_out: list[float] = []
        self.pose_updates = 0
        self.place(framing)

    @contextlib.contextmanager
    def atomic(self) -> Iterator[None]:
        """What is written meanwhile arrives together, and wakes the server's event loop once."""
        with self._server.atomic(), self.browsers.atomic():
            yield

    def place(self, framing: Framing) -> None:
        """Where new browsers begin from now on."""
        self.framing = framing
        view, initial = camera(self._mode, framing), self._server.initial_camera
        initial.position, initial.look_at = view.position, view.look_at
        initial.near, initial.far, initial.fov = view.near, view.far, float(FIELD_OF_VIEW)

    def handle(self, event: events.Look) -> None:
        """Look otherwise, or with another pair of eyes."""
        match event:
            case events.SetCamera(browser, mode):
                self.browsers.choose(browser, mode, self.framing)
            case events.SetSize(size):
                self._size = size
            case events.SetRange(shown):
                self.scene.expected.shown = shown
            case events.SetArrows(shown):
                self.scene.arrows.shown = shown
            case events.SetPath(name, shown):
                self.scene.extra_paths.show(name, shown)
            case events.SetMap():
                pass  # a replay's own, which knows where it flew
            case events.SetDark(dark):
                self.dark = dark
                self._theme()
            case events.Joined(browser):
                self.browsers.join(browser, self.framing)
                self._laying_out = [time.monotonic() + s for s in _LAID_OUT]
            case events.Left(browser):
                self.browsers.leave(browser)
            case _:
                assert_never(event)

    def reframe(self) -> None:
        """Take every camera to where it begins."""
        self.browsers.reframe(self.framing)

    def show(self, sample: Sample) -> None:
        """Put everything where it is at `sample`."""
        self.scene.show(sample)
        self.browsers.show(sample)
        self.pose_updates += 1

    def annotate(self, sample: Sample) -> float:
        """What a reader needs less often than an eye: names, sizes, the grid. Returns how large a drone is drawn, m."""
        eye, pose = self.browsers.last_moved(self.framing)
        target = pose.apply(sample.position_ref)
        apart = pose.apply(sample.position_imu) - target
        span = self._span(eye, target)
        self.scene.annotate(sample, span, imu_above=float(apart @ screen_up(target - eye)) >= 0)
        self.scene.seen_from(pose.back(eye))
        self.scene.ground.rule(grid_cell(float(np.linalg.norm(eye - target)), self.scene.ground.cell))
        return span

    def to_lay_out(self, now: float) -> float:
        """s until the charts of a page that has just been opened are to be laid out again; inf when none is."""
        return self._laying_out[0] - now if self._laying_out else np.inf

    def laid_out(self) -> None:
        """They are: the cameras may settle too."""
        self._laying_out.pop(0)
        self.browsers.settle(self.framing)

    def _span(self, eye: Array, target: Array) -> float:
        if self._size is None:
            return self.drone.span_m
        return readable_span(float(np.linalg.norm(eye - target)), self.drone.span_m, self._size)

    def _theme(self) -> None:
        self._server.gui.configure_theme(
            dark_mode=self.dark, show_logo=False, show_share_button=False, brand_color=palette.BRAND
        )
