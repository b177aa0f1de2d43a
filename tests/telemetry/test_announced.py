"""Resets, lanes, parameters, biases, control and motors of a MAVLink log: what the vehicle says of itself."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.app.recording import open_log
from companion.model import Flight, StatusText
from companion.telemetry.events import text_resets
from tests.recordings import recording, shared
from tests.tlogs import Writer


def said(*texts: str) -> list[tuple[str, int | None]]:
    return [
        (reset.kind, reset.core) for reset in text_resets([StatusText(i * 10.0, 6, t) for i, t in enumerate(texts)])
    ]


def test_what_ardupilot_announces() -> None:
    assert said("EKF3 IMU0 MAG0 in-flight yaw alignment complete") == [("heading", 0)]
    assert said("EKF3 IMU1 emergency yaw reset", "EKF3 IMU0 yaw aligned using GPS") == [("heading", 1), ("heading", 0)]
    assert said("EKF3 IMU0 origin set", "EKF3 IMU0 is using GPS", "EKF2 IMU1 forced reset") == [
        ("position", 0), ("position", 0), ("attitude", 1),
    ]  # fmt: skip
    assert said("EKF3 IMU0 initialised", "Arming motors", "PreArm: EKF attitude is bad") == []


def test_a_lane_switch_is_announced_twice_and_counted_once() -> None:
    switch = [StatusText(70.1, 2, "EKF3 lane switch 1"), StatusText(70.2, 2, "EKF primary changed:1")]
    assert [(r.t, r.kind, r.core) for r in text_resets(switch)] == [(70.1, "lane", 1)]


def sent(path: Path, *messages: tuple[float, str, dict[str, Any]], autopilot: int = 3) -> Flight:
    log = Writer(path / "log.tlog")
    log.heartbeat(0.0, autopilot=autopilot)
    for step in range(1001):
        t = step / 50
        log.raw_imu(t, 20.0 + t)
        log.attitude(t, 20.0 + t, roll=0.1, yaw=1.0)
        for boot, name, fields in messages:
            if t <= boot - 20.0 < t + 1 / 50:
                log.send(t, name, **fields)
    return open_log(log.close())[0]


def parameter(t: float, name: str, value: float, **ids: int) -> tuple[float, str, dict[str, Any]]:
    fields = {"param_id": name.encode(), "param_value": value, "param_type": 9, "param_count": 1, "param_index": 65535}
    return t, "param_value", fields | ids


def test_a_parameter_set_in_flight(tmp_path: Path) -> None:
    flight = sent(tmp_path, parameter(21, "A", 1), parameter(22, "A", 1), parameter(30, "A", 2), parameter(31, "B", 3))
    (change,) = flight.parameter_changes
    assert (change.name, change.value) == ("A", 2.0)
    assert change.t == pytest.approx(30.0, abs=0.03)
    assert flight.parameters == {"A": 2.0, "B": 3.0}


def test_a_trim_set_in_flight_holds_from_then_on(tmp_path: Path) -> None:
    flight = sent(
        tmp_path, parameter(21, "AHRS_TRIM_X", 0), parameter(21, "AHRS_TRIM_Y", 0), parameter(30, "AHRS_TRIM_X", 0.08)
    )
    imu = flight.imus["RAW_IMU"]
    before, after = imu.accel[imu.t < 29.9], imu.accel[imu.t > 30.1]
    assert np.ptp(before, axis=0) == pytest.approx(0.0)
    assert before[0] == pytest.approx([0.0, 0.0, -9.80665])
    assert after[0] == pytest.approx(-9.80665 * np.array([0.0, -np.sin(0.08), np.cos(0.08)]))
    assert any("AHRS_TRIM (+0.0800, +0.0000) rad applied to the IMUs from 30.0 s on" in note for note in flight.notes)


def test_mavproxy_sends_parameters_in_the_vehicle_s_name(tmp_path: Path) -> None:
    """It downloads them as a file: the vehicle itself never says them. What it does say, it knows better."""
    own, theirs = parameter(21, "A", 1), [parameter(22, name, 7, compid=190) for name in ("A", "INS_GYRO_FILTER")]
    camera = parameter(22, "INS_ACCEL_FILTER", 5, compid=100)
    flight = sent(tmp_path, own, *theirs, camera)
    assert flight.parameters == {"A": 1.0, "INS_GYRO_FILTER": 7.0}
    assert not flight.parameter_changes
    assert flight.imus["RAW_IMU"].low_pass_hz == 7.0


def test_what_the_parameters_say_of_an_imu(tmp_path: Path) -> None:
    known = {"INS_GYR_ID": 2752772, "INS_GYRO_FILTER": 40, "INS_ACCEL_FILTER": 20}
    imu = sent(tmp_path, *(parameter(21, name, value) for name, value in known.items())).imus["RAW_IMU"]
    assert (imu.device_id, imu.interval, imu.bias_removed) == (2752772, None, False)
    assert (imu.gyro_low_pass_hz, imu.accel_low_pass_hz, imu.low_pass_hz) == (40.0, 20.0, 20.0)
    off = sent(tmp_path, parameter(21, "INS_GYRO_FILTER", 40), parameter(21, "INS_ACCEL_FILTER", 0)).imus["RAW_IMU"]
    assert (off.gyro_low_pass_hz, off.accel_low_pass_hz, off.low_pass_hz) == (40.0, 0.0, 40.0)
    odd = sent(tmp_path, *(parameter(21, name, np.nan) for name in known)).imus["RAW_IMU"]
    assert (odd.device_id, odd.low_pass_hz) == (None, None)


def test_motors_as_shares_of_their_range(tmp_path: Path) -> None:
    pulses = {f"servo{i}_raw": 0 for i in range(5, 9)} | {f"servo{i}_raw": 1000 + 250 * (i - 1) for i in range(1, 5)}
    main = {"time_usec": 25_000_000, "port": 0} | pulses
    ranges = parameter(21, "SERVO2_MIN", 1200), parameter(21, "SERVO2_MAX", 1300)
    more = main | {"port": 1, "servo2_raw": 1300, "time_usec": 25_000_100}
    motors = sent(tmp_path, *ranges, (25.0, "servo_output_raw", main), (25.0, "servo_output_raw", more)).actuators
    assert motors
    assert len(motors) == 1
    assert motors.output[0, :5].tolist() == pytest.approx([0.0, 0.5, 0.5, 0.75, np.nan], nan_ok=True)
    assert motors.output[0, 16:19].tolist() == pytest.approx([0.0, 0.3, 0.5])
    assert np.isnan(motors.output[0, 8:16]).all()


def test_the_stamps_of_motors_wrap_every_72_minutes(tmp_path: Path) -> None:
    log = Writer(tmp_path / "log.tlog")
    log.heartbeat(0.0)
    for i in range(400):
        boot = 4285.0 + i / 10
        log.attitude(i / 10, boot)
        outputs = {f"servo{k}_raw": 1500 for k in range(1, 9)}
        log.send(i / 10, "servo_output_raw", time_usec=round(boot * 1e6) % 2**32, port=0, **outputs)
    motors = open_log(log.close())[0].actuators
    assert motors
    assert motors.t == pytest.approx(4285.0 + np.arange(400) / 10, abs=1e-5)


@pytest.mark.parametrize("name", ["attitude_target", "nav_controller_output"])
def test_the_desired_attitude(tmp_path: Path, name: str) -> None:
    roll, heading = 0.3, 1.0  # the heading of NAV_CONTROLLER_OUTPUT is the present one
    q = [
        np.cos(roll / 2) * np.cos(0.5),
        np.sin(roll / 2) * np.cos(0.5),
        np.sin(roll / 2) * np.sin(0.5),
        np.cos(roll / 2) * np.sin(0.5),
    ]
    fields: dict[str, Any] = {
        "attitude_target": dict.fromkeys(("body_roll_rate", "body_pitch_rate", "body_yaw_rate", "thrust"), 0.0)
        | {"time_boot_ms": 25_000, "type_mask": 0, "q": q},
        "nav_controller_output": dict.fromkeys(("nav_pitch", "alt_error", "aspd_error", "xtrack_error"), 0.0)
        | {"nav_roll": np.degrees(roll), "nav_bearing": 0, "target_bearing": 0, "wp_dist": 0},
    }[name]
    control = sent(tmp_path, (25.0, name, fields)).control
    assert control
    assert control.source == name.upper()
    assert abs(control.q_ned_frd[0] @ q) == pytest.approx(1.0, abs=1e-6)
    assert heading == 1.0


def test_the_estimator_s_bias_is_the_gyro_minus_the_rates_of_attitude() -> None:
    """The simulator's biases are (10, -15, 8) mrad/s, known to the EKF by the end."""
    (bias,) = open_log(recording("sitl/copter-biased-imu-100hz.tlog"))[0].biases
    assert (bias.source, bias.imu_instance) == ("RAW_IMU - ATTITUDE", 0)
    assert bias.gyro[-1] * 1e3 == pytest.approx([10.0, -15.0, 8.0], abs=0.6)
    assert np.isnan(bias.accel).all()


