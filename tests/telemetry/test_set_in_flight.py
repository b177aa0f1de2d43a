"""What is set, saved or said again while a log runs, and what holds when."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import companion as c
from companion.mavlink import Packer
from tests.dataflash_writer import write_dataflash
from tests.tlogs import Writer
from tests.ulogs import key, message, ulog

DEVICE = 1310988
TYPES = {
    "PARM": ("QNf", "TimeUS,Name,Value"),
    "IMU": ("QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "XKQ": ("QBffff", "TimeUS,C,Q1,Q2,Q3,Q4"),
    "XKF1": ("QBfffffffff", "TimeUS,C,VN,VE,VD,PN,PE,PD,GX,GY,GZ"),
    "XKF4": ("QBcb", "TimeUS,C,SV,PI"),
    "ATT": ("Qcccccc", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
    "ERR": ("QBB", "TimeUS,Subsys,ECode"),
}


def test_a_calibration_that_is_saved_after_the_landing_changes_nothing_before(tmp_path: Path) -> None:
    n = 400
    t, zero = (10_000_000 + 5000 * np.arange(n)).astype(np.uint64), np.zeros(n, np.float32)
    noise = 1e-4 * np.random.default_rng(1).normal(size=n)
    sensor: dict[str, Any] = {"timestamp": t, "timestamp_sample": t, "device_id": np.full(n, DEVICE, np.uint32)}
    gyro = {**sensor, "x": (0.02 + noise).astype(np.float32), "y": zero, "z": zero}
    accel = {**sensor, "x": zero, "y": noise.astype(np.float32), "z": zero - np.float32(9.8)}
    parameters = {"CAL_GYRO0_ID": DEVICE, "CAL_GYRO0_XOFF": 0.02, "CAL_ACC0_ID": DEVICE}
    log = tmp_path / "a.ulg"
    written = ulog({"sensor_gyro": gyro, "sensor_accel": accel}, parameters)
    log.write_bytes(written + message(b"P", key("float CAL_GYRO0_XOFF") + struct.pack("<f", 0.05)))
    (flight,) = c.open_log(log)
    assert flight.parameters["CAL_GYRO0_XOFF"] == np.float32(0.05)
    (imu,) = flight.imus.values()
    np.testing.assert_allclose(imu.gyro[:-2, 0].mean(), 0.0, atol=1e-4)


@pytest.mark.parametrize("sign", ["a field of old", "a parameter of old"])
def test_what_the_drivers_of_old_have_calibrated_is_not_calibrated_again(tmp_path: Path, sign: str) -> None:
    """Until PX4 1.10 sensor_gyro.x is without CAL_GYROn_XOFF already (PX4Gyroscope::update, val_calibrated)."""
    n, of_old = 400, sign == "a field of old"
    t, zero = (10_000_000 + 5000 * np.arange(n)).astype(np.uint64), np.zeros(n, np.float32)
    noise = (1e-4 * np.random.default_rng(1).normal(size=n)).astype(np.float32)
    sensor: dict[str, Any] = {"timestamp": t, "device_id": np.full(n, DEVICE, np.uint32)}
    sensor |= {"integral_dt": np.full(n, 5000, np.uint32)} if of_old else {}
    gyro, accel = {**sensor, "x": noise, "y": zero, "z": zero}, {**sensor, "x": noise, "y": zero, "z": zero - 9.8}
    accel["z"] = accel["z"].astype(np.float32)
    parameters = {"CAL_GYRO0_ID": DEVICE, "CAL_GYRO0_XOFF": 0.02, "CAL_ACC0_ID": DEVICE, "CAL_ACC0_ZSCALE": 1.1}
    parameters |= {} if of_old else {"CAL_GYRO0_EN": 1, "CAL_ACC0_EN": 1}
    log = tmp_path / "a.ulg"
    log.write_bytes(ulog({"sensor_gyro": gyro, "sensor_accel": accel}, parameters, version=(1, 9)))
    (flight,) = c.open_log(log)
    (imu,) = flight.imus.values()
    np.testing.assert_allclose(imu.gyro[:, 0].mean(), 0.0, atol=1e-4)
    np.testing.assert_allclose(imu.accel[:, 2].mean(), -9.8, atol=1e-4)


@pytest.mark.parametrize(
    ("parameters", "kind", "pitch"),
    [
        ({"PTCH_TRIM_DEG": 3.0}, 1, 3.0),
        ({"TRIM_PITCH_CD": 300.0}, 1, 3.0),
        ({"PTCH_TRIM_DEG": 3.0, "FLIGHT_OPTIONS": 256.0}, 1, 0.0),
        ({"PTCH_TRIM_DEG": 3.0, "Q_ENABLE": 1.0}, 1, 0.0),
        ({"PTCH_TRIM_DEG": 3.0}, 2, 0.0),
    ],
)
def test_the_pitch_of_a_plane_is_sent_without_its_trim(
    tmp_path: Path, parameters: dict[str, float], kind: int, pitch: float
) -> None:
    """ArduPlane's send_attitude: `p -= radians(plane.g.pitch_trim)`, unless GCS_REMOVE_TRIM_PITCH is set."""
    log = Writer(tmp_path / "plane.tlog")
    for i, (name, value) in enumerate(parameters.items()):
        said: dict[str, Any] = {"param_value": value, "param_type": 9, "param_count": 2, "param_index": i}
        log.send(0.0, "param_value", param_id=name.encode(), **said)
    for i in range(200):
        if i % 50 == 0:
            log.heartbeat(0.02 * i, kind=kind)
        log.raw_imu(0.02 * i, 20 + 0.02 * i)
        log.attitude(0.02 * i, 20 + 0.02 * i)
    path = log.close()
    (flight,) = c.open_log(path)
    assert flight.attitude is not None
    np.testing.assert_allclose(2.0 * np.degrees(np.arcsin(flight.attitude.q_ned_frd[:, 2])), pitch, atol=1e-6)
    assert any("lacks the trim" in note for note in flight.notes) == (pitch != 0.0)


