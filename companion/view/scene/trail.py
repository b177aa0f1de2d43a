"""The paths in the picture: trails behind the drones, and paths that stand still.

Trails are fixed sets of short lines of which only those that change are sent again. What stands still: the whole flight
with its worst stretch and errors, GPS fixes, the best estimate.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import viser

from companion.comparison import FreeState
from companion.model import Array, interpolated
from companion.present import Rgb, length, palette
from companion.strapdown import SAME_TIME
from companion.view.scene.cameras import between
from companion.view.scene.drone import AUTOPILOT, IMU, NEARER, NEARER_SCALE, WORLD, Move, linear_light
from companion.view.state.live import FreeRun
from companion.view.state.moments import sigmas_along
from companion.view.state.places import Path
from companion.view.state.sending import Indices, by_shape, evenly, windows
from companion.view.state.trajectory import EXTRA_PATHS, DisplayTrajectory, ExtraPath, Worst, worst_stretch

CHUNK = 60
"""Segments a line: sending `.points` resends the whole line, so a long trail is many short ones."""
CHUNKS = 20
"""Lines a trail: 1,200 segments in all. Software WebGL draws two such trails at about 9 frames a second."""
FINE_HZ = 6.0
"""Segments a second where only the last minute or so of a long flight is shown."""
OUTLINE = CHUNK * CHUNKS // 2
"""Points of a track that are chosen by its shape, at most."""


Segments = npt.NDArray[np.float32]
NOTHING: Segments = np.zeros((1, 2, 3), dtype=np.float32)


def add_lines(
    scene: viser.SceneApi, name: str, colour: Rgb, thickness: float, *, scale: float = 1.0, visible: bool = False
) -> viser.LineSegmentsHandle:
    """A node of lines so many pixels thick, with none yet. scale: see `drone.NEARER`."""
    return scene.add_line_segments(
        name, NOTHING, colour, thickness=thickness, thickness_units="screen", scale=scale, visible=visible
    )


def segments(positions: Array, kept: Indices, breaks: Indices) -> tuple[Segments, Indices]:
    """Lines (M, 2, 3) between neighbours of the points `kept`, and the index at which each is complete.

    None of them crosses the jump just before an index of `breaks`.
    """
    starts, stops = kept[:-1], kept[1:]
    unbroken = np.searchsorted(breaks, starts, side="right") == np.searchsorted(breaks, stops, side="right")
    points = positions.astype(np.float32)
    return np.stack([points[starts], points[stops]], axis=1)[unbroken], stops[unbroken]


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """A track simplified."""

    segments: Segments  # (M, 2, 3)
    ends: Array  # (M,) s, when each is complete, increasing
    first: int = 0  # number of the chunk that they begin with


def simplified(t: Array, positions: Array, restarts: Indices, outline: Indices | None = None) -> list[Lines]:
    """A track at t (N,) s, positions (N, 3) NED m, broken just before each of `restarts`: fine, and all in few lines.

    The fine one is left out where the few are as many. outline: `by_shape` of the positions, to OUTLINE points or more.
    """
    inner = restarts[(restarts > 0) & (restarts < len(t))]
    jumps = np.union1d(inner - 1, inner)  # both ends, so that a jump is a gap at its true place
    few = CHUNK * CHUNKS + 1 - len(jumps)
    levels = []
    if FINE_HZ * (t[-1] - t[0]) > CHUNK * CHUNKS:
        kept = np.union1d(evenly(len(t), int(FINE_HZ * (t[-1] - t[0]))), jumps)
        levels.append(_lines(t, positions, kept, inner))
    if few < CHUNK * CHUNKS / 2:
        few, inner, jumps = CHUNK * CHUNKS + 1, inner[:0], inner[:0]  # more anchors than the eye can part
    # Half by shape, for round corners in a long flight; half by time, so that the path keeps up with the drone.
    kept = np.unique(np.concatenate([evenly(len(t), few // 2), jumps, by_shape(positions, few // 2, outline)]))
    return [*levels, _lines(t, positions, kept, inner)]


class Trail:
    """The part of a track between two times. The nodes are made once and reused for every track that is loaded.

    scale: of the lines, see `drone.NEARER`.
    """

    chunks = CHUNKS

    def __init__(self, scene: viser.SceneApi, name: str, colour: Rgb, thickness: float, *, scale: float = 1.0) -> None:
        self._nodes = [add_lines(scene, f"{name}/{i}", colour, thickness, scale=scale) for i in range(self.chunks)]
        self._levels: list[Lines] = []
        self._shown = [_NONE] * self.chunks

    def load(self, t: Array, positions: Array, restarts: Indices, colour: Rgb, outline: Indices | None = None) -> None:
        """Take another track: times (N,) s, positions (N, 3) NED m, broken just before each index of `restarts`.

        outline: as for `simplified`.
        """
        for node in self._nodes:
            node.colors = np.array(colour, dtype=np.uint8)
        self._levels = simplified(t, positions, restarts, outline)
        self._shown = [(-1, -1, -1, -1)] * len(self._nodes)

    def hide(self) -> None:
        """Show nothing of it until it is loaded again."""
        self._levels = []

    def show(self, since: float, until: float) -> None:
        """Show what lies between two times, s, as finely as there are lines for it."""
        nodes = len(self._nodes)
        due = [_NONE] * nodes
        for i, level in enumerate(self._levels):
            parts = windows(level.ends, since, until, CHUNK)
            if len(parts) <= nodes:
                for chunk, a, b in parts:
                    due[(level.first + chunk) % nodes] = (i, level.first + chunk, a, b)
                break
        for place, (node, part) in enumerate(zip(self._nodes, due, strict=True)):
            if part == self._shown[place]:
                continue
            self._shown[place] = part
            i, chunk, a, b = part
            if b > a:
                begin = (chunk - self._levels[i].first) * CHUNK
                node.points = self._levels[i].segments[begin + a : begin + b].copy()
            node.visible = b > a


_NONE = (0, 0, 0, 0)


def _lines(t: Array, positions: Array, kept: Indices, breaks: Indices) -> Lines:
    points, stops = segments(positions, kept.astype(np.intp), breaks)
    return Lines(points, t[stops])


_SEEN_M, _SEEN = 0.01, 0.01  # m, and of its length: a smaller change is not sent


class AttachedLine:
    """Only the view thread may call it. name: a node under the drone's, whose place is where the line begins."""

    def __init__(self, scene: viser.SceneApi, name: str, colour: Rgb, thickness: float) -> None:
        self.node = add_lines(scene, name, colour, thickness, visible=True)
        self._end: Sequence[float] = (0.0, 0.0, 0.0)  # m NED from the drone

    def moves(self, end: Sequence[float]) -> list[Move]:
        """What changes when it is drawn to `end` (3,) m NED from the drone.

        Plain numbers: a recording has three lines in each of 3,000 pictures, and NumPy takes longer for so few.
        """
        moved = max(abs(new - old) for new, old in zip(end, self._end, strict=True))
        if moved <= min(_SEEN_M, _SEEN * math.hypot(*end)):
            return []
        self._end = end
        points = np.zeros((1, 2, 3), dtype=np.float32)
        points[0, 1] = end
        return [Move(self.node, "points", points)]


