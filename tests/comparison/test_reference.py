"""The autopilot's state between its messages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from companion.comparison import Limits, reference_at
from companion.comparison.reference import attitude_error, attitude_jumps, length, position_jumps
from companion.model import AttitudeTrack, ImuTrack, PositionTrack, median, nearest, percentile
from companion.strapdown import motions, preintegrate, quaternion
from tests.flights import flight_of, lively, seconds


def test_attitude_is_scipys_slerp() -> None:
    flight = flight_of(motions.coning(seconds(5, 20)))
    assert flight.attitude
    t = np.linspace(10.0, 15.0, 333)
    ours = reference_at(flight.attitude, None, t, Limits()).q_ned_frd
    theirs = Slerp(flight.attitude.t, Rotation.from_quat(flight.attitude.q_ned_frd, scalar_first=True))(t)
    assert length(attitude_error(ours, theirs.as_quat(scalar_first=True))).max() < 1e-12


def test_position_is_of_fourth_order_in_the_interval() -> None:
    """Cubic Hermite: half the interval between messages, a sixteenth of the error."""

    def error(rate_hz: float) -> float:
        flight = flight_of(motions.circle(seconds(20, rate_hz)))
        t = np.linspace(12.0, 28.0, 1777)
        assert flight.attitude
        between = reference_at(flight.attitude, flight.position, t, Limits())
        return float(length(between.position - motions.circle(t).position).max())

    assert np.log2(error(5) / error(10)) == pytest.approx(4, abs=0.2)


def test_at_the_messages_it_is_the_messages() -> None:
    flight = flight_of(motions.circle(seconds(5, 10)))
    assert flight.attitude
    assert flight.position
    at = reference_at(flight.attitude, flight.position, flight.position.t, Limits())
    assert np.allclose(at.position, flight.position.position, atol=1e-12)
    assert np.allclose(at.velocity, flight.position.velocity, atol=1e-12)
    assert at.attitude_known.all()
    assert at.position_known.all()


def test_nothing_is_known_outside_or_in_a_gap() -> None:
    t = np.delete(seconds(10, 20), slice(60, 80))  # 13.0 to 14.0 s is missing
    flight = flight_of(motions.rest(t))
    assert flight.attitude
    at = np.array([9.99, 10.0, 12.95, 13.5, 14.0, 20.0, 20.01])
    known = reference_at(flight.attitude, flight.position, at, Limits())
    assert known.attitude_known.tolist() == [False, True, False, False, True, True, False]
    assert known.position_known.tolist() == known.attitude_known.tolist()


def test_a_yaw_reset_is_an_attitude_jump_and_a_flip_is_none() -> None:
    motion = motions.spin(seconds(10, 50), rate=(7.0, 0.0, 0.0))
    q = motion.q_ned_frd.copy()
    assert not len(attitude_jumps(AttitudeTrack(motion.t, q, motion.gyro), Limits()))
    q[250:] = quaternion.multiply(quaternion.exp(np.array([0.0, 0.0, np.radians(20)])), q[250:])
    jumps = attitude_jumps(AttitudeTrack(motion.t, q, motion.gyro), Limits())
    assert jumps == pytest.approx(np.array([[motion.t[249], motion.t[250]]]))


def test_a_gps_glitch_is_a_position_jump_and_a_manoeuvre_is_none() -> None:
    motion = motions.circle(seconds(30, 4))
    position = motion.position.copy()
    assert not len(position_jumps(PositionTrack(motion.t, position, motion.velocity), Limits()))
    position[50:70] += (10.0, 0.0, 0.0)
    jumps = position_jumps(PositionTrack(motion.t, position, motion.velocity), Limits())
    assert jumps[:, 1] == pytest.approx(motion.t[[50, 70]])


@pytest.mark.parametrize("count", [1, 2, 3, 10, 101])
def test_median_and_percentile_are_to_the_last_digit_what_numpy_says(count: int) -> None:
    values = np.random.default_rng(count).normal(size=count)
    assert median(values) == np.median(values)
    for percent in (0.0, 5.0, 33.3, 50.0, 90.0, 100.0):
        assert percentile(values, percent) == np.percentile(values, percent)


def test_nearest_is_the_nearest() -> None:
    samples = np.array([0.0, 1.0, 3.0])
    assert nearest(samples, np.array([-5.0, 0.4, 0.6, 1.9, 2.1, 9.0])).tolist() == [0, 0, 1, 1, 2, 2]


def test_between_two_attitudes_the_error_is_what_a_steady_acceleration_makes() -> None:
    """By the rates at both ends alone: the IMU is sampled no faster."""
    axis, acceleration = np.array([0.6, 0.0, 0.8]), 5.0  # rad/s²

    def turned(t: np.ndarray) -> np.ndarray:
        return quaternion.exp(0.5 * acceleration * t[:, None] ** 2 * axis)

    sent = np.arange(0.0, 1.01, 0.125)
    track = AttitudeTrack(sent, turned(sent), acceleration * sent[:, None] * axis)
    slow = preintegrate(ImuTrack(sent, track.rates, np.zeros((len(sent), 3))), method="midpoint")
    t = np.linspace(0.0, 1.0, 65)
    found = reference_at(track, None, t, Limits(gap_s=1.0))
    error = found.interpolation_error(np.arange(len(t)), slow).attitude
    off = np.linalg.norm(quaternion.log(quaternion.multiply(turned(t), quaternion.conjugate(found.q_ned_frd))), axis=1)
    np.testing.assert_allclose(off, error, atol=1e-9)
    assert error.max() == pytest.approx(acceleration * 0.125**2 / 8)


@pytest.mark.parametrize("bias", [0.0, 0.01])
def test_between_two_samples_the_error_is_at_least_what_the_motion_makes(bias: float) -> None:
    """The vehicle turns to and fro between two samples: neither tells it, and an IMU does, biased or not."""
    motion = lively(20.0)
    flight = flight_of(motion, every=50)
    assert flight.attitude
    imu = replace(motion.imu, gyro=motion.gyro + bias, accel=motion.accel + bias)
    found = reference_at(flight.attitude, flight.position, motion.t, Limits(gap_s=2.0))
    error = found.interpolation_error(np.arange(len(motion.t)), preintegrate(imu))
    for off, sigma, most in (
        (attitude_error(motion.q_ned_frd, found.q_ned_frd), error.attitude, 0.05),
        (motion.velocity - found.velocity, error.velocity, 0.1),
        (motion.position - found.position, error.position, 0.001),
    ):
        size = length(off)
        assert size.max() > most
        assert (size < 1.1 * sigma + 0.05 * size.max()).all()
        assert sigma.max() < 2.0 * size.max()
