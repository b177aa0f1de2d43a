"""The fields of each message of a simulated autopilot at the steps of its loop, in wire units."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.mavlink import MessageLayout
from companion.model import STANDARD_GRAVITY, Array, geodetic_from_ned
from companion.simulate.true_flight import GPS_SIGMA, HOME, Flown, pressure
from companion.strapdown import quaternion

Steps = npt.NDArray[np.int64]
Fields = Mapping[str, npt.NDArray[Any] | float]

_ALIGNED = 0b11_0011_1111  # ESTIMATOR_STATUS_FLAGS: attitude, velocity, position and height are known
_RATIO = 0.05  # of an innovation to what it may be, in an estimator that is well
_LOCAL_NED, _ON_GROUND, _IN_AIR = 1, 1, 2  # MAV_FRAME, MAV_LANDED_STATE
_ALOFT_M = 0.1
_COVARIANCE = 21  # elements; the first is NaN where it is not known


def _odometry(flown: Flown, index: Steps, _: Steps) -> Fields:
    """As PX4's: both frames are local NED."""
    unknown = np.full((len(index), _COVARIANCE), np.nan)
    names = ("x", "y", "z", "vx", "vy", "vz", "rollspeed", "pitchspeed", "yawspeed")
    columns = np.hstack([flown.position[index], flown.velocity[index], flown.rates[index]]).T
    known = dict(zip(names, columns, strict=True)) | {"q": flown.q_ned_frd[index]}
    frames = {"frame_id": _LOCAL_NED, "child_frame_id": _LOCAL_NED}
    return {**known, **frames, "pose_covariance": unknown, "velocity_covariance": unknown}


_MG, _MRAD = STANDARD_GRAVITY * 1e-3, 1e-3
_GAUSS = 1e-4  # tesla
_FIX_3D, _SATELLITES, _UNKNOWN = 3, 14, 65535
_HPA, _MILD = 100.0, 2500  # Pa; cdegC
_IMU = ("xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro")
_COMPASS = ("xmag", "ymag", "zmag")
_ANGLES, _RATES = ("roll", "pitch", "yaw"), ("rollspeed", "pitchspeed", "yawspeed")
_QUATERNION = ("q1", "q2", "q3", "q4")

STREAMS = {
    "RAW_IMU": 27, "SCALED_IMU": 26, "SCALED_IMU2": 116, "HIGHRES_IMU": 105, "ATTITUDE": 30,
    "ATTITUDE_QUATERNION": 31, "LOCAL_POSITION_NED": 32, "GLOBAL_POSITION_INT": 33, "SYS_STATUS": 1, "SIM_STATE": 108,
    "GPS_RAW_INT": 24, "SCALED_PRESSURE": 29, "VIBRATION": 241, "EKF_STATUS_REPORT": 193, "ESTIMATOR_STATUS": 230,
    "EXTENDED_SYS_STATE": 245, "ODOMETRY": 331, "GPS2_RAW": 124, "SCALED_IMU3": 129, "ATTITUDE_TARGET": 83,
}  # fmt: skip
"""Messages that can be requested → their ids."""


