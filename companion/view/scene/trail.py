"""The paths behind the drones, in fixed sets of short lines of which only those that change are sent again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import viser

from companion.analysis import FreeState
from companion.model import Array
from companion.present import Rgb, palette
from companion.view.scene.drone import AUTOPILOT, IMU, WORLD, Move
from companion.view.state.live import FreeRun
from companion.view.state.sending import Indices, by_shape, evenly, windows
from companion.view.state.trajectory import DisplayTrajectory

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

    scale: of the lines, see `drone.NEARER`. chunks: how many lines.
    """

    def __init__(
        self,
        scene: viser.SceneApi,
        name: str,
        colour: Rgb,
        thickness: float,
        *,
        scale: float = 1.0,
        chunks: int = CHUNKS,
    ) -> None:
        self._nodes = [add_lines(scene, f"{name}/{i}", colour, thickness, scale=scale) for i in range(chunks)]
        self._levels: list[Lines] = []
        self._shown = [_NONE] * chunks

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

    def __init__(
        self, scene: viser.SceneApi, name: str, drone: str, colour: Rgb, thickness: float, seconds: float
    ) -> None:
        super().__init__(scene, name, colour, thickness, chunks=LIVE_CHUNKS)
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
