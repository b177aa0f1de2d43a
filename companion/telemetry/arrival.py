"""How messages arrived: count, rate, longest gap, copies."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from companion.mavlink import Messages
from companion.telemetry.clock import device_time
from companion.telemetry.lazy import Lazy
from companion.tracks import Array, MessageStats

_ECHO_S = 2.0  # two identical frames within this time are one packet heard twice


def arrivals(messages: Mapping[str, Messages]) -> Mapping[str, MessageStats]:
    """The statistics of a flight's messages by name."""
    return Lazy({name: partial(message_stats, messages[name]) for name in sorted(messages)})


def message_stats(messages: Messages) -> MessageStats:
    """Count, rate, gap and copies; by device time where the message carries it, else by the log's stamps."""
    own = device_time(messages)
    if own is None:
        return arrival(messages.log_time, _echoes(messages))
    return arrival(own, _copies(messages, own))


def arrival(times: Array, duplicates: int) -> MessageStats:
    """The statistics of messages at times (N,) s; those without a time (NaN) count, and that is all."""
    gaps = np.diff(times)
    if not (gaps > 0).all():
        gaps = np.diff(np.unique(times[np.isfinite(times)]))
    if not len(gaps):
        return MessageStats(len(times), None, None, duplicates)
    return MessageStats(len(times), float(1.0 / np.median(gaps)), float(gaps.max()), duplicates)


def _copies(messages: Messages, own: Array) -> int:
    """How many messages have the device time and content of another."""
    if (np.diff(own) > 0).all():
        return 0
    order = np.argsort(own, kind="stable")
    again = np.flatnonzero(np.diff(own[order]) == 0)
    rows = np.ascontiguousarray(messages.rows).view(np.dtype((np.void, messages.rows.dtype.itemsize)))
    return int((rows[order[again]] == rows[order[again + 1]]).sum())


def _echoes(messages: Messages) -> int:
    """How many frames without a device time are one that was heard just before: the same CRC, which covers `seq`."""
    frame = messages.crc.astype(np.uint32) << 8 | messages.seq
    order = np.argsort(frame, kind="stable")  # in file order among equals
    same = np.flatnonzero(np.diff(frame[order]) == 0)
    apart = messages.log_time[order[same + 1]] - messages.log_time[order[same]]
    return int((apart < _ECHO_S).sum())
