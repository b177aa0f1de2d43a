"""Two assessments side by side: what drifts more, what is expected, found and fitted, and what of it is no chance.

Also here: how far one set of values lies above another, and how sure that is: Hodges and Lehmann's shift with its
interval.

Of all differences between the two sets the median is the estimate; the interval is between the two differences that
the distribution of Mann and Whitney's U (paired: Wilcoxon's signed rank) puts at its ends. Neither assumes a
distribution of the values, and one wild window moves neither. Source: Hollander, Wolfe, Chicken, Nonparametric
Statistical Methods (2014), sections 3.2-3.3 (paired), 4.2-4.3.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from companion.comparison import NAMES, DriftRow, Expected, length
from companion.constants import num
from companion.model import Array, IntArray, brief, nearest
from companion.verdict.assessment import Assessment
from companion.verdict.finding import Finding


@dataclass(frozen=True, slots=True)
class Shift:
    """By how much values of b exceed values of a."""

    estimate: float
    low: float  # 95 % interval; infinite when there are too few values to bound it
    high: float


def shift(a: Array, b: Array, *, paired: bool) -> Shift:
    """The shift from a (N,) to b (M,); paired: both are of the same N occasions.

    Of very many values evenly spaced ones are taken. Raises ValueError for an empty set, or pairs of unequal number.
    """
    if not len(a) or not len(b) or (paired and len(a) != len(b)):
        raise ValueError(f"cannot compare {len(a)} with {len(b)} values")
    if paired:
        change = _some(b - a)
        first, second = np.triu_indices(len(change))
        differences = np.sort(0.5 * (change[first] + change[second]))  # Walsh averages
        n = len(change)
        counts, variance = _signed_ranks(n) if n <= num.RANK_EXACT else None, n * (n + 1) * (2 * n + 1) / 24
    else:
        a, b = _some(a), _some(b)
        n, m = len(a), len(b)
        differences = np.sort((b[:, None] - a).ravel())
        counts, variance = _rank_sums(n, m) if max(n, m) <= num.RANK_EXACT else None, n * m * (n + m + 1) / 12
    skip = _edge(counts, len(differences), variance)
    low, high = (differences[skip - 1], differences[-skip]) if skip else (-np.inf, np.inf)
    return Shift(float(np.median(differences)), float(low), float(high))


def _some(values: Array) -> Array:
    if len(values) <= num.RANK_MAX:
        return values
    return np.asarray(values[np.linspace(0, len(values) - 1, num.RANK_MAX).round().astype(np.intp)])


def _edge(counts: Array | None, count: int, variance: float) -> int:
    """Which difference from either end bounds the interval, counted from 1; 0 when none does.

    counts: how many arrangements give each value 0, 1, ... of the statistic; None: it is taken as normal.
    """
    if counts is None:
        return max(0, int(np.floor(count / 2 - num.Z_975 * np.sqrt(variance) + 0.5)))
    below = np.cumsum(counts) / counts.sum()
    return int(np.searchsorted(below, num.RANK_TAIL, side="right"))


def _rank_sums(n: int, m: int) -> Array:
    """How many ways of drawing n of the ranks 1 ... n + m give each value of Mann and Whitney's U, 0 ... n m."""
    ways = np.zeros((n + 1, n * (n + m) + 1))
    ways[0, 0] = 1.0
    for rank in range(1, n + m + 1):
        ways[1:, rank:] += ways[:-1, :-rank].copy()
    smallest = n * (n + 1) // 2
    return ways[n, smallest : smallest + n * m + 1]


