"""How often messages came, and the longest that one was waited for: over the time of a flight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.model import Array

BINS = 120


@dataclass(frozen=True, slots=True, eq=False)
class Rates:
    """One message, in equal stretches of time."""

    t: Array  # (B,) s, boot clock, middle of each stretch
    hz: Array  # (B,) messages a second in it
    gap_s: Array  # (B,) the longest time between two messages that reaches into it


def rates(t: Array, first: float, last: float, bins: int = BINS) -> Rates:
    """The rates and gaps of messages at `t` (N,) s, between two times (s): a second a stretch, or longer ones.

    A message that is late is a gap in every stretch that it is missed in; before the first and after the last too.
    """
    count = int(np.clip(last - first, 1, bins))
    edges = np.linspace(first, max(last, first + 1e-3), count + 1)
    hz = np.histogram(t, edges)[0] / np.diff(edges)
    times = np.concatenate([[first], t[(t > first) & (t < last)], [last]])
    waits = np.diff(times)
    gap = np.zeros(count)
    begin = np.clip(np.searchsorted(edges, times[:-1], side="right") - 1, 0, count - 1)
    end = np.clip(np.searchsorted(edges, times[1:], side="left") - 1, 0, count - 1)
    np.maximum.at(gap, begin, waits)
    np.maximum.at(gap, end, waits)
    for i in np.flatnonzero(end > begin + 1):  # a gap over several stretches
        gap[begin[i] : end[i] + 1] = np.maximum(gap[begin[i] : end[i] + 1], waits[i])
    return Rates((edges[:-1] + edges[1:]) / 2, hz, gap)
