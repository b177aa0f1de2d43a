"""The world and who looks at it, as they wish to see it: what stands behind a replay and behind a live page."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping

import numpy as np
import viser

from companion.present import palette
from companion.view.browsers import Browsers
from companion.view.charts.chart_pages import ChartPages, LiveCharts
from companion.view.panels.controls import Controls
from companion.view.scene.cameras import Framing, grid_cell, readable_span, screen_up
from companion.view.scene.scene import Scene
from companion.view.scene.vehicle_shapes import Drone
from companion.view.state.choice import EXTRA_PATHS, SHOWN, CameraMode, TrailSpan
from companion.view.state.sending import Cadence
from companion.view.state.trajectory import Sample

_LAID_OUT = (1.0, 2.5, 5.0)  # s after it is opened: a page is laid out after 1 to 3 s
_APART = 0.4  # s between a chart's new size and its new data: a slow page must not take them for one change
SIZES = {"Easy to see": 1.0, "Larger": 1.7, "Smaller": 0.5, "True size": None}


class Controller:
    """Built when the server is up; from then on only the view thread may call it."""

    charts: ChartPages | LiveCharts

    def __init__(
        self,
        server: viser.ViserServer,
        controls: Controls,
        drone: Drone,
        framing: Framing,
        trails: Mapping[str, TrailSpan],
        *,
        mode: CameraMode = "Free",
        expects: bool = False,
        map_host: str = "",
        rates: Mapping[str, float],
    ) -> None:
        """Adds the folder of what can be chosen of the picture.

        trails: by their names, the first is chosen; expects: whether it is known how far the autopilot should be, and
        the ellipsoid can be drawn; map_host: whose map can be laid under the flight, "" for none; rates: see `Cadence`.
        """
        self._server, self.drone, self._trails = server, drone, trails
        self.is_due = Cadence(trails=8.0, **rates)
        self._laying_out: list[float] = []
        self.joined_at = 0.0  # s of the steady clock, when a page was opened last
        self.pose_updates = 0
        self.stale = True  # whether the picture is to be drawn though nothing moves
        self.scene = Scene(server.scene, drone)
        gui = controls.gui
        with (folder := gui.add_folder("Picture", expand_by_default=False)):
            self._trail = gui.add_dropdown("Paths", tuple(trails))
            self.extra_path_boxes = {
                name: gui.add_checkbox(label, SHOWN[name], hint=hint, visible=False)
                for name, (label, hint) in EXTRA_PATHS.items()
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
                visible=expects,
                hint="Around the IMU: where the autopilot should be, if nothing is wrong",
            )
            self.arrows = gui.add_checkbox("Arrows", False, hint="Velocity of both, and gravity")
            self._dark = gui.add_checkbox("Dark", False)
        controls.on_change(self._trail, lambda _: self.is_due.at_once("trails"))
        controls.on_change(self.arrows, lambda _: setattr(self, "stale", True))
        controls.on_change(self._dark, lambda _: self._theme())
        self.browsers = Browsers(server, folder, controls, self.choose_camera, mode, framing)
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

    def choose_camera(self, browser: int, mode: CameraMode) -> None:
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
        eye, pose = self.browsers.last_moved()
        target = pose.apply(sample.position_ref)
        apart = pose.apply(sample.position_imu) - target
        distance, size = float(np.linalg.norm(eye - target)), SIZES.get(self._size.value, 1.0)
        span = self.drone.span_m if size is None else readable_span(distance, self.drone.span_m, size)
        self.scene.expected.shown = bool(self._ellipsoid.value)
        self.scene.annotate(sample, span, imu_above=float(apart @ screen_up(target - eye)) >= 0)
        self.scene.seen_from(pose.back(eye))
        self.scene.ground.rule(grid_cell(distance, self.scene.ground.cell))
        self.scene.extra_paths.choose({name: bool(box.value) for name, box in self.extra_path_boxes.items()})
        return span

    def draw_trails(self, now: float, sample: Sample, show: Callable[[float, float], None]) -> None:
        """Show the paths as they are at `sample`, when that is due."""
        if self.is_due("trails", now):
            span = self._trails.get(self._trail.value, TrailSpan(None))
            show(*span.around(sample.t, sample.t - sample.since_anchor_s))

    def draw_charts(self, now: float, draw: Callable[[], None]) -> None:
        """Draw the charts when that is due; those of a page that has just been opened are laid out again before."""
        left = self._laying_out[0] - now if self._laying_out else np.inf
        if left <= 0:
            self._laying_out.pop(0)
            self.charts.relayout()
            self.browsers.settle()
            self.is_due.wait("charts", now + _APART)
        elif left >= _APART and self.is_due("charts", now):
            draw()

    def _theme(self) -> None:
        self._server.gui.configure_theme(
            dark_mode=self.dark, show_logo=False, show_share_button=False, brand_color=palette.BRAND
        )
