"""An IMU that aligns itself at rest."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

import companion as c
from companion.comparison import (
    GENERIC,
    Alignment,
    ImuSpec,
    ReferenceSpec,
    SensorSpec,
    align,
    compare,
    replay_from_rest,
)
from companion.model import STANDARD_GRAVITY, AttitudeTrack, DataError, Flight, Series
from companion.strapdown import ImuModel, Sensor, motions, quaternion
from companion.verdict import autopilot_bias
from tests.comparison.test_rest import BIAS, noisy, rest_then_motion
from tests.flights import flight_of, seconds
from tests.recordings import BUNDLED, recording

FIELD = np.array([21e-6, 4.5e-6, 43e-6])
"""T, NED: pointing 12.1° east of north."""
DECLINATION = float(np.arctan2(FIELD[1], FIELD[0]))


def aligned(flight: Flight) -> Alignment:
    return align(flight, compare(flight), GENERIC)


def with_magnetometer(flight: Flight) -> Flight:
    attitude = flight.require_attitude()
    body = quaternion.rotate(quaternion.conjugate(attitude.q_ned_frd), np.broadcast_to(FIELD, (len(attitude), 3)))
    series = Series(attitude.t, body, ("x_tesla", "y_tesla", "z_tesla"), "RAW_IMU")
    return replace(flight, series={"magnetometer": series})


def angle(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.linalg.norm(quaternion.log(quaternion.multiply(a, quaternion.conjugate(b))))))


def test_the_attitude_from_rest_is_the_true_one_within_its_error() -> None:
    flight = noisy(rest_then_motion())
    found = aligned(flight)
    truth = flight.require_attitude().q_ned_frd[0]
    assert angle(found.q_ned_frd, truth) < 0.1
    assert found.heading_from == "autopilot"
    assert [round(row.since_s) for row in found.later] == [1, 10, 40]
    for row in found.later:
        assert row.tilt_deg < 3 * row.expected_tilt_deg
        assert row.heading_deg < 3 * row.expected_heading_deg
    assert found.later[-1].expected_tilt_deg == max(row.expected_tilt_deg for row in found.later)


NOTHING = SensorSpec(1e-7, 0.0, 1e-9, 0.1, 0.0, 35.0)
PERFECT = ReferenceSpec(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_an_accelerometer_that_is_off_leans_the_attitude_by_as_much_as_gravity_says() -> None:
    found = aligned(noisy(rest_then_motion()))
    assert found.tilt_sigma == pytest.approx(GENERIC.accel.residual_bias / STANDARD_GRAVITY, rel=0.1)


def test_a_gyro_at_rest_feels_the_earth_turn_and_takes_it_for_its_bias() -> None:
    """Of a perfect IMU that nothing else is wrong with: after a turn the Earth's rate is felt along another axis."""
    flight = flight_of(rest_then_motion())
    found = align(flight, compare(flight), ImuSpec("perfect", NOTHING, NOTHING, "none"), PERFECT)
    last = found.later[-1]
    assert np.radians(last.expected_tilt_deg) == pytest.approx(7.2921e-5 * last.since_s * np.sqrt(2.0), rel=0.1)


def test_a_gyro_that_is_noisier_at_rest_than_its_data_sheet_says_is_taken_as_it_is() -> None:
    """σ² after t s is what white noise of density N adds, N² t, and what it left of the bias over a rest of T s."""
    density = 3.0 * GENERIC.gyro.noise_density
    flight = noisy(rest_then_motion(), ImuModel(gyro=Sensor(density)))
    quiet = ImuSpec("quiet", replace(NOTHING, noise_density=1e-7), NOTHING, "none")
    found = align(flight, compare(flight), quiet, PERFECT)
    assert found.rest.gyro_noise == pytest.approx(density, rel=0.2)
    one, lasted = found.later[0].since_s, found.rest.end_s - found.rest.start_s
    expected = density * np.sqrt(one + one**2 / lasted)
    assert np.radians(found.later[0].expected_heading_deg) == pytest.approx(expected, rel=0.2)


def test_a_heading_taken_from_the_autopilot_is_as_unsure_as_the_autopilots_at_both_ends() -> None:
    flight = flight_of(rest_then_motion())
    unsure = replace(PERFECT, heading=0.1)
    first = align(flight, compare(flight), ImuSpec("perfect", NOTHING, NOTHING, "none"), unsure).later[0]
    assert np.radians(first.expected_heading_deg) == pytest.approx(0.1 * np.sqrt(2.0), rel=0.01)
    assert first.expected_tilt_deg < 0.1


def test_the_heading_of_the_magnetometer_needs_the_declination() -> None:
    flight = with_magnetometer(noisy(rest_then_motion()))
    found = aligned(flight)
    assert found.heading_from == "autopilot"
    assert "declination is not known" in found.notes[0]
    assert found.magnetic_error_rad == pytest.approx(-DECLINATION, abs=1e-3)
    known = aligned(replace(flight, declination=DECLINATION))
    assert known.heading_from == "magnetometer"
    assert known.magnetic_error_rad == pytest.approx(0.0, abs=1e-3)
    assert angle(known.q_ned_frd, flight.require_attitude().q_ned_frd[0]) < 0.1