def payloads(layout: MessageLayout, flown: Flown, index: Steps, boot_us: Steps) -> list[bytes]:
    """The payloads of one message at loop steps `index` (N,), `boot_us` (N,) µs after boot: as on the wire, untrimmed.

    Integers are cut towards zero, as ArduPilot's C casts do (GCS_Common.cpp, send_raw_imu).
    """
    rows = np.zeros(len(index), layout.dtype)
    stamps = {"time_usec": boot_us, "time_boot_ms": boot_us // 1000}
    fields = {name: stamp for name, stamp in stamps.items() if name in layout.fields}
    for field, values in (fields | dict(_FIELDS[layout.name](flown, index, boot_us))).items():
        rows[field] = values
    packed, size = rows.tobytes(), layout.max_length
    return [packed[begin : begin + size] for begin in range(0, len(packed), size)]


def _global(flown: Flown, index: Steps, _: Steps) -> Fields:
    position = flown.position[index]
    place = _geodetic(position) * [1e7, 1e7, 1e3]
    names = ("lat", "lon", "alt", "relative_alt", "vx", "vy", "vz")
    columns = _columns(names, place, -position[:, 2:] * 1e3, flown.velocity[index] * 100)
    return {**columns, "hdg": _UNKNOWN}  # not known


def _fix(flown: Flown, index: Steps, boot_us: Steps) -> Fields:
    """GPS_RAW_INT: the newest fix, with the time at which it came. Without the extensions that it does not know."""
    seen, t = flown.aiding, flown.truth.t[index]
    newest = np.maximum(np.searchsorted(seen.fixed, t + 1e-6, side="right") - 1, 0)
    place, (north, east, _) = _geodetic(seen.place[newest]) * [1e7, 1e7, 1e3], seen.velocity[newest].T
    horizontal, vertical, speed = (round(1e3 * sigma) for sigma in GPS_SIGMA)
    return {
        "time_usec": np.maximum(boot_us - np.rint((t - seen.fixed[newest]) * 1e6).astype(np.int64), 0),
        **_columns(("lat", "lon", "alt"), place),
        "vel": np.hypot(north, east) * 100,
        "cog": np.degrees(np.arctan2(east, north)) % 360.0 * 100,
        "fix_type": _FIX_3D, "satellites_visible": _SATELLITES, "eph": 80, "epv": 120,
        "h_acc": horizontal, "v_acc": vertical, "vel_acc": speed, "hdg_acc": 0, "yaw": 0,
    }  # fmt: skip


def _highres(flown: Flown, index: Steps, _: Steps) -> Fields:
    readings = flown.imu.accel[index], flown.imu.gyro[index], flown.aiding.fields[0][index] / _GAUSS
    return {**_columns((*_IMU, *_COMPASS), *readings), "fields_updated": 0x1FF}


def _milli(flown: Flown, index: Steps, _: Steps, *, second: bool = False) -> Fields:
    imu, field = flown.second if second else flown.imu, flown.aiding.fields[second]
    readings = np.hstack([imu.accel[index] / _MG, imu.gyro[index] / _MRAD, field[index] / _GAUSS * 1e3])
    return _columns((*_IMU, *_COMPASS), np.clip(np.trunc(readings), -32768, 32767))


def _truth(flown: Flown, index: Steps, _: Steps) -> Fields:
    """SIM_STATE; like ArduPilot's without a time of its own, and with degE7 in lat_int and lon_int."""
    truth = flown.truth
    q, place = truth.q_ned_frd[index], _geodetic(truth.position[index])
    names = (*_QUATERNION, *_ANGLES, "lat", "lon", "alt", "lat_int", "lon_int", *_IMU, "vn", "ve", "vd")
    sensed = truth.accel[index], truth.gyro[index], truth.velocity[index]
    return _columns(names, q, quaternion.to_euler(q), place, place[:, :2] * 1e7, *sensed)


def _columns(names: tuple[str, ...], *values: Array) -> Fields:
    """Field names → columns of blocks (N, ...) that lie side by side."""
    return dict(zip(names, np.hstack(values).T, strict=True))


def _geodetic(position: Array) -> Array:
    """NED (N, 3) in m about home → latitude and longitude in °, altitude in m."""
    place = geodetic_from_ned(position, HOME)
    return np.column_stack([np.degrees(place[:, :2]), place[:, 2]])


def _ratios(*names: str) -> Callable[[Flown, Steps, Steps], Fields]:
    return lambda _flown, _index, _: dict.fromkeys(names, _RATIO) | {"flags": _ALIGNED}


_FIELDS: Mapping[str, Callable[[Flown, Steps, Steps], Fields]] = {
    "RAW_IMU": _milli,
    "SCALED_IMU": _milli,
    "SCALED_IMU2": partial(_milli, second=True),
    "HIGHRES_IMU": _highres,
    "ATTITUDE": lambda f, i, _: _columns((*_ANGLES, *_RATES), quaternion.to_euler(f.q_ned_frd[i]), f.rates[i]),
    "ATTITUDE_QUATERNION": lambda f, i, _: _columns((*_QUATERNION, *_RATES), f.q_ned_frd[i], f.rates[i]),
    "LOCAL_POSITION_NED": lambda f, i, _: _columns(("x", "y", "z", "vx", "vy", "vz"), f.position[i], f.velocity[i]),
    "GLOBAL_POSITION_INT": _global,
    "GPS_RAW_INT": _fix,
    "SCALED_PRESSURE": lambda f, i, _: {"press_abs": pressure(f.aiding.height[i]) / _HPA, "temperature": _MILD},
    "SIM_STATE": _truth,
    "SYS_STATUS": lambda *_: {"load": 250, "voltage_battery": 12_600, "battery_remaining": 80},
    "VIBRATION": lambda *_: dict.fromkeys(("vibration_x", "vibration_y", "vibration_z"), 1),
    "EKF_STATUS_REPORT": _ratios("velocity_variance", "pos_horiz_variance", "pos_vert_variance", "compass_variance"),
    "ESTIMATOR_STATUS": _ratios("vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio"),
    "EXTENDED_SYS_STATE": lambda f, i, _: {
        "landed_state": np.where(-f.truth.position[i, 2] > _ALOFT_M, _IN_AIR, _ON_GROUND)
    },
    "ODOMETRY": _odometry,
}
"""Message → its fields but the stamp, at loop steps (N,), at times (N,) µs after boot."""