LIVE_CHUNKS = 40
"""Lines of a growing trail: a segment is a quarter of a second in 10 minutes, and only what is chosen is shown."""


class LiveTrail(Trail):
    """It grows at one end and is forgotten at the other. Made once, reused for ever.

    drone: the node at whose place it ends. seconds: how far it reaches back; that sets how long a segment is.
    """

    chunks = LIVE_CHUNKS

    def __init__(
        self, scene: viser.SceneApi, name: str, drone: str, colour: Rgb, thickness: float, seconds: float
    ) -> None:
        super().__init__(scene, name, colour, thickness)
        self._tip_line = add_lines(scene, f"{drone}/tip", colour, thickness)
        self._spacing = seconds / (CHUNK * (LIVE_CHUNKS - 1))
        self._lines = Lines(np.zeros((LIVE_CHUNKS * CHUNK, 2, 3), np.float32), np.zeros(LIVE_CHUNKS * CHUNK))
        self._first = 0  # number of the first chunk that is kept: never the same for other points
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._first += LIVE_CHUNKS
        self._count = 0  # segments kept
        self._levels = []
        self._last: tuple[float, Array] | None = None
        self._before: Array | None = None  # the point before the last
        self._tip: tuple[float, Array] | None = None

    def add(self, t: float, position: Array, *, broken: bool = False) -> None:
        """The drone is at `position` (3,) NED, m, at t s; broken: it has jumped there."""
        if not np.isfinite(position).all():
            return
        if self._last is None or broken:
            if broken and self._tip is not None:
                self._extend(*self._tip)
            self._last = self._tip = (t, position)
            self._before = None
        elif t - self._last[0] >= self._spacing:
            self._extend(t, position)
        self._tip = (t, position)

    def reach(self, now: float) -> None:
        """Draw the newest piece up to the drone; nothing while an earlier time than the newest is shown.

        It hangs on the drone and begins a segment earlier than it has to: a browser that is late with new points shows
        no gap then.
        """
        last, tip, before = self._last, self._tip, self._before
        # Where a segment has just ended the one before it is drawn: hidden, it would be back at the next instant.
        if last is None or tip is None or tip[0] > now + 1e-6 or (before is None and last[0] >= tip[0]):
            self._tip_line.visible = False
            return
        end = tip[1]
        middle, begin = last[1] - end, np.zeros(3) if before is None else before - end
        self._tip_line.points = np.array([[begin, middle], [middle, np.zeros(3)]], dtype=np.float32)
        self._tip_line.visible = True

    def _extend(self, t: float, position: Array) -> None:
        if self._last is None or t <= self._last[0]:
            return
        kept = self._lines
        if self._count == len(kept.ends):
            for column in (kept.segments, kept.ends):
                column[:-CHUNK] = column[CHUNK:]
            self._count -= CHUNK
            self._first += 1
        kept.segments[self._count] = self._last[1], position
        kept.ends[self._count] = t
        self._count += 1
        self._levels = [Lines(kept.segments[: self._count], kept.ends[: self._count], self._first)]
        self._before, self._last = self._last[1], (t, position)


