"""How far the reckoning should be off, against sensors that are off by that much."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import chdtri

from companion.comparison import GENERIC, ReferenceSpec, compare, windows
from companion.comparison.budget import (
    ATTITUDE,
    POSITION,
    VELOCITY,
    budget,
    expected_over,
    nees,
    shares_of,
    stacked,
    window_noise,
)
from companion.constants import num
from companion.model import rows
from companion.strapdown import ImuModel, Sensor, error_sums, motions, propagate, simulate
from tests.flights import flight_of, seconds

pytestmark = pytest.mark.slow

RNG = np.random.default_rng(6)
CERTAIN = ReferenceSpec(0, 0, 1e-7, 1e-6, 1e-6, 0, 0, 0)
"""An autopilot that knows the truth, and an IMU that is where it should be."""

FINE = replace(GENERIC, gyro=replace(GENERIC.gyro, residual_bias=GENERIC.gyro.residual_bias / 2.0))
"""In ten seconds the greater bias turns the IMU by more than the budget's first order holds for."""

MOTION = motions.circle(seconds(40, 50))


def drawn(seed: int) -> ImuModel:
    """An IMU of the generic kind: its biases drawn from what is left after calibration."""
    rng = np.random.default_rng(seed)
    return ImuModel(
        gyro=Sensor(
            noise_density=FINE.gyro.noise_density,
            bias_walk=FINE.gyro.bias_walk,
            bias=rng.normal(0, FINE.gyro.residual_bias, 3),
            matrix=np.eye(3) + np.diag(rng.normal(0, FINE.gyro.scale, 3)),
        ),
        accel=Sensor(
            noise_density=FINE.accel.noise_density,
            bias_walk=FINE.accel.bias_walk,
            bias=rng.normal(0, FINE.accel.residual_bias, 3),
            matrix=np.eye(3) + np.diag(rng.normal(0, FINE.accel.scale, 3)),
        ),
    )


def test_errors_of_drawn_sensors_are_as_large_as_the_budget_says() -> None:
    """The mean NEES of 9 states over 150 sensors lies inside the 99 % band of chi-square, one window of each."""
    motion = motions.circle(seconds(11, 50))  # with one window of the longest horizon
    flight = flight_of(motion)
    normalised: dict[float, list[float]] = {2.0: [], 10.0: []}
    for seed in range(150):
        comparison = compare(flight, track=simulate(motion.imu, drawn(seed), seed))
        for horizon, found in normalised.items():
            chosen = windows(comparison, horizon)
            allowed = budget(comparison, chosen, FINE, CERTAIN)
            found.append(float(nees(stacked(comparison, chosen), allowed.total)[0]))
    low, high = (float(chdtri(9 * 150, 1 - p)) / 150 for p in (0.005, 0.995))
    for horizon, found in normalised.items():
        assert low < np.mean(found) < high, f"{horizon:g} s"


def test_shares_sum_to_the_total() -> None:
    comparison = compare(flight_of(MOTION))
    allowed = budget(comparison, windows(comparison, 5.0), GENERIC, ReferenceSpec())
    for block in (ATTITUDE, VELOCITY, POSITION):
        shares = shares_of(allowed.power(block))
        assert sum(shares.values()) == pytest.approx(1.0)
        assert min(shares.values()) >= 0
    assert (np.linalg.eigvalsh(allowed.total) > 0).all()


@pytest.mark.parametrize("horizon", [0.5, 1.0, 5.0, 7.5])
def test_windows_that_share_a_pass_grow_as_by_themselves(horizon: float) -> None:
    comparison = compare(flight_of(MOTION))
    chosen = windows(comparison, horizon)
    shared, start = comparison.growth(chosen), chosen.start
    q, velocity = comparison.reference.q_ned_frd[start], comparison.reference.velocity[start]
    track, path = comparison.track, comparison.path
    exact = propagate(track, path, start, chosen.end, q, velocity)
    step = num.COVARIANCE_STEP_S if horizon.is_integer() else 0.0
    sums = error_sums(track, path, start, chosen.end, step_s=step)
    alone = propagate(track, path, start, chosen.end, q, velocity, sums=sums)
    for name in ("transition", "gyro_matrix", "accel_matrix", "time_offset"):
        np.testing.assert_allclose(getattr(shared, name), getattr(alone, name), atol=1e-10)
        every_sample = getattr(exact, name)
        np.testing.assert_allclose(getattr(shared, name), every_sample, atol=5e-3 * np.abs(every_sample).max())
    for cause, covariance in alone.noise.items():
        np.testing.assert_allclose(shared.noise[cause], covariance, rtol=1e-9, atol=1e-10)
        every_sample = exact.noise[cause]
        np.testing.assert_allclose(shared.noise[cause], every_sample, atol=5e-3 * np.abs(every_sample).max())


@pytest.mark.parametrize(("off", "follows", "allowed"), [(0.2, False, 0.2), (1.0, False, 0.25), (0.2, True, 0.0)])
def test_a_velocity_that_contradicts_its_own_position_is_allowed_for(
    off: float, *, follows: bool, allowed: float
) -> None:
    """Up to where an estimator in order has it; not an error that both have, which the IMU tells."""
    flight = flight_of(MOTION)
    position = flight.position
    assert position is not None
    north = np.array([off, 0.0, 0.0])
    moved = position.position + follows * (position.t - position.t[0])[:, None] * north
    astray = replace(flight, position=replace(position, velocity=position.velocity + north, position=moved))
    comparison = compare(astray)
    for horizon in (2.0, 5.0):
        own = budget(comparison, windows(comparison, horizon), GENERIC, CERTAIN)
        assert np.abs(own.error[:, POSITION][:, 0]) == pytest.approx(off * horizon * (not follows), abs=0.02)
        end = own.causes["autopilot_end"][:, POSITION, POSITION]
        assert np.sqrt(np.trace(end, axis1=1, axis2=2)) == pytest.approx(allowed * horizon, abs=0.03)


