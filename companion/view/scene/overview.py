"""The whole flight at one glance: both paths, pale; thick and with its name the stretch that ends farthest apart."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import viser

from companion.model import Array
from companion.present import Rgb, length, palette
from companion.view.scene.trail import OUTLINE, Segments, segments
from companion.view.state.decimation import Indices, by_shape
from companion.view.state.trajectory import DisplayTrajectory, Worst, worst_stretch

MOST_POINTS = OUTLINE
"""Of each path: they never move, but software WebGL draws each of their lines in every picture."""
_WORST_POINTS = 60
_PALE: Rgb = (205, 205, 205)
_NOTHING = np.zeros((1, 2, 3), dtype=np.float32)


class Overview:
    """Only the view thread may call it."""

    def __init__(self, scene: viser.SceneApi, root: str, nearer: str, scale: float) -> None:
        """nearer: the node under which lines of this scale cover what lies behind them, see `scene.NEARER`."""

        def lines(name: str, thickness: float, root: str = root, scale: float = 1.0) -> viser.LineSegmentsHandle:
            return scene.add_line_segments(
                f"{root}/{name}", _NOTHING, _PALE, thickness=thickness, thickness_units="screen", scale=scale,
                visible=False,
            )  # fmt: skip

        self._paths = {"imu": lines("path_imu", 2.5), "autopilot": lines("path_autopilot", 1.2, nearer, scale)}
        self._worst = {"imu": lines("worst_imu", 7.0), "autopilot": lines("worst_autopilot", 3.0, nearer, scale)}
        self._apart = lines("worst_apart", 4.0)
        self._label = scene.add_label(
            f"{root}/worst_name", "", anchor="bottom-center", font_screen_scale=1.1, visible=False
        )

    @property
    def label(self) -> str:
        """What is written at the worst stretch; "" while nothing is."""
        return self._label.text if self._label.visible else ""

    def load(self, display: DisplayTrajectory, colour: Rgb, outlines: Mapping[str, Indices]) -> None:
        """Lay out another replay. colour: of its IMU; outlines: of "imu" and "autopilot", `by_shape`."""
        replay = display.replay
        worst = worst_stretch(replay)
        places: dict[str, tuple[Array, Indices, Rgb]] = {
            "imu": (replay.position_imu, display.restarts, colour),
            "autopilot": (replay.position_ref, display.restarts[:0], palette.AUTOPILOT),
        }
        for name, (positions, breaks, shade) in places.items():
            _draw(
                self._paths[name],
                _simple(positions, breaks, MOST_POINTS, outlines[name]),
                palette.mix(shade, _PALE, 0.55),
            )
            part = _part(replay.t, worst)
            broken = breaks[(breaks > part.start) & (breaks < part.stop)] - part.start
            _draw(self._worst[name], _simple(positions[part], broken, _WORST_POINTS), shade)
        self._label.visible = worst is not None
        nothing = np.zeros((0, 2, 3), dtype=np.float32)
        if worst is None:
            _draw(self._apart, nothing, palette.DIFFERENCE)
            return
        at = int(np.searchsorted(replay.t, worst.end_s))
        ends = np.stack([replay.position_ref[at], replay.position_imu[at]])
        _draw(self._apart, ends[None].astype(np.float32), palette.DIFFERENCE)
        self._label.text = worst_words(worst)
        self._label.position = ends[0]  # the autopilot's, which is in the picture however far the IMU has gone astray


def worst_words(worst: Worst) -> str:
    """What is written at the worst stretch."""
    return f"{worst.end_s:.0f} s: {length(worst.apart_m)} apart"


def _part(t: Array, worst: Worst | None) -> slice:
    if worst is None:
        return slice(0, 0)
    return slice(*np.searchsorted(t, [worst.start_s, worst.end_s + 1e-6]).tolist())


def _simple(positions: Array, breaks: Indices, most: int, outline: Indices | None = None) -> Segments:
    if len(positions) < 2:
        return np.zeros((0, 2, 3), dtype=np.float32)
    inner = breaks[(breaks > 0) & (breaks < len(positions))]
    if 4 * len(inner) > most:
        inner = inner[:0]  # more anchors than the eye can part
    kept = np.union1d(by_shape(positions, most - 2 * len(inner), outline), np.union1d(inner - 1, inner)).astype(np.intp)
    return segments(positions, kept, inner)[0]


def _draw(line: viser.LineSegmentsHandle, lines: Segments, colour: Rgb) -> None:
    line.visible = len(lines) > 0
    if len(lines):
        line.points, line.colors = lines, np.array(colour, dtype=np.uint8)