_FARTHEST_M = 1e7  # a ball beyond that is not drawn
_JUST_BEGUN_S = 1.5  # a free run begins a second before it is first seen


class LiveTrails:
    """The three paths and the ball. Only the view thread may call it."""

    def __init__(self, scene: viser.SceneApi, seconds: float) -> None:
        self._autopilot = LiveTrail(scene, f"{WORLD}/live_autopilot", AUTOPILOT, palette.AUTOPILOT, 2.5, seconds)
        self._imu = LiveTrail(scene, f"{WORLD}/live_imu", IMU, palette.IMU, 2.5, seconds)
        ball = f"{WORLD}/free"
        self._ball = scene.add_icosphere(ball, 1.0, palette.FREE, visible=False, cast_shadow=False)
        self._free = LiveTrail(scene, f"{WORLD}/live_free", ball, palette.FREE, 2.0, seconds)
        self._all = (self._autopilot, self._imu, self._free)
        self._anchor = np.nan
        self._was_free = False

    def clear(self) -> None:
        """Forget all paths."""
        for trail in self._all:
            trail.clear()
        self._anchor, self._was_free = np.nan, False

    def add(self, display: DisplayTrajectory, free: FreeState | None) -> None:
        """Go on to the last sample of the display."""
        t, anchor = display.end, float(display.replay.anchors[-1])
        if not display.replay.has_position:
            return
        self._autopilot.add(t, display.replay.position_ref[-1])
        self._imu.add(t, display.replay.position_imu[-1], broken=anchor != self._anchor)
        self._anchor = anchor
        if free is not None:
            begun = not self._was_free or t - free.anchor_s < _JUST_BEGUN_S
            self._free.add(t, free.state.position, broken=begun)
        self._was_free = free is not None

    def show(self, since: float, until: float) -> None:
        """Show what lies between two times, s, boot clock."""
        for trail in self._all:
            trail.show(since, until)

    def reach(self, now: float, free: FreeRun | None) -> None:
        """Lead the paths up to the drones at `now`, s, and put the ball where the free run is."""
        for trail in self._all:
            trail.reach(now)
        near = free is not None and not np.isnan(self._anchor) and bool(np.abs(free.position).max() < _FARTHEST_M)
        self._ball.visible = near
        if near and free is not None:
            self._ball.position = free.position

    def resize(self, span: float) -> None:
        """Fit the ball to drones so many m wide. A change too small to see is not sent."""
        radius = 0.12 * span
        if abs(radius - self._ball.radius) > 0.04 * self._ball.radius:
            self._ball.radius = radius


_MOST_POINTS = OUTLINE
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
            by_shape(replay.position_ref, _MOST_POINTS // 2, outline), evenly(len(replay.t), _MOST_POINTS // 2)
        )
        lines, ends = segments(replay.position_ref, kept.astype(np.intp), display.restarts[:0])
        # Anew: viser 1.1 draws no other colours for points that stay as they are.
        self._scene.add_line_segments(
            self._name,
            lines if len(lines) else NOTHING,
            _sigma_colours(sigmas_along(display, replay.t[ends])) if len(lines) else palette.UNKNOWN,
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
            _draw(self._arc, _simple(replay.position_imu[part], _MOST_POINTS // 4), shade)


def _sigma_colours(sigmas: Array) -> npt.NDArray[np.uint8]:
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
    kept = np.union1d(evenly(len(positions), _MOST_POINTS // 2), by_shape(positions, _MOST_POINTS // 2))
    points = positions[kept]
    return np.stack([points, points + np.array([size, 0.0, 0.0])], axis=1).astype(np.float32)


def dashes(positions: Array) -> tuple[Segments, npt.NDArray[np.uint8]]:
    """A path (N, 3) as lines (M, 2, 3) with their colours: dark and light in turn, each dash as long as the others."""
    points = positions[by_shape(positions, _MOST_POINTS)]
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    distinct = np.concatenate([[True], np.diff(along) > 0])
    points, along = points[distinct], along[distinct]
    edges = np.linspace(0.0, along[-1], DASHES + 1)
    at = np.union1d(edges, along)
    path = interpolated(at, along, points)
    dash = np.searchsorted(edges, (at[:-1] + at[1:]) / 2, side="right") - 1
    shades = np.array([palette.BEST, palette.BEST_LIGHT], dtype=np.uint8)[dash % 2]
    return np.stack([path[:-1], path[1:]], axis=1).astype(np.float32), np.repeat(shades[:, None], 2, axis=1)
