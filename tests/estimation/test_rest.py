"""Where a vehicle is taken to stand still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.rest import at_rest
from companion.model import STANDARD_GRAVITY, Array, Event, Flight, ImuTrack, Vehicle
from companion.strapdown import motions, quaternion
from tests.estimation.sensed import PLACE, gps_of


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
