"""The drift table on flights whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import companion as c
from companion.comparison import Integration, Limits, drift
from companion.model import AttitudeTrack, DataError, Flight, ImuTrack, NavState, PositionTrack, SettingsError
from companion.strapdown import dead_reckon, motions, quaternion
from tests.flights import flight_of, seconds
from tests.recordings import BUNDLED


def with_imu(flight: Flight, imu: ImuTrack) -> Flight:
    return replace(flight, imus={"RAW_IMU": imu})


def test_an_ideal_imu_does_not_drift() -> None:
    for row in drift(flight_of(motions.coning(seconds(60, 200)))).rows:
        assert row.attitude_deg
        assert row.velocity_mps
        assert row.position_m
        assert row.attitude_deg.max < 0.01
        assert row.velocity_mps.max < 0.001
        assert row.position_m.max < 0.02
        assert row.windows == int(60 / row.horizon_s)
        assert not row.excluded


def test_constant_biases_drift_as_the_textbook_says() -> None:
    """At rest: tilt b t, velocity g b t²/2, position g b t³/6 for a gyro bias; a t²/2 for an accelerometer bias."""
    flight = flight_of(motions.rest(seconds(60, 100)))
    imu, g, t = flight.imu(), 9.80665, 5.0
    gyro_bias, accel_bias = 1e-3, 0.01
    row = drift(with_imu(flight, replace(imu, gyro=imu.gyro + [gyro_bias, 0, 0])), horizons=(t,)).rows[0]
    assert row.attitude_deg
    assert row.velocity_mps
    assert row.position_m
    assert row.attitude_deg.median == pytest.approx(np.degrees(gyro_bias * t), rel=1e-6)
    assert row.velocity_mps.median == pytest.approx(g * gyro_bias * t**2 / 2, rel=1e-4)
    assert row.position_m.median == pytest.approx(g * gyro_bias * t**3 / 6, rel=1e-3)
    row = drift(with_imu(flight, replace(imu, accel=imu.accel + [0, accel_bias, 0])), horizons=(t,)).rows[0]
    assert row.position_m
    assert row.position_m.median == pytest.approx(accel_bias * t**2 / 2, rel=1e-6)


def test_the_sign_is_autopilot_minus_imu() -> None:
    """A gyro that reads too much about down turns the reckoning clockwise: the autopilot is counter-clockwise of it."""
    flight = flight_of(motions.rest(seconds(10, 100)))
    imu = flight.imu()
    errors = drift(with_imu(flight, replace(imu, gyro=imu.gyro + [0, 0, 0.01])), horizons=(2,)).rows[0].errors
    assert errors.attitude == pytest.approx(np.tile([0, 0, -0.02], (5, 1)), abs=1e-9)
    errors = drift(with_imu(flight, replace(imu, accel=imu.accel + [0.1, 0, 0])), horizons=(2,)).rows[0].errors
    assert errors.velocity == pytest.approx(np.tile([-0.2, 0, 0], (5, 1)), abs=1e-9)


def test_one_pass_equals_integrating_every_window_by_itself() -> None:
    motion = motions.coning(seconds(40, 100))
    flight = flight_of(motion, every=5)
    imu = flight.imu()
    imu = replace(imu, gyro=imu.gyro + [0.01, 0.0, -0.02])
    errors = drift(with_imu(flight, imu), horizons=(7,), how=Integration(middle="linear")).rows[0].errors
    for anchor, end, position in zip(errors.anchor_s, errors.end_s, errors.position, strict=True):
        k, e = np.searchsorted(imu.t, [anchor, end])
        start = NavState(imu.t[k], motion.q_ned_frd[k], motion.velocity[k], motion.position[k])
        alone = dead_reckon(imu[k : e + 1], start, middle="linear")
        assert position == pytest.approx(motion.position[e] - alone.position[-1], abs=1e-9)


def test_windows_over_a_gap_are_left_out_and_counted() -> None:
    t = seconds(60, 100)
    imu_t = np.delete(t, slice(2510, 2590))  # 0.8 s missing, more than a turn of the cone
    flight = with_imu(flight_of(motions.coning(t)), motions.coning(imu_t).imu)
    row = drift(flight, horizons=(5,)).rows[0]
    assert row.excluded == {"imu_gap": 1}
    assert row.windows == 11
    assert row.attitude_deg
    assert row.attitude_deg.max < 0.01
    bridged = drift(flight, horizons=(5,), how=Integration(limits=Limits(gap_s=10))).rows[0]
    assert bridged.attitude_deg
    assert bridged.attitude_deg.max > 1.0, "the test's gap would not have mattered"


def test_no_window_is_shorter_than_its_horizon_beside_a_gap() -> None:
    """An edge of the grid that falls into the gap is moved to the end of it."""
    t = seconds(60, 100)
    imu_t = np.delete(t, slice(1020, 1520))
    flight = with_imu(flight_of(motions.circle(t)), motions.circle(imu_t).imu)
    for row in drift(flight, horizons=(1, 2)).rows:
        assert row.errors.end_s - row.errors.anchor_s == pytest.approx(row.horizon_s, abs=0.02)


def test_windows_over_jumps_are_left_out_and_counted() -> None:
    motion = motions.circle(seconds(60, 50))
    q, position = motion.q_ned_frd.copy(), motion.position.copy()
    q[motion.t > 25.3] = quaternion.multiply(quaternion.exp(np.array([0.0, 0.0, 0.3])), q[motion.t > 25.3])
    position[motion.t > 47.7] += (0.0, 55.7, 0.0)
    flight = replace(
        flight_of(motion),
        attitude=AttitudeTrack(motion.t, q, motion.gyro),
        position=PositionTrack(motion.t, position, motion.velocity),
    )
    row = drift(flight, horizons=(5,)).rows[0]
    assert row.excluded == {"attitude_jump": 1, "position_jump": 1}
    assert row.windows == 10
    assert row.attitude_deg
    assert row.attitude_deg.max < 1e-3, "what remains is as good as ever"


def test_without_a_position_the_attitude_is_still_compared() -> None:
    row = drift(replace(flight_of(motions.coning(seconds(20, 100))), position=None), horizons=(5,)).rows[0]
    assert row.attitude_deg
    assert row.velocity_mps is None
    assert row.position_m is None
    assert (row.windows, row.excluded) == (4, {})


def test_a_horizon_longer_than_the_flight_has_no_window() -> None:
    row = drift(flight_of(motions.rest(seconds(20, 100))), horizons=(30,)).rows[0]
    assert (row.windows, row.attitude_deg, row.excluded) == (0, None, {})


def test_a_horizon_below_the_sample_interval_has_no_window() -> None:
    assert drift(flight_of(motions.rest(seconds(20, 2))), horizons=(1e-9,)).rows[0].windows == 0


@pytest.mark.parametrize("horizons", [(0,), (-1,), (float("nan"),), (float("inf"),)])
def test_senseless_horizons_are_refused(horizons: tuple[float, ...]) -> None:
    with pytest.raises(SettingsError, match="horizons must be positive"):
        drift(flight_of(motions.rest(seconds(20, 100))), horizons=horizons)


def test_what_is_missing_is_named() -> None:
    flight = flight_of(motions.rest(seconds(20, 100)))
    with pytest.raises(DataError, match="no usable HIGHRES_IMU.*RAW_IMU \\(2001\\)"):
        drift(flight, imu="HIGHRES_IMU")
    with pytest.raises(DataError, match="no attitude to compare with.*Ask the vehicle for ATTITUDE"):
        drift(replace(flight, attitude=None))
    with pytest.raises(DataError, match="no IMU message with two samples.*RAW_IMU \\(1\\)"):
        drift(with_imu(flight, flight.imu()[:1]))


def test_each_column_is_the_percentile_that_its_heading_says() -> None:
    flight = c.open_log(BUNDLED / "copter-demo-100hz.tlog")[0]
    (row,) = drift(flight, horizons=(5.0,)).rows
    assert row.position_m is not None
    errors = np.sort(np.linalg.norm(row.errors.position, axis=1))
    assert row.position_m.max == errors[-1]
    assert row.position_m.median == np.median(errors)
    at = 0.95 * (len(errors) - 1)
    assert row.position_m.p95 == pytest.approx(np.interp(at, np.arange(len(errors)), errors))
