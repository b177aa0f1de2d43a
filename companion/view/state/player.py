"""The play clock: which instant of the flight is shown, how fast it moves, and what the controls of time do to it."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from companion.model import Array
from companion.strapdown import SAME_TIME

Stop = Literal["anchor", "event", "sample"]
SLOWEST, FASTEST = 0.1, 50.0  # times real time


class Player:
    """A clock over the interval `[first, last]` of a flight's boot clock, s, or over a part `[start, end]` of it.

    It has no clock of its own: whoever owns it calls `advance` with the seconds that have passed in the room.
    Whatever is done, `first <= start <= time <= end <= last`.
    """

    def __init__(self, first: float, last: float) -> None:
        self.playing = False
        self.loop = False
        self.backwards = False
        self._speed = 1.0
        self.stops: dict[Stop, Array] = {}  # s, sorted: where `jump` goes
        self._until: float | None = None  # where playing pauses, within the part
        self.first = self.start = self.time = first
        self.last = self.end = last
        self.load(first, last)

    def load(self, first: float, last: float, time: float | None = None) -> None:
        """Take another interval, at `time` as near as it allows (default: its start); speed and loop are kept.

        With a `time` it is the same flight recomputed, and the part stays as far as it still lies within.
        """
        low = first if time is None or self.start <= self.first else self.start
        high = last if time is None or self.end >= self.last else self.end
        until = None if time is None else self._until
        self.first, self.last = first, last
        self.choose_part(low, high)
        self.seek(self.start if time is None else time)
        self._until = until

    def choose_part(self, low: float, high: float) -> None:
        """Stay between two times, in either order; no part at all is the whole."""
        if math.isfinite(low) and math.isfinite(high):
            low, high = (min(max(t, self.first), self.last) for t in sorted((low, high)))
            whole = low >= high
            self.start, self.end = (self.first, self.last) if whole else (low, high)
            self.seek(self.time)

    def cut(self, edge: Literal["from", "to", "whole"]) -> None:
        """Play only what comes from the instant shown on, or up to it, or the whole again."""
        parts = {"from": (self.time, self.end), "to": (self.start, self.time), "whole": self.whole}
        self.choose_part(*parts[edge])

    @property
    def part(self) -> tuple[float, float]:
        """From when to when it is played, s."""
        return self.start, self.end

    @property
    def whole(self) -> tuple[float, float]:
        """From when to when it could be played, s."""
        return self.first, self.last

    @property
    def duration(self) -> float:
        """Length of the part that is played, s."""
        return self.end - self.start

    @property
    def speed(self) -> float:
        """Flight seconds per second of the room, always within 0.1 ... 50."""
        return self._speed

    @speed.setter
    def speed(self, value: float) -> None:
        if math.isfinite(value):
            self._speed = min(max(value, SLOWEST), FASTEST)

    def toggle(self) -> None:
        """Play or pause. Play at the end starts over, as every player does."""
        if not self.playing and self.time == self._goal:
            self.time = self.end if self.backwards else self.start
        self.playing, self._until = not self.playing, None

    def play(self, start: float, end: float) -> None:
        """Play forwards from one time to another, and pause there."""
        self.go(start)
        self.backwards, self.playing, self._until = False, True, end

    def seek(self, time: float) -> None:
        """Go to `time`, or to the nearest bound. Something that is no number is ignored."""
        if math.isfinite(time):
            self._until = None
            self.time = min(max(time, self.start), self.end)

    def seek_share(self, share: float) -> None:
        """Go to a share (0 ... 1) of the part that is played."""
        self.seek(self.start + share * self.duration)

    def go(self, time: float) -> None:
        """Pause and go to `time`, or to the nearest bound. Something that is no number is ignored."""
        if math.isfinite(time):
            self.playing = False
            self.seek(time)

    def step(self, seconds: float) -> None:
        """Pause and move by so many seconds."""
        self.go(self.time + seconds)

    def jump(self, to: Stop, *, forward: bool) -> None:
        """Pause and go to the next of such instants of the part, or to the one before, where there is one."""
        times = self.stops[to]
        times = times[(times >= self.start) & (times <= self.end)]
        after = int(np.searchsorted(times, self.time + SAME_TIME, side="right"))
        i = after if forward else int(np.searchsorted(times, self.time - SAME_TIME)) - 1
        if 0 <= i < len(times):
            self.go(float(times[i]))

    def advance(self, dt: float) -> None:
        """Let `dt` seconds of the room pass. Where the part ends: pause there, or start over when looping."""
        if not self.playing or not 0 < dt < math.inf:
            return
        step = dt * self._speed
        time = self.time - step if self.backwards else self.time + step
        if self._until is not None and time >= self._until and not self.backwards:
            self.go(self._until)
            return
        if time > self.start if self.backwards else time < self.end:
            self.time = time
        elif self.loop and self.duration > 0:
            # Rounding may put the remainder on the bound itself.
            self.seek(self.start + (time - self.start) % self.duration)
        else:
            self.time, self.playing = self._goal, False

    @property
    def _goal(self) -> float:
        return self.start if self.backwards else self.end
