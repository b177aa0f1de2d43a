"""The world and who looks at it: what stands behind a replay and behind a live page.

Every browser has a camera of its own, and a node of its own under the world's name. It takes the place of the shared
one there, and with it moves everything that hangs on that name, in this browser alone.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import viser

from companion.present import palette
from companion.view.panels.chart import relayout
from companion.view.panels.chart_pages import ChartPages, LiveCharts
from companion.view.panels.controls import ChooseCamera, Controls, write
from companion.view.scene.cameras import (
    CAMERA_MODES,
    STILL,
    UNMOVED,
    Framing,
    Pose,
    camera,
    grid_cell,
    readable_span,
    step_back,
    world,
)
from companion.view.scene.drone import WORLD
from companion.view.scene.scene import Picture, Scene, unseen
from companion.view.scene.vehicle_shapes import Drone
from companion.view.state.sending import Cadence
from companion.view.state.trajectory import EXTRA_PATHS, CameraMode, Sample, TrailSpan

_NARROW = 0.6  # width by height of a phone held upright; between two panels a laptop leaves 0.77


@dataclass(slots=True)
class _Browser:
    client: viser.ClientHandle
    world: viser.FrameHandle
    chooser: viser.GuiDropdownHandle[CameraMode]
    pose: Pose
    mode: CameraMode = "Free"


class Browsers:
    """Who looks, and how. Only the view thread may call it."""

    def __init__(
        self,
        server: viser.ViserServer,
        folder: viser.GuiFolderHandle,
        controls: Controls,
        choose: ChooseCamera,
        mode: CameraMode,
        framing: Framing,
    ) -> None:
        """folder: where each finds its list of cameras; choose: called where one of them is to look otherwise."""
        self._server, self._folder, self._controls, self._choose, self._mode = server, folder, controls, choose, mode
        self._open: dict[int, _Browser] = {}
        self.framing = self._opening = framing
        self.place(framing)

    def place(self, framing: Framing, opening: Framing | None = None) -> None:
        """Where cameras stand from now on; opening: where they begin, None: there too."""
        before, self.framing, self._opening = self._opening, framing, opening or framing
        camera(self._mode, self._opening).begin(self._server.initial_camera)
        for browser in self._open.values():
            if browser.mode in STILL and _stands(browser.client, browser.mode, before):
                _stand(browser.client, browser.mode, self._opening)

    def __len__(self) -> int:
        return len(self._open)

    @contextlib.contextmanager
    def atomic(self) -> Iterator[None]:
        """What is written to one browser meanwhile arrives together; to one whose world stands still nothing is."""
        with contextlib.ExitStack() as together:
            for browser in self._open.values():
                if browser.mode not in STILL:
                    together.enter_context(browser.client.atomic())
            yield

    def join(self, number: int) -> None:
        """A page has been opened. One that is closed again already is passed over."""
        client = self._server.get_clients().get(number)
        if client is None or number in self._open:
            return
        with self._folder:  # the list is this browser's own, in the folder that all share
            chooser = client.gui.add_dropdown("Camera", CAMERA_MODES, initial_value=self._mode, order=-1.0)
        self._controls.on_change(chooser, lambda mode: self._choose(mode, number))
        frame = client.scene.add_frame(WORLD, show_axes=False)
        self._open[number] = _Browser(client, frame, chooser, UNMOVED, self._mode)
        # a page that has found its way to another server may keep the camera of the one before
        _stand(client, self._mode, self._opening)

    def look(self, framing: Framing, number: int) -> None:
        """Take the camera of a browser to a part of the flight, where it does not follow."""
        browser = self._open.get(number)
        if browser is not None and browser.mode in STILL:
            _stand(browser.client, browser.mode, framing)

    def settle(self) -> None:
        """Take the cameras of phones to where they begin: the view for all, sent as a page opens, may come last."""
        for browser in self._open.values():
            wide = camera(self._mode, self._opening)
            if _narrow(browser.client) and np.allclose(browser.client.camera.position, wide.position, rtol=1e-4):
                _stand(browser.client, browser.mode, self._opening)

    def leave(self, number: int) -> None:
        """A page has been closed."""
        self._open.pop(number, None)

    def choose(self, number: int, mode: CameraMode) -> None:
        """Look otherwise in one browser."""
        browser = self._open.get(number)
        if browser is not None and mode in CAMERA_MODES:
            browser.mode = mode
            write(browser.chooser, mode)
            _stand(browser.client, mode, self.framing)

    def reframe(self) -> None:
        """Take every browser's camera to where its mode begins. From there on it is the user's."""
        for browser in self._open.values():
            _stand(browser.client, browser.mode, self.framing)

    def show(self, sample: Sample) -> None:
        """Move the world where a camera follows. A world that stands still costs nothing."""
        for browser in self._open.values():
            pose = world(browser.mode, sample)
            if pose is not browser.pose:
                browser.world.position, browser.world.wxyz = pose.position, pose.wxyz
                browser.pose = pose
            eye = step_back(browser.mode, browser.client.camera.position, sample)
            if eye is not None:
                browser.client.camera.position = eye

    def pose(self, number: int) -> Pose | None:
        """How the world stands in a browser; None for one that has gone."""
        browser = self._open.get(number)
        return None if browser is None else browser.pose

    def last_moved(self) -> Picture:
        """What the camera that moved last sees: sizes and names are one for all browsers."""
        if not self._open:
            return unseen(camera("Free", self.framing))
        browser = max(self._open.values(), key=lambda b: b.client.camera.update_timestamp)
        seen = browser.client.camera
        return Picture(seen.position, seen.look_at, (seen.image_width, seen.image_height), browser.pose)


def _stand(client: viser.ClientHandle, mode: CameraMode, framing: Framing) -> None:
    view = camera(mode, framing, narrow=_narrow(client))
    client.camera.position, client.camera.look_at = view.position, view.look_at


def _stands(client: viser.ClientHandle, mode: CameraMode, framing: Framing) -> bool:
    """Whether a camera is where `_stand` took it, or where the page began: nobody has moved it."""
    places = (camera(mode, framing, narrow=narrow).position for narrow in {_narrow(client), False})
    return any(np.allclose(client.camera.position, place, rtol=1e-3) for place in places)


def _narrow(client: viser.ClientHandle) -> bool:
    return client.camera.image_width < _NARROW * client.camera.image_height


_LAID_OUT = (1.0, 2.5, 5.0)  # s after it is opened: a page is laid out after 1 to 3 s
_APART = 0.4  # s between a chart's new size and its new data: a slow page must not take them for one change
SIZES = {"Easy to see": 1.0, "Larger": 1.7, "Smaller": 0.5, "True size": None}


class Controller:
    """Built when the server is up; from then on only the view thread may call it."""

    charts: ChartPages | LiveCharts
    trails: ClassVar[Mapping[str, TrailSpan]]  # by their names, the first is chosen
    rates: ClassVar[Mapping[str, float]]  # Hz, see `Cadence`
    mode: ClassVar[CameraMode] = "Free"
    expects: ClassVar[bool] = False  # whether the ellipsoid can be drawn: how far off the autopilot should be is known

    def __init__(
        self, server: viser.ViserServer, controls: Controls, drone: Drone, framing: Framing, map_host: str = ""
    ) -> None:
        """Adds the folder of what can be chosen of the picture.

        map_host: whose map can be laid under the flight, "" for none.
        """
        self._server, self.drone = server, drone
        self.is_due = Cadence(trails=8.0, **self.rates)
        self._laying_out: list[float] = []
        self.joined_at = 0.0  # s of the steady clock, when a page was opened last
        self.pose_updates = 0
        self.stale = True  # whether the picture is to be drawn though nothing moves
        self.scene = Scene(server.scene, drone)
        gui = controls.gui
        with (folder := gui.add_folder("Picture", expand_by_default=False)):
            self._trail = gui.add_dropdown("Paths", tuple(self.trails))
            self.extra_path_boxes = {
                name: gui.add_checkbox(label, shown, hint=hint, visible=False)
                for name, (label, hint, shown) in EXTRA_PATHS.items()
            }
            self.map_box = gui.add_checkbox(
                "Map of the ground",
                False,
                visible=bool(map_host),
                hint=f"Fetches pictures of the ground from {map_host}. Nothing is fetched before",
            )
            self._size = gui.add_dropdown("Drones", tuple(SIZES))
            self._ellipsoid = gui.add_checkbox(
                "3σ ellipsoid",
                False,
                visible=self.expects,
                hint="Around the IMU: where the autopilot should be, if nothing is wrong",
            )
            self.arrows = gui.add_checkbox("Arrows", False, hint="Velocity of both, and gravity")
            self._dark = gui.add_checkbox("Dark", False)
        controls.on_change(self._trail, lambda _: self.is_due.at_once("trails"))
        controls.on_change(self.arrows, lambda _: setattr(self, "stale", True))
        controls.on_change(self._dark, lambda _: self._theme())
        self.browsers = Browsers(server, folder, controls, self.choose_camera, self.mode, framing)
        self._theme()

    def turn(self, now: float, dt: float) -> None:
        """Draw: at `now`, s of a steady clock, `dt` s after the last time."""
        raise NotImplementedError

    def wait(self) -> None:
        """Wait until there is something new to draw, for some milliseconds at most. Called when a turn is due."""

    def close(self) -> None:
        """End whatever works beside the view thread."""

    def visit(self, t: str, imu: str, *, again: bool) -> None:
        """An address is opened that requests an instant (s, boot clock) and an IMU. Untrusted text; "" for none.

        again: not by the user: the page remembers what it showed last of this log.
        """

    @contextlib.contextmanager
    def atomic(self) -> Iterator[None]:
        """What is written meanwhile arrives together, and wakes the server's event loop once."""
        with self._server.atomic(), self.browsers.atomic():
            yield

    def join(self, browser: int) -> None:
        """A page has been opened."""
        self.browsers.join(browser)
        self.stale = True
        self.joined_at = time.monotonic()
        self._laying_out = [self.joined_at + s for s in _LAID_OUT]

    def choose_camera(self, mode: CameraMode, browser: int) -> None:
        """Move one browser's camera otherwise."""
        self.browsers.choose(browser, mode)
        self.stale = True

    @property
    def dark(self) -> bool:
        """Whether the page is dark."""
        return bool(self._dark.value)

    def draw(self, sample: Sample) -> None:
        """Put everything where it is at `sample`."""
        self.scene.arrows.shown = bool(self.arrows.value)
        self.scene.show(sample)
        self.browsers.show(sample)
        self.pose_updates += 1

    def annotate(self, sample: Sample) -> float:
        """What a reader needs less often than an eye: names, sizes, the grid. Returns how large a drone is drawn, m."""
        picture = self.browsers.last_moved()
        distance = float(np.linalg.norm(picture.eye - picture.pose.apply(sample.position_ref)))
        size = SIZES.get(self._size.value, 1.0)
        span = self.drone.span_m if size is None else readable_span(distance, self.drone.span_m, size)
        self.scene.expected.shown = bool(self._ellipsoid.value)
        self.scene.annotate(sample, span, picture)
        self.scene.seen_from(picture.pose.back(picture.eye))
        self.scene.ground.rule(grid_cell(distance, self.scene.ground.cell))
        self.scene.extra_paths.choose({name: bool(box.value) for name, box in self.extra_path_boxes.items()})
        return span

    def draw_trails(self, now: float, sample: Sample, show: Callable[[float, float], None]) -> None:
        """Show the paths as they are at `sample`, when that is due."""
        if self.is_due("trails", now):
            span = self.trails.get(self._trail.value, TrailSpan(None))
            show(*span.around(sample.t, sample.t - sample.since_anchor_s))

    def draw_charts(self, now: float, draw: Callable[[], None]) -> None:
        """Draw the charts when that is due; those of a page that has just been opened are laid out again before."""
        left = self._laying_out[0] - now if self._laying_out else np.inf
        if left <= 0:
            self._laying_out.pop(0)
            relayout(self.charts.charts)
            self.browsers.settle()
            self.is_due.wait("charts", now + _APART)
        elif left >= _APART and self.is_due("charts", now):
            draw()

    def _theme(self) -> None:
        self._server.gui.configure_theme(
            dark_mode=self.dark, show_logo=False, show_share_button=False, brand_color=palette.BRAND
        )
