"""Which reading of a sensor stands at which keyframe, and where a vehicle is taken to stand still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.constants import healthy
from companion.estimation.aiding_sensors import SENSORS
from companion.estimation.iteration import start_of
from companion.estimation.learned_noise import FIRST_NOISE
from companion.estimation.linearisation import linearise, preintegrate_imu
from companion.estimation.readings import Intake, Readings, at_rest
from companion.estimation.setup import set_up
from companion.model import (
    STANDARD_GRAVITY,
    Array,
    Event,
    Flight,
    GpsTrack,
    ImuTrack,
    Origin,
    Vehicle,
    geodetic_from_ned,
)
from companion.strapdown import motions, quaternion
from tests.estimation.sensed import LATENCY, PLACE, at, gps_of, sensed, true_states, with_imu

SPACING = 0.4
T = np.concatenate([np.arange(0.0, 10.0, SPACING), np.arange(20.0, 30.0, SPACING)])
"""Keyframes, with a gap in which there are none."""


@pytest.mark.parametrize("rate", [0.7, 2.5, 10.0, 50.0])
@pytest.mark.parametrize("seed", range(3))
def test_each_keyframe_has_the_nearest_reading_within_half_a_spacing_and_each_reading_counts_once(
    rate: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    when = np.sort(rng.uniform(-1.0, 31.0, round(32 * rate)))
    found = SENSORS["barometer"].at_keyframes(when, when[:, None], T, SPACING)
    apart = np.abs(when[:, None] - T[found.keyframe])
    assert (found.t == when[apart.argmin(axis=0)]).all(), "the nearest of all"
    assert (np.abs(found.t - T[found.keyframe]) <= 0.5 * SPACING + 1e-3).all()
    assert (np.diff(found.keyframe) > 0).all()
    assert (np.diff(found.t) > 0).all()
    assert (found.value[:, 0] == found.t).all()
    near = np.abs(when[:, None] - T).min(axis=0) <= 0.5 * SPACING
    alone = np.ones(len(T), np.bool_)
    alone[found.keyframe] = False
    shared = np.isin(np.abs(when[:, None] - T).argmin(axis=0), np.searchsorted(when, found.t))
    assert (alone & near <= shared).all(), "who has none within reach shares it with another"


def fixes(t: Array) -> GpsTrack:
    return gps_of(motions.rest(t), np.random.default_rng(0), rate=1.0)


def fixed(track: GpsTrack) -> list[Readings]:
    flight, _ = sensed(30.0)
    intake = Intake(flight, flight.imu(), T, SPACING / 2, track, Origin(*PLACE), [])
    taken = [row.read(row, intake) for row in SENSORS.values() if row.device == "gps" and row.read is not None]
    return [one for one in taken if one is not None]


def test_a_fix_stands_where_the_vehicle_was_when_it_was_made() -> None:
    track = fixes(np.arange(0.0, 30.0, 0.01))
    for one in fixed(track):
        assert (np.abs(one.t - healthy.GPS_LATENCY_S - T[one.keyframe]) <= 0.5 * SPACING + 1e-3).all()
        assert not ((one.t > 10.3) & (one.t < 19.7)).any(), "no keyframe is near"


def test_a_fix_beside_a_gap_of_the_imu_is_where_the_velocity_leads() -> None:
    """At the true states a fix without noise leaves nothing, though no latency is learned there: 8 m/s are 0.8 m."""
    flight, truth = sensed(40.0, "circle", rate=50.0)
    (gps,) = flight.gps
    where = geodetic_from_ned(at(gps.t - LATENCY, truth.t, truth.position), PLACE)
    imu = flight.imu()
    kept = (imu.t < 15.0) | (imu.t > 17.0)
    cut = with_imu(flight, replace(imu, t=imu.t[kept], gyro=imu.gyro[kept], accel=imu.accel[kept]))
    exact = replace(gps, latitude=where[:, 0], longitude=where[:, 1], height=where[:, 2])
    setup = set_up(replace(cut, gps=(exact,)), None, STANDARD_GRAVITY, None)
    states = true_states(setup, flight, truth)
    scale = {one.name: 1.0 for one in setup.readings}
    linear = linearise(
        setup,
        preintegrate_imu(setup, (np.zeros(3), np.zeros(3))),
        states,
        FIRST_NOISE,
        scale,
        {},
        start_of(setup, states).slow,
    )
    left = next(one for one in linear.measurements if one.name == "gps_position")
    beside = np.isin(setup.t[left.keyframe], setup.t[np.flatnonzero(setup.broken)[:, None] + [0, 1]])
    assert beside.any()
    assert np.abs(left.residual).max() < 0.1


def test_what_a_receiver_says_of_itself_is_believed_down_to_centimetres() -> None:
    track = fixes(np.arange(0.0, 30.0, 0.01))
    vain = replace(track, horizontal_sigma=np.full(len(track), 1e-6), speed_sigma=np.full(len(track), 0.3))
    stated = {one.name: one.sigma for one in fixed(vain)}
    assert (stated["gps_position"] > 0.01).all()
    assert (stated["gps_velocity"] == 0.3).all()


def disarmed(t: Array, gyro: Array, accel: Array) -> tuple[Flight, ImuTrack]:
    """A vehicle whose motors are off, with a little noise on what it reads."""
    rng = np.random.default_rng(3)
    track = ImuTrack(
        t, gyro + 2e-3 * rng.standard_normal((len(t), 3)), accel + 0.02 * rng.standard_normal((len(t), 3)), "RAW_IMU"
    )
    vehicle = Vehicle(1, 1, "ARDUPILOTMEGA", "QUADROTOR")
    off = Event(float(t[0]), "disarmed", "disarmed")
    return Flight(vehicle, 1, 0.0, float(t[-1]), {"RAW_IMU": track}, None, None, events=(off,)), track


def swinging(t: Array, sweep: float, period: float) -> tuple[Array, Array]:
    """Readings of a vehicle that leans to and fro about x by `sweep` rad."""
    w = 2.0 * np.pi / period
    roll = sweep * np.sin(w * t)
    q = quaternion.exp(roll[:, None] * [1.0, 0.0, 0.0])
    gyro = np.outer(sweep * w * np.cos(w * t), [1.0, 0.0, 0.0])
    up = np.broadcast_to([0.0, 0.0, -STANDARD_GRAVITY], (len(t), 3))
    return gyro, np.asarray(quaternion.rotate(quaternion.conjugate(q), up))


def test_a_vehicle_whose_motors_are_off_rests_while_nothing_turns_it() -> None:
    t = np.arange(0.0, 20.0, 0.01)
    keyframes = np.arange(0.0, 20.0, 0.2)
    gyro, accel = swinging(t, 0.0, 3.0)
    rates, sigma, rests = at_rest(*disarmed(t, gyro, accel), keyframes)
    assert rests[1:-1].mean() > 0.8
    assert np.abs(rates[rests]).max() < 5.0 * sigma[rests].max()
    assert np.median(sigma[rests]) < 1.5e-3  # 50 samples with 2 mrad/s each


def test_the_rate_of_a_swing_that_turns_round_is_no_bias() -> None:
    """It is as quiet there as on the ground for half a second: but its rate is worth no more than it changes by."""
    t = np.arange(0.0, 20.0, 0.01)
    keyframes = np.arange(1.0, 19.0, 0.2)
    gyro, accel = swinging(t, 0.02, 4.0)
    rates, sigma, rests = at_rest(*disarmed(t, gyro, accel), keyframes)
    assert (np.abs(rates[rests]) < 2.0 * sigma[rests, None]).all()


def test_sigma_is_honest_for_noise_that_neighbouring_samples_share() -> None:
    """Where means agree by chance, the scatter of the samples alone says how well they are known."""
    t, normalised = np.arange(0.0, 3.0, 0.01), []
    up = np.tile([0.0, 0.0, -STANDARD_GRAVITY], (300, 1))
    for seed in range(200):
        shared = np.random.default_rng(seed).normal(0.0, 1.5e-3, (25, 3)).repeat(2, axis=0)
        flight, track = disarmed(t, np.zeros((300, 3)), up)
        quiet = replace(track, gyro=np.tile(shared, (6, 1)))
        rates, sigma, rests = at_rest(replace(flight, imus={"RAW_IMU": quiet}), quiet, np.array([0.5, 1.0, 1.5, 2.0]))
        assert rests.all()
        normalised.append((rates / sigma[:, None]) ** 2)
    assert 0.5 < np.mean(normalised) < 1.2


@pytest.mark.parametrize(("velocity", "moved"), [(0.0, 0.0), (0.15, 0.15), (0.15, 0.0), (0.15, -0.15), (0.0, 0.15)])
def test_a_boat_that_drifts_does_not_rest(velocity: float, moved: float) -> None:
    """Its IMU is as quiet as on the ground. A receiver at rest wanders too, and not as its velocity says."""
    t, keyframes = np.arange(0.0, 30.0, 0.01), np.arange(1.0, 29.0, 0.2)
    flight, track = disarmed(t, *swinging(t, 0.0, 3.0))
    motion = motions.rest(t)
    drift = np.array([1.0, -0.5, 0.0])
    gps = gps_of(
        replace(
            motion, position=motion.position + moved * t[:, None] * drift, velocity=motion.velocity + velocity * drift
        ),
        np.random.default_rng(2),
        PLACE,
    )
    _, _, rests = at_rest(replace(flight, gps=(gps,)), track, keyframes)
    drifts = velocity == moved != 0.0
    assert not rests.any() if drifts else rests[1:-1].mean() > 0.8
