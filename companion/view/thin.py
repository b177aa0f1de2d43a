"""Fewer points that look the same: choosing which samples of a long track a browser has to draw."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from companion.model import Array

Indices = npt.NDArray[np.intp]


def extremes(series: tuple[Array, ...], limit: int) -> Indices:
    """Indices of at most `limit` samples that keep the first, the last and every peak and dip of each series.

    The samples are cut into equal buckets and each bucket keeps the smallest and the largest value of each
    series, so that a spike of one sample stays visible however long the track is. `series` share one time axis
    and are finite; `limit` must leave room for a bucket (2 for each series, and 2 for the ends).
    """
    n = len(series[0])
    if n <= limit:
        return np.arange(n, dtype=np.intp)
    buckets = (limit - 2) // (2 * len(series))
    if buckets < 1:
        raise ValueError(f"{len(series)} series need a limit of {2 * len(series) + 2} points or more, got {limit}")
    edges = np.linspace(0, n, buckets + 1).astype(np.intp)
    kept = [0, n - 1]
    for values in series:
        for a, b in pairwise(edges):
            kept.append(int(a + np.argmin(values[a:b])))
            kept.append(int(a + np.argmax(values[a:b])))
    return np.unique(np.array(kept, dtype=np.intp))


def evenly(n: int, limit: int, keep: Indices | None = None) -> Indices:
    """Indices of about `limit` of `n` samples, evenly spread, the first and the last and those in `keep` among them."""
    if n <= limit:
        return np.arange(n, dtype=np.intp)
    spread = np.linspace(0, n - 1, limit).round().astype(np.intp)
    return spread if keep is None else np.union1d(spread, keep).astype(np.intp)


def windows(ends: Array, since: float, until: float, chunk: int, chunks: int) -> list[tuple[int, int]]:
    """For each chunk of a trail, the range of its own segments that lie between two times.

    `ends` (M,) s is the time at which each segment is complete, increasing. A chunk holds `chunk` segments.
    The ranges are half open and relative to the chunk; an empty one is `(0, 0)`.
    """
    first = int(np.searchsorted(ends, since, side="left"))
    last = int(np.searchsorted(ends, until, side="right"))
    ranges = []
    for begin in range(0, chunks * chunk, chunk):
        a, b = max(first - begin, 0), min(last - begin, chunk)
        ranges.append((a, b) if a < b else (0, 0))
    return ranges
