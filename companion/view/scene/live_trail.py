"""The paths behind drones that are still flying: they grow at one end and are forgotten at the other."""

from __future__ import annotations

import numpy as np
import viser

from companion.analysis import FreeState
from companion.model import Array
from companion.present import Rgb, palette
from companion.view.scene.scene import AUTOPILOT, IMU, WORLD
from companion.view.scene.trail import CHUNK
from companion.view.state.sending import update
from companion.view.state.trajectory import DisplayTrajectory

CHUNKS = 40
"""Lines a trail: a segment is a quarter of a second in 10 minutes, and only what is chosen is shown."""


class LiveTrail:
    """Segments in a ring of lines, of which only the newest is sent again as it grows. Made once, reused for ever.

    drone: the node at whose place it ends. seconds: how far it reaches back; that sets how long a segment is.
    """

    def __init__(
        self, scene: viser.SceneApi, name: str, drone: str, colour: Rgb, thickness: float, seconds: float
    ) -> None:
        self._lines = [
            scene.add_line_segments(
                place, _NOTHING, colour, thickness=thickness, thickness_units="screen", visible=False
            )
            for place in (*(f"{name}/{i}" for i in range(CHUNKS)), f"{drone}/tip")
        ]
        self._spacing = seconds / (CHUNK * (CHUNKS - 1))
        self._segments = np.zeros((CHUNKS, CHUNK, 2, 3), dtype=np.float32)
        self._ends = np.full((CHUNKS, CHUNK), np.inf)  # s, when each segment is complete
        self._shown = [(0, 0, 0)] * CHUNKS
        self._uses = [0] * CHUNKS  # of each line: old and new points must not be taken for one another
        self._next = 0  # segment, counted since the start
        self._last: tuple[float, Array] | None = None
        self._before: Array | None = None  # the point before the last
        self._tip: tuple[float, Array] | None = None

    def clear(self) -> None:
        """Forget everything."""
        self._ends[:] = np.inf
        self._next, self._last, self._before, self._tip = 0, None, None, None

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

    def show(self, since: float, until: float) -> None:
        """Show what lies between two times, s."""
        first, last = (self._ends < since).sum(axis=1).tolist(), (self._ends <= until).sum(axis=1).tolist()
        for i, (line, a, b) in enumerate(zip(self._lines[:-1], first, last, strict=True)):
            key = (a, b, self._uses[i]) if b > a else (0, 0, 0)
            if key == self._shown[i]:
                continue
            self._shown[i] = key
            if b > a:
                line.points = self._segments[i, a:b].copy()
            line.visible = b > a

    def reach(self, now: float) -> None:
        """Draw the newest piece up to the drone; nothing while an earlier time than the newest is shown.

        It hangs on the drone and begins a segment earlier than it has to: a browser that is late with new points shows
        no gap then.
        """
        tip = self._lines[-1]
        fresh = False
        if self._last is not None and self._tip is not None and self._tip[0] <= now + 1e-6:
            # Where a segment has just ended the one before it is drawn: hidden, it would be back at the next instant.
            fresh = self._last[0] < self._tip[0] or self._before is not None
        if fresh and self._last and self._tip:
            end = self._tip[1]
            begin = end if self._before is None else self._before
            last = self._last[1]
            tip.points = np.array([[begin - end, last - end], [last - end, np.zeros(3)]], dtype=np.float32)
        update(tip, visible=fresh)

    def _extend(self, t: float, position: Array) -> None:
        if self._last is None or t <= self._last[0]:
            return
        chunk, place = self._next // CHUNK % CHUNKS, self._next % CHUNK
        if place == 0:
            self._ends[chunk] = np.inf
            self._uses[chunk] += 1
        self._segments[chunk, place] = self._last[1], position
        self._ends[chunk, place] = t
        self._next += 1
        self._before, self._last = self._last[1], (t, position)


_NOTHING = np.zeros((1, 2, 3), dtype=np.float32)


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

    def reach(self, now: float, ball: Array | None) -> None:
        """Lead the paths up to the drones at `now`, s, and put the ball at (3,) NED, m; None: there is none."""
        for trail in self._all:
            trail.reach(now)
        near = ball is not None and bool(np.abs(ball).max() < _FARTHEST_M)
        update(self._ball, visible=near)
        if near and ball is not None:
            self._ball.position = ball

    def resize(self, span: float) -> None:
        """Fit the ball to drones so many m wide. A change too small to see is not sent."""
        radius = 0.12 * span
        if abs(radius - self._ball.radius) > 0.04 * self._ball.radius:
            self._ball.radius = radius
