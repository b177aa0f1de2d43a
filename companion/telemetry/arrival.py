"""How messages arrived: count, rate, longest gap, copies."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
import numpy.typing as npt

from companion.mavlink import Messages
from companion.model import Array, MessageStats
from companion.telemetry.clock import device_time
from companion.telemetry.lazy import Lazy

_ECHO_S = 2.0  # two identical frames within this time are one packet heard twice


def arrivals(messages: Mapping[str, Messages], timed: Mapping[str, Messages]) -> Mapping[str, MessageStats]:
    """The statistics of a flight's messages by name, each made when it is asked for; timed: with boot times.

    By device time where the message carries it, else by the log's stamps. No message is kept for it, only its times.
    """
    makers: dict[str, Callable[[], MessageStats]] = {}
    for name in sorted(messages):
        one = messages[name]
        own = device_time(one)
        if own is None:
            makers[name] = partial(_stamped, one.log_time, one.crc, one.seq)
        else:
            makers[name] = partial(arrival, timed[name].t if name in timed else own, _copies(one, own))
    return Lazy(makers)


def _stamped(log_time: Array, crc: npt.NDArray[np.uint16], seq: npt.NDArray[np.uint8]) -> MessageStats:
    return arrival(log_time, _echoes(log_time, crc, seq))


def arrival(times: Array, duplicates: int) -> MessageStats:
    """The statistics of messages at times (N,) s; those without a time (NaN) count, and that is all."""
    gaps = np.diff(times)
    in_order = (gaps >= 0).all()  # though perhaps several at once
    gaps = gaps[gaps > 0] if in_order else np.diff(np.unique(times[np.isfinite(times)]))
    if not len(gaps):
        return MessageStats(len(times), None, None, duplicates)
    known = times[np.isfinite(times)]
    span = float(known.max() - known.min())
    return MessageStats(len(times), (len(known) - 1) / span, float(gaps.max()), duplicates)


def _copies(messages: Messages, own: Array) -> int:
    """How many messages have the device time and content of another."""
    if (np.diff(own) > 0).all():
        return 0
    order = np.argsort(own, kind="stable")
    again = np.flatnonzero(np.diff(own[order]) == 0)
    rows = np.ascontiguousarray(messages.rows).view(np.dtype((np.void, messages.rows.dtype.itemsize)))
    return int((rows[order[again]] == rows[order[again + 1]]).sum())


def _echoes(log_time: Array, crc: npt.NDArray[np.uint16], seq: npt.NDArray[np.uint8]) -> int:
    """How many frames without a device time are one that was heard just before: the same CRC, which covers `seq`."""
    frame = crc.astype(np.uint32) << 8 | seq
    order = np.argsort(frame, kind="stable")  # in file order among equals
    same = np.flatnonzero(np.diff(frame[order]) == 0)
    apart = log_time[order[same + 1]] - log_time[order[same]]
    return int((apart < _ECHO_S).sum())
