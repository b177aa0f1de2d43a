"""Paths that stand still: the whole flight with its worst stretch and errors, GPS fixes, the best estimate."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import viser

from companion.model import Array, interpolated
from companion.present import Rgb, length, palette
from companion.strapdown import SAME_TIME
from companion.view.scene.cameras import between
from companion.view.scene.drone import NEARER, NEARER_SCALE, linear_light
from companion.view.scene.trail import NOTHING, OUTLINE, Segments, add_lines, segments
from companion.view.state.choice import EXTRA_PATHS, ExtraPath
from companion.view.state.moments import sigmas_along
from companion.view.state.places import Path
from companion.view.state.sending import Indices, by_shape, evenly
from companion.view.state.trajectory import DisplayTrajectory, Worst, worst_stretch

MOST_POINTS = OUTLINE
"""Of each path: they never move, but software WebGL draws each of their lines in every picture."""
_WORST_POINTS = 60
_PALE: Rgb = (205, 205, 205)
DASHES = 240
"""Of the best estimate, dark and light in turn: it is seen on a light page and on a dark one."""


class Overview:
    """The autopilot's path in the colours of its error, the IMU's since the anchor, and thick the worst stretch.

    Only the view thread may call it.
    """

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._scene, self._name = scene, f"{root}/path_autopilot"
        self._arc = add_lines(scene, f"{root}/path_imu", _PALE, 2.5)
        self._worst = {
            "imu": add_lines(scene, f"{root}/worst_imu", _PALE, 7.0),
            "autopilot": add_lines(scene, f"{NEARER}/worst_autopilot", _PALE, 3.0, scale=NEARER_SCALE),
        }
        self._apart = add_lines(scene, f"{root}/worst_apart", palette.DIFFERENCE, 4.0)
        self._label = scene.add_label(
            f"{root}/worst_name", "", anchor="bottom-center", font_screen_scale=1.1, visible=False
        )
        self._display: DisplayTrajectory | None = None
        self._anchor = -1  # that the arc begins at, by its number

    def load(self, display: DisplayTrajectory, colour: Rgb, outline: Indices) -> None:
        """Lay out another replay. colour: of its IMU; outline: of the autopilot's positions, `by_shape`."""
        replay = display.replay
        self._display, self._anchor, self._colour = display, -1, colour
        kept = np.union1d(
            by_shape(replay.position_ref, MOST_POINTS // 2, outline), evenly(len(replay.t), MOST_POINTS // 2)
        )
        lines, ends = segments(replay.position_ref, kept.astype(np.intp), display.restarts[:0])
        # Anew: viser 1.1 draws no other colours for points that stay as they are.
        self._scene.add_line_segments(
            self._name,
            lines if len(lines) else NOTHING,
            sigma_colours(sigmas_along(display, replay.t[ends])) if len(lines) else palette.UNKNOWN,
            thickness=2.4,
            thickness_units="screen",
            visible=len(lines) > 0,
        )
        worst = worst_stretch(replay)
        part = slice(0, 0) if worst is None else between(replay.t, *worst.span)
        places = {"imu": (replay.position_imu, colour), "autopilot": (replay.position_ref, palette.AUTOPILOT)}
        for name, (positions, shade) in places.items():
            _draw(self._worst[name], _simple(positions[part]), np.array(shade, dtype=np.uint8))
        self._apart.visible = self._label.visible = worst is not None
        if worst is None:
            return
        at = int(np.searchsorted(replay.t, worst.end_s))
        ends = np.stack([replay.position_ref[at], replay.position_imu[at]])
        self._apart.points = ends[None].astype(np.float32)
        self._label.text = worst_words(worst)
        self._label.position = ends.mean(axis=0)

    @property
    def name(self) -> tuple[viser.LabelHandle, bool]:
        """What is written at the worst place, and whether there is one."""
        return self._label, self._apart.visible

    def show(self, t: float) -> None:
        """Draw where the IMU goes from the anchor before t, s, to the next."""
        if self._display is None:
            return
        replay = self._display.replay
        anchor = int(np.searchsorted(replay.anchors, t + SAME_TIME, side="right")) - 1
        if anchor != self._anchor:
            self._anchor = anchor
            bounds = np.append(replay.anchors, np.inf)
            start = bounds[anchor] if anchor >= 0 else -np.inf
            # Up to the last sample before the next anchor, where it jumps back to the autopilot.
            part = slice(*np.searchsorted(replay.t, [start, bounds[anchor + 1]]).tolist())
            shade = np.array(palette.mix(self._colour, _PALE, 0.55), dtype=np.uint8)
            _draw(self._arc, _simple(replay.position_imu[part], MOST_POINTS // 4), shade)


def sigma_colours(sigmas: Array) -> npt.NDArray[np.uint8]:
    """(M, 2, 3) the colours of lines that end with so many σ (M,), NaN for unknown: see `palette.SIGMAS`."""
    stops, colours = (np.array(column) for column in zip(*palette.SIGMAS, strict=True))
    mixed = interpolated(sigmas, stops, colours)
    mixed[np.isnan(sigmas)] = palette.UNKNOWN
    return np.repeat(linear_light(mixed)[:, None], 2, axis=1)


def worst_words(worst: Worst) -> str:
    """What is written at the worst stretch."""
    return f"{worst.end_s:.0f} s: {length(worst.apart_m)} apart"


def _simple(positions: Array, most: int = _WORST_POINTS) -> Segments:
    if len(positions) < 2:
        return NOTHING[:0]
    return segments(positions, by_shape(positions, most), np.zeros(0, np.intp))[0]


def _draw(line: viser.LineSegmentsHandle, lines: Segments, colours: npt.NDArray[np.uint8]) -> None:
    """colours: (3,) of all, or (M, 2, 3)."""
    line.visible = len(lines) > 0
    if len(lines):
        line.points, line.colors = lines, colours


class ExtraPaths:
    """Those that can be shown or not. Only the view thread may call it."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._gps = add_lines(scene, f"{root}/gps", palette.GPS, 5.0)
        self._best = add_lines(scene, f"{root}/best", palette.BEST, 2.5)
        self.shown: Mapping[ExtraPath, bool] = dict.fromkeys(EXTRA_PATHS, False)
        self.there = dict.fromkeys(EXTRA_PATHS, False)

    def load(self, gps: Path | None, best: Path | None, size: float) -> None:
        """Lay out another flight, before it is chosen what is shown of it; None: it has no such path.

        size: m, about a pixel of a picture of the whole.
        """
        self.there = {"gps": gps is not None, "best": best is not None}
        if gps is not None:
            self._gps.points = dots(gps.position, size)
        if best is not None:
            self._best.points, self._best.colors = dashes(best.position)

    def choose(self, shown: Mapping[ExtraPath, bool]) -> None:
        """Show some of them, where they are there."""
        self.shown = shown
        self._gps.visible = "gps" in self.visible
        self._best.visible = "best" in self.visible

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
