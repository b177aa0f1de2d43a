"""The best estimate of simulated flights whose truth is known, with every aiding sensor and without one."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.accuracy.verdicts import FAULTS
from benchmarks.accuracy.verdicts import flight as simulated
from companion.estimation import ATTITUDE, CONSTANTS, POSITION, VELOCITY, BestEstimate, smooth
from companion.estimation.model import corrected
from companion.estimation.setup import first_guess, set_up
from companion.model import STANDARD_GRAVITY, Array, Flight
from companion.strapdown import ImuModel, Motion, Sensor, quaternion, simulate
from tests.estimation.sensed import BIASES, LATENCY, compass_of, errors, nees, sensed, with_imu

pytestmark = pytest.mark.slow

FLIGHTS = (("square", 0), ("square", 1), ("circle", 2))
OUTAGE = (30.0, 45.0)


@cache
def estimated(path: str = "square", seed: int = 0) -> tuple[Flight, Motion, BestEstimate]:
    flight, truth = sensed(60.0, path, seed=seed, fixes_hz=5.0)
    return flight, truth, smooth(flight)


def without(flight: Flight, *names: str) -> Flight:
    return replace(flight, **dict.fromkeys(names, ()))  # type: ignore[arg-type]


def test_a_short_gap_of_the_imu_leaves_its_bias_known() -> None:
    """In a minute unheard an IMU may be calibrated anew, 20 mrad/s: in a second it changes by a sixtieth of that."""
    flight, _ = sensed(30.0, seed=3, rate=25.0)
    imu = flight.imu()
    kept = (imu.t < 24.0) | (imu.t > 25.0)
    gap = with_imu(flight, replace(imu, t=imu.t[kept], gyro=imu.gyro[kept], accel=imu.accel[kept]))
    before, after = (smooth(one).gyro_bias_sigma[-1] for one in (flight, gap))
    assert (after < 1.3 * np.hypot(before, 0.02 / 60.0)).all()


def heading(error: Array) -> Array:
    """(K,) the turn about down."""
    return error[:, 2]


def test_sigma_is_honest() -> None:
    """Mean NEES over flights: the dimension is 3, and what errors of neighbouring keyframes share widens the band."""
    found = [(estimate, errors(estimate, truth)) for _, truth, estimate in (estimated(*flight) for flight in FLIGHTS)]
    for block in (ATTITUDE, VELOCITY, POSITION):
        mean = np.mean([nees(estimate, error, block) for estimate, error in found])
        assert 0.3 < mean < 6.0


@pytest.mark.parametrize("seed", [1, 3])
def test_noise_that_a_steady_hover_hardly_tells_is_not_taken_for_none(seed: int) -> None:
    """What these flights tell of the gyro's noise is less than one reading's worth: most likely there is none."""
    flight, truth = sensed(60.0, "rest", rate=25.0, seed=seed)
    density = 7e-3, 0.3
    noisy = ImuModel(gyro=Sensor(density[0]), accel=Sensor(density[1]))
    imu = replace(simulate(truth.imu, noisy, np.random.default_rng(seed)), source="RAW_IMU")
    best = smooth(replace(with_imu(flight, imu), events=()))
    assert density[0] / 6.0 < best.noise.gyro_noise < 2.0 * density[0]
    assert best.noise.accel_noise == pytest.approx(density[1], rel=0.25)
    assert not best.explained


def test_nothing_is_explained_where_nothing_is_wrong() -> None:
    assert [estimated(*flight)[2].explained for flight in FLIGHTS] == [()] * len(FLIGHTS)


def test_a_compass_that_averages_is_read_when_it_was_read() -> None:
    """As autopilots do, over 0.1 s: of a vehicle that swings 1.5 times a second the field of now is another."""
    flight, truth = sensed(60.0, "coning", seed=1)
    best = smooth(replace(flight, compasses=(compass_of(truth, np.random.default_rng(5), averaged=10),)))
    place = CONSTANTS["compass_latency"][0]
    sigma = best.constants_sigma[place]
    assert sigma < 0.005
    assert np.abs(best.states.constants[place] - 0.045) < 2.0 * sigma
    assert not best.explained


def test_the_biases_and_the_latency_are_recovered() -> None:
    for flight in FLIGHTS:
        _, _, found = estimated(*flight)
        for bias, sigma, true in (
            (found.states.gyro_bias, found.gyro_bias_sigma, BIASES[0]),
            (found.states.accel_bias, found.accel_bias_sigma, BIASES[1]),
        ):
            assert (np.abs(bias - true) < 3.5 * sigma).mean() > 0.95
        latency = CONSTANTS["gps_latency"][0]
        off = found.states.constants[latency] - LATENCY
        assert np.abs(off) < max(4.0 * found.constants_sigma[latency], 0.01)


def test_it_is_better_than_each_aiding_sensor() -> None:
    _, truth, found = estimated()
    error = errors(found, truth)
    assert np.percentile(np.linalg.norm(error[:, :2], axis=1), 95) < np.radians(0.2)
    assert np.percentile(np.abs(heading(error)), 95) < np.radians(1.0)
    assert np.percentile(np.linalg.norm(error[:, VELOCITY], axis=1), 95) < 0.1  # the GPS: 0.1 a component
    assert np.percentile(np.linalg.norm(error[:, POSITION], axis=1), 95) < 0.6  # 0.4, 0.4 and 0.6 a component


@pytest.mark.parametrize("rate", [(1.0, 0.7, 0.3), (0.1, 0.05, 0.02)])
def test_an_autopilot_whose_attitude_is_lost_misleads_nobody(rate: tuple[float, float, float]) -> None:
    """Its attitude is where the iteration begins first: from one that turns by itself, rad/s, it finds no way back."""
    flight, truth, right = estimated()
    attitude = flight.attitude
    assert attitude is not None
    lost = quaternion.multiply(quaternion.exp(attitude.t[:, None] * np.array(rate)), attitude.q_ned_frd)
    best = smooth(replace(flight, attitude=replace(attitude, q_ned_frd=lost)))
    assert not best.explained
    apart = np.abs(errors(best, truth) - errors(right, truth))
    assert (apart < 0.05 * np.sqrt(np.diagonal(right.covariance, axis1=1, axis2=2))[:, :9] + 1e-9).all()


def test_where_it_begins_does_not_matter() -> None:
    """20° and 30 m away the same place is reached, to 1 % of σ."""
    flight, _, found = estimated()
    setup = set_up(flight, None, STANDARD_GRAVITY, None)
    near = first_guess(setup, flight)
    away = replace(
        near,
        q_ned_frd=quaternion.multiply(quaternion.exp(np.radians([14.0, -8.0, 12.0])), near.q_ned_frd),
        position=near.position + [20.0, -20.0, 10.0],
        velocity=near.velocity + [2.0, -1.0, 1.0],
    )
    other = smooth(flight, guess=away)
    apart = quaternion.log(quaternion.multiply(found.q_ned_frd, quaternion.conjugate(other.q_ned_frd)))
    assert np.abs(apart / found.sigma(ATTITUDE)).max() < 0.01
    assert np.abs((found.velocity - other.velocity) / found.sigma(VELOCITY)).max() < 0.01
    assert np.abs((found.position - other.position) / found.sigma(POSITION)).max() < 0.01


def test_a_plane_that_turns_and_turns_knows_how_late_its_gps_is() -> None:
    """A circle that comes later is a circle that is turned: only the compass tells them apart, and not well."""
    plane = next(fault for fault in FAULTS if fault.name.startswith("plane"))
    flight, _ = simulated(np.random.default_rng(2), plane)
    best = smooth(flight)
    (latency,), (sigma,) = best.states.constant("gps_latency"), best.constants_sigma[CONSTANTS["gps_latency"][0]]
    assert latency == pytest.approx(LATENCY, abs=3.0 * sigma)
    assert sigma > 0.03


def test_the_autopilots_estimate_aids_nothing() -> None:
    flight, _, found = estimated()
    other = smooth(replace(flight, attitude=None))
    np.testing.assert_allclose(other.position, found.position, atol=0.1 * float(found.sigma(POSITION).min()))


def test_a_late_fix_is_taken_where_the_vehicle_was() -> None:
    """At 3 m/s up and down in two seconds, 0.1 s of even acceleration from the fix on would be off by 0.15 m/s."""
    flight, truth = sensed(40.0, "heave", fixes_hz=5.0)
    found = smooth(flight)
    error = errors(found, truth)
    assert found.explained == ()
    assert error[:, VELOCITY].std(axis=0)[2] < 0.02  # of fixes of 0.1
    assert np.abs(np.median(found.states.accel_bias, axis=0) - BIASES[1])[2] < 0.03


def test_a_gps_outage_is_bridged_and_sigma_grows() -> None:
    flight, truth = sensed(60.0, seed=1)
    (gps,) = flight.gps
    lost = (gps.t > OUTAGE[0]) & (gps.t < OUTAGE[1])
    found = smooth(replace(flight, gps=(replace(gps, fix_type=np.where(lost, 1.0, gps.fix_type)),)))
    error, sigma = errors(found, truth), found.sigma(POSITION)
    middle = (found.t > OUTAGE[0] + 5) & (found.t < OUTAGE[1] - 5)
    outside = (found.t < OUTAGE[0] - 5) | (found.t > OUTAGE[1] + 5)
    assert sigma[middle, :2].max() > 1.5 * np.median(sigma[outside, :2])  # in which the slow error of the GPS stands
    assert np.abs(error[:, POSITION] / sigma).max() < 6.0
    assert np.linalg.norm(error[middle, :][:, POSITION], axis=1).max() < 10.0
    assert np.diff(found.t).max() < 1.5  # keyframes go on


def test_without_a_compass_heading_comes_from_acceleration() -> None:
    flight, truth, with_it = estimated()
    found = smooth(without(flight, "compasses"))
    assert (with_it.heading_from, found.heading_from) == ("compass", "GPS and acceleration")
    error, sigma = heading(errors(found, truth)), found.sigma(ATTITUDE)[:, 2]
    assert (np.abs(error) < 4.0 * sigma).mean() > 0.95
    assert sigma.max() < np.radians(20.0)
    assert sigma.mean() > with_it.sigma(ATTITUDE)[:, 2].mean()


def test_without_gps_attitude_is_all_there_is() -> None:
    flight, truth, with_it = estimated()
    found = smooth(without(flight, "gps"))
    assert any("no GPS" in note for note in found.notes)
    error, sigma = errors(found, truth), found.sigma(ATTITUDE)
    assert (np.abs(error[:, ATTITUDE]) < 4.0 * sigma).mean() > 0.95
    assert np.percentile(np.linalg.norm(error[:, :2], axis=1), 95) < np.radians(3.0)
    assert found.sigma(ATTITUDE).mean() > with_it.sigma(ATTITUDE).mean()


def test_at_any_time_it_is_carried_by_the_imu() -> None:
    flight, truth, found = estimated()
    t = flight.imu().t[500:-500:7]
    q, velocity, position = found.at(t)
    i = np.searchsorted(truth.t, t)
    angle = quaternion.log(quaternion.multiply(truth.q_ned_frd[i], quaternion.conjugate(q)))
    assert np.percentile(np.linalg.norm(angle, axis=1), 95) < np.radians(1.0)
    assert np.percentile(np.linalg.norm(velocity - truth.velocity[i], axis=1), 95) < 0.15
    assert np.percentile(np.linalg.norm(position - truth.position[i], axis=1), 95) < 0.7
    there = found.at(found.t)
    np.testing.assert_allclose(there[2], found.position, atol=1e-9)


def test_between_two_samples_it_turns_on() -> None:
    """At 0.4 rad/s a sample's own attitude is off by 0.002 rad in the middle of 10 ms, and one turned back by twice."""
    flight, _, found = estimated("circle", 2)
    t = flight.imu().t[500:-500:50]
    middle, before, after = (found.at(t + part * 0.01)[0] for part in (0.499, 0.0, 1.0))
    away = quaternion.multiply(quaternion.conjugate(quaternion.slerp(before, after, 0.499)), middle)
    assert np.linalg.norm(quaternion.log(away), axis=1).max() < 3e-4


