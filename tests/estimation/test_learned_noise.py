"""Steps of learning: a series of them is summed where it can be."""

from __future__ import annotations

import pytest

from companion.estimation.learned_noise import Change, _further


def taken(ratio: float, steps: int) -> tuple[float, list[Change]]:
    """How far off the logarithm of a density still is that began 1 off, where each plain step leaves `ratio` of it."""
    off, changes = 1.0, list[Change]()
    for _ in range(steps):
        changes.append(_further((ratio - 1.0) * off, changes[-1] if changes else None))
        off += changes[-1].size
    return off, changes


@pytest.mark.parametrize("ratio", [-0.95, -0.5, 0.5, 0.8])
def test_a_geometric_series_ends_at_its_second_step(ratio: float) -> None:
    """Also one that goes to and fro."""
    off, _ = taken(ratio, 2)
    assert off == pytest.approx(0.0, abs=1e-12)


def test_where_a_series_led_no_other_goes_on() -> None:
    """A step beside the long one before it says nothing of a series; and none is trusted for more than five steps."""
    off, changes = taken(0.95, 6)
    assert [one.plain for one in changes] == [True, False] * 3
    assert changes[1].size == pytest.approx(5.0 * 0.95 * changes[0].size)
    assert abs(off) < 0.95**12


def test_steps_that_are_no_series_are_taken_as_they_are() -> None:
    assert _further(0.1, Change(1.0, plain=True)) == Change(0.1, plain=True)
    assert _further(0.1, Change(0.0, plain=True)) == Change(0.1, plain=True)
    assert _further(-2.0, Change(0.1, plain=True)) == Change(-2.0, plain=True), "it grows"
