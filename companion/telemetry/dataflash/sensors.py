"""An ArduPilot log's records → the series of its sensors and estimators, by the rows of `sources`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from companion.logs import Records
from companion.model import Array, Series
from companion.telemetry.dataflash.cores import of_cores
from companion.telemetry.dataflash.imu import batches
from companion.telemetry.dataflash.rows import sample_time, sound, sources
from companion.telemetry.quantities import Raw, RawSeries, raw_series, series_of
from companion.telemetry.sources import GPS_ACCURACY, RECORD_SOURCES, Fields, Source

_BLENDED = 2  # instance of GPS: the mean of the receivers, made by ArduPilot
_ACCURACY = {field for ways in GPS_ACCURACY.values() for field, _ in ways}
_OF_CORES = frozenset({"estimator", "innovation"})

NEEDED = frozenset(name for row in RECORD_SOURCES for name in row.names) | {
    "GPA", "GPA2", "ISBH", "ISBD", "XKF8", "XKF9", "NKF8", "NKF9",
}  # fmt: skip
"""Records that become series."""


def record_sensors(records: Mapping[str, Records], prefix: str, core: int, notes: list[str]) -> Mapping[str, Series]:
    """The series of an ArduPilot log; of the cores of the EKF that flew (prefix: "XK") that one first."""
    parts: list[RawSeries | None] = []
    for row in RECORD_SOURCES:
        parts += _of_ekf(records, row, prefix, core) if row.kind in _OF_CORES else _of_sensors(records, row, notes)
    return series_of([*parts, *batches(records, notes)])


def _of_ekf(records: Mapping[str, Records], row: Source, prefix: str, core: int) -> Iterator[RawSeries | None]:
    for name in (name for name in row.names if name.startswith(prefix)):
        cores = of_cores(records, name)
        for number in sorted(cores, key=lambda number: (number != core, number)):
            yield _raw_series(cores[number], f"{name}[{number}]", row, number, [])


def _of_sensors(records: Mapping[str, Records], row: Source, notes: list[str]) -> Iterator[RawSeries | None]:
    for number, name, one in sources(records, row.names):
        if row.kind == "gps":
            if number < _BLENDED:
                yield _gps(records, one, name, row, number, notes)
            continue
        whole = one
        if row.sampled and not (good := sound(one)).all():
            whole = one.select(good)
            notes.append(
                f"{name}: {len(one) - len(whole)} of {len(one)} left out, as the driver called itself unhealthy"
            )
        yield _raw_series(whole, name, row, number, notes)


def _raw_series(one: Records, name: str, row: Source, number: int, notes: list[str]) -> RawSeries | None:
    if "Clip" in one.layout.fields:  # counts for this IMU alone; older logs have Clip0, Clip1 and Clip2
        row = replace(row, fields=row.fields | {f"clips_{number}": (("Clip", ""),)})
    if row.name == "CURR" and one.layout.has_numbers("Volt") and one["Volt"].dtype.kind == "i":  # until ArduPilot 3.2
        hundredths: Fields = {column: ((field, "hundredths"),) for column, ((field, _),) in row.fields.items()}
        row = replace(row, fields=hundredths)
    t = sample_time(one, row.sampled) if row.sampled else one.t
    return raw_series(row, name, t, lambda field: _column(one, field), one.layout.units, instance=number, notes=notes)


def _column(one: Records, field: str) -> Raw | None:
    if not one.layout.has_numbers(field):  # where damage made a text of it too
        return None
    if field in one.layout.multipliers:
        return one.in_unit(field)
    values = one[field]
    return values.astype(np.float64) if values.dtype.kind == "f" else values


def _gps(
    records: Mapping[str, Records], one: Records, name: str, row: Source, number: int, notes: list[str]
) -> RawSeries | None:
    """A receiver with what GPA says of the same fix. The time is that of its sample, which GPA has as well."""
    t = one.t
    accuracy = next((own for instance, _, own in sources(records, ("GPA", "GPA2")) if instance == number), None)
    if accuracy is None or not len(accuracy):
        return _raw_series(one, name, row, number, notes)
    beside = np.minimum(np.searchsorted(accuracy.t, t), len(accuracy) - 1)
    paired = accuracy.t[beside] == t  # they are written together, at the same microsecond

    def column(field: str) -> Raw | None:
        values = _column(accuracy if field in _ACCURACY else one, field)
        if values is not None and field in _ACCURACY:
            return np.where(paired, values[beside], np.nan)
        if values is not None and field == "VZ" and accuracy.layout.has_numbers("VV"):
            return np.where(paired & (accuracy["VV"][beside] == 0), np.nan, values)  # the receiver gives no climb
        return values

    sampled: Array = np.where(paired, sample_time(accuracy, "SMS")[beside], t)
    units = {**one.layout.units, **accuracy.layout.units}
    return raw_series(row, name, sampled, column, units, instance=number, notes=notes)
