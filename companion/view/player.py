"""The play clock: which instant of the flight is shown, and how fast it moves. Knows nothing of what is shown."""

from __future__ import annotations

import math

SLOWEST, FASTEST = 0.1, 50.0  # times real time


class Player:
    """A clock over the interval `[start, end]` of a flight's boot clock, in seconds.

    It has no clock of its own: whoever owns it calls `advance` with the seconds that have passed in the room.
    """

    def __init__(self, start: float, end: float) -> None:
        self.playing = False
        self.loop = False
        self._speed = 1.0
        self.start, self.end, self.time = start, end, start
        self.load(start, end)

    def load(self, start: float, end: float, time: float | None = None) -> None:
        """Take another interval, at `time` as near as it allows (default: its start); speed and loop are kept."""
        if not (math.isfinite(start) and math.isfinite(end) and start <= end):
            raise ValueError(f"a play interval needs finite bounds in order, got [{start}, {end}]")
        self.start, self.end = start, end
        self.seek(start if time is None else time)

    @property
    def duration(self) -> float:
        """Length of the interval, s."""
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
        if not self.playing and self.time >= self.end:
            self.time = self.start
        self.playing = not self.playing

    def seek(self, time: float) -> None:
        """Go to `time`, or to the nearest bound. Something that is no number is ignored."""
        if math.isfinite(time):
            self.time = min(max(time, self.start), self.end)

    def step(self, seconds: float) -> None:
        """Pause and move by `seconds`, forward or back."""
        self.playing = False
        self.seek(self.time + seconds)

    def advance(self, dt: float) -> None:
        """Let `dt` seconds of the room pass. At the end: pause there, or start over when looping."""
        if not self.playing or not 0 < dt < math.inf:
            return
        time = self.time + dt * self._speed
        if time < self.end:
            self.time = time
        elif self.loop and self.duration > 0:
            self.time = self.start + (time - self.start) % self.duration
        else:
            self.time, self.playing = self.end, False
