"""How messages arrived: count, rate, longest gap, copies."""

from __future__ import annotations

import numpy as np

from companion.mavlink import Messages
from companion.telemetry.clock import device_time
from companion.tracks import Array, MessageStats

_ECHO_S = 2.0  # two identical frames within this time are one packet heard twice


def message_stats(messages: Messages, t: Array) -> MessageStats:
    """Count, rate, gap and copies; by device time where the message carries it, else by the log's stamps."""
    times = t if device_time(messages) is not None else messages.log_time
    return arrival(times, _copies(messages))


def arrival(times: Array, duplicates: int) -> MessageStats:
    """The statistics of messages at times (N,) s."""
    gaps = np.diff(np.unique(times))
    if not len(gaps):
        return MessageStats(len(times), None, None, duplicates)
    return MessageStats(len(times), float(1.0 / np.median(gaps)), float(gaps.max()), duplicates)


def _copies(messages: Messages) -> int:
    """How many messages repeat another: the same device time and content, or the same frame heard again."""
    own = device_time(messages)
    if own is not None:
        order = np.argsort(own, kind="stable")
        rows = np.ascontiguousarray(messages.rows[order]).view(np.dtype((np.void, messages.rows.dtype.itemsize)))
        return int((rows[1:] == rows[:-1]).sum())
    order = np.lexsort((messages.log_time, messages.crc, messages.seq))
    same = (np.diff(messages.crc[order].astype(np.int64)) == 0) & (np.diff(messages.seq[order].astype(np.int64)) == 0)
    return int((same & (np.diff(messages.log_time[order]) < _ECHO_S)).sum())
