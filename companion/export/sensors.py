"""The sensors of a flight, and what its estimator and a simulator say of themselves, as tables."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from companion.export.table import Column, Table, quaternions, series_name, table_name, times, vectors
from companion.model import Flight, ImuTrack, Series

_AIDING = ("gps", "magnetometer", "barometer")  # kinds of series
_UNITS = {
    "s": "s", "m": "m", "mps": "m/s", "mps2": "m/s²", "rad": "rad", "rad2": "rad²", "radps": "rad/s", "pa": "Pa",
    "degc": "°C", "tesla": "T",
}  # fmt: skip
"""The end of a column's name → its unit."""


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
        *vectors("gyro", track.gyro, "rad/s", "radps", "FRD"),
        *vectors("accel", track.accel, "m/s²", "mps2", "FRD"),
    )
    if track.interval is not None:
        columns = (*columns, Column("interval_s", track.interval, "s"))
    return Table(table_name(track.source), columns, about)


def series_table(flight: Flight, key: str, series: Series) -> Table:
    body = ("vibration", "magnetometer")
    columns = (
        Column(name, series[name], _UNITS.get(name.rsplit("_", 1)[-1], ""), "FRD" if key.startswith(body) else "")
        for name in series.columns
    )
    return Table(series_name(key), (*times(flight, series.t), *columns), {"source": series.source})


def sensor_tables(flight: Flight) -> Iterator[Table]:
    """Biases, desired attitude, motors, and a simulator's truth: those that the flight has.

    GPS, compasses and barometers are among the series, but for those that only PX4's drivers tell of.
    """
    told = {series.source for key, series in flight.series.items() if key.startswith(_AIDING)}
    for gps in flight.gps:
        if gps.source not in told:
            columns = (
                Column("lat_rad", gps.latitude, "rad"), Column("lon_rad", gps.longitude, "rad"),
                Column("height_m", gps.height, "m"), *vectors("velocity", gps.velocity, "m/s", "mps", "NED"),
                Column("horizontal_sigma_m", gps.horizontal_sigma, "m"),
                Column("vertical_sigma_m", gps.vertical_sigma, "m"), Column("speed_sigma_mps", gps.speed_sigma, "m/s"),
                Column("fix_type", gps.fix_type), Column("satellites", gps.satellites),
            )  # fmt: skip
            yield Table(table_name(f"gps_{gps.source}"), (*times(flight, gps.t), *columns), {"source": gps.source})
    for compass in flight.compasses:
        if compass.source not in told:
            name = table_name(f"magnetometer_{compass.source}")
            columns = tuple(Column(f"{x}_tesla", b, "T", "FRD") for x, b in zip("xyz", compass.field.T, strict=True))
            yield Table(name, (*times(flight, compass.t), *columns), {"source": compass.source})
    for air in flight.barometers:
        if air.source not in told:
            columns = (
                Column("pressure_pa", air.pressure, "Pa"), Column("altitude_m", air.altitude, "m"),
                Column("temperature_degc", air.temperature, "°C"),
            )  # fmt: skip
            yield Table(
                table_name(f"barometer_{air.source}"), (*times(flight, air.t), *columns), {"source": air.source}
            )
    for i, bias in enumerate(flight.biases):
        columns = (
            *vectors("gyro", bias.gyro, "rad/s", "radps", "FRD"),
            *vectors("accel", bias.accel, "m/s²", "mps2", "FRD"),
            *vectors("gyro_sigma", bias.gyro_sigma, "rad/s", "radps", "FRD"),
            *vectors("accel_sigma", bias.accel_sigma, "m/s²", "mps2", "FRD"),
        )
        of = "" if bias.imu_instance is None else str(bias.imu_instance)
        yield Table(f"bias_{i}", (*times(flight, bias.t), *columns), {"source": bias.source, "instance": of})
    if (control := flight.control) is not None:
        columns = quaternions("q", control.q_ned_frd)
        yield Table("control", (*times(flight, control.t), *columns), {"source": control.source})
    if (motors := flight.actuators) is not None:
        columns = tuple(Column(f"output_{i}", share) for i, share in enumerate(motors.output.T, 1))
        yield Table("actuators", (*times(flight, motors.t), *columns), {"source": motors.source})
    if (used := flight.imu_in_use) is not None:
        columns = (Column("instance", used.instance),)
        yield Table("imu_in_use", (*times(flight, used.t), *columns), {"source": used.source})
    if flight.aiding_in_use:
        yield _aiding_in_use(flight)
    if (truth := flight.truth) is not None:
        columns = (
            *quaternions("q", truth.q_ned_frd),
            *vectors("position", truth.position, "m", "m", "NED"),
            *vectors("velocity", truth.velocity, "m/s", "mps", "NED"),
        )
        yield Table("truth", (*times(flight, truth.t), *columns), {"source": truth.source})


def _aiding_in_use(flight: Flight) -> Table:
    used = [(kind, one.source, t, i) for kind, one in flight.aiding_in_use.items() for t, i in one.changes]
    columns = (
        *times(flight, np.array([t for _, _, t, _ in used], np.float64)),
        Column("kind", np.array([kind for kind, _, _, _ in used], np.str_)),
        Column("instance", np.array([i for _, _, _, i in used], np.int64)),
    )
    return Table("aiding_in_use", columns, {"source": ", ".join(dict.fromkeys(source for _, source, _, _ in used))})
