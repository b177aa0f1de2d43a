"""Thinning keeps what the eye would miss: peaks, ends, and the gaps at anchors."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.view.state.sending import by_shape, evenly, extremes, windows


@given(st.integers(1, 20_000), st.integers(10, 500), st.data())
def test_a_spike_of_one_sample_survives(n: int, limit: int, data: st.DataObject) -> None:
    values = np.sin(np.arange(n) / 50)
    where = data.draw(st.integers(0, n - 1))
    values[where] = data.draw(st.sampled_from([-9.0, 9.0]))
    kept = extremes((values, np.zeros(n)), limit)
    assert where in kept
    assert len(kept) <= max(limit, n if n <= limit else 0)


@given(st.integers(1, 5000), st.integers(6, 300))
def test_the_range_the_ends_and_the_order_are_kept(n: int, limit: int) -> None:
    values = np.random.default_rng(n).normal(size=n)
    kept = extremes((values,), limit)
    assert (np.diff(kept) > 0).all()
    assert (kept[0], kept[-1]) == (0, n - 1)
    assert (values[kept].min(), values[kept].max()) == (values.min(), values.max())


def test_every_series_keeps_its_own_peak() -> None:
    a, b = np.zeros(10_000), np.zeros(10_000)
    a[1234], b[1240] = 1.0, -1.0
    kept = extremes((a, b), 300)
    assert {1234, 1240} <= set(kept.tolist())


def test_too_small_a_limit_is_refused() -> None:
    with pytest.raises(ValueError, match="2 series need a limit of 6"):
        extremes((np.zeros(100), np.zeros(100)), 5)


@given(st.integers(0, 99), st.integers(3, 60), st.integers(2, 30))
def test_the_shape_of_a_path_is_kept(seed: int, n: int, limit: int) -> None:
    """Both ends, never more than asked for, and everything once there is room."""
    path = np.random.default_rng(seed).normal(size=(n, 3)).cumsum(axis=0)
    kept = by_shape(path, limit)
    assert (np.diff(kept) > 0).all()
    assert {0, n - 1} <= set(kept.tolist())
    assert len(kept) <= max(limit, 2)
    assert len(by_shape(path, n)) == n


@given(st.integers(0, 99), st.integers(3, 200), st.integers(2, 30), st.integers(0, 30))
def test_a_rougher_shape_is_part_of_a_finer_one(seed: int, n: int, limit: int, more: int) -> None:
    path = np.random.default_rng(seed).normal(size=(n, 3)).cumsum(axis=0)
    assert by_shape(path, limit, among=by_shape(path, limit + more)).tolist() == by_shape(path, limit).tolist()


def test_a_straight_path_needs_its_ends_and_a_corner_itself() -> None:
    line = np.linspace([0.0, 0.0, 0.0], [10.0, 20.0, -5.0], 1000)
    assert by_shape(line, 100).tolist() == [0, 999]
    corner = np.concatenate([line, line[-1] + np.linspace([0.1, 0.0, 0.0], [30.0, 0.0, 0.0], 500)])
    assert by_shape(corner, 3).tolist() == [0, 999, 1499]
    assert by_shape(np.zeros((50, 3)), 10).tolist() == [0, 49], "it never moves"


def test_a_circle_of_an_hour_is_round() -> None:
    angle = np.linspace(0, 60 * np.pi, 36_000)
    path = 50 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    kept = by_shape(path, 600)
    middles = (path[kept[1:]] + path[kept[:-1]]) / 2
    assert (50 - np.linalg.norm(middles, axis=1)).max() < 0.04 * 50  # 20 points a turn, split in halves


@given(st.integers(1, 5000), st.integers(2, 500))
def test_an_even_choice_has_both_ends(n: int, limit: int) -> None:
    kept = evenly(n, limit)
    assert (np.diff(kept) > 0).all()
    assert {0, n - 1} <= set(kept.tolist())
    assert len(kept) == min(n, limit)


@given(st.integers(0, 200), st.floats(-5, 25), st.floats(-5, 25))
def test_windows_show_every_segment_between_the_times_once(m: int, since: float, until: float) -> None:
    ends = np.sort(np.random.default_rng(m).uniform(0, 20, m))
    shown = [20 * chunk + i for chunk, a, b in windows(ends, since, until, 20) for i in range(a, b)]
    assert shown == [i for i in range(m) if since <= ends[i] <= until]
