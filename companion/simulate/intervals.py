"""The message intervals of a simulated autopilot, and the rules of ArduPilot and PX4 for requests."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from companion.simulate.true_flight import LOOP_US

Autopilot = Literal["ardupilot", "px4"]

ACCEPTED, DENIED = 0, 2  # MAV_RESULT

_DISTINCT = 10
"""Distinct intervals that ArduPilot keeps for a link; a further one silently becomes the nearest of them."""


@dataclass(slots=True)
class _Stream:
    interval_us: int  # 0: not sent
    due_us: int


class Intervals:
    """Which message is due when.

    default: message → interval in µs at boot, 0 for one that is not sent. unlimited: those of them that PX4 sends at
    every update of their source, which comes so often.
    """

    def __init__(
        self, default: Mapping[str, int], autopilot: Autopilot, *, unlimited: Collection[str] = frozenset()
    ) -> None:
        self._default = dict(default)
        self._unlimited = set(unlimited)
        self._autopilot = autopilot
        self._streams = {name: _Stream(interval, 0) for name, interval in default.items()}

    def get(self, name: str) -> int:
        """The interval of MESSAGE_INTERVAL: µs, -1 for one that is not sent, 0 for one that is not known.

        PX4: 0 for one that is not sent, -1 for one without a limit (mavlink_receiver.cpp, get_message_interval).
        """
        if name not in self._streams:
            return 0
        interval = self._streams[name].interval_us
        if self._autopilot == "px4":
            return -1 if name in self._unlimited and interval == self._default[name] else interval
        return interval or -1

    def set(self, name: str, requested_us: float, now_us: int) -> int:
        """SET_MESSAGE_INTERVAL: ACCEPTED or DENIED (GCS_Common.cpp, set_message_interval)."""
        if name not in self._streams:
            return DENIED
        interval = int(requested_us)
        if interval == 0:
            interval = self._default[name]
        elif interval < 0:
            interval = 0
        elif self._autopilot == "ardupilot":
            milliseconds = interval // 1000  # requested 150 Hz, got 166.7
            if milliseconds < LOOP_US // 800:  # 333 Hz is the fastest at a 400 Hz loop
                return DENIED
            interval = self._nearest(name, milliseconds * 1000)
        self._streams[name] = _Stream(interval, now_us)
        return ACCEPTED

    @property
    def next_us(self) -> float:
        """When the next message is due; infinite when none is sent."""
        return min((stream.due_us for stream in self._streams.values() if stream.interval_us), default=math.inf)

    def due(self, now_us: int) -> list[str]:
        """The messages to send now."""
        due = []
        for name, stream in self._streams.items():
            if stream.interval_us and stream.due_us <= now_us:
                due.append(name)
                stream.due_us += stream.interval_us
                if stream.due_us < now_us - stream.interval_us:  # too far behind to make good
                    stream.due_us = now_us + stream.interval_us
        return due

    def schedule(self, name: str, now_us: int, count: int) -> npt.NDArray[np.int64]:
        """When a message that is sent now will be sent the next times, if nobody sets its interval: µs, (count,)."""
        stream = self._streams[name]
        due = stream.due_us + stream.interval_us * np.arange(count - 1)
        return np.concatenate(([now_us], -(-due // LOOP_US) * LOOP_US))

    def _nearest(self, name: str, interval: int) -> int:
        used = {stream.interval_us for other, stream in self._streams.items() if other != name} - {0}
        if interval in used or len(used) < _DISTINCT:
            return interval
        return min(used, key=lambda known: abs(known - interval))
