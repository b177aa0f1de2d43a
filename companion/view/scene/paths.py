"""Paths that stand still: the whole flight at one glance with its worst stretch, the GPS fixes, the best estimate."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import viser

from companion.model import Array, interpolated
from companion.present import Rgb, length, palette
from companion.view.scene.trail import OUTLINE, Segments, add_lines, segments
from companion.view.state.choice import SHOWN, ExtraPath
from companion.view.state.decimation import Indices, by_shape, evenly
from companion.view.state.places import Path
from companion.view.state.sending import update
from companion.view.state.trajectory import DisplayTrajectory, Worst, worst_stretch

MOST_POINTS = OUTLINE
"""Of each path: they never move, but software WebGL draws each of their lines in every picture."""
_WORST_POINTS = 60
_PALE: Rgb = (205, 205, 205)
DASHES = 240
"""Of the best estimate, dark and light in turn: it is seen on a light page and on a dark one."""


class Overview:
    """Both paths, pale; thick and with its name the stretch that ends farthest apart.

    nearer: the node under which lines of this scale cover what lies behind them, see `scene.NEARER`. Only the view
    thread may call it.
    """

    def __init__(self, scene: viser.SceneApi, root: str, nearer: str, scale: float) -> None:
        self._paths = {
            "imu": add_lines(scene, f"{root}/path_imu", _PALE, 2.5),
            "autopilot": add_lines(scene, f"{nearer}/path_autopilot", _PALE, 1.2, scale=scale),
        }
        self._worst = {
            "imu": add_lines(scene, f"{root}/worst_imu", _PALE, 7.0),
            "autopilot": add_lines(scene, f"{nearer}/worst_autopilot", _PALE, 3.0, scale=scale),
        }
        self._apart = add_lines(scene, f"{root}/worst_apart", palette.DIFFERENCE, 4.0)
        self._label = scene.add_label(
            f"{root}/worst_name", "", anchor="bottom-center", font_screen_scale=1.1, visible=False
        )

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
        self._apart.visible = self._label.visible = worst is not None
        if worst is None:
            return
        at = int(np.searchsorted(replay.t, worst.end_s))
        ends = np.stack([replay.position_ref[at], replay.position_imu[at]])
        self._apart.points = ends[None].astype(np.float32)
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


class ExtraPaths:
    """Those that can be shown or not. Only the view thread may call it."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._gps = add_lines(scene, f"{root}/gps", palette.GPS, 5.0)
        self._best = add_lines(scene, f"{root}/best", palette.BEST, 2.5)
        self.shown: Mapping[ExtraPath, bool] = SHOWN
        self.there = dict.fromkeys(SHOWN, False)

    def load(self, gps: Path | None, best: Path | None, size: float) -> None:
        """Lay out another flight; None: it has no such path. size: m, about a pixel of a picture of the whole."""
        self.there = {"gps": gps is not None, "best": best is not None}
        if gps is not None:
            self._gps.points = dots(gps.position, size)
        if best is not None:
            self._best.points, self._best.colors = dashes(best.position)
        self.choose(self.shown)

    def choose(self, shown: Mapping[ExtraPath, bool]) -> None:
        """Show some of them, where they are there."""
        self.shown = shown
        update(self._gps, visible="gps" in self.visible)
        update(self._best, visible="best" in self.visible)

    @property
    def visible(self) -> tuple[ExtraPath, ...]:
        """Those in the picture."""
        return tuple(name for name, there in self.there.items() if there and self.shown[name])


def dots(positions: Array, size: float) -> Segments:
    """Lines (M, 2, 3) so short, m, that each looks like a dot."""
    kept = np.union1d(evenly(len(positions), MOST_POINTS // 2), by_shape(positions, MOST_POINTS // 2))
    points = positions[kept]
    return np.stack([points, points + np.array([size, 0.0, 0.0])], axis=1).astype(np.float32)


def dashes(positions: Array) -> tuple[Segments, npt.NDArray[np.uint8]]:
    """A path (N, 3) as lines (M, 2, 3) with their colours: dark and light in turn, each dash as long as the others."""
    points = positions[by_shape(positions, MOST_POINTS)]
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    distinct = np.concatenate([[True], np.diff(along) > 0])
    points, along = points[distinct], along[distinct]
    edges = np.linspace(0.0, along[-1], DASHES + 1)
    at = np.union1d(edges, along)
    path = interpolated(at, along, points)
    dash = np.searchsorted(edges, (at[:-1] + at[1:]) / 2, side="right") - 1
    shades = np.array([palette.BEST, palette.BEST_LIGHT], dtype=np.uint8)[dash % 2]
    return np.stack([path[:-1], path[1:]], axis=1).astype(np.float32), np.repeat(shades[:, None], 2, axis=1)
