"""Topics of old firmware, of the drivers, and with nothing in them: what becomes of each."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import companion as c
from companion.model import STANDARD_GRAVITY, Flight
from tests.ulogs import Fields, ulog

N = 50
T = np.arange(1, N + 1, dtype=np.uint64) * np.uint64(100_000)
F32 = np.float32


def full(value: float, kind: npt.DTypeLike = F32, size: int | None = None) -> npt.NDArray[Any]:
    return np.full(N if size is None else (N, size), value, kind)


def vectors(x: float, y: float, z: float) -> npt.NDArray[np.float32]:
    return np.tile(np.array([x, y, z], F32), (N, 1)) + np.arange(N, dtype=F32)[:, None] * F32(1e-6)


@pytest.fixture
def read(tmp_path: Path) -> Any:
    def flight(topics: Mapping[str, Fields], **more: Any) -> Flight:
        path = tmp_path / "log.ulg"
        path.write_bytes(ulog(topics, **more))
        return c.open_log(path)[0]

    return flight


def gps(**other: npt.NDArray[Any]) -> dict[str, npt.NDArray[Any]]:
    return {
        "timestamp": T,
        "lat": full(473_977_418, np.int32),
        "lon": full(85_455_938, np.int32),
        "alt": full(488_123, np.int32),
        "eph": full(0.7),
        "epv": 1.1 + 0.01 * np.arange(N, dtype=F32),
        "s_variance_m_s": full(0.2),
        "vel_n_m_s": full(1.0),
        "vel_e_m_s": full(-2.0),
        "vel_d_m_s": full(0.5),
        "vel_m_s": full(2.0),
        "cog_rad": full(np.pi / 2),
        "fix_type": full(3, np.uint8),
        "vel_ned_valid": full(1, np.bool_),
        "satellites_used": full(11, np.uint8),
    } | other


def test_a_receiver_of_old_firmware_tells_integers(read: Any) -> None:
    (track,) = read({"vehicle_gps_position": gps()}, version=(1, 8)).gps
    np.testing.assert_allclose(np.degrees(track.latitude), 47.3977418, rtol=1e-12)
    np.testing.assert_allclose(np.degrees(track.longitude), 8.5455938, rtol=1e-12)
    np.testing.assert_allclose(track.height, 488.123)
    np.testing.assert_array_equal(track.velocity, np.tile([1.0, -2.0, 0.5], (N, 1)))
    np.testing.assert_allclose(track.speed_sigma, 0.2, rtol=1e-6)
    np.testing.assert_allclose(track.t, T * 1e-6)


def test_before_the_first_fix_nothing_is_known(read: Any) -> None:
    fix = full(3, np.uint8)
    fix[:20], fix[20:25] = 0, 2
    lat = full(473_977_418, np.int32)
    lat[:20] = 0
    (track,) = read({"vehicle_gps_position": gps(fix_type=fix, lat=lat)}).gps
    assert np.isnan(track.latitude[:20]).all()
    assert np.isnan(track.velocity[:20]).all()
    assert np.isfinite(track.latitude[20:]).all()
    assert np.isnan(track.height[:25]).all()
    assert np.isfinite(track.height[25:]).all()


def test_without_a_velocity_there_are_speed_and_course(read: Any) -> None:
    (track,) = read({"vehicle_gps_position": gps(vel_ned_valid=full(0, np.bool_))}).gps
    np.testing.assert_allclose(track.velocity[:, :2], np.tile([0.0, 2.0], (N, 1)), atol=1e-6)
    assert np.isnan(track.velocity[:, 2]).all()


@pytest.mark.parametrize(
    ("what", "note"),
    [
        (gps(fix_type=full(0, np.uint8)), "vehicle_gps_position left out: it never has a fix"),
        (gps(lat=full(0, np.int32), lon=full(0, np.int32)), "vehicle_gps_position left out: it never has a fix"),
        (gps(timestamp=T + np.uint64(1_795_290_136_000_000)), "vehicle_gps_position"),
    ],
)
def test_a_receiver_without_a_fix_or_of_another_clock_is_left_out(read: Any, what: Fields, note: str) -> None:
    others = {
        name: {"timestamp": T, "arming_state": full(1, np.uint8), "nav_state": full(0, np.uint8)}
        for name in ("vehicle_status",)
    }
    combined = {
        "timestamp": T,
        "gyro_rad": vectors(0, 0, 0),
        "gyro_integral_dt": full(4000, np.uint32),
        "accelerometer_m_s2": vectors(0, 0, -9.8),
    }
    flight = read(
        {
            "vehicle_gps_position": what,
            "sensor_combined": combined,
            "sensor_mag": {"timestamp": T, "x": full(0.1), "y": full(0.2), "z": full(0.3)},
            **others,
        }
    )
    assert not flight.gps
    assert any(note in told for told in flight.notes), flight.notes


def test_a_single_fix_far_from_its_neighbours_is_dropped_and_counted(read: Any) -> None:
    lat = full(473_977_418, np.int32)
    lat[25] += 45_000
    flight = read({"vehicle_gps_position": gps(lat=lat)})
    assert len(flight.gps[0]) == N - 1
    assert "vehicle_gps_position: 1 fix left out that those before and after contradict" in flight.notes


def test_a_position_that_its_neighbours_contradict_is_dropped_and_counted(read: Any) -> None:
    valid = dict.fromkeys(("xy_valid", "z_valid", "v_xy_valid", "v_z_valid"), full(1, np.bool_))
    place = {name: np.arange(N, dtype=F32) for name in ("x", "y", "z")}
    place["x"][20] += F32(508.0)
    rest = {name: full(1.0) for name in ("vx", "vy", "vz", "ref_lat", "ref_lon", "ref_alt")}
    flight = read({"vehicle_local_position": {"timestamp": T} | place | rest | valid})
    assert len(flight.position) == N - 1
    assert "vehicle_local_position: 1 sample left out that those before and after contradict" in flight.notes


def test_when_rflymad_switched_a_fault_on_is_part_of_the_truth(read: Any) -> None:
    fault = full(0, np.uint32)
    fault[30:] = 123_450
    truth = {"timestamp": T, "q": np.tile(np.array([1, 0, 0, 0], F32), (N, 1))}
    flight = read({"vehicle_attitude_groundtruth": truth, "rfly_ctrl_lxl": {"timestamp": T, "id": fault}})
    assert flight.truth.faults == (pytest.approx(3.1),)


def test_the_truth_between_two_positions_is_the_cubic_of_position_and_velocity(read: Any) -> None:
    """A path of third order in time is that cubic."""
    t = T * 1e-6
    powers = {"x": (1, 2, 3, -4), "y": (0, -5, 1, 2), "z": (-9, 0, 0, 1)}
    path = {axis: np.polynomial.Polynomial(factors) for axis, factors in powers.items()}
    place = {axis: one(t) for axis, one in path.items()} | {f"v{axis}": one.deriv()(t) for axis, one in path.items()}
    sooner = T[:-1] + np.uint64(30_000)
    flight = read(
        {
            "vehicle_attitude_groundtruth": {
                "timestamp": sooner,
                "q": np.tile(np.array([1, 0, 0, 0], F32), (N - 1, 1)),
            },
            "vehicle_local_position_groundtruth": {"timestamp": T} | place,
        }
    )
    expected = np.column_stack([one(sooner * 1e-6) for one in path.values()])
    np.testing.assert_allclose(flight.truth.position, expected, atol=1e-9)


def test_the_driver_of_the_selected_sensor_is_no_second_one(read: Any) -> None:
    def mag(device: int) -> Fields:
        field = vectors(0.2, 0.0, 0.4)
        return {
            "timestamp": T,
            "device_id": full(device, np.uint32),
            "x": field[:, 0],
            "y": field[:, 1],
            "z": field[:, 2],
        }

    selected = {"timestamp": T, "device_id": full(7, np.uint32), "magnetometer_ga": vectors(0.25, 0.0, 0.4)}
    flight = read({"vehicle_magnetometer": selected, "sensor_mag": mag(7), "sensor_mag:1": mag(9)})
    assert [(one.source, one.instance, one.calibrated) for one in flight.compasses] == [
        ("vehicle_magnetometer", 0, True),
        ("sensor_mag_1", 1, False),
    ]
    np.testing.assert_allclose(flight.compasses[0].field[0], [25e-6, 0.0, 40e-6], atol=1e-12)


@pytest.mark.parametrize("constant", [0.0, 0.3])
def test_a_compass_that_never_changes_is_none(read: Any, constant: float) -> None:
    flight = read(
        {"vehicle_magnetometer": {"timestamp": T, "magnetometer_ga": full(constant, size=3)}, "sensor_baro": baro()}
    )
    assert not flight.compasses
    assert any(note.startswith("vehicle_magnetometer left out") for note in flight.notes)


def baro(pressure: float = 95_000.0) -> dict[str, npt.NDArray[Any]]:
    return {
        "timestamp": T,
        "pressure": (pressure + np.arange(N) * pressure * 1e-6).astype(F32),
        "temperature": full(21.0),
    }


@pytest.mark.parametrize("pressure", [95_000.0, 950.0])
def test_a_pressure_is_in_pascal_whatever_the_firmware(read: Any, pressure: float) -> None:
    (track,) = read({"sensor_baro": baro(pressure)}).barometers
    assert np.median(track.pressure) == pytest.approx(95_000, rel=1e-4)
    assert np.median(track.altitude) == pytest.approx(540, abs=5)


def test_compass_and_barometer_were_once_in_sensor_combined(read: Any) -> None:
    offset = full(-3_000, np.int32)
    offset[::2] = 2_147_483_647  # no reading
    flight = read(
        {
            "sensor_combined": {
                "timestamp": T,
                "gyro_rad": vectors(0, 0, 0),
                "gyro_integral_dt": full(4000, np.uint32),
                "accelerometer_m_s2": vectors(0, 0, -9.8),
                "magnetometer_timestamp_relative": offset,
                "magnetometer_ga": vectors(0.2, 0.1, 0.4),
                "baro_timestamp_relative": offset,
                "baro_alt_meter": np.linspace(100, 101, N).astype(F32),
                "baro_temp_celcius": full(30.0),
            }
        },
        version=(1, 6),
    )
    ((compass,), (barometer,)) = flight.compasses, flight.barometers
    np.testing.assert_allclose(compass.t, T[1::2] * 1e-6 - 0.003)
    np.testing.assert_allclose(barometer.t, compass.t)
    assert np.isnan(barometer.pressure).all()
    assert barometer.altitude[-1] == pytest.approx(101)


@pytest.mark.parametrize(
    ("version", "topic", "interval", "attitude"),
    [
        ((1, 6), "estimator_status", 0.012, 4),
        ((1, 8), "estimator_status", 0.008, 4),
        ((1, 13), "estimator_states", 0.010, 4),
        ((1, 16), "estimator_states", 1.0, 3),
    ],
)
def test_a_bias_in_the_state_vector_is_that_of_its_version(
    read: Any, version: tuple[int, int], topic: str, interval: float, attitude: int
) -> None:
    states, covariances = full(0.0, size=25), full(0.0, size=24)
    states[:, 10:13], states[:, 13:16] = (
        np.array([0.01, -0.02, 0.005]) * interval,
        np.array([0.1, 0.2, -0.3]) * interval,
    )
    covariances[:, attitude + 6 : attitude + 9] = (0.001 * interval) ** 2
    covariances[:, attitude + 9 : attitude + 12] = (0.05 * interval) ** 2
    (track,) = read({topic: {"timestamp": T, "states": states, "covariances": covariances}}, version=version).biases
    np.testing.assert_allclose(track.gyro[0], [0.01, -0.02, 0.005], rtol=1e-5)
    np.testing.assert_allclose(track.accel[0], [0.1, 0.2, -0.3], rtol=1e-5)
    np.testing.assert_allclose(track.gyro_sigma, 0.001, rtol=1e-4)
    np.testing.assert_allclose(track.accel_sigma, 0.05, rtol=1e-4)


def test_a_bias_is_told_for_each_sensor_and_only_where_there_is_one(read: Any) -> None:
    gyro, valid = full(11, np.uint32), full(1, np.bool_)
    gyro[30:], valid[:5] = 12, 0
    topic = {
        "timestamp": T,
        "gyro_device_id": gyro,
        "accel_device_id": gyro,
        "gyro_bias": vectors(0.01, 0, 0),
        "accel_bias": vectors(0.1, 0, 0),
        "gyro_bias_variance": full(1e-6, size=3),
        "accel_bias_variance": full(1e-4, size=3),
        "gyro_bias_valid": valid,
        "accel_bias_valid": full(1, np.bool_),
    }
    imus = {f"vehicle_imu:{i}": imu(11 + i) for i in range(2)}
    first, second = read({"estimator_sensor_bias": topic, **imus}).biases
    assert (first.imu_instance, len(first), second.imu_instance, len(second)) == (0, 30, 1, 20)
    assert np.isnan(first.gyro[:5]).all()
    assert np.isfinite(first.accel).all()
    np.testing.assert_allclose(second.gyro_sigma, 1e-3, rtol=1e-5)


def imu(device: int, every: int = 100_000, dt: int = 4_000) -> Fields:
    t = np.arange(1, N + 1, dtype=np.uint64) * np.uint64(every)
    return {
        "timestamp": t + np.uint64(500),
        "timestamp_sample": t,
        "accel_device_id": full(device, np.uint32),
        "gyro_device_id": full(device, np.uint32),
        "delta_angle": vectors(0.1, -0.2, 0.3) * F32(dt * 1e-6),
        "delta_velocity": vectors(0, 0, -9.8) * F32(dt * 1e-6),
        "delta_angle_dt": full(dt, np.uint32),
        "delta_velocity_dt": full(dt, np.uint32),
    }


def test_vehicle_imu_is_the_mean_over_its_interval(read: Any) -> None:
    flight = read({"vehicle_imu": imu(0x26000A, every=4_000), "vehicle_imu:1": imu(0x3C0012)})
    track = flight.imus["vehicle_imu"]
    np.testing.assert_allclose(track.t, np.arange(1, N + 1) * 0.004 - 0.002)
    np.testing.assert_allclose(track.interval, 0.004)
    np.testing.assert_allclose(track.gyro[0], [0.1, -0.2, 0.3], rtol=1e-5)
    assert track.covered == pytest.approx(1.0)
    assert flight.imus["vehicle_imu_1"].covered == pytest.approx(0.04)
    assert (track.device_id, track.bias_removed, track.low_pass_hz) == (0x26000A, False, None)
    assert track.gyro_range == pytest.approx(np.radians(2000))
    assert track.accel_range == pytest.approx(16 * STANDARD_GRAVITY)
    assert flight.default_imu == "vehicle_imu"


def test_each_sensor_is_the_mean_over_its_own_interval(read: Any) -> None:
    """An accelerometer that samples less often than the gyro integrates for longer."""
    other = {"delta_velocity": vectors(0, 0, -9.8) * F32(5e-3), "delta_velocity_dt": full(5_000, np.uint32)}
    track = read({"vehicle_imu": dict(imu(1)) | other}).imus["vehicle_imu"]
    np.testing.assert_allclose(track.gyro[0], [0.1, -0.2, 0.3], rtol=1e-5)
    np.testing.assert_allclose(track.accel[0], [0.0, 0.0, -9.8], rtol=1e-5)


def test_an_imu_of_zeros_is_left_out(read: Any) -> None:
    silent = dict(imu(3)) | {name: full(0.0, size=3) for name in ("delta_angle", "delta_velocity")}
    flight = read({"vehicle_imu": imu(2), "vehicle_imu:1": silent})
    assert list(flight.imus) == ["vehicle_imu"]
    assert "vehicle_imu_1 left out: it has no readings, or zeros only" in flight.notes


def test_a_fifo_is_every_sample_that_it_held(read: Any) -> None:
    """8 kHz in messages of 32, calibrated and turned into the body frame: the track with the most samples."""
    sample = np.arange(1, N + 1, dtype=np.uint64) * np.uint64(4_000)

    def fifo(scale: float, device: int, x: float) -> Fields:
        raw = np.full((N, 32), round(x / scale), np.int16)
        raw[:, 1] += np.int16(7)
        zero = np.zeros((N, 32), np.int16)
        return {
            "timestamp": sample,
            "timestamp_sample": sample,
            "device_id": full(device, np.uint32),
            "dt": full(125.0),
            "scale": full(scale),
            "samples": full(32, np.uint8),
            "x": raw,
            "y": zero,
            "z": zero,
        }

    flight = read(
        {
            "vehicle_imu": imu(0x26000A, every=4_000),
            "sensor_gyro_fifo": fifo(1e-3, 0x26000A, 0.5),
            "sensor_accel_fifo": fifo(5e-3, 0x26000A, 9.8),
        },
        parameters={
            "CAL_GYRO0_ID": 0x26000A,
            "CAL_GYRO0_XOFF": 0.1,
            "CAL_ACC0_ID": 0x26000A,
            "CAL_ACC0_XOFF": 0.05,
            "CAL_ACC0_XSCALE": 1.01,
            "SENS_BOARD_ROT": 2,
        },
    )
    track = flight.imus["sensor_gyro_fifo"]
    assert track.rate_hz == pytest.approx(8_000)
    assert len(track) == N * 32
    assert track.interval is None
    np.testing.assert_allclose(track.t[31], 0.004)
    np.testing.assert_allclose(track.t[0], 0.004 - 31 * 125e-6)
    # Yaw 90°: what the board reads forward is to the right of the vehicle.
    np.testing.assert_allclose(track.gyro[0], [0.0, 0.4, 0.0], atol=1e-6)
    np.testing.assert_allclose(track.gyro[1], [0.0, 0.407, 0.0], atol=1e-6)
    np.testing.assert_allclose(track.accel[0], [0.0, (9.8 - 0.05) * 1.01, 0.0], atol=1e-6)
    assert track.gyro_range == pytest.approx(32.768)
    assert flight.default_imu == "vehicle_imu"  # means over intervals that join lose nothing


def test_what_the_controllers_use_is_the_last_resort(read: Any) -> None:
    body = {"timestamp": T, "timestamp_sample": T, "xyz": vectors(0.1, 0.2, 0.3)}
    push = {"timestamp": T, "timestamp_sample": T, "xyz": vectors(0, 0, -9.8)}
    topics = {"vehicle_angular_velocity": body, "vehicle_acceleration": push}
    track = read(topics, parameters={"IMU_GYRO_CUTOFF": 40.0, "IMU_ACCEL_CUTOFF": 30.0}).imus[
        "vehicle_angular_velocity"
    ]
    assert (track.bias_removed, track.interval) == (True, None)
    assert (track.gyro_low_pass_hz, track.accel_low_pass_hz) == (40.0, 30.0)
    assert list(read(topics | {"vehicle_imu": imu(1)}).imus) == ["vehicle_imu"]


def test_the_imu_in_use_is_known_by_its_device(read: Any) -> None:
    chosen = full(11, np.uint32)
    chosen[20:40] = 12
    chosen[45] = 99  # an IMU that the log does not have
    flight = read(
        {
            "vehicle_imu": imu(11),
            "vehicle_imu:1": imu(12),
            "sensor_selection": {"timestamp": T, "gyro_device_id": chosen},
        }
    )
    assert flight.imu_in_use
    assert flight.imu_in_use.instance.tolist() == [0, 1, 0]
    np.testing.assert_allclose(flight.imu_in_use.t, T[[0, 20, 40]] * 1e-6)


def test_announced_resets(read: Any) -> None:
    """Counters are bytes; two resets between two rows are told as such."""
    quat, xy, turn = full(255, np.uint8), full(3, np.uint8), full(0.0, size=4)
    turn[:, 0] = 1.0
    quat[20:], quat[30:], xy[40:] = 0, 1, 5
    turn[20:30] = [np.cos(0.05), 0, 0, np.sin(0.05)]
    turn[30:] = [np.cos(0.05), np.sin(0.05), 0, 0]
    place = {name: full(0.0) for name in ("x", "y", "z", "vx", "vy", "vz", "ref_alt")}
    flags = {name: full(1, np.bool_) for name in ("xy_valid", "z_valid", "v_xy_valid", "v_z_valid")}
    flight = read(
        {
            "vehicle_attitude": {
                "timestamp": T,
                "q": np.tile(np.array([1, 0, 0, 0], F32), (N, 1)),
                "delta_q_reset": turn,
                "quat_reset_counter": quat,
            },
            "vehicle_local_position": {
                "timestamp": T,
                **place,
                **flags,
                "ref_lat": full(47.0, np.float64),
                "ref_lon": full(8.0, np.float64),
                "delta_xy": full(3.0, size=2),
                "xy_reset_counter": xy,
            },
            "estimator_selector_status": {
                "timestamp": T,
                "primary_instance": np.repeat(np.array([0, 2], np.uint8), N // 2),
                "gyro_device_id": full(11, np.uint32),
            },
        }
    )
    assert [(reset.t, reset.kind, reset.text) for reset in flight.resets] == [
        (pytest.approx(2.1), "heading", "heading reset by 5.7°"),
        (pytest.approx(2.6), "lane", "EKF2 instance 0 → 2"),
        (pytest.approx(3.1), "attitude", "attitude reset by 5.7°"),
        (pytest.approx(4.1), "position", "position reset by 4.24 m, the last of 2"),
    ]


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ((1100, 1500, 1900), (0.1, 0.5, 0.9)),
        ((0.1, 0.5, 0.9), (0.1, 0.5, 0.9)),
        ((819.1, 4095.5, 8191.0), (0.1, 0.5, 1.0)),
    ],
)
def test_outputs_are_shares_of_their_range(read: Any, values: tuple[float, ...], expected: tuple[float, ...]) -> None:
    moving = np.tile(np.array(values, F32), (N, 1))
    moving[::2] *= F32(0.9999)
    outputs = np.concatenate((moving, full(0.0, size=13)), axis=1)
    still = {"timestamp": T, "noutputs": full(1, np.uint32), "output": full(1500.0, size=16)}
    flight = read(
        {
            "actuator_outputs": still,
            "actuator_outputs:1": {"timestamp": T, "noutputs": full(4, np.uint32), "output": outputs},
        }
    )
    assert flight.actuators
    assert flight.actuators.source == "actuator_outputs_1"
    np.testing.assert_allclose(flight.actuators.output[1], expected, atol=1e-3)


def test_a_setpoint_without_a_quaternion_is_one_of_angles(read: Any) -> None:
    topic = {
        "timestamp": T,
        "roll_body": full(0.0),
        "pitch_body": full(0.0),
        "yaw_body": full(1.0),
        "q_d": full(0.0, size=4),
        "q_d_valid": full(0, np.bool_),
    }
    track = read({"vehicle_attitude_setpoint": topic}).control
    assert track
    np.testing.assert_allclose(track.q_ned_frd[0], [np.cos(0.5), 0, 0, np.sin(0.5)], atol=1e-7)


def test_nan_everywhere_is_nothing_anywhere(read: Any) -> None:
    nan = full(np.nan, size=3)
    flight = read(
        {
            "vehicle_gps_position": gps(
                latitude_deg=full(np.nan, np.float64),
                longitude_deg=full(np.nan, np.float64),
                altitude_msl_m=full(np.nan, np.float64),
            ),
            "vehicle_magnetometer": {"timestamp": T, "magnetometer_ga": nan},
            "sensor_baro": {"timestamp": T, "pressure": nan[:, 0]},
            "vehicle_imu": dict(imu(1)) | {"delta_angle": nan},
            "estimator_sensor_bias": {"timestamp": T, "gyro_bias": nan, "accel_bias": nan},
            "vehicle_attitude_groundtruth": {"timestamp": T, "q": full(np.nan, size=4)},
            "vehicle_attitude_setpoint": {"timestamp": T, "q_d": full(np.nan, size=4)},
            "actuator_outputs": {"timestamp": T, "noutputs": full(4, np.uint32), "output": full(np.nan, size=16)},
        }
    )
    assert not any((flight.gps, flight.compasses, flight.barometers, flight.imus, flight.biases))
    assert flight.truth is flight.control is flight.actuators is flight.imu_in_use is None
    assert len(flight.notes) == 4


def test_how_far_imus_are_apart_is_what_px4_says_of_those_that_there_are(read: Any) -> None:
    ids = np.tile(np.array([3932170, 4325386, 0, 0], np.uint32), (N, 1))
    apart = np.column_stack([np.arange(N) * 1e-3, np.arange(N) * 2e-3, np.zeros((N, 2))]).astype(F32)
    healthy = np.tile(np.array([True, False, False, False]), (N, 1))
    flight = read(
        {
            "sensors_status_imu": {
                "timestamp": T,
                "gyro_device_ids": ids,
                "gyro_inconsistency_rad_s": apart,
                "gyro_healthy": healthy,
                "accel_device_ids": ids,
                "accel_inconsistency_m_s_s": 10 * apart,
                "accel_healthy": healthy,
            }
        }
    )
    told = flight.series["inconsistency"]
    np.testing.assert_array_equal(told.t, T * 1e-6)
    for i in (0, 1):
        np.testing.assert_array_equal(told[f"gyro_{i}_radps"], apart[:, i])
        np.testing.assert_array_equal(told[f"accel_{i}_mps2"], (10 * apart)[:, i])
        assert (told[f"gyro_{i}_healthy"] == healthy[:, i]).all(), "a sensor that is never healthy is one nevertheless"
    assert np.isnan(told["gyro_2_radps"]).all(), "its device id is 0"
    assert np.isnan(told["accel_3_healthy"]).all()


def test_one_damaged_interval_does_not_change_the_unit_of_all(tmp_path: Path) -> None:
    """Some releases before PX4 1.7 tell the interval in s, all others in µs."""
    n = 400
    interval = np.full(n, 0.004, np.float32)
    interval[100] = 3e7
    readings = np.tile(np.array([0.01, 0.0, -9.8], np.float32), (n, 1))
    t = (10_000_000 + 4000 * np.arange(n)).astype(np.uint64)
    combined: Fields = {"timestamp": t, "gyro_rad": readings, "accelerometer_m_s2": readings}
    path = tmp_path / "old.ulg"
    path.write_bytes(ulog({"sensor_combined": {**combined, "gyro_integral_dt": interval}}, version=(1, 6)))
    imu = c.open_log(path)[0].imus["sensor_combined"]
    assert len(imu) == n - 1
    assert imu.interval is not None
    np.testing.assert_allclose(imu.interval, 0.004, rtol=1e-6)
    assert imu.t[0] == pytest.approx(9.998)
