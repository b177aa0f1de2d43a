"""The topics of a PX4 ULog that tracks are made of, and the series of its sensors and estimators, by `sources`.

What is damaged or not of the boot clock is left out and noted. `vehicle_*` is the sensor that PX4 has selected,
calibrated and turned into the body frame; `sensor_*` is one driver's own. A driver's topic is a sensor of its own where
its device is not a selected one. Sources: PX4 v1.6 to v1.16 `msg/SensorGps.msg`, `VehicleMagnetometer.msg`,
`VehicleAirData.msg`, `SensorBaro.msg`, `SensorCombined.msg`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np

from companion.logs import Ulog, UlogTopic
from companion.model import Array, Series, counted
from companion.telemetry.clock import LONGEST_WAIT_S, ON_BOARD, left_out, off_course
from companion.telemetry.parameters import words
from companion.telemetry.samples import commonest
from companion.telemetry.sources import (
    DRIVER_SOURCES,
    SI,
    TOPIC_SOURCES,
    Raw,
    RawSeries,
    Source,
    covariances,
    raw_series,
    series_of,
)

Topic = UlogTopic

Topics = Mapping[str, Topic]
"""Topic by the name that PX4's tools give it: vehicle_imu, vehicle_imu_1, ..."""

_DATED, _SAMPLED = "timestamp", "timestamp_sample"
_XYZ = ("[0]", "[1]", "[2]")
_Q = ("q[0]", "q[1]", "q[2]", "q[3]")
NEEDED: Mapping[str, tuple[str, ...]] = {
    "vehicle_imu": ("timestamp_sample", "delta_angle_dt", "delta_velocity_dt")
    + tuple(f"delta_{of}{i}" for of in ("angle", "velocity") for i in _XYZ),
    "sensor_combined": ("gyro_integral_dt", *(f"{of}{i}" for of in ("gyro_rad", "accelerometer_m_s2") for i in _XYZ)),
    "vehicle_attitude": _Q,
    "vehicle_angular_velocity": ("xyz[0]", "xyz[1]", "xyz[2]"),
    "vehicle_local_position": (
        "x", "y", "z", "vx", "vy", "vz", "xy_valid", "z_valid", "v_xy_valid", "v_z_valid", "ref_lat", "ref_lon",
        "ref_alt",
    ),
    "home_position": ("lat", "lon", "alt"),
    "vehicle_status": ("arming_state", "nav_state"),
    "vehicle_magnetometer": tuple(f"magnetometer_ga{i}" for i in _XYZ),
    "sensor_mag": ("x", "y", "z"),
    "vehicle_air_data": ("baro_pressure_pa", "baro_alt_meter"),
    "sensor_baro": ("pressure",),
    "vehicle_gps_position": ("fix_type",),
    "sensor_gps": ("fix_type",),
    "estimator_sensor_bias": tuple(f"{of}_bias{i}" for of in ("gyro", "accel") for i in _XYZ),
    "sensor_selection": ("gyro_device_id",),
    "vehicle_attitude_groundtruth": _Q,
    "vehicle_local_position_groundtruth": ("x", "y", "z", "vx", "vy", "vz"),
}  # fmt: skip
"""What is read of a topic without asking whether it is there."""

_INSTANCES = 16  # the most that a flight controller publishes of one topic


def topics_of(log: Ulog, read: list[UlogTopic]) -> tuple[dict[str, Topic], dict[str, Array], list[str]]:
    """The topics by name, without those whose declaration lacks what is read of them; their times (N,) s; and notes.

    read: the log's topics; the list is empty afterwards. Rows whose time is not of the clock of the others (UNIX time,
    damage) are left out: see `timestamps`.
    """
    whole: dict[str, UlogTopic] = {}
    notes = [
        f"{words(name) or 'data of no topic'}: {counted(count, 'message')} left out: the log's declaration of them is "
        "damaged or missing"
        for name, count in log.undecoded.items()
    ]
    while read:
        one = read.pop(0)
        name = _name(one.name, one.instance)
        lacks = [field for field in (_DATED, *NEEDED.get(one.name, ())) if field not in one]
        if not name.isidentifier():
            notes.append(f"a topic is left out: its name is damaged ({words(name)})")
        elif lacks:
            notes.append(f"{name} is left out: the log declares it without {', '.join(lacks)}")
        else:
            whole[name] = one
    times = {name: topic.seconds() for name, topic in whole.items()}
    apart = off_course(times, ON_BOARD)
    notes += left_out(times, apart)
    for name, mask in apart.items():
        whole[name], times[name] = whole[name].select(~mask), times[name][~mask]
    topics = {name: topic for name, topic in whole.items() if len(topic)}
    notes += _published({name: topic for name, topic in topics.items() if topic.fields_read})
    return topics, {name: times[name] for name in topics}, notes


def _name(topic: str, instance: int) -> str:
    return f"{topic}_{instance}" if instance else topic


def let_go(topics: dict[str, Topic], *kinds: str) -> None:
    """Forget the topics of these kinds, and with them their rows."""
    for name in [name for kind in kinds for _, name, _ in instances(topics, kind)]:
        del topics[name]


def instance_names(topic: str) -> list[str]:
    """The names that the instances of a topic may have: vehicle_imu, vehicle_imu_1, ..."""
    return [_name(topic, instance) for instance in range(_INSTANCES)]


def instances(topics: Topics, topic: str) -> Iterator[tuple[int, str, Topic]]:
    """(instance, name, columns) of each instance of a topic that is in the log."""
    for instance, name in enumerate(instance_names(topic)):
        if name in topics:
            yield instance, name, topics[name]


