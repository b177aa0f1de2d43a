"""How far one set of values lies above another, and how sure that is: Hodges and Lehmann's shift with its interval.

Of all differences between the two sets the median is the estimate; the interval is between the two differences that
the distribution of Mann and Whitney's U (paired: Wilcoxon's signed rank) puts at its ends. Neither assumes a
distribution of the values, and one wild window moves neither. Source: Hollander, Wolfe, Chicken, Nonparametric
Statistical Methods (2014), sections 3.2-3.3 (paired), 4.2-4.3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.constants import num
from companion.model import Array


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
        skip = _edge(
            _signed_ranks(n) if n <= num.RANK_EXACT else None, len(differences), n * (n + 1) * (2 * n + 1) / 24
        )
    else:
        a, b = _some(a), _some(b)
        n, m = len(a), len(b)
        differences = np.sort((b[:, None] - a).ravel())
        skip = _edge(_rank_sums(n, m) if max(n, m) <= num.RANK_EXACT else None, n * m, n * m * (n + m + 1) / 12)
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
