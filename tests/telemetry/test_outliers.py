"""What is damage and what is motion: whatever a vehicle can do, at any rate of sampling, stays."""

from __future__ import annotations

import numpy as np
import pytest

from companion.strapdown import quaternion
from companion.telemetry.samples import FASTEST, STRONGEST, lone, lone_fields, lone_turns, readable

RATES = pytest.mark.parametrize("hertz", [1.0, 4.0, 25.0, 250.0])
N, FINE = 250, 10  # samples, and steps between two of them


def turning(hertz: float, fastest: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (N,), attitudes (N, 4) and rates (N, 3) of a body whose rate wanders, up to `fastest` rad/s."""
    rng = np.random.default_rng(seed)
    dt = 1.0 / hertz / FINE
    knots = rng.uniform(-1.0, 1.0, (N * FINE // 5 + 2, 3))
    at = np.arange(N * FINE) / 5.0
    rates = np.column_stack([np.interp(at, np.arange(len(knots)), axis) for axis in knots.T])
    rates *= fastest / np.linalg.norm(rates, axis=1).max()
    q = [np.array([1.0, 0.0, 0.0, 0.0])]
    for step in quaternion.exp(rates[:-1] * dt):
        q.append(quaternion.multiply(q[-1], step))
    every = slice(None, None, FINE)
    return np.arange(N) / hertz, np.array(q)[every], rates[every]


@RATES
@pytest.mark.parametrize("fastest", [0.0, 1.0, 7.0, 35.0])
def test_no_turn_is_damage(hertz: float, fastest: float) -> None:
    """Nor the field that a compass feels in it: up to the end of a usual gyro's range."""
    t, q, rates = turning(hertz, fastest, seed=1)
    assert not lone_turns(t, q, rates).any()
    field = quaternion.rotate(quaternion.conjugate(q), np.tile([20e-6, 0.0, 45e-6], (N, 1)))
    assert not lone_fields(t, field).any()


@RATES
def test_steps_and_pairs_are_no_damage(hertz: float) -> None:
    """A reset stays, and of two odd samples beside each other it is not known which are right."""
    t, q, rates = turning(hertz, 0.05, seed=2)
    q[100:] = quaternion.multiply(np.array([0.0, 0.0, 0.0, 1.0]), q[100:])
    q[200:202] = quaternion.multiply(np.array([0.0, 1.0, 0.0, 0.0]), q[200:202])
    assert not lone_turns(t, q, rates).any()
    place = np.zeros((N, 3))
    place[100:] = 500.0
    place[200:202, 1] = -500.0
    assert not lone(place).any()


@RATES
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_one_sample_away_is_damage(hertz: float, sign: float) -> None:
    t, q, rates = turning(hertz, 0.05, seed=3)
    q[150] = sign * quaternion.multiply(q[150], np.array([0.0, 1.0, 0.0, 0.0]))
    assert np.flatnonzero(lone_turns(t, q, rates)).tolist() == [150]
    place = np.outer(np.arange(N), [1.0, 0.5, 0.0]) / hertz
    place[150, 2] += 508.0
    assert np.flatnonzero(lone(place)).tolist() == [150]
    field = np.tile([20e-6, 0.0, 45e-6], (N, 1))
    field[150] *= 100.0
    assert np.flatnonzero(lone_fields(t, field)).tolist() == [150]


def test_without_rates_a_turn_within_the_range_of_a_gyro_is_none() -> None:
    t, q, _ = turning(4.0, 0.05, seed=4)
    q[150] = quaternion.multiply(q[150], np.array([0.0, 1.0, 0.0, 0.0]))
    assert not lone_turns(t, q, None).any(), "at 4 Hz a body may turn over and back"
    assert lone_turns(t / 100.0, q, None).sum() == 1, "at 400 Hz none can"


@pytest.mark.parametrize(("times", "damaged"), [(1.5, False), (2.8, False), (4.5, True)])
def test_between_two_samples_a_vehicle_may_turn_up_to_three_times_as_fast_as_at_both(
    times: float, damaged: bool
) -> None:
    """A swing of 4 rad/s at the samples of 10 Hz: what a gyro read there explains a turn of 0.4 rad at least."""
    rate, period = 4.0, 0.1
    q = np.tile(quaternion.IDENTITY, (N, 1))
    q[150] = quaternion.exp(np.array([0.0, 0.0, times * rate * period + np.radians(9.0)]))
    rates = np.tile([0.0, 0.0, rate], (N, 1))
    assert lone_turns(period * np.arange(N, dtype=np.float64), q, rates).any() == damaged


@pytest.mark.parametrize(("times", "damaged"), [(3.0, False), (9.0, False), (11.0, True)])
def test_a_place_is_astray_that_lies_ten_times_as_far_off_as_its_neighbours_are_apart(
    times: float, damaged: bool
) -> None:
    """A receiver that is corrected by 20 m within a second may well have been 100 m off."""
    place = np.zeros((N, 2))
    place[150], place[151:] = [10.0, 20.0 * times], [20.0, 0.0]
    assert lone(place).any() == damaged


def test_what_a_part_can_read_is_readable() -> None:
    """Up to its range on three axes at once, turned into the axes of the body, and calibrated."""
    full = np.array([[1.0, 1.0, 1.0], [-1.7, 0.0, 0.0]])
    assert readable(full * FASTEST, full * STRONGEST).all()
    assert readable(full * 35.0, full * 157.0, (35.0, 157.0)).all()
    assert not readable(full[:1] * 71.0, full[:1], (35.0, 157.0)).any()
    for wrong in (np.nan, np.inf, -np.inf, 1e30):
        odd = np.array([[0.0, wrong, 0.0], [0.0, 0.0, 0.0]])
        assert readable(odd, np.zeros((2, 3))).tolist() == [False, True]
        assert readable(np.zeros((2, 3)), odd).tolist() == [False, True]