def test_one_cause_alone_is_the_textbook() -> None:
    """At rest a gyro bias b leans gravity over: g b t³/6 in two axes; gravity off by d: d t²/2 in one."""
    comparison = compare(flight_of(motions.rest(seconds(20, 100))))
    allowed = budget(comparison, windows(comparison, 10.0), GENERIC, ReferenceSpec())
    fall = allowed.causes["gravity"][0]
    assert np.sqrt(fall[8, 8]) == pytest.approx(0.003 * 10**2 / 2)
    lean = allowed.causes["gyro_bias"][0]
    assert np.sqrt(lean[6, 6]) == pytest.approx(9.80665 * GENERIC.gyro.residual_bias * 10**3 / 6, rel=1e-3)


def test_a_coarse_rate_is_mostly_sampling() -> None:
    def share(rate: float) -> float:
        comparison = compare(flight_of(motions.coning(seconds(40, rate))))
        return shares_of(budget(comparison, windows(comparison, 5.0), GENERIC, ReferenceSpec()).power(ATTITUDE))[
            "sampling"
        ]

    assert share(200) < 0.01
    assert share(8) > 0.9


def test_what_rk4_misses_of_an_even_turn_is_sampling() -> None:
    """2 rad from sample to sample, alike with both middle samples: what is missing is none of the IMU's."""
    comparison = compare(flight_of(motions.spin(seconds(20, 10), (0.1, 0.2, 20.0))))
    expected = expected_over(comparison, windows(comparison, 1.0), GENERIC, ReferenceSpec())
    assert expected is not None
    assert expected.inside["attitude"] == 1.0
    assert expected.shares["attitude"]["sampling"] > 0.9


def test_quantisation_of_a_sensor_that_reads_zero() -> None:
    """A reading of zero stands for anything within one step: uniform, 1/√3 of a step."""
    flight = flight_of(motions.rest(seconds(20, 100)))
    coarse = replace(flight.imu(), gyro_step=1e-3)
    comparison = compare(flight, track=coarse)
    allowed = budget(comparison, windows(comparison, 10.0), GENERIC, ReferenceSpec())
    found = np.sqrt(allowed.causes["quantisation"][0][0, 0])
    assert found == pytest.approx(1e-3 / np.sqrt(3) * 10, rel=0.01)


def test_readings_that_swing_across_steps_are_white_noise_of_a_step_over_root_twelve() -> None:
    """A rounded reading is off by step²/12, each by itself: over the time t a random walk of step² t / (12 rate)."""
    rate, duration, step = 100.0, 10.0, 0.02
    flight = flight_of(motions.rest(seconds(20, rate)))
    swing = np.where(np.arange(len(flight.imu())) % 2, 0.5, -0.5)[:, None] * np.ones(3)
    for sensor, block in (("gyro", ATTITUDE), ("accel", VELOCITY)):
        track = flight.imu()
        rounded = replace(track, **{sensor: getattr(track, sensor) + swing, f"{sensor}_step": step})
        comparison = compare(flight, track=rounded)
        chosen = windows(comparison, duration)
        found = budget(comparison, chosen, GENERIC, ReferenceSpec()).causes["quantisation"][:, block, block]
        expected = step**2 / (12.0 * rate) * duration
        assert found[:, [0, 1], [0, 1]] == pytest.approx(np.full((len(chosen.start), 2), expected), rel=0.02)


def test_the_noise_in_flight_is_measured() -> None:
    model = ImuModel(gyro=Sensor(noise_density=2e-3), accel=Sensor(noise_density=0.05))
    comparison = compare(flight_of(MOTION), track=simulate(MOTION.imu, model, 1))
    measured = np.median(
        window_noise(comparison.reading_means(windows(comparison, 5.0)), comparison.track.rate_hz), axis=0
    )
    assert measured == pytest.approx([2e-3, 0.05], rel=0.1)


@pytest.mark.parametrize("horizon", [1.0, 1.5])
def test_what_a_vehicle_does_in_a_gap_is_no_noise_of_the_window_behind_it(horizon: float) -> None:
    motion = motions.coning(seconds(20, 100), angle=0.4, frequency=0.25)
    heard = (motion.t <= 14.2) | (motion.t >= 16.0 - 1e-9)
    track = rows(motion.imu, heard)
    comparison = compare(flight_of(motion), track=track)
    chosen = windows(comparison, horizon)
    assert 16.0 in track.t[chosen.start].round(6)
    found = window_noise(comparison.reading_means(chosen), track.rate_hz)
    assert (found < [GENERIC.gyro.noise_density, GENERIC.accel.noise_density]).all()


def test_a_window_whose_covariance_cannot_be_inverted_costs_no_other() -> None:
    covariance = np.stack([np.eye(3), np.zeros((3, 3)), 4 * np.eye(3)])
    found = nees(np.ones((3, 3)), covariance)
    assert found[[0, 2]] == pytest.approx([3.0, 0.75])
    assert np.isnan(found[1])
