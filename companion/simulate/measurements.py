"""What each message of a simulated autopilot carries at a step of its loop, in wire units."""

from __future__ import annotations

import numpy as np

from companion.frames import geodetic_from_ned
from companion.mavlink import Value
from companion.simulate.flown import Flown
from companion.strapdown import quaternion
from companion.tracks import STANDARD_GRAVITY, ImuTrack

Fields = dict[str, Value]

_MG, _MRAD = STANDARD_GRAVITY * 1e-3, 1e-3
_HOME = (float(np.radians(47.0)), float(np.radians(8.0)), 500.0)  # latitude and longitude in rad, altitude in m

STREAMS = {
    "RAW_IMU": 27, "SCALED_IMU": 26, "SCALED_IMU2": 116, "HIGHRES_IMU": 105, "ATTITUDE": 30,
    "ATTITUDE_QUATERNION": 31, "LOCAL_POSITION_NED": 32, "GLOBAL_POSITION_INT": 33, "SYS_STATUS": 1, "SIM_STATE": 108,
}  # fmt: skip
"""Messages that can be asked for → their ids."""


def fields(name: str, flown: Flown, index: int, boot_us: int) -> Fields:
    """The fields of message `name` at loop step `index`, `boot_us` µs after boot.

    Integers are cut towards zero, as ArduPilot's C casts do (GCS_Common.cpp, send_raw_imu).
    """
    if name == "SYS_STATUS":
        return {"load": 250, "voltage_battery": 12_600, "battery_remaining": 80}
    if name == "SIM_STATE":
        return _truth(flown, index)
    stamp: Fields = {"time_usec": boot_us} if name in ("RAW_IMU", "HIGHRES_IMU") else {"time_boot_ms": boot_us // 1000}
    if name == "HIGHRES_IMU":
        return {**stamp, **_floats(flown, index), "fields_updated": 0x3F}
    if name in ("RAW_IMU", "SCALED_IMU", "SCALED_IMU2"):
        return stamp | _milli(flown.second if name == "SCALED_IMU2" else flown.imu, index)
    return stamp | (_attitude(name, flown, index) if name.startswith("ATTITUDE") else _position(name, flown, index))


def _attitude(name: str, flown: Flown, index: int) -> Fields:
    q = flown.q_ned_frd[index]
    rates = zip(("rollspeed", "pitchspeed", "yawspeed"), flown.rates[index].tolist(), strict=True)
    if name == "ATTITUDE":
        return {**dict(zip(("roll", "pitch", "yaw"), _euler(q), strict=True)), **dict(rates)}
    return {**dict(zip(("q1", "q2", "q3", "q4"), q.tolist(), strict=True)), **dict(rates)}


def _position(name: str, flown: Flown, index: int) -> Fields:
    position, velocity = flown.position[index].tolist(), flown.velocity[index].tolist()
    if name == "LOCAL_POSITION_NED":
        return dict(zip(("x", "y", "z", "vx", "vy", "vz"), position + velocity, strict=True))
    lat, lon, alt = _geodetic(position)
    return {
        "lat": int(lat * 1e7),
        "lon": int(lon * 1e7),
        "alt": int(alt * 1e3),
        "relative_alt": int(-position[2] * 1e3),
        **dict(zip(("vx", "vy", "vz"), (int(v * 100) for v in velocity), strict=True)),
        "hdg": 65535,  # not known
    }


def _milli(imu: ImuTrack, index: int) -> Fields:
    accel = np.clip(np.trunc(imu.accel[index] / _MG), -32768, 32767).astype(int).tolist()
    gyro = np.clip(np.trunc(imu.gyro[index] / _MRAD), -32768, 32767).astype(int).tolist()
    return dict(zip(("xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro"), accel + gyro, strict=True))


def _floats(flown: Flown, index: int) -> Fields:
    values = flown.imu.accel[index].tolist() + flown.imu.gyro[index].tolist()
    return dict(zip(("xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro"), values, strict=True))


def _truth(flown: Flown, index: int) -> Fields:
    """SIM_STATE; like ArduPilot's without a time of its own, and with degE7 in lat_int and lon_int."""
    truth = flown.truth
    roll, pitch, yaw = _euler(truth.q_ned_frd[index])
    lat, lon, alt = _geodetic(truth.position[index].tolist())
    found: Fields = dict(zip(("q1", "q2", "q3", "q4"), truth.q_ned_frd[index].tolist(), strict=True))
    found |= {"roll": roll, "pitch": pitch, "yaw": yaw, "alt": alt, "lat": lat, "lon": lon}
    found |= {"lat_int": int(lat * 1e7), "lon_int": int(lon * 1e7)}
    keys = ("xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro", "vn", "ve", "vd")
    values = np.concatenate((truth.accel[index], truth.gyro[index], truth.velocity[index])).tolist()
    return found | dict(zip(keys, values, strict=True))


def _euler(q: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> list[float]:
    """Roll, pitch, yaw in rad."""
    return [float(angle) for angle in np.ravel(quaternion.to_euler(q))]


def _geodetic(position: list[float]) -> tuple[float, float, float]:
    """NED in m about home → latitude and longitude in °, altitude in m."""
    latitude, longitude, height = geodetic_from_ned(np.array([position]), _HOME)[0].tolist()
    return float(np.degrees(latitude)), float(np.degrees(longitude)), height
