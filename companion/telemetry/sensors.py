"""Which field of which message, record or topic becomes which column of a flight's series."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from companion.mavlink import Messages
from companion.model import IMU_MESSAGES, Array, Series
from companion.telemetry.quantities import Fields, Raw, RawSeries, raw_series, series_of

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
    "course_rad": ("cog", "cdeg"),
    "horizontal_sigma_m": ("h_acc", "mm"),
    "vertical_sigma_m": ("v_acc", "mm"),
    "speed_sigma_mps": ("vel_acc", "mm/s"),
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

_ESTIMATOR_ACCURACY: Fields = {
    "horizontal_sigma_m": ("pos_horiz_accuracy", "m"),
    "vertical_sigma_m": ("pos_vert_accuracy", "m"),
}
_AHRS: Fields = {f"{angle}_rad": (angle, "rad") for angle in ("roll", "pitch", "yaw")}
_AIRSPEED: Fields = {
    "airspeed_mps": ("airspeed", "m/s"),
    "pressure_pa": ("raw_press", "hPa"),
    "temperature_degc": ("temperature", "cdegC"),
}
_PITOT: Fields = {"pressure_pa": ("press_diff", "hPa"), "temperature_degc": ("temperature_press_diff", "cdegC")}
_RANGE: Fields = {
    "range_m": ("current_distance", "cm"),
    "least_m": ("min_distance", "cm"),
    "most_m": ("max_distance", "cm"),
    "orientation": ("orientation", ""),
}
_RANGEFINDER: Fields = {"range_m": ("distance", "m")}
_FLOW: Fields = {
    "x_radps": ("flow_rate_x", "rad/s"),
    "y_radps": ("flow_rate_y", "rad/s"),
    "quality": ("quality", ""),
    "range_m": ("ground_distance", "m"),
}
_FLOW_RAD: Fields = {
    "x_rad": ("integrated_x", "rad"),
    "y_rad": ("integrated_y", "rad"),
    "gyro_x_rad": ("integrated_xgyro", "rad"),
    "gyro_y_rad": ("integrated_ygyro", "rad"),
    "gyro_z_rad": ("integrated_zgyro", "rad"),
    "interval_us": ("integration_time_us", ""),
    "quality": ("quality", ""),
    "range_m": ("distance", "m"),
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


@dataclass(frozen=True, slots=True)
class Source:
    """What a message says of one sensor."""

    message: str
    kind: str
    fields: Fields
    instance: int = 0  # which sensor of its kind: of IMU and compass the message has one each
    of: tuple[str, ...] = ()  # the fields by which the message tells several sensors apart


_SOURCES = (
    Source("VIBRATION", "vibration", _VIBRATION),
    Source("SCALED_PRESSURE", "barometer", _BAROMETER),
    Source("SCALED_PRESSURE2", "barometer", _BAROMETER, instance=1),
    Source("SCALED_PRESSURE3", "barometer", _BAROMETER, instance=2),
    Source("GPS_RAW_INT", "gps", _GPS),
    Source("GPS2_RAW", "gps", _GPS, instance=1),
    *(Source(name, "magnetometer", _COMPASS, one.instance) for name, one in IMU_MESSAGES.items()),
    *(Source(name, "temperature", _THERMOMETER, one.instance) for name, one in IMU_MESSAGES.items()),
    Source("EKF_STATUS_REPORT", "estimator", _EKF_STATUS_REPORT),
    Source("ESTIMATOR_STATUS", "estimator", _ESTIMATOR_STATUS),
    Source("ESTIMATOR_STATUS", "accuracy", _ESTIMATOR_ACCURACY),
    Source("AHRS2", "attitude", _AHRS, instance=1),
    Source("AHRS3", "attitude", _AHRS, instance=2),
    Source("AIRSPEED", "airspeed", _AIRSPEED, of=("id",)),
    Source("SCALED_PRESSURE", "airspeed", _PITOT),
    Source("DISTANCE_SENSOR", "range", _RANGE, of=("id", "orientation")),
    Source("RANGEFINDER", "range", _RANGEFINDER),
    Source("OPTICAL_FLOW", "flow", _FLOW, of=("sensor_id",)),
    Source("OPTICAL_FLOW_RAD", "flow", _FLOW_RAD, of=("sensor_id",)),
    Source("LOCAL_POSITION_NED_COV", "variance", _POSITION_COV),
    Source("ATTITUDE_QUATERNION_COV", "variance", _ATTITUDE_COV),
    Source("ODOMETRY", "variance", _ODOMETRY),
)

SENSOR_MESSAGES = frozenset(source.message for source in _SOURCES)
"""Messages that become series."""


def message_sensors(
    messages: Mapping[str, Messages], seconds: Mapping[str, Array], notes: list[str], *, px4: bool
) -> Mapping[str, Series]:
    """The series in a boot's messages, at their boot times `seconds`. px4: the autopilot is one.

    What is left out is added to the notes.
    """
    return series_of(
        _of_messages(one, t, source, number, px4, notes)
        for source in _SOURCES
        if source.message in messages
        for number, one, t in _each(messages[source.message], seconds[source.message], source)
    )


def _each(messages: Messages, t: Array, source: Source) -> Iterator[tuple[int | None, Messages, Array]]:
    """The messages of each sensor with their times, and its number; None where the message is of one."""
    if not source.of or not len(messages):
        yield None, messages, t
        return
    ids = np.column_stack([messages[name] for name in source.of])
    sensors = np.unique(ids, axis=0)
    for number, own in enumerate(sensors):
        mine = (ids == own).all(axis=1)
        yield number if len(sensors) > 1 else None, messages.select(mine), t if mine.all() else t[mine]


def _of_messages(
    messages: Messages, t: Array, source: Source, number: int | None, px4: bool, notes: list[str]
) -> RawSeries | None:
    fields = _VIBRATION_PX4 if px4 and source.kind == "vibration" else source.fields

    def column(field: str) -> Raw | None:
        name, _, place = field.partition("[")
        if name not in messages.layout.fields:
            return None
        return messages[name][:, int(place[:-1])] if place else messages[name]

    units = messages.layout.units
    name = messages.name if number is None else f"{messages.name}[{number}]"
    told = None if fields is _PITOT else notes  # by zeros the message says that there is no such sensor
    return raw_series(source.kind, name, t, fields, column, units, instance=source.instance + (number or 0), notes=told)