def commonest_device(topic: Topic, field: str) -> int:
    """The device id that most rows are of; 0 where none is logged."""
    devices = topic.ids(field)
    return commonest(devices[devices != 0])


def sampled(topic: Topic) -> Array:
    """When it was measured; where that is not logged (before PX4 1.11 often, or zero), when it was published."""
    t = topic.seconds()
    if _SAMPLED not in topic:
        return t
    measured = topic.seconds(_SAMPLED)
    return np.where(np.abs(measured - t) < LONGEST_WAIT_S, measured, t)


def _published(topics: Topics) -> Iterator[str]:
    """A note for each topic of which some samples are taken at the time of their publication: see `sampled`.

    Where most times are so far off, as in estimator_event_flags, the field means another thing.
    """
    for name, topic in topics.items():
        if _SAMPLED in topic:
            measured = topic.seconds(_SAMPLED)
            off = (measured > 0) & (np.abs(measured - topic.seconds()) >= LONGEST_WAIT_S)
            if 0 < off.sum() <= len(off) / 2:
                yield (
                    f"{name}: {int(off.sum())} of {len(off)} taken at the time of their publication: that of the "
                    f"sample is {LONGEST_WAIT_S:g} s and more off it"
                )


_EXTRAPOLATED = 8  # fix_type of PX4: the receiver goes on from its last fix
_HECTOPASCAL = 2000.0  # below it a pressure is in hPa (before PX4 1.14): no air weighs more or, in Pa, less

_SELECTED = (
    ("gps", "vehicle_gps_position", "device_id", "sensor_gps", ""),
    ("magnetometer", "vehicle_magnetometer", "device_id", "sensor_mag", "magnetometer_timestamp_relative"),
    ("barometer", "vehicle_air_data", "baro_device_id", "sensor_baro", "baro_timestamp_relative"),
)
"""Kind, topic of the selected sensors, its device id, topic of single drivers; and in sensor_combined, which had the
readings before PX4 1.8, the offset of their times.
"""

SELECTED_KINDS = tuple(kind for kind, *_ in _SELECTED)


def topic_series(topics: Topics, attitude_elements: int, notes: list[str]) -> list[RawSeries]:
    """The series of a PX4 log; what is left out is added to the notes. attitude_elements: of EKF2's covariance."""

    def made(row: Source, name: str, topic: Topic, instance: int) -> RawSeries | None:
        # The thermometer is that of vehicle_imu, which is the name of the track.
        source = name.replace("_status", "") if row.kind == "temperature" else name
        reported = None if row.kind in SELECTED_KINDS else notes
        return raw_series(row, source, sampled(topic), partial(_column, topic), instance=instance, notes=reported)

    several = (
        made(row, name, topic, instance)
        for row in (*TOPIC_SOURCES, *covariances(attitude_elements))
        for instance, name, topic in instances(topics, row.name)
    )
    return [one for one in several if one is not None]


def aiding_series(topics: Topics, series: list[RawSeries], notes: list[str]) -> Mapping[str, Series]:
    """What tracks are made of: of receivers, compasses and barometers one for each device, of other kinds `series`."""
    rows = {(row.name, row.kind): row for row in (*TOPIC_SOURCES, *DRIVER_SOURCES)}
    parts: list[RawSeries | None] = [one for one in series if one.kind not in SELECTED_KINDS]
    for kind, selected, device, driver, offset in _SELECTED:
        sensors = list(_sensors(topics, selected, device, driver))
        parts += [
            raw_series(rows[of, kind], name, sampled(topic), partial(_reading, topic), instance=instance, notes=notes)
            for of, instance, name, topic in sensors
        ]
        combined = topics.get("sensor_combined")
        if not sensors and combined is not None and offset in combined:
            row, t = rows["sensor_combined", kind], _relative(combined, offset)
            parts.append(raw_series(row, row.name, t, partial(_reading, combined), notes=notes))
    return series_of(parts)


def _column(topic: Topic, field: str) -> Raw | None:
    """A field; None where it is that of a sensor whose device id is 0: there is no such sensor."""
    name, _, place = field.partition("[")
    device = topic.get(f"{name.partition('_')[0]}_device_ids[{place}") if place else None
    return None if device is not None and not device.any() else topic.get(field)


def _reading(topic: Topic, field: str) -> Array | None:
    """A field of a sensor, NaN where it does not count."""
    if field not in topic:
        return None
    values = topic.column(field)
    if field == "fix_type":
        values[values == _EXTRAPOLATED] = 1.0
    elif field.startswith("vel_") and field != "vel_m_s":
        values[~topic.flag("vel_ned_valid")] = np.nan
    elif field == "pressure" and np.isfinite(values).any() and np.nanmedian(values) < _HECTOPASCAL:
        values *= SI["hPa"]
    return values


def _sensors(topics: Topics, selected: str, device: str, driver: str) -> Iterator[tuple[str, int, str, Topic]]:
    """The selected sensors, then drivers' topics of others: of a device that no selected topic speaks of."""
    chosen = list(instances(topics, selected))
    devices = {number for _, _, topic in chosen for number in np.unique(topic.ids(device)).tolist()}
    yield from ((selected, *one) for one in chosen)
    for instance, name, topic in instances(topics, driver):
        own = set(np.unique(topic.ids("device_id")).tolist())
        known = 0 not in devices | own  # without ids the driver may be the selected one
        if not chosen or (known and not own & devices):
            yield driver, instance, name, topic


def _relative(topic: Topic, field: str) -> Array:
    """Times that sensor_combined tells as an offset from its own; NaN where there is no reading (2³¹ - 1 µs)."""
    offset = np.asarray(topic[field], np.float64) * 1e-6
    return np.where(np.abs(offset) < LONGEST_WAIT_S, topic.seconds() + offset, np.nan)
