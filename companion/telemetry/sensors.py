"""Which field of which message, record or topic becomes which column of a flight's series."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from companion.mavlink import Messages, Records
from companion.series import Series
from companion.telemetry.series import Fields, Found, Raw, find, series_of
from companion.tracks import Array

_COMPASS: Fields = {f"{axis}_tesla": (f"{axis}mag", "mgauss") for axis in "xyz"}
_THERMOMETER: Fields = {"temperature_degc": ("temperature", "cdegC")}
_BAROMETER: Fields = {"pressure_pa": ("press_abs", "hPa"), "temperature_degc": ("temperature", "cdegC")}
_GPS: Fields = {
    "lat_rad": ("lat", "degE7"),
    "lon_rad": ("lon", "degE7"),
    "height_m": ("alt", "mm"),
    "speed_mps": ("vel", "cm/s"),
    "satellites": ("satellites_visible", ""),
    "fix_type": ("fix_type", ""),
    "hdop": ("eph", "hundredths"),
}
_CLIPS: Fields = {f"clips_{i}": (f"clipping_{i}", "") for i in range(3)}
_VIBRATION: Fields = {f"{axis}_mps2": (f"vibration_{axis}", "m/s/s") for axis in "xyz"} | dict(_CLIPS)
# PX4 puts other things into the three fields, of the IMU that it has selected (modules/mavlink/streams/VIBRATION.hpp).
_VIBRATION_PX4: Fields = {
    "coning_rad2": ("vibration_x", ""),
    "gyro_radps": ("vibration_y", "rad/s"),
    "accel_mps2": ("vibration_z", "m/s/s"),
} | dict(_CLIPS)
_EKF_STATUS_REPORT: Fields = {
    "velocity_ratio": ("velocity_variance", ""),
    "position_ratio": ("pos_horiz_variance", ""),
    "height_ratio": ("pos_vert_variance", ""),
    "compass_ratio": ("compass_variance", ""),
    "airspeed_ratio": ("airspeed_variance", ""),
    "flags": ("flags", ""),
}
_ESTIMATOR_STATUS: Fields = {
    "velocity_ratio": ("vel_ratio", ""),
    "position_ratio": ("pos_horiz_ratio", ""),
    "height_ratio": ("pos_vert_ratio", ""),
    "compass_ratio": ("mag_ratio", ""),
    "airspeed_ratio": ("tas_ratio", ""),
    "flags": ("flags", ""),
}

_PLACE = ("north_m2", "east_m2", "down_m2")
_LEAN = ("roll_rad2", "pitch_rad2", "yaw_rad2")
_SPEED = ("vn_m2ps2", "ve_m2ps2", "vd_m2ps2")


def _diagonal(names: tuple[str, ...], field: str, places: tuple[int, ...]) -> Fields:
    """Elements of a matrix that a message sends as an array."""
    return {name: (f"{field}[{place}]", "") for name, place in zip(names, places, strict=True)}


# MAVLink common.xml: the upper triangle of a symmetric matrix row by row (6 x 6, 9 x 9), or all nine of a 3 x 3.
_ODOMETRY: Fields = {
    **_diagonal((*_PLACE, *_LEAN), "pose_covariance", (0, 6, 11, 15, 18, 20)),
    **_diagonal(_SPEED, "velocity_covariance", (0, 6, 11)),
}
_POSITION_COV: Fields = _diagonal((*_PLACE, *_SPEED), "covariance", (0, 9, 17, 24, 30, 35))
_ATTITUDE_COV: Fields = _diagonal(_LEAN, "covariance", (0, 4, 8))

_IMUS = ("RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3", "HIGHRES_IMU")
_SOURCES: tuple[tuple[str, str, Fields], ...] = (
    ("VIBRATION", "vibration", _VIBRATION),
    ("SCALED_PRESSURE", "barometer", _BAROMETER),
    ("SCALED_PRESSURE2", "barometer", _BAROMETER),
    ("SCALED_PRESSURE3", "barometer", _BAROMETER),
    ("GPS_RAW_INT", "gps", _GPS),
    ("GPS2_RAW", "gps", _GPS),
    *((name, "magnetometer", _COMPASS) for name in _IMUS),
    *((name, "temperature", _THERMOMETER) for name in _IMUS),
    ("EKF_STATUS_REPORT", "estimator", _EKF_STATUS_REPORT),
    ("ESTIMATOR_STATUS", "estimator", _ESTIMATOR_STATUS),
    ("LOCAL_POSITION_NED_COV", "variance", _POSITION_COV),
    ("ATTITUDE_QUATERNION_COV", "variance", _ATTITUDE_COV),
    ("ODOMETRY", "variance", _ODOMETRY),
)

SENSOR_MESSAGES = frozenset(message for message, _, _ in _SOURCES)
"""Messages that become series."""


_RATIOS = ("velocity_ratio", "position_ratio", "height_ratio", "compass_ratio", "airspeed_ratio", "flags")
_XKF4: Fields = {name: (field, "") for name, field in zip(_RATIOS, ("SV", "SP", "SH", "SM", "SVT", "SS"), strict=True)}
_RECORDS: tuple[tuple[str, str, Fields], ...] = (
    (
        "VIBE",
        "vibration",
        {f"{axis.lower()}_mps2": (f"Vibe{axis}", "m/s/s") for axis in "XYZ"}
        | {f"clips_{i}": (f"Clip{i}", "") for i in range(3)},
    ),
    (
        "BARO",
        "barometer",
        {"pressure_pa": ("Press", "Pa"), "altitude_m": ("Alt", "m"), "temperature_degc": ("Temp", "degC")},
    ),
    (
        "GPS",
        "gps",
        {
            "lat_rad": ("Lat", "deg"),
            "lon_rad": ("Lng", "deg"),
            "height_m": ("Alt", "m"),
            "speed_mps": ("Spd", "m/s"),
            "satellites": ("NSats", ""),
            "fix_type": ("Status", ""),
            "hdop": ("HDop", ""),
        },
    ),
    ("MAG", "magnetometer", {f"{axis.lower()}_tesla": (f"Mag{axis}", "mgauss") for axis in "XYZ"}),
    ("IMU", "temperature", {"temperature_degc": ("T", "degC")}),
    ("XKF4", "estimator", _XKF4),
    ("NKF4", "estimator", _XKF4),
)

RECORD_SENSORS = frozenset(record for record, _, _ in _RECORDS)
"""Records that become series."""

_GPS_TOPIC: Fields = {
    "lat_rad": ("latitude_deg", "deg"),
    "lon_rad": ("longitude_deg", "deg"),
    "height_m": ("altitude_msl_m", "m"),
    "speed_mps": ("vel_m_s", "m/s"),
    "satellites": ("satellites_used", ""),
    "fix_type": ("fix_type", ""),
    "hdop": ("hdop", ""),
}
# Before PX4 1.14: integers.
_GPS_OLD: Fields = dict(_GPS_TOPIC) | {
    "lat_rad": ("lat", "degE7"), "lon_rad": ("lon", "degE7"), "height_m": ("alt", "mm"),
}  # fmt: skip
_ESTIMATOR_TOPIC: Fields = {
    "velocity_ratio": ("vel_test_ratio", ""),
    "position_ratio": ("pos_test_ratio", ""),
    "height_ratio": ("hgt_test_ratio", ""),
    "compass_ratio": ("mag_test_ratio", ""),
    "airspeed_ratio": ("tas_test_ratio", ""),
    "flags": ("solution_status_flags", ""),
}
_TOPICS: tuple[tuple[str, str, Fields], ...] = (
    (
        "vehicle_imu_status",
        "vibration",
        {
            "coning_rad2": ("delta_angle_coning_metric", ""),
            "gyro_radps": ("gyro_vibration_metric", "rad/s"),
            "accel_mps2": ("accel_vibration_metric", "m/s/s"),
        }
        | {f"clips_{axis}": (f"accel_clipping[{i}]", "") for i, axis in enumerate("xyz")},
    ),
    (
        "vehicle_air_data",
        "barometer",
        {
            "pressure_pa": ("baro_pressure_pa", "Pa"),
            "altitude_m": ("baro_alt_meter", "m"),
            "temperature_degc": ("ambient_temperature", "degC"),
        },
    ),
    ("vehicle_gps_position", "gps", _GPS_TOPIC),
    (
        "vehicle_magnetometer",
        "magnetometer",
        {f"{a}_tesla": (f"magnetometer_ga[{i}]", "gauss") for i, a in enumerate("xyz")},
    ),
    ("vehicle_imu_status", "temperature", {"temperature_degc": ("temperature_accel", "degC")}),
    ("estimator_status", "estimator", _ESTIMATOR_TOPIC),
    (
        "vehicle_odometry",
        "variance",
        {
            **_diagonal(_PLACE, "position_variance", (0, 1, 2)),
            **_diagonal(_LEAN, "orientation_variance", (0, 1, 2)),
            **_diagonal(_SPEED, "velocity_variance", (0, 1, 2)),
        },
    ),
)
_INSTANCES = 4


def message_sensors(
    messages: Mapping[str, Messages], seconds: Mapping[str, Array], *, px4: bool
) -> Mapping[str, Series]:
    """The series in a boot's messages, at their boot times `seconds`. px4: the autopilot is one."""
    return series_of(
        _of_messages(messages[name], seconds[name], kind, _VIBRATION_PX4 if px4 and kind == "vibration" else fields)
        for name, kind, fields in _SOURCES
        if name in messages
    )


