"""Which column of which record becomes which column of a flight's series: one row of the table per kind of record."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from companion.logs import Records
from companion.model import Array, Series
from companion.telemetry.dataflash.cores import of_cores
from companion.telemetry.dataflash.imu import batches
from companion.telemetry.dataflash.rows import sample_time, sound, sources
from companion.telemetry.quantities import Fields, Raw, RawSeries, raw_series, series_of

_BLENDED = 2  # instance of GPS: the mean of the receivers, made by ArduPilot
_SIGMAS: Fields = {
    "horizontal_sigma_m": ("HAcc", "m"), "vertical_sigma_m": ("VAcc", "m"), "speed_sigma_mps": ("SAcc", "m/s"),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class RecordSource:
    """A kind of record that becomes series."""

    names: tuple[str, ...]  # of the first, second, ... sensor; since 2020 all are in the first, with an instance column
    kind: str
    fields: Fields
    sampled: str = ""  # the column with the time of the sample itself; "": that of the record is


def _axes(units: str, *names: str) -> Fields:
    return {name: (field, units) for name, field in zip(names[::2], names[1::2], strict=True)}


_RATIOS = ("velocity_ratio", "position_ratio", "height_ratio", "compass_ratio", "airspeed_ratio", "flags")
_ATTITUDE: Fields = _axes("deg", "roll_rad", "Roll", "pitch_rad", "Pitch", "yaw_rad", "Yaw")

SOURCES: tuple[RecordSource, ...] = (
    RecordSource(
        ("VIBE",),
        "vibration",
        {
            **_axes("m/s/s", "x_mps2", "VibeX", "y_mps2", "VibeY", "z_mps2", "VibeZ"),
            **{f"clips_{i}": (f"Clip{i}", "") for i in range(3)},
        },
    ),
    RecordSource(
        ("BARO", "BAR2", "BAR3"),
        "barometer",
        {"pressure_pa": ("Press", "Pa"), "altitude_m": ("Alt", "m"), "temperature_degc": ("Temp", "degC")},
        "SMS",
    ),
    RecordSource(
        ("GPS", "GPS2"),
        "gps",
        {
            "lat_rad": ("Lat", "deg"),
            "lon_rad": ("Lng", "deg"),
            "height_m": ("Alt", "m"),
            "speed_mps": ("Spd", "m/s"),
            "satellites": ("NSats", ""),
            "fix_type": ("Status", ""),  # AP_GPS::GPS_Status has the numbers of GPS_FIX_TYPE
            "hdop": ("HDop", ""),
            "course_rad": ("GCrs", "deg"),
            "vd_mps": ("VZ", "m/s"),
            **_SIGMAS,
        },
    ),
    RecordSource(
        ("MAG", "MAG2", "MAG3"),
        "magnetometer",
        _axes("mgauss", "x_tesla", "MagX", "y_tesla", "MagY", "z_tesla", "MagZ"),
        "S",
    ),
    RecordSource(("IMU", "IMU2", "IMU3"), "temperature", {"temperature_degc": ("T", "degC")}),
    RecordSource(
        ("ARSP", "ASP2"),
        "airspeed",
        {"airspeed_mps": ("Airspeed", "m/s"), "pressure_pa": ("DiffPress", "Pa"), "temperature_degc": ("Temp", "degC")},
    ),
    RecordSource(
        ("RFND",),
        "range",
        {"range_m": ("Dist", "m"), "status": ("Stat", ""), "orientation": ("Orient", ""), "quality": ("Quality", "")},
    ),
    RecordSource(("RFND",), "range", {"range_m": ("Dist1", "m"), "orientation": ("Orient1", "")}),  # before 2020
    RecordSource(
        ("OF",),
        "flow",
        {
            **_axes("rad/s", "x_radps", "flowX", "y_radps", "flowY", "body_x_radps", "bodyX", "body_y_radps", "bodyY"),
            "quality": ("Qual", ""),
        },
    ),
    RecordSource(
        ("XKF4", "NKF4", "EKF4"),
        "estimator",
        {name: (field, "") for name, field in zip(_RATIOS, ("SV", "SP", "SH", "SM", "SVT", "SS"), strict=True)},
    ),
    RecordSource(
        ("XKF3", "NKF3", "EKF3"),
        "innovation",
        {
            **_axes("m/s", "vn_mps", "IVN", "ve_mps", "IVE", "vd_mps", "IVD"),
            **_axes("m", "north_m", "IPN", "east_m", "IPE", "down_m", "IPD"),
            **_axes("mgauss", "x_tesla", "IMX", "y_tesla", "IMY", "z_tesla", "IMZ"),
            "yaw_rad": ("IYAW", "deg"),
            "airspeed_mps": ("IVT", "m/s"),
        },
    ),
    RecordSource(("AHR2",), "attitude", _ATTITUDE),
    RecordSource(("DCM",), "attitude", _ATTITUDE),
)
"""Of the EKFs' records: EKF3's, EKF2's, and those of the one before them."""