def test_a_gyro_that_reads_too_much_is_corrected_towards_the_truth() -> None:
    flight, truth = sensed(120.0)
    imu = flight.imu()
    scaled = with_imu(flight, replace(imu, gyro=imu.gyro * [1.0, 1.0, 1.01]))
    found = smooth(scaled)

    def too_much(gyro: Array) -> float:
        """By what part of the true rate about z, turns to both sides."""
        turns = truth.gyro[:, 2] - truth.gyro[:, 2].mean()
        return float(((gyro[:, 2] - truth.gyro[:, 2]) * turns).sum() / (turns**2).sum())

    assert too_much(scaled.imu().gyro) == pytest.approx(0.01, abs=1e-3)
    sigma = found.constants_sigma[CONSTANTS["gyro_matrix"][0]][-1]
    assert too_much(corrected(scaled.imu(), found).gyro) == pytest.approx(0.0, abs=4.0 * sigma)
    assert sigma < 0.0025


def test_a_scale_is_told_of_the_axes_that_turn_more_than_the_noise() -> None:
    """Pitch by 0.18 rad/s rms, whose noise is a hundredth of that; roll, which is nothing but noise, tells none."""
    flight, _ = sensed(60.0, "square", rate=50.0)
    imu = flight.imu()
    gyro = np.where((imu.t >= 30.0)[:, None], 1.15 * imu.gyro, imu.gyro)
    (found,) = smooth(with_imu(flight, replace(imu, gyro=gyro))).explained
    assert (found.kind, found.shape) == ("gyro_scale", "step")
    assert found.onset == pytest.approx(30.0, abs=0.5)
    assert found.size.tolist() == [0.0, pytest.approx(0.15, abs=0.02), pytest.approx(0.15, abs=0.02)]