def _of_messages(messages: Messages, t: Array, kind: str, fields: Fields) -> Found | None:
    def column(field: str) -> Raw | None:
        name, _, place = field.partition("[")
        if name not in messages.layout.fields:
            return None
        return messages[name][:, int(place[:-1])] if place else messages[name]

    return find(kind, messages.name, t, fields, column, messages.layout.units)


def record_sensors(records: Mapping[str, Records], core: int) -> Mapping[str, Series]:
    """The series of an ArduPilot log; of the estimator's cores the given one first."""
    found: list[Found | None] = []
    for name, kind, fields in _RECORDS:
        if name not in records or (name == "NKF4" and "XKF4" in records):
            continue
        instances: list[int | None] = [*records[name].instances] or [None]
        if kind == "estimator":
            instances.sort(key=lambda number: number != core)
        for number in instances:
            one = records[name] if number is None else records[name].instance(number)
            source = f"{name}[{number or 0}]"
            # "Clip" counts for this IMU alone; older logs have Clip0, Clip1 and Clip2.
            own = {f"clips_{number or 0}": ("Clip", "")} if "Clip" in one.layout.fields else {}
            found.append(_of_records(one, source, kind, dict(fields) | own))
    return series_of(found)


def _of_records(records: Records, source: str, kind: str, fields: Fields) -> Found | None:
    layout = records.layout

    def column(field: str) -> Raw | None:
        if not layout.has_numbers(field):  # where damage made a text of it too
            return None
        return records.in_unit(field) if field in layout.multipliers else records[field]

    return find(kind, source, records.in_unit("TimeUS"), fields, column, layout.units)


def topic_sensors(topics: Mapping[str, Mapping[str, Any]]) -> Mapping[str, Series]:
    """The series of a PX4 log; topics by name: "vehicle_imu_status", "vehicle_imu_status_1", ..."""
    found: list[Found | None] = []
    for topic, kind, fields in _TOPICS:
        for name in (topic, *(f"{topic}_{i}" for i in range(1, _INSTANCES))):
            if name in topics:
                columns = topics[name]
                own = _GPS_OLD if kind == "gps" and "lat" in columns else fields
                t = np.asarray(columns["timestamp_sample" if "timestamp_sample" in columns else "timestamp"]) * 1e-6
                # The thermometer is that of vehicle_imu, which is the name of the track.
                source = name.replace("_status", "") if kind == "temperature" else name
                found.append(find(kind, source, t, own, columns.get))
    return series_of(found)