@pytest.mark.parametrize(("where", "used"), [(recording, {60.0: 0, 80.0: 1}), (shared, {80.0: 1, 125.5: 0})])
def test_lanes_tell_which_imu_the_estimator_used(where: Callable[[str], Path], used: dict[float, int]) -> None:
    flight = open_log(where("sitl/copter-imu1-fail-100hz.tlog"))[0]
    assert flight.imu_in_use
    assert flight.imu_in_use.at(np.array(list(used))).tolist() == list(used.values())
    assert [bias.imu_instance for bias in flight.biases] == [0, 1]


def test_px4s_means_stand_in_the_middle_of_their_interval() -> None:
    flight = open_log(recording("px4/px4_hover_250hz.tlog"))[0]
    highres, scaled = flight.imus["HIGHRES_IMU"], flight.imus["SCALED_IMU"]
    assert highres.interval is not None
    assert highres.interval[0] == pytest.approx(1 / 250)
    assert (highres.bias_removed, scaled.bias_removed) == (True, False)
    assert flight.imu_in_use
    assert flight.imu_in_use.at(np.array([65.0])) == 0, "SCALED_IMU and HIGHRES_IMU are of one sensor"
    (bias,) = flight.biases
    assert bias.source == "SCALED_IMU - HIGHRES_IMU"
    assert bias.accel[-1, 0] == pytest.approx(0.32, abs=0.02)


def test_px4s_resets_say_what_jumped() -> None:
    """The yaw reset of -4.07° at 31.8 s, which ODOMETRY counts."""
    resets = [reset for reset in open_log(recording("px4/px4_hover.tlog"))[0].resets if 31.0 < reset.t < 32.5]
    assert "heading" in {reset.kind for reset in resets}
