"""The path behind a drone that is still flying: it grows at one end and is forgotten at the other."""

from __future__ import annotations

import numpy as np
import viser

from companion.model import Array
from companion.view.palette import Rgb
from companion.view.trail import CHUNK
from companion.view.visible import show

CHUNKS = 40
"""Lines a trail: a segment is a quarter of a second in 10 minutes, and only what is chosen is shown."""


class Wake:
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
        for i, line in enumerate(self._lines[:-1]):
            ends = self._ends[i]
            full = int(np.isfinite(ends).sum())
            a = int(np.searchsorted(ends[:full], since))
            b = int(np.searchsorted(ends[:full], until, side="right"))
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
        fresh = self._last is not None and self._tip is not None and self._last[0] < self._tip[0] <= now + 1e-6
        if fresh and self._last and self._tip:
            end = self._tip[1]
            begin = end if self._before is None else self._before
            last = self._last[1]
            tip.points = np.array([[begin - end, last - end], [last - end, np.zeros(3)]], dtype=np.float32)
        show(tip, fresh)

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
