"""Noise that is learned: its limits, what lasts or stands alone of it, and the series of steps to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.estimation import smooth
from companion.estimation.iteration import estimate, start_of
from companion.estimation.learned_noise import FIRST_NOISE, Change, _further, coloured, noise_limits, outlier_weights
from companion.estimation.linearisation import linearise, preintegrate_imu
from companion.estimation.model import VELOCITY
from companion.estimation.setup import first_guess, set_up
from companion.estimation.system import Problem
from companion.model import STANDARD_GRAVITY, Array
from tests.estimation.sensed import BIASES, at, gps_of, sensed, true_states, with_imu


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


def heard_by_the_barometer(noise: Array) -> Problem:
    """The true states of a flight whose GPS is far better than its barometer, which errs by this at the keyframes."""
    flight, truth = sensed(240.0, "circle", rate=25.0, fixes_hz=2.5)
    (baro,) = flight.barometers
    t = set_up(flight, None, STANDARD_GRAVITY, None).t
    up = -at(t, truth.t, truth.position)[:, 2] + noise[: len(t)]
    heights = replace(baro, t=t, altitude=up, pressure=101325.0 - 12.0 * up, temperature=np.full(len(t), 20.0))
    setup = set_up(replace(flight, barometers=(heights,)), None, STANDARD_GRAVITY, None)
    scale = {one.name: 0.05 if one.name.startswith("gps") else 3.0 for one in setup.readings}
    states = true_states(setup, flight, truth)
    return linearise(
        setup, preintegrate_imu(setup, BIASES), states, FIRST_NOISE, scale, {}, start_of(setup, states).slow
    )


@pytest.mark.parametrize("memory", [0.0, 0.8])
def test_white_noise_of_an_imu_is_no_correlated_noise(memory: float) -> None:
    """Smoothed disturbances are correlated even where the noise is white: that of an AR(1) process is more."""
    flight, _ = sensed(120.0, "circle", rate=50.0)
    imu, rng = flight.imu(), np.random.default_rng(3)
    keyframes = np.floor(imu.t / 0.4).astype(np.intp)
    steps, noise = rng.normal(size=(keyframes[-1] + 1, 3)), np.zeros((keyframes[-1] + 1, 3))
    for i in range(1, len(noise)):
        noise[i] = memory * noise[i - 1] + steps[i]
    setup = set_up(
        with_imu(flight, replace(imu, accel=imu.accel + 0.5 * noise[keyframes])), None, STANDARD_GRAVITY, None
    )
    _, linear = estimate(setup, start_of(setup, first_guess(setup, flight)))
    grown = coloured(linear)["accel"]
    assert grown < 1.25 if memory == 0.0 else grown > 1.4


def test_readings_in_steps_are_never_believed_to_be_finer_than_their_steps() -> None:
    flight, _ = sensed(12.0, "circle", rate=50.0)

    def least(step: float) -> tuple[float, float]:
        imu = replace(flight.imu(), gyro_step=step, accel_step=10.0 * step)
        limits = noise_limits(set_up(with_imu(flight, imu), None, STANDARD_GRAVITY, None))
        return limits["gyro_noise"][0], limits["accel_noise"][0]

    (gyro, accel), (twice_gyro, twice_accel) = least(0.02), least(0.04)
    assert (twice_gyro, twice_accel) == pytest.approx((2.0 * gyro, 2.0 * accel)), "in proportion to the step"
    assert gyro > 10.0 * least(0.0)[0]
    assert accel > 10.0 * least(0.0)[1]


def test_a_reading_that_its_neighbours_contradict_counts_linearly_and_several_together_in_full() -> None:
    """Huber: a weight of (k / r)², so that its square counts k² however far off it is."""
    noise = np.random.default_rng(0).normal(size=601)
    noise[200] += 150.0
    noise[400:420] += 150.0
    linear = heard_by_the_barometer(noise)
    one = next(one for one in linear.measurements if one.name == "barometer")
    weight = outlier_weights(linear)["barometer"]
    alone, together = np.isin(one.keyframe, 200), np.isin(one.keyframe, np.arange(404, 416))
    assert weight[alone] == pytest.approx((4.0 / (150.0 / 1.5)) ** 2, rel=0.1)
    assert weight[together] == pytest.approx(np.ones(12))
    assert (weight[~alone & ~np.isin(one.keyframe, np.arange(394, 426))] == 1.0).all()


def test_a_receiver_whose_position_goes_as_its_velocity_errs_is_in_order() -> None:
    """Both come of one filter: an error of the motion that it sees is in the velocity, and adds up in the position."""
    squares = []
    for seed in range(3):
        flight, truth = sensed(60.0, rate=50.0, seed=seed)
        rng, dt, sigma = np.random.default_rng(seed), 0.02, 0.15  # m/s, for some 8 s
        motion, keeps = sigma * rng.normal(size=(len(truth.t), 3)) * [1.0, 1.0, 0.0], np.exp(-dt / 8.0)
        for k in range(1, len(motion)):
            motion[k] = keeps * motion[k - 1] + np.sqrt(1.0 - keeps**2) * motion[k]
        seen = replace(
            truth, position=truth.position + np.cumsum(motion, axis=0) * dt, velocity=truth.velocity + motion
        )
        best = smooth(replace(flight, gps=(gps_of(seen, rng, rate=5.0),)))
        assert best.explained == ()
        off = best.velocity[:, :2] - np.column_stack([np.interp(best.t, truth.t, v) for v in truth.velocity.T[:2]])
        squares.append(np.mean((off / best.sigma(VELOCITY)[:, :2]) ** 2))
    assert np.mean(squares) < 5.0  # three times the usual error: a prior of its size holds it back


@pytest.mark.parametrize("walk", [0.0, 6e-4])  # rad/s/√s
def test_the_walk_of_a_gyro_that_wanders_is_learned(walk: float) -> None:
    """One that stands still is believed to walk as parts do."""
    flight, _ = sensed(240.0, "circle", rate=25.0)
    imu = flight.imu()
    steps = np.random.default_rng(4).normal(size=(len(imu), 3)) * walk / np.sqrt(imu.rate_hz)
    setup = set_up(with_imu(flight, replace(imu, gyro=imu.gyro + steps.cumsum(axis=0))), None, STANDARD_GRAVITY, None)
    settled, _ = estimate(setup, start_of(setup, first_guess(setup, flight)))
    assert settled.noise.gyro_walk == pytest.approx(max(walk, FIRST_NOISE.gyro_walk), rel=0.5)


@pytest.mark.parametrize("size", [0.01, 0.05])  # rad/s
def test_a_step_of_a_gyro_is_a_fault_and_no_walk(size: float) -> None:
    flight, _ = sensed(240.0, "circle", rate=25.0)
    imu = flight.imu()
    off = np.where(imu.t > 140.0, size, 0.0)[:, None] * [0.0, 1.0, 0.0]
    best = smooth(with_imu(flight, replace(imu, gyro=imu.gyro + off)))
    assert [one.kind for one in best.explained] == ["gyro_bias"]
    assert best.noise.gyro_walk < 2.0 * FIRST_NOISE.gyro_walk
