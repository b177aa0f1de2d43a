"""The sensors of a flight, the reports of its estimator and a simulator's truth as tables."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

import numpy as np

from companion.export.table import Column, Table, quaternions, series_name, table_name, times, vectors
from companion.model import Array, Flight, ImuTrack, Series

_AIDING = ("gps", "magnetometer", "barometer")  # kinds of series


def imu_table(flight: Flight, track: ImuTrack) -> Table:
    known = {
        "device_id": track.device_id,
        "low_pass_hz": track.low_pass_hz,
        "gyro_range_radps": track.gyro_range,
        "accel_range_mps2": track.accel_range,
    }
    about = {
        "source": track.source,
        "instance": str(track.instance),
        "accel": "specific force: (0, 0, -g) at rest and level",
        "bias_removed": "the estimator's" if track.bias_removed else "no",
        "sample": "an instant's" if track.interval is None else "the mean over interval_s, whose middle is t_s",
        **{name: f"{value:.6g}" if isinstance(value, float) else str(value) for name, value in known.items() if value},
    }
    columns = (
        *times(flight, track.t),
        *vectors("gyro", "radps", track.gyro, "FRD"),
        *vectors("accel", "mps2", track.accel, "FRD"),
    )
    if track.interval is not None:
        columns = (*columns, Column("interval_s", track.interval))
    return Table(table_name(track.source), columns, about)


def series_table(flight: Flight, key: str, series: Series) -> Table:
    frame = "FRD" if key.startswith(("vibration", "magnetometer")) else ""
    columns = (Column(name, series[name], frame) for name in series.columns)
    return Table(series_name(key), (*times(flight, series.t), *columns), {"source": series.source})


class _Timed(Protocol):
    @property
    def t(self) -> Array: ...
    @property
    def source(self) -> str: ...


def sensor_tables(flight: Flight) -> Iterator[Table]:
    """Biases, desired attitude, motors, and a simulator's truth: those that the flight has.

    GPS, compasses and barometers are among the series, but for those that only PX4's drivers report.
    """
    known = {series.source for key, series in flight.series.items() if key.startswith(_AIDING)}

    def table(name: str, of: _Timed, *columns: Column, **about: str) -> Table:
        return Table(name, (*times(flight, of.t), *columns), {"source": of.source, **about})

    for gps in flight.gps:
        if gps.source not in known:
            yield table(
                table_name(f"gps_{gps.source}"), gps, Column("lat_rad", gps.latitude),
                Column("lon_rad", gps.longitude), Column("height_m", gps.height),
                *vectors("velocity", "mps", gps.velocity, "NED"), Column("horizontal_sigma_m", gps.horizontal_sigma),
                Column("vertical_sigma_m", gps.vertical_sigma), Column("speed_sigma_mps", gps.speed_sigma),
                Column("fix_type", gps.fix_type), Column("satellites", gps.satellites),
            )  # fmt: skip
    for compass in flight.compasses:
        if compass.source not in known:
            columns = (
                Column(f"{axis}_tesla", field, "FRD") for axis, field in zip("xyz", compass.field.T, strict=True)
            )
            yield table(table_name(f"magnetometer_{compass.source}"), compass, *columns)
    for air in flight.barometers:
        if air.source not in known:
            values = {"pressure_pa": air.pressure, "altitude_m": air.altitude, "temperature_degc": air.temperature}
            yield table(table_name(f"barometer_{air.source}"), air, *(Column(*column) for column in values.items()))
    for i, bias in enumerate(flight.biases):
        yield table(
            f"bias_{i}", bias, *vectors("gyro", "radps", bias.gyro, "FRD"),
            *vectors("accel", "mps2", bias.accel, "FRD"), *vectors("gyro_sigma", "radps", bias.gyro_sigma, "FRD"),
            *vectors("accel_sigma", "mps2", bias.accel_sigma, "FRD"),
            instance="" if bias.imu_instance is None else str(bias.imu_instance),
        )  # fmt: skip
    if (control := flight.control) is not None:
        yield table("control", control, *quaternions("q", control.q_ned_frd))
    if (motors := flight.actuators) is not None:
        yield table("actuators", motors, *(Column(f"output_{i}", share) for i, share in enumerate(motors.output.T, 1)))
    if (used := flight.imu_in_use) is not None:
        yield table("imu_in_use", used, Column("instance", used.instance))
    if flight.aiding_in_use:
        yield _aiding_in_use(flight)
    if (truth := flight.truth) is not None:
        moved = vectors("position", "m", truth.position, "NED"), vectors("velocity", "mps", truth.velocity, "NED")
        yield table("truth", truth, *quaternions("q", truth.q_ned_frd), *moved[0], *moved[1])


def _aiding_in_use(flight: Flight) -> Table:
    used = [(kind, one.source, t, i) for kind, one in flight.aiding_in_use.items() for t, i in one.changes]
    columns = (
        *times(flight, np.array([t for _, _, t, _ in used], np.float64)),
        Column("kind", np.array([kind for kind, _, _, _ in used], np.str_)),
        Column("instance", np.array([i for _, _, _, i in used], np.int64)),
    )
    return Table("aiding_in_use", columns, {"source": ", ".join(dict.fromkeys(source for _, source, _, _ in used))})
