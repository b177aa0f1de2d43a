"""What the charts draw: series over time, thinned so that no peak is lost, with their gaps and their envelope."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.tracks import Array
from companion.view.thin import Indices, extremes

MOST_POINTS = 250
"""Points a chart: a moving cursor resends them all, several times a second, to every browser."""
MOST_HOLES = 20
"""Gaps a chart can show; of more, the longest."""


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """What one chart draws: thinned and finite."""

    t: Array  # (M,) s, boot clock
    values: tuple[Array, ...]  # each (M,)
    hole: Array  # (M,) 1 where the autopilot's state is not known, else 0

    def at(self, now: float) -> tuple[Array, ...]:
        """The chart's columns: times, values, and a last one that shades the holes and has a line at `now`.

        On a scale of 0 to 1 a hole is a block from edge to edge (2), and elsewhere the column's base lies out of sight
        (-1). The line leaps from the base to the other and back. A gap of NaN would do as well, but then a number that
        is not finite would be on its way to the screen.
        """
        k = int(np.searchsorted(self.t, now))
        inserted = (np.insert(v, k, [np.interp(now, self.t, v)] * 3) for v in self.values)
        inside = float(self.hole[min(k, len(self.hole) - 1)] * self.hole[max(k - 1, 0)])
        here = np.array([inside, 1 - inside, inside])
        shade = 3 * np.insert(self.hole, k, here) - 1
        return (np.insert(self.t, k, [now] * 3), *inserted, shade)


def curves(
    t: Array, values: Sequence[Array], known: Array | None = None, part: tuple[float, float] | None = None
) -> Curves:
    """Thin `values` (each (N,)) over `t` (N,) to what a chart can draw, keeping every peak.

    known: (N,), False (0) where the autopilot's state is not known. part: s, only what lies between two times, and one
    sample more on either side so that the lines reach the edges.
    """
    low, high = 0, len(t)
    if part is not None:
        low = max(int(np.searchsorted(t, part[0], side="right")) - 1, 0)
        high = min(int(np.searchsorted(t, part[1], side="left")) + 1, len(t))
    t, values = t[low:high], [v[low:high] for v in values]
    hole = np.zeros(len(t)) if known is None else 1.0 - known[low:high]
    edges, hole = _edges(t, hole)
    kept = np.union1d(extremes(tuple(values), MOST_POINTS - len(edges)), edges)
    return Curves(t[kept], tuple(v[kept] for v in values), hole[kept])


def _edges(t: Array, hole: Array) -> tuple[Indices, Array]:
    """The samples on both sides of where a hole begins or ends, and the holes without those too many to show."""
    flags = np.concatenate([[0.0], hole, [0.0]])
    begins, ends = np.flatnonzero(np.diff(flags) > 0), np.flatnonzero(np.diff(flags) < 0)  # [begin, end)
    if len(begins) > MOST_HOLES:
        longest = np.sort(np.argsort(t[ends - 1] - t[begins])[-MOST_HOLES:])
        begins, ends = begins[longest], ends[longest]
        hole = np.zeros(len(t))
        for begin, end in zip(begins, ends, strict=True):
            hole[begin:end] = 1.0
    beside = np.concatenate([begins - 1, begins, ends - 1, ends])
    return np.unique(beside[(beside >= 0) & (beside < len(t))]).astype(np.intp), hole