def _signed_ranks(n: int) -> Array:
    """How many sets of the ranks 1 ... n have each sum, 0 ... n (n + 1) / 2: Wilcoxon's signed-rank statistic."""
    ways = np.zeros(n * (n + 1) // 2 + 1)
    ways[0] = 1.0
    for rank in range(1, n + 1):
        ways[rank:] += ways[:-rank].copy()
    return ways


QUANTITIES = ("attitude", "velocity", "position")


@dataclass(frozen=True, slots=True)
class Change:
    """How the errors of B's windows compare with those of A's, at one horizon, in one quantity."""

    ratio: float  # B's error as a multiple of A's: Hodges and Lehmann's shift of the logarithms
    low: float  # 95 % interval from the spread between windows; 0 and infinity when there are too few
    high: float
    paired: bool  # window by window of one flight, or one set of windows against another

    @property
    def direction(self) -> Literal["worse", "better", "same"]:
        """Worse or better when the interval leaves no room for "unchanged"."""
        return "worse" if self.low > 1.0 else "better" if self.high < 1.0 else "same"

    def worse_than(self, limit: float) -> bool:
        """Whether B is worse by more than this part (0.1 is 10 %), and by more than the spread between windows."""
        return self.direction == "worse" and self.ratio > 1.0 + limit


@dataclass(frozen=True, slots=True, eq=False)
class ContrastRow:
    """One horizon."""

    a: DriftRow
    b: DriftRow
    expected_a: Expected | None
    expected_b: Expected | None
    changes: Mapping[str, Change]  # attitude, velocity, position; what one of the two lacks is absent


@dataclass(frozen=True, slots=True)
class FigureChange:
    """A fitted error of the IMU that both flights tell."""

    name: str  # one of NAMES
    a: float
    b: float
    sigma: float  # of the difference

    @property
    def differs(self) -> bool:
        """Whether the difference is larger than both fits explain (95 %)."""
        return abs(self.b - self.a) > num.Z_975 * self.sigma


@dataclass(frozen=True, slots=True, eq=False)
class Contrast:
    """B held against A."""

    __repr__ = brief

    rows: tuple[ContrastRow, ...]  # the horizons that both have
    figures: tuple[FigureChange, ...]
    gone: tuple[Finding, ...]  # findings of kinds that only A has
    new: tuple[Finding, ...]  # ... that only B has
    kept: tuple[str, ...]  # kinds that both have

    def worse_than(self, limit: float) -> list[tuple[float, str, Change]]:
        """(horizon s, quantity, change) of all that is significantly worse by more than this part."""
        every = ((row.b.horizon_s, name, change) for row in self.rows for name, change in row.changes.items())
        return [one for one in every if one[2].worse_than(limit)]


def contrast(a: Assessment, b: Assessment, *, same_flight: bool) -> Contrast:
    """B against A; same_flight: both are of one flight, and each window of B is held against its own of A."""
    of_b = {row.horizon_s: (row, expected) for row, expected in zip(b.drift.rows, b.expected, strict=True)}
    of_a = zip(a.drift.rows, a.expected, strict=True)
    both = [(row, expected, *of_b[row.horizon_s]) for row, expected in of_a if row.horizon_s in of_b]
    rows = [ContrastRow(one, two, mine, theirs, _changes(one, two, same_flight)) for one, mine, two, theirs in both]
    kinds_a, kinds_b = ({(f.kind, f.side) for f in assessment.verdict.findings} for assessment in (a, b))
    gone = tuple(f for f in a.verdict.findings if (f.kind, f.side) not in kinds_b)
    new = tuple(f for f in b.verdict.findings if (f.kind, f.side) not in kinds_a)
    return Contrast(tuple(rows), _figures(a, b), gone, new, tuple(sorted({kind for kind, _ in kinds_a & kinds_b})))


def _changes(a: DriftRow, b: DriftRow, same_flight: bool) -> dict[str, Change]:
    of_a, of_b = np.arange(a.windows), np.arange(b.windows)
    if same_flight:
        of_a, of_b = _pairs(a.errors.anchor_s, b.errors.anchor_s, num.PAIRED_ANCHORS * a.horizon_s)
    if not len(of_a) or not len(of_b):
        return {}
    changes = {}
    for quantity in QUANTITIES:
        if quantity != "attitude" and (a.position_m is None or b.position_m is None):
            continue
        sizes = (length(getattr(row.errors, quantity)[chosen]) for row, chosen in ((a, of_a), (b, of_b)))
        moved = shift(*(np.log(np.maximum(size, num.LOG_MIN_ERROR)) for size in sizes), paired=same_flight)
        ratio, low, high = (float(np.exp(one)) for one in (moved.estimate, moved.low, moved.high))
        changes[quantity] = Change(ratio, low, high, same_flight)
    return changes


def _pairs(a: Array, b: Array, apart: float) -> tuple[IntArray, IntArray]:
    """Indices of the anchors a and b that are of the same window: settings can change which windows are usable."""
    if not len(a) or not len(b):
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    partner = nearest(b, a) if len(b) > 1 else np.zeros(len(a), np.intp)
    close = np.flatnonzero(np.abs(b[partner] - a) <= apart)
    return close, partner[close]


def _figures(a: Assessment, b: Assessment) -> tuple[FigureChange, ...]:
    first, second = a.calibration, b.calibration
    if first is None or second is None:
        return ()
    both = np.flatnonzero(np.logical_and(first.observable, second.observable))
    sigma = np.hypot(first.sigma, second.sigma)
    return tuple(FigureChange(NAMES[i], float(first.values[i]), float(second.values[i]), float(sigma[i])) for i in both)