@pytest.mark.parametrize("pitch", [-89.9, 0.0, 60.0, 89.9])
def test_a_nose_that_points_up_takes_the_heading_that_the_autopilot_has(pitch: float) -> None:
    """A tail-sitter before take-off: a little lean is any roll there, and takes the yaw angle with it."""
    q = quaternion.from_euler(0.0, np.radians(pitch), np.radians(40.0))
    motion = motions.rest(seconds(10, 50), q)
    leaning = motion.accel + np.array([0.0, 0.03, 0.0]) + np.random.default_rng(1).normal(0.0, 0.01, motion.accel.shape)
    flight = flight_of(replace(motion, accel=leaning))
    assert angle(aligned(flight).q_ned_frd, q) < 0.4
    magnetic = aligned(with_magnetometer(flight)).magnetic_error_rad
    assert magnetic is not None
    assert magnetic == pytest.approx(-DECLINATION, abs=0.02)


def test_a_flight_that_never_rests_says_what_it_found() -> None:
    with pytest.raises(DataError, match=r"no rest of three seconds.*quietest moment, at .* turns by"):
        aligned(noisy(motions.coning(seconds(40, 100), angle=0.3, frequency=0.3)))


def test_a_long_flight_is_reckoned_on_in_pieces() -> None:
    """The errors of all its samples at once would take 1 kB for each."""
    motion = motions.rest(seconds(600, 100))
    turning = motion.gyro + 0.05 * (motion.t > 30.0)[:, None]
    flight = flight_of(replace(motion, gyro=turning))
    comparison = compare(flight)
    tracemalloc.start()
    found = align(flight, comparison, GENERIC)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found.later[-1].since_s == pytest.approx(motion.t[-1] - found.rest.end_s)
    assert most < 500 * len(motion.t)


def test_a_gap_ends_the_reckoning() -> None:
    flight = noisy(rest_then_motion())
    imu = flight.imu()
    away = np.abs(imu.t - imu.t[0] - 25) > 0.5
    gapped = replace(imu, t=imu.t[away], gyro=imu.gyro[away], accel=imu.accel[away])
    found = aligned(replace(flight, imus={"RAW_IMU": gapped}))
    assert found.later[-1].since_s == pytest.approx(14.5, abs=0.6)
    assert "gap" in found.notes[-1]


def test_the_replay_from_rest_follows_the_truth_unanchored() -> None:
    """50 s after switch-on; with the biases that the rest shows, and nothing of the autopilot but where it is."""
    flight = noisy(rest_then_motion())
    shown = replay_from_rest(flight, aligned(flight))
    assert shown.from_rest
    assert shown.anchors == pytest.approx([shown.t[0]])
    assert shown.t[0] == pytest.approx(flight.start, abs=0.6)
    error = np.degrees(np.linalg.norm(shown.attitude_error, axis=1))
    assert error.max() < 1.0
    assert np.linalg.norm(shown.position_error[shown.t < shown.t[0] + 8], axis=1).max() < 0.5


def test_the_bias_that_the_autopilot_holds() -> None:
    flight = noisy(rest_then_motion(30.0))
    attitude = flight.require_attitude()
    rates = np.column_stack([np.interp(attitude.t, flight.imu().t, g) for g in flight.imu().gyro.T]) - BIAS
    held = autopilot_bias(replace(flight, attitude=replace(attitude, rates=rates)), flight.imu())
    assert held
    assert held.gyro == pytest.approx(BIAS, abs=1e-4)
    other = replace(flight.imu(), instance=1)
    assert autopilot_bias(flight, other) is None, "the rates are those of the first IMU"
    freed = replace(flight.imu(), bias_removed=True)
    assert autopilot_bias(replace(flight, attitude=replace(attitude, rates=rates)), freed) is None
    logged = AttitudeTrack(attitude.t, attitude.q_ned_frd, rates, "XKQ", rates_reported=False)
    assert autopilot_bias(replace(flight, attitude=logged), flight.imu()) is None


def test_recordings() -> None:
    demo = aligned(c.open_log(BUNDLED / "copter-demo-100hz.tlog")[0])
    assert demo.heading_from == "magnetometer"
    assert all(
        row.tilt_deg < row.expected_tilt_deg and row.heading_deg < row.expected_heading_deg for row in demo.later
    )
    flight = c.open_log(recording("sitl/copter-biased-imu-100hz.tlog"))[0]
    held = autopilot_bias(flight, flight.imu())
    assert held
    assert held.gyro == pytest.approx([9.5e-3, -14.5e-3, 7.2e-3], abs=1e-3)