OF_CORES = frozenset({"estimator", "innovation"})

NEEDED = frozenset(name for source in SOURCES for name in source.names) | {
    "GPA", "GPA2", "ISBH", "ISBD", "XKF8", "XKF9", "NKF8", "NKF9",
}  # fmt: skip
"""Records that become series."""


def record_sensors(records: Mapping[str, Records], prefix: str, core: int) -> tuple[Mapping[str, Series], list[str]]:
    """The series of an ArduPilot log and notes; of the cores of the EKF that flew (prefix: "XK") that one first."""
    parts: list[RawSeries | None] = []
    notes: list[str] = []
    for source in SOURCES:
        if source.kind in OF_CORES:
            parts += _of_ekf(records, source, prefix, core)
        else:
            parts += _of_sensors(records, source, notes)
    return series_of([*parts, *batches(records, notes)]), notes


def _of_ekf(records: Mapping[str, Records], source: RecordSource, prefix: str, core: int) -> Iterator[RawSeries | None]:
    for name in (name for name in source.names if name.startswith(prefix)):
        cores = of_cores(records, name)
        for number in sorted(cores, key=lambda number: (number != core, number)):
            yield _raw_series(cores[number], f"{name}[{number}]", source, number, [])


def _of_sensors(records: Mapping[str, Records], source: RecordSource, notes: list[str]) -> Iterator[RawSeries | None]:
    for number, name, one in sources(records, source.names):
        if source.kind == "gps":
            if number < _BLENDED:
                yield _gps(records, one, name, source, number, notes)
            continue
        whole = one
        if source.sampled and not (good := sound(one)).all():
            whole = one.select(good)
            notes.append(
                f"{name}: {len(one) - len(whole)} of {len(one)} left out, as the driver called itself unhealthy"
            )
        yield _raw_series(whole, name, source, number, notes)


def _raw_series(one: Records, name: str, source: RecordSource, number: int, notes: list[str]) -> RawSeries | None:
    fields = source.fields
    if "Clip" in one.layout.fields:  # counts for this IMU alone; older logs have Clip0, Clip1 and Clip2
        fields = {**fields, f"clips_{number}": ("Clip", "")}
    t = sample_time(one, source.sampled) if source.sampled else one.t
    units = one.layout.units
    return raw_series(
        source.kind, name, t, fields, lambda field: _column(one, field), units, instance=number, notes=notes
    )


def _column(one: Records, field: str) -> Raw | None:
    if not one.layout.has_numbers(field):  # where damage made a text of it too
        return None
    if field in one.layout.multipliers:
        return one.in_unit(field)
    values = one[field]
    return values.astype(np.float64) if values.dtype.kind == "f" else values


def _gps(
    records: Mapping[str, Records], one: Records, name: str, source: RecordSource, number: int, notes: list[str]
) -> RawSeries | None:
    """A receiver with what GPA says of the same fix. The time is that of its sample, which GPA has as well."""
    t = one.t
    accuracy = next((own for instance, _, own in sources(records, ("GPA", "GPA2")) if instance == number), None)
    if accuracy is None or not len(accuracy):
        return _raw_series(one, name, source, number, notes)
    row = np.minimum(np.searchsorted(accuracy.t, t), len(accuracy) - 1)
    paired = accuracy.t[row] == t  # they are written together, at the same microsecond

    def column(field: str) -> Raw | None:
        if field in {sigma for sigma, _ in _SIGMAS.values()}:
            values = _column(accuracy, field)
            return None if values is None else np.where(paired, values[row], np.nan)
        values = _column(one, field)
        if field == "VZ" and values is not None and accuracy.layout.has_numbers("VV"):
            return np.where(paired & (accuracy["VV"][row] == 0), np.nan, values)  # the receiver gives no climb
        return values

    sampled: Array = np.where(paired, sample_time(accuracy, "SMS")[row], t)
    return raw_series(
        "gps", name, sampled, source.fields, column, {**one.layout.units, **accuracy.layout.units}, instance=number,
        notes=notes,
    )  # fmt: skip
