"""What the charts draw: series over time, thinned so that no peak is lost, with their gaps and their envelope."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.model import Array
from companion.view.state.decimation import Indices, extremes

MOST_POINTS = 250
"""Points a chart: a moving cursor resends them all, several times a second, to every browser."""
MOST_GAPS = 20
"""Gaps a chart can show; of more, the longest."""


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """What one chart draws: thinned and finite."""

    t: Array  # (M,) s, boot clock
    values: tuple[Array, ...]  # each (M,)
    gap: Array  # (M,) 1 where the autopilot's state is not known, else 0

    def at(self, now: float) -> tuple[Array, ...]:
        """The chart's columns: times, values, and a last one that shades the gaps and has a line at `now`.

        On a scale of 0 to 1 a gap is a block from edge to edge (2), and elsewhere the column's base lies out of sight
        (-1). The line leaps from the base to the other and back. A gap of NaN would do as well, but then a number that
        is not finite would be on its way to the screen.
        """
        k = int(np.searchsorted(self.t, now))
        inserted = (np.insert(v, k, [np.interp(now, self.t, v)] * 3) for v in self.values)
        inside = float(self.gap[min(k, len(self.gap) - 1)] * self.gap[max(k - 1, 0)])
        here = np.array([inside, 1 - inside, inside])
        shade = 3 * np.insert(self.gap, k, here) - 1
        return (np.insert(self.t, k, [now] * 3), *inserted, shade)


def curves(
    lines: Sequence[tuple[Array, Array]],
    known: tuple[Array, Array] | None = None,
    part: tuple[float, float] | None = None,
    most: int = MOST_POINTS,
) -> Curves:
    """Thin lines, each times (N,) and values (N,), to `most` points on one time axis, keeping every peak of each.

    Lines with the same array of times share their points; the others are drawn straight between their own.
    known: times and flags, False (0) where the autopilot's state is not known. part: s, only what lies between two
    times, and one sample more on either side so that the lines reach the edges.
    """
    groups: dict[int, tuple[Array, list[Array]]] = {}
    for t, values in lines:
        cut = _cut(t, part)
        groups.setdefault(id(t), (t[cut], []))[1].append(values[cut])
    gaps, flags, edges = np.zeros(1), np.zeros(1), np.zeros(0)
    if known is not None:
        cut = _cut(known[0], part)
        gaps = known[0][cut]
        beside, flags = _edges(gaps, 1.0 - known[1][cut])
        edges = gaps[beside]
    share = (most - len(edges)) // len(groups)
    kept = [t[extremes(tuple(values), max(share, 2 * len(values) + 2))] for t, values in groups.values() if len(t)]
    times = np.unique(np.concatenate([*kept, edges]))
    drawn = tuple(np.interp(times, t, v) if len(t) else np.zeros(len(times)) for t, v in lines)
    last = np.clip(np.searchsorted(gaps, times, side="right") - 1, 0, len(gaps) - 1)
    return Curves(times, drawn, flags[last])


def _cut(t: Array, part: tuple[float, float] | None) -> slice:
    if part is None:
        return slice(0, len(t))
    low = max(int(np.searchsorted(t, part[0], side="right")) - 1, 0)
    return slice(low, min(int(np.searchsorted(t, part[1], side="left")) + 1, len(t)))


def _edges(t: Array, gap: Array) -> tuple[Indices, Array]:
    """The samples on both sides of where a gap begins or ends, and the gaps without those too many to show."""
    flags = np.concatenate([[0.0], gap, [0.0]])
    begins, ends = np.flatnonzero(np.diff(flags) > 0), np.flatnonzero(np.diff(flags) < 0)  # [begin, end)
    if len(begins) > MOST_GAPS:
        longest = np.sort(np.argsort(t[ends - 1] - t[begins])[-MOST_GAPS:])
        begins, ends = begins[longest], ends[longest]
        gap = np.zeros(len(t))
        for begin, end in zip(begins, ends, strict=True):
            gap[begin:end] = 1.0
    beside = np.concatenate([begins - 1, begins, ends - 1, ends])
    return np.unique(beside[(beside >= 0) & (beside < len(t))]).astype(np.intp), gap
