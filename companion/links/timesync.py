"""How long a message takes, and what the vehicle's clock says: by TIMESYNC, there and back.

https://mavlink.io/en/services/timesync.html. ArduPilot (GCS_Common.cpp, handle_timesync) and PX4 (mavlink_timesync.cpp)
answer with the ns since their boot.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from statistics import median

from companion.links import requests
from companion.links.requests import Request
from companion.mavlink import Messages

_QUICK_S, _SLOW_S = 1.0, 5.0  # between two questions: until enough are answered, and after that
_ANSWER_S = 0.2  # within which an answer is due
_ENOUGH = 10
_KEPT = 20
_STEP_S = 0.5  # between two answers: the clock has been set, or the vehicle has rebooted
_RATE_AFTER_S = 60.0  # before a clock's rate can be told from the jitter of the link


@dataclass(frozen=True, slots=True)
class Clock:
    """What is known of a vehicle's clock."""

    latency_ms: float  # half of the way there and back, median; the 20 ms that a link gathers for are in it
    booted: float  # s UNIX, by our clock, when the vehicle's read zero
    rate_ppm: float | None  # by how much it runs faster than ours; None: not yet known
    steps: int  # how often it has been set, or has started again


class Timesync:
    """Asks and listens. Times in s of a steady clock, `unix` is what our clock says of the day."""

    def __init__(self) -> None:
        self._due = 0.0
        self._asked: deque[int] = deque(maxlen=4)  # ns, questions that may still be answered
        self._answers: deque[tuple[float, float]] = deque(maxlen=_KEPT)  # s: there and back; vehicle's clock minus ours
        self._first: tuple[float, float] | None = None  # s when, and what the difference was
        self._newest = 0.0
        self._steps = 0

    def next_request(self, now: float) -> Request | None:
        """What to send now, if anything."""
        if now < self._due:
            return None
        self._due = now + (_QUICK_S if len(self._answers) < _ENOUGH else _SLOW_S)
        self._asked.append(int(now * 1e9))
        return requests.timesync(self._asked[-1])

    def awaits(self, now: float) -> bool:
        """Whether an answer is due."""
        return bool(self._asked) and now - self._asked[-1] * 1e-9 < _ANSWER_S

    def hear(self, answers: Messages, now: float) -> None:
        """Take TIMESYNC messages of the vehicle; those that answer somebody else are passed over."""
        for theirs, ours in zip(answers["tc1"].tolist(), answers["ts1"].tolist(), strict=True):
            if theirs == 0 or ours not in self._asked:
                continue
            self._asked.remove(ours)
            way = now - ours * 1e-9
            difference = theirs * 1e-9 - (ours * 1e-9 + way / 2)
            if self._answers and abs(difference - self._answers[-1][1]) > _STEP_S:
                self._answers.clear()
                self._first = None
                self._steps += 1
            self._answers.append((way, difference))
            self._first = self._first or (now, difference)
            self._newest = now

    def clock(self, now: float, unix: float) -> Clock | None:
        """What is known; None before the first answer."""
        if not self._answers or self._first is None:
            return None
        _, difference = min(self._answers)  # the fastest is the truest
        since, before = self._first
        elapsed = self._newest - since
        rate = 1e6 * (difference - before) / elapsed if elapsed > _RATE_AFTER_S else None
        latency = median(way for way, _ in self._answers) / 2
        return Clock(1e3 * latency, unix - (now + difference), rate, self._steps)
