"""Small logs of every format, made here: seven seconds of a vehicle that sways at 25 Hz."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from pathlib import Path

from tests.tlogs import Writer

SECONDS, HZ = 8, 25
_HEAD = b"\xa3\x95"
_SIZES = {"Q": 8, "B": 1, "f": 4, "d": 8, "L": 4, "I": 4, "H": 2, "n": 4, "N": 16, "Z": 64}
_PACK = {"n": "4s", "N": "16s", "Z": "64s", "L": "i"}
_RECORDS = {
    "PARM": (10, "QNf", "TimeUS,Name,Value"),
    "MSG": (11, "QZ", "TimeUS,Message"),
    "IMU": (12, "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "ATT": (13, "Qfff", "TimeUS,Roll,Pitch,Yaw"),
    "XKQ": (14, "QBffff", "TimeUS,C,Q1,Q2,Q3,Q4"),
    "XKF1": (15, "QBfffffffff", "TimeUS,C,VN,VE,VD,PN,PE,PD,GX,GY,GZ"),
    "XKF4": (16, "QBHb", "TimeUS,C,SS,PI"),
    "GPS": (17, "QBBIHBfLLf", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt"),
}


def _sway() -> Iterator[tuple[float, float, float]]:
    """Time s, roll rad, roll rate rad/s."""
    for i in range(SECONDS * HZ):
        t = i / HZ
        yield 20.0 + t, 0.1 * math.sin(t), 0.1 * math.cos(t)


def tlog(path: Path) -> bytes:
    """A telemetry log, packed by pymavlink."""
    log = Writer(path)
    log.send(0, "param_value", param_id=b"INS_GYR_ID", param_value=1.0, param_type=6, param_count=1, param_index=0)
    for boot, roll, _ in _sway():
        t = boot - 20.0
        log.raw_imu(t, boot)
        log.attitude(t, boot, roll=roll)
        log.local_position(t, boot)
        if (boot * HZ) % HZ == 0:
            log.heartbeat(t)
            log.send(t, "system_time", time_unix_usec=round((1.7e9 + boot) * 1e6), time_boot_ms=round(boot * 1e3))
            log.send(t, "statustext", severity=6, text=b"ArduCopter V4.6.0 (12345678)")
    return log.close().read_bytes()


def dataflash() -> bytes:
    """An ArduPilot on-board log."""
    out = [_fmt(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")]
    for name, (number, letters, columns) in _RECORDS.items():
        out.append(_fmt(number, 3 + sum(_SIZES.get(c, 1) for c in letters), name, letters, columns))
    out.append(_record("PARM", 20_000_000, b"INS_GYR_ID", 1.0))
    out.append(_record("MSG", 20_000_000, b"ArduCopter V4.6.0 (12345678)"))
    for t, roll, rate in _sway():
        us = round(t * 1e6)
        out.append(_record("IMU", us, 0, rate, 0.0, 0.0, 0.0, 9.8 * math.sin(roll), -9.8 * math.cos(roll)))
        out.append(_record("ATT", us, math.degrees(roll), 0.0, 0.0))
        out.append(_record("XKQ", us, 0, math.cos(roll / 2), math.sin(roll / 2), 0.0, 0.0))
        out.append(_record("XKF1", us, 0, 0.0, 0.0, 0.0, 1.0, 2.0, -3.0, 0.0, 0.0, 0.0))
        out.append(_record("XKF4", us, 0, 0b11111, 0))
        out.append(_record("GPS", us, 0, 3, 1000, 2300, 10, 0.8, 474_000_000, 85_000_000, 400.0))
    return b"".join(out)


def dataflash_text() -> bytes:
    """The same, written out as text."""
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    for name, (number, letters, columns) in _RECORDS.items():
        lines.append(f"FMT, {number}, {3 + sum(_SIZES.get(c, 1) for c in letters)}, {name}, {letters}, {columns}")
    lines += ["PARM, 20000000, INS_GYRO_FILTER, 20", "MSG, 20000000, ArduCopter V4.6.0 (12345678)"]
    for t, roll, rate in _sway():
        us = round(t * 1e6)
        lines.append(f"IMU, {us}, 0, {rate}, 0, 0, 0, {9.8 * math.sin(roll)}, {-9.8 * math.cos(roll)}")
        lines.append(f"ATT, {us}, {math.degrees(roll)}, 0, 0")
        lines.append(f"XKQ, {us}, 0, {math.cos(roll / 2)}, {math.sin(roll / 2)}, 0, 0")
        lines.append(f"XKF1, {us}, 0, 0, 0, 0, 1, 2, -3, 0, 0, 0")
        lines.append(f"XKF4, {us}, 0, {0b11111}, 0")
        lines.append(f"GPS, {us}, 0, 3, 1000, 2300, 10, 0.8, 47.4, 8.5, 400")
    return "\n".join([*lines, ""]).encode()


def _fmt(number: int, length: int, name: str, letters: str, columns: str) -> bytes:
    body = struct.pack("<BB4s16s64s", number, length, name.encode(), letters.encode(), columns.encode())
    return _HEAD + bytes([128]) + body


def _record(name: str, *values: object) -> bytes:
    number, letters, _ = _RECORDS[name]
    return _HEAD + bytes([number]) + struct.pack("<" + "".join(_PACK.get(c, c) for c in letters), *values)


_TOPICS = {
    "vehicle_imu": (
        "uint64_t timestamp;uint64_t timestamp_sample;float[3] delta_angle;float[3] delta_velocity;"
        "uint32_t delta_angle_dt;uint32_t delta_velocity_dt;",
        "<QQ3f3fII",
    ),
    "vehicle_attitude": ("uint64_t timestamp;float[4] q;", "<Q4f"),
    "vehicle_local_position": (
        "uint64_t timestamp;double ref_lat;double ref_lon;float x;float y;float z;float vx;float vy;float vz;"
        "float ref_alt;bool xy_valid;bool z_valid;bool v_xy_valid;bool v_z_valid;bool xy_global;",
        "<Qdd7f5?",
    ),
    "vehicle_status": ("uint64_t timestamp;uint8_t arming_state;uint8_t nav_state;", "<QBB"),
}


def ulog() -> bytes:
    """A PX4 on-board log."""
    out = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 20_000_000)]
    out += [_message("F", f"{name}:{fields}".encode()) for name, (fields, _) in _TOPICS.items()]
    for kind, name, value in (
        ("int32_t", "MAV_SYS_ID", struct.pack("<i", 1)),
        ("int32_t", "CAL_GYRO0_ID", struct.pack("<i", 7)),
        ("float", "SENS_BOARD_X_OFF", struct.pack("<f", 0.0)),
    ):
        key = f"{kind} {name}".encode()
        out.append(_message("P", bytes([len(key)]) + key + value))
    out += [_message("A", struct.pack("<BH", 0, i) + name.encode()) for i, name in enumerate(_TOPICS)]
    for t, roll, rate in _sway():
        us, dt = round(t * 1e6), 1.0 / HZ
        velocity = (0.0, 9.8 * math.sin(roll) * dt, -9.8 * math.cos(roll) * dt)
        out.append(_data(0, "vehicle_imu", us, us, rate * dt, 0.0, 0.0, *velocity, round(dt * 1e6), round(dt * 1e6)))
        out.append(_data(1, "vehicle_attitude", us, math.cos(roll / 2), math.sin(roll / 2), 0.0, 0.0))
        out.append(_data(2, "vehicle_local_position", us, 47.4, 8.5, 1.0, 2.0, -3.0, 0.0, 0.0, 0.0, 400.0, *[True] * 5))
        out.append(_data(3, "vehicle_status", us, 2, 4))
    return b"".join(out)


def _data(number: int, topic: str, *values: object) -> bytes:
    return _message("D", struct.pack("<H", number) + struct.pack(_TOPICS[topic][1], *values))


def _message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


TOML = """\
[log]
dialect = "ardupilotmega"
[integration]
method = "rk4"
gravity = 9.80665
[drift]
horizons_s = [1, 2, 5]
[live]
imu_hz = 100
"""
