"""Shift and interval against SciPy's tests, which count the same arrangements another way."""

from __future__ import annotations

import numpy as np
import pytest

from companion.verdict.difference import shift

SIZES = [(5, 5), (8, 20), (30, 17), (60, 80), (1, 200), (3, 4), (1, 1), (2, 30)]


@pytest.mark.parametrize(("n", "m"), SIZES)
@pytest.mark.parametrize("seed", range(4))
def test_the_interval_is_where_mann_and_whitney_no_longer_object(n: int, m: int, seed: int) -> None:
    """A shift just inside the interval is not rejected at 5 %, one just outside it is."""
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=n), rng.normal(0.7, 2.0, size=m)
    found = shift(a, b, paired=False)
    assert found.low <= found.estimate <= found.high
    assert found.estimate == pytest.approx(np.median(np.subtract.outer(b, a)))

    from scipy import stats  # noqa: PLC0415  (half a second, which processes without this test are spared)

    def p(moved: float) -> float:
        if max(n, m) <= 50:
            return float(stats.mannwhitneyu(b - moved, a, method="exact").pvalue)
        return float(stats.mannwhitneyu(b - moved, a, method="asymptotic").pvalue)

    if np.isinf(found.low):
        assert p(-1e9) > 0.05, "so few values that nothing can be rejected"
        return
    assert p(found.low + 1e-9) > 0.05 > p(found.low - 1e-9) * 0.999
    assert p(found.high - 1e-9) > 0.05 > p(found.high + 1e-9) * 0.999


@pytest.mark.parametrize("n", [2, 5, 6, 12, 40, 90])
@pytest.mark.parametrize("seed", range(4))
def test_the_interval_of_pairs_is_where_wilcoxon_no_longer_objects(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    a = rng.normal(size=n)
    b = a + rng.normal(0.3, 1.0, size=n)
    found = shift(a, b, paired=True)

    from scipy import stats  # noqa: PLC0415  (half a second, which processes without this test are spared)

    def p(moved: float) -> float:
        return float(stats.wilcoxon(b - a - moved, method="exact" if n <= 50 else "approx", correction=True).pvalue)

    if n < 6:
        assert np.isinf(found.low), "of five pairs none is rare enough"
        return
    assert p(found.low + 1e-9) > 0.05 > p(found.low - 1e-9) * 0.999
    assert p(found.high - 1e-9) > 0.05 > p(found.high + 1e-9) * 0.999


def test_the_interval_holds_the_truth_as_often_as_it_says() -> None:
    rng = np.random.default_rng(1)
    held = {False: 0, True: 0}
    for _ in range(400):
        a, b = rng.exponential(size=15), rng.exponential(size=20) + 0.5
        found = shift(a, b, paired=False)
        held[False] += found.low <= 0.5 <= found.high
        found = shift(a, a + 0.5 + rng.normal(size=15), paired=True)
        held[True] += found.low <= 0.5 <= found.high
    for count in held.values():
        assert 0.92 < count / 400 < 0.99


def test_nothing_changed() -> None:
    a = np.array([1.0, 5.0, 2.0, 8.0, 3.0, 9.0, 4.0])
    assert shift(a, a, paired=True) == shift(a, a.copy(), paired=True)
    same = shift(a, a, paired=True)
    assert (same.low, same.estimate, same.high) == (0.0, 0.0, 0.0)


def test_one_wild_value_does_not_matter() -> None:
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=30), rng.normal(3.0, size=30)
    wild = b.copy()
    wild[np.argmax(wild)] = 1e9
    found, tame = shift(a, wild, paired=False), shift(a, b, paired=False)
    assert found.estimate == pytest.approx(tame.estimate, abs=0.2)
    assert found.high == pytest.approx(tame.high, abs=0.5)


def test_very_many_values_cost_no_memory() -> None:
    rng = np.random.default_rng(3)
    found = shift(rng.normal(size=200_000), rng.normal(1.0, size=200_000), paired=False)
    assert found.low < 1.0 < found.high
    assert found.high - found.low < 0.3


def test_what_cannot_be_compared() -> None:
    with pytest.raises(ValueError, match="0 with 1"):
        shift(np.zeros(0), np.zeros(1), paired=False)
    with pytest.raises(ValueError, match="2 with 1"):
        shift(np.zeros(2), np.zeros(1), paired=True)
