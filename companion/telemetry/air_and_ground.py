"""Series of any format → typed tracks of what is measured against the air and the ground: airspeed, range, flow.

As in `companion.telemetry.aiding`, a row with these columns in the format's table is all that it needs.
"""

from __future__ import annotations

import numpy as np

from companion.model import AirspeedTrack, Array, FlowTrack, RangeTrack, Series
from companion.telemetry.outliers import lone, uncontradicted

CONSTANT = 20  # readings that are all the same are those of no sensor: even at rest they differ by a step
_GOOD = 4.0  # RFND.Stat: RangeFinder::Status::Good
_GUST = 30.0  # m/s: an airspeed that is off by as much for one sample is damage
_CENTIMETRE = 0.01  # m, to which DISTANCE_SENSOR is cut: a reading at the end of the range is within it


def is_constant(source: str, values: Array, notes: list[str]) -> bool:
    """Whether all readings (N,) or (N, k) of a source are the same: even at rest those of a sensor differ."""
    constant = len(values) >= CONSTANT and bool((values == values[:1]).all())
    if constant:
        notes.append(f"{source} left out: all of its {len(values)} readings are the same")
    return constant


def airspeed_track(one: Series, notes: list[str]) -> AirspeedTrack | None:
    """None for one that never measures."""
    names = ("airspeed_mps", "true_airspeed_mps", "pressure_pa", "temperature_degc")
    indicated, true, pressure, warm = (_column(one, name) for name in names)
    told = indicated if np.isfinite(indicated).any() else pressure
    if is_constant(one.source, told, notes):
        return None
    good = np.isfinite(told) & uncontradicted(one.source, notes, lone(indicated[:, None], _GUST), what="airspeed")
    return AirspeedTrack(
        one.t[good], indicated[good], true[good], pressure[good], warm[good], one.source, one.instance
    )  # fmt: skip


def range_track(one: Series, notes: list[str]) -> RangeTrack | None:
    """None for one that never has a reading within its range, or where all are the same."""
    distance, status, percent = (_column(one, name).copy() for name in ("range_m", "status", "quality"))
    least, most = (_constant(_column(one, name)) for name in ("least_m", "most_m"))
    distance[~(distance > 0.0) | (np.isfinite(status) & (status != _GOOD)) | (percent == 0.0)] = np.nan
    if least is not None and most is not None and least < most:
        distance[(distance < least - _CENTIMETRE) | (distance > most + _CENTIMETRE)] = np.nan
    known = distance[np.isfinite(distance)]
    if not len(known):
        notes.append(f"{one.source} left out: it never has a reading within its range")
        return None
    if is_constant(one.source, known, notes):
        return None
    orientation = _constant(_column(one, "orientation"))
    return RangeTrack(
        one.t,
        distance=distance,
        sigma=np.sqrt(np.where(_column(one, "variance_m2") > 0.0, _column(one, "variance_m2"), np.nan)),
        quality=np.where(percent >= 0.0, 0.01 * percent, np.nan),
        orientation=None if orientation is None else int(orientation),
        least=least,
        most=most,
        source=one.source,
        instance=one.instance,
    )


def flow_track(one: Series, notes: list[str]) -> FlowTrack | None:
    """From rates, or from angles over an interval; None where all are the same."""
    if "x_rad" in one.columns:
        interval = _column(one, "interval_us") * 1e-6
        interval = np.where(interval > 0.0, interval, np.nan)
        flow = np.column_stack([_column(one, f"{axis}_rad") for axis in "xy"]) / interval[:, None]
        gyro = np.column_stack([_column(one, f"gyro_{axis}_rad") for axis in "xyz"]) / interval[:, None]
    else:
        interval = np.full(len(one), np.nan)
        flow = np.column_stack([_column(one, f"{axis}_radps") for axis in "xy"])
        gyro = np.column_stack([_column(one, f"body_{axis}_radps") for axis in "xyz"])
    good = np.isfinite(flow).all(axis=1)
    if not good.any():
        notes.append(f"{one.source} left out: it never tells a flow")
        return None
    if is_constant(one.source, flow[good], notes):
        return None
    distance = _column(one, "range_m")
    return FlowTrack(
        one.t[good],
        flow=flow[good],
        gyro=gyro[good],
        interval=interval[good],
        quality=_column(one, "quality")[good],
        distance=np.where(distance > 0.0, distance, np.nan)[good],  # negative or zero is "not known"
        source=one.source,
        instance=one.instance,
    )


def _column(one: Series, name: str) -> Array:
    """(N,), NaN where the source has no such column."""
    return one[name] if name in one.columns else np.full(len(one), np.nan)


def _constant(values: Array) -> float | None:
    """The value that most of (N,) have; None where none is told."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None