def test_in_a_dataflash_log_a_trim_holds_from_when_it_is_set_and_a_mask_from_the_next_boot(tmp_path: Path) -> None:
    rows: list[tuple[str, tuple[object, ...]]] = [
        ("PARM", (10**6, name, value))
        for name, value in {"AHRS_TRIM_X": 0.0, "AHRS_TRIM_Y": 0.0, "EK3_IMU_MASK": 3.0}.items()
    ]
    for k in range(1, 400):
        t, roll = 10**6 + k * 20000, 0.01 * np.sin(0.01 * k)
        if k == 300:
            rows += [("PARM", (t, "AHRS_TRIM_X", 0.05)), ("PARM", (t, "EK3_IMU_MASK", 2.0))]
            rows += [("ERR", (t, subsystem, 0)) for subsystem in (24, 10, 12)]
        for i in (0, 1):
            rows.append(("IMU", (t, i, roll, 0.0, 0.001 * i, 0.0, 0.0, -9.8)))
            rows += [("XKQ", (t, i, 1.0, 0.5 * roll, 0.0, 0.0)), ("XKF1", (t, i, *[0.0] * 9))]
        rows += [("XKF4", (t, 0, 0, 0)), ("ATT", (t, 100, 100, 0, 0, 0, 0))]
    (flight,) = c.open_log(write_dataflash(tmp_path / "a.bin", TYPES, rows))
    assert flight.control is not None
    desired = np.degrees(2.0 * np.arcsin(flight.control.q_ned_frd[[10, -10], 1]))
    np.testing.assert_allclose(desired, [1.0, 1.0 + np.degrees(0.05)], atol=0.01)
    assert flight.imu_in_use is not None
    assert flight.imu_in_use.at(np.array([2.0, 8.0])).tolist() == [0, 0]
    assert [bias.imu_instance for bias in flight.biases] == [0, 1]
    said = [event.text for event in flight.events if event.text.startswith(("EKF primary", "flight mode", "crash"))]
    assert sum(text.endswith("resolved") for text in said) == 1, "a core and a mode are no error that ends"


class Log:
    """A telemetry log, message by message, in any order."""

    def __init__(self) -> None:
        self.messages: list[tuple[float, int, str, dict[str, Any]]] = []

    def put(self, t: float, name: str, *, echoes: int = 0, **fields: Any) -> None:
        """A message that was received at t s, and some times more, a tenth of a second apart."""
        self.messages.append((t, echoes, name, fields))

    def flight(self, path: Path) -> c.Flight:
        packer, written = Packer(1, 1), b""
        for t, echoes, name, fields in sorted(self.messages, key=lambda one: one[0]):
            packet = packer.pack(name, fields)
            for k in range(1 + echoes):
                written += int((1.7e9 + t + 0.1 * k) * 1e6).to_bytes(8, "big") + packet
        path.write_bytes(written)
        (flight,) = c.open_log(path)
        return flight


