"""What is sent to the browsers, how often, and no more than is seen: few samples of a long track.

What a node or a control shows already is not sent again: viser compares before it sends.
"""

from __future__ import annotations

import heapq

import numpy as np
import numpy.typing as npt

from companion.model import Array

Indices = npt.NDArray[np.intp]


class Cadence:
    """When each of several things is due again. rates: Hz of each, by its name."""

    def __init__(self, **rates: float) -> None:
        self._rates = rates
        self._due = dict.fromkeys(rates, 0.0)

    def __call__(self, what: str, now: float) -> bool:
        """Whether it is due at `now`, s; if so, it has been taken."""
        if now < self._due[what]:
            return False
        self._due[what] = now + 1.0 / self._rates[what]
        return True

    def at_once(self, *what: str) -> None:
        """These are due at the next look; none named: all."""
        self._due.update(dict.fromkeys(what or self._rates, 0.0))

    def wait(self, what: str, until: float) -> None:
        """This is not due before."""
        self._due[what] = until


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
    first, longest = edges[:-1], int(np.diff(edges).max())
    members = np.minimum(first[:, None] + np.arange(longest), edges[1:, None] - 1)  # shorter ones repeat their last
    kept = [np.array([0, n - 1])]
    for values in series:
        in_buckets = values[members]
        kept += [first + in_buckets.argmin(axis=1), first + in_buckets.argmax(axis=1)]
    return np.unique(np.concatenate(kept)).astype(np.intp)


def evenly(n: int, limit: int) -> Indices:
    """Indices of at most `limit` of `n` samples, evenly spread, the first and the last among them."""
    return np.linspace(0, n - 1, min(n, limit)).round().astype(np.intp)


def by_shape(points: Array, limit: int, among: Indices | None = None) -> Indices:
    """Indices of at most `limit` of `points` (N, 3) between which straight lines stay closest to the path.

    Douglas and Peucker (1973) from the top: the line that is farthest from its part of the path is split there, again
    and again. First and last are kept; a path that stands still needs two points. among: the same for a higher limit,
    which holds all that this one chooses: few points are looked at in place of all.
    """
    if among is not None:
        return among if len(among) <= limit else among[by_shape(points[among], limit)]
    n = len(points)
    if n <= 2:
        return np.arange(n, dtype=np.intp)
    axes = np.ascontiguousarray(points.T)
    waiting = [_farthest(axes, 0, n - 1)]
    kept = [0, n - 1]
    rounding = (1e-9 * float(np.ptp(points, axis=0).max())) ** 2
    while waiting and len(kept) < limit:
        distance, first, middle, last = heapq.heappop(waiting)
        if -distance <= rounding:  # negative, so that the farthest comes first
            break
        kept.append(middle)
        for a, b in ((first, middle), (middle, last)):
            if b - a > 1:
                heapq.heappush(waiting, _farthest(axes, a, b))
    return np.unique(np.array(kept, dtype=np.intp))


def _farthest(axes: Array, first: int, last: int) -> tuple[float, int, int, int]:
    """Minus the squared distance of the point farthest from the line of two of them, (3, N), and the three indices."""
    begin = axes[:, first]
    line, away = axes[:, last] - begin, axes[:, first + 1 : last] - begin[:, None]
    length = float(line @ line)
    if length > 0:
        share = line @ away
        share /= length
        np.maximum(share, 0.0, out=share)  # np.clip takes longer than all else for a few points
        np.minimum(share, 1.0, out=share)
        away -= line[:, None] * share
    distances = np.einsum("ij,ij->j", away, away)
    middle = int(distances.argmax())
    return -float(distances[middle]), first, first + 1 + middle, last


def windows(ends: Array, since: float, until: float, chunk: int) -> list[tuple[int, int, int]]:
    """The chunks of a trail that lie between two times: of each its number, and the range of its own segments.

    `ends` (M,) s is the time at which each segment is complete, increasing. A chunk holds `chunk` segments. The ranges
    are half open and relative to the chunk; empty ones are left out.
    """
    first = int(np.searchsorted(ends, since, side="left"))
    last = int(np.searchsorted(ends, until, side="right"))
    return [
        (i, max(first - i * chunk, 0), min(last - i * chunk, chunk))
        for i in range(first // chunk, -(-last // chunk))
        if last > first
    ]
