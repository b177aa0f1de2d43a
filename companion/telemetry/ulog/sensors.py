"""A PX4 ULog's topics → the series of its sensors and estimators, by the rows of `sources`.

`vehicle_*` is the sensor that PX4 has selected, calibrated and turned into the body frame; `sensor_*` is one driver's
own. A driver's topic is a sensor of its own where its device is not a selected one. Sources: PX4 v1.6 to v1.16
`msg/SensorGps.msg`, `VehicleMagnetometer.msg`, `VehicleAirData.msg`, `SensorBaro.msg`, `SensorCombined.msg`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np

from companion.model import Array, Series
from companion.telemetry.quantities import Raw, RawSeries, raw_series, series_of
from companion.telemetry.sources import DRIVER_SOURCES, SI, TOPIC_SOURCES, Source, covariances
from companion.telemetry.timestamps import LONGEST_WAIT_S
from companion.telemetry.ulog.estimator import Version, attitude_elements
from companion.telemetry.ulog.topics import Topic, Topics, instances, sampled

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


def topic_series(topics: Topics, version: Version, notes: list[str]) -> list[RawSeries]:
    """The series of a PX4 log of this version; what is left out is added to the notes."""

    def made(row: Source, name: str, topic: Topic, instance: int) -> RawSeries | None:
        # The thermometer is that of vehicle_imu, which is the name of the track.
        source = name.replace("_status", "") if row.kind == "temperature" else name
        reported = None if row.kind in SELECTED_KINDS else notes
        return raw_series(row, source, sampled(topic), partial(_column, topic), instance=instance, notes=reported)

    several = (
        made(row, name, topic, instance)
        for row in (*TOPIC_SOURCES, *covariances(attitude_elements(version)))
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
    devices: set[int] = set()
    any_selected = False
    for instance, name, topic in instances(topics, selected):
        any_selected = True
        devices |= set(np.unique(topic.ids(device)).tolist())
        yield selected, instance, name, topic
    for instance, name, topic in instances(topics, driver):
        own = set(np.unique(topic.ids("device_id")).tolist())
        known = 0 not in devices | own  # without ids the driver may be the selected one
        if not any_selected or (known and not own & devices):
            yield driver, instance, name, topic


def _relative(topic: Topic, field: str) -> Array:
    """Times that sensor_combined tells as an offset from its own; NaN where there is no reading (2³¹ - 1 µs)."""
    offset = np.asarray(topic[field], np.float64) * 1e-6
    return np.where(np.abs(offset) < LONGEST_WAIT_S, topic.seconds() + offset, np.nan)