def flown(log: Log) -> None:
    for i in range(1500):
        t = 10.0 + 0.02 * i
        log.put(t, "ATTITUDE", time_boot_ms=int(1e3 * t), roll=0.01 * np.sin(t))
        log.put(t, "RAW_IMU", time_usec=int(1e6 * t), zacc=-1000, xgyro=i % 7, xmag=200 + i % 3)
        if i % 50 == 0:
            log.put(t, "HEARTBEAT", autopilot=3, type=2, custom_mode=5, base_mode=1)


def test_what_a_receiver_says_without_a_fix_is_as_old_as_what_comes_with_it(tmp_path: Path) -> None:
    """ArduPilot stamps it with the time of the last fix."""
    log = Log()
    flown(log)
    times = np.arange(10.0, 40.0, 0.2)
    fixed = (times < 20.0) | (times > 30.0)
    for t, has in zip(times, fixed, strict=True):
        stamp = int(1e6 * (t if has else 19.8))
        log.put(t, "GPS_RAW_INT", time_usec=stamp, fix_type=6 if has else 1, lat=int(4.7e8 + 1e3 * t), lon=80000000)
    flight = log.flight(tmp_path / "a.tlog")
    (gps,) = flight.gps
    assert len(gps) == len(times)
    assert ((gps.fix_type < 2) == ~fixed).all()
    np.testing.assert_allclose(np.diff(gps.t), 0.2, atol=0.05)


def test_a_text_that_is_received_several_times_was_said_once(tmp_path: Path) -> None:
    log = Log()
    flown(log)
    log.put(40.1, "STATUSTEXT", echoes=3, text=b"EKF3 IMU0 yaw aligned", severity=6)
    log.put(41.0, "STATUSTEXT", text=b"EKF3 primary changed:1", severity=4)
    flight = log.flight(tmp_path / "a.tlog")
    assert [text.text for text in flight.texts] == ["EKF3 IMU0 yaw aligned", "EKF3 primary changed:1"]
    assert sorted(reset.kind for reset in flight.resets) == ["heading", "lane"]


def test_the_pressure_of_ardupilots_airspeed_is_in_pascal(tmp_path: Path) -> None:
    """Whatever the dialect says; and 32767 is no temperature."""
    log = Log()
    flown(log)
    for t in np.arange(10.0, 40.0):
        log.put(t, "AIRSPEED", airspeed=15.0 + 0.1 * np.sin(t), raw_press=140.0 + np.sin(t), temperature=32767, id=0)
    airspeed = log.flight(tmp_path / "a.tlog").series["airspeed"]
    np.testing.assert_allclose(airspeed["pressure_pa"], 140.0, atol=1.1)
    assert np.isnan(airspeed["temperature_degc"]).all()


def test_an_imu_is_believed_up_to_its_own_range(tmp_path: Path) -> None:
    """HIGHRES_IMU of the second, an ADIS1647x of 40 g, beside a first one of 16 g."""
    log = Log()
    devices = {"INS_ACC_ID": 0x34000A, "INS_GYR_ID": 0x34000A, "INS_ACC2_ID": 0x310012, "INS_GYR2_ID": 0x310012}
    for name, value in devices.items():
        log.put(9.0, "PARAM_VALUE", param_id=name.encode(), param_value=float(value), param_type=9)
    for i in range(500):
        t, shaken = 10.0 + 0.02 * i, 35.0 if 200 <= i < 203 else 1.0
        log.put(t, "ATTITUDE", time_boot_ms=int(1e3 * t))
        log.put(t, "HIGHRES_IMU", time_usec=int(1e6 * t), id=1, zacc=-9.8 * shaken, xgyro=0.01 * np.sin(i))
        if i % 50 == 0:
            log.put(t, "HEARTBEAT", autopilot=3, type=2)
    imu = log.flight(tmp_path / "a.tlog").imus["HIGHRES_IMU"]
    assert (imu.instance, len(imu)) == (1, 500)
