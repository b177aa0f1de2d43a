"""Columns of any format → the series of a flight: vibration, barometer, GPS, magnetometer, temperatures, estimator.

The first source of a kind is called by the kind ("gps"), each further one by kind and source ("gps:GPS2_RAW");
temperatures, of which each belongs to an IMU, always by both. What the columns mean is in docs/messages.md.

Also here: values that are made when they are first read: of most of a flight, most never are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from companion.model import Array, Series
from companion.telemetry.samples import increasing
from companion.telemetry.sources import COLUMNS, NONE_IF_ZERO, SI, Source

T = TypeVar("T")
Raw = npt.NDArray[Any]


class Lazy(Mapping[str, T]):
    """Name → value, made once by the name's maker, which is forgotten with all that it held."""

    def __init__(self, makers: Mapping[str, Callable[[], T]]) -> None:
        self._names = tuple(makers)
        self._makers = dict(makers)
        self._known: dict[str, T] = {}

    def __getitem__(self, name: str) -> T:
        if name not in self._known and name in self._makers:
            self._known[name] = self._makers[name]()
            del self._makers[name]
        return self._known[name]

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


class LazyTuple(Sequence[T]):
    """A tuple whose items are made together, by its maker, when it is first looked into."""

    def __init__(self, maker: Callable[[], Sequence[T]]) -> None:
        self._maker: Callable[[], Sequence[T]] | None = maker
        self._known: tuple[T, ...] = ()

    def __getitem__(self, index: Any) -> Any:
        return self._items()[index]

    def __len__(self) -> int:
        return len(self._items())

    def _items(self) -> tuple[T, ...]:
        if self._maker is not None:
            self._known = tuple(self._maker())
            self._maker = None
        return self._known


_UNKNOWN: Mapping[str, Mapping[str, tuple[float, ...]]] = {
    # GPS_RAW_INT
    "gps": {"satellites": (255.0,), "speed_mps": (655.35,), "hdop": (655.35,), "course_rad": (math.radians(655.35),)},
    # SYS_STATUS, BATTERY_STATUS, and PX4's battery_status
    "battery": {"voltage_v": (0.0, 65.535), "current_a": (-0.01, -1.0)},
}
"""Kind → column → what stands in it for "not known"."""

SIGMAS = ("horizontal_sigma_m", "vertical_sigma_m", "speed_sigma_mps")
_FIX_2D, _FIX_3D = 2, 3  # GPS_FIX_TYPE
_POLE = math.radians(89.9)  # nobody flies there: a latitude of 90° is a receiver that has no fix


@dataclass(frozen=True, slots=True, eq=False)
class RawSeries:
    """The raw columns of one source, and what makes them SI."""

    kind: str
    source: str
    t: Array  # (N,) s, boot clock; NaN where it is not known
    raw: Mapping[str, Raw]  # column → (N,), as the log has it
    factors: Mapping[str, float]
    instance: int = 0  # which sensor of its kind


def raw_series(
    row: Source,
    source: str,
    t: Array,
    column: Callable[[str], Raw | None],
    units: Mapping[str, str] | None = None,
    *,
    instance: int = 0,
    notes: list[str] | None = None,
) -> RawSeries | None:
    """What a source has of a kind; None when that is nothing. `column` gives a field of the source, None for none.

    A sensor that is zero throughout is none, and is noted.
    """
    raw: dict[str, Raw] = {}
    factors: dict[str, float] = {}
    for name, ways in row.fields.items():
        for field, unit in ways:
            if (values := column(field)) is not None:
                raw[name] = np.array(values)  # not a view: the rows need not stay for it
                stated = (units or {}).get(field, "")
                factors[name] = SI[stated if stated in SI and stated else unit]
                break
    silent = row.kind in NONE_IF_ZERO and not any(v.any() for v in raw.values())
    if silent and raw and len(t) and notes is not None and NONE_IF_ZERO[row.kind] and row.noted:
        notes.append(f"{source} left out as {row.kind}: it is zero throughout")
    return None if not raw or not len(t) or silent else RawSeries(row.kind, source, t, raw, factors, instance)


def series_of(several: Iterable[RawSeries | None]) -> Mapping[str, Series]:
    """The series of a flight by key, in the order found, each made when it is read."""
    makers: dict[str, Callable[[], Series]] = {}
    for one in several:
        if one is not None:
            alone = one.kind != "temperature" and one.kind not in makers
            makers[one.kind if alone else f"{one.kind}:{one.source}"] = partial(_series, one)
    return Lazy(makers)


def _series(series: RawSeries) -> Series:
    known = COLUMNS.get(series.kind, ())
    names = known if series.raw.keys() <= set(known) else tuple(series.raw)
    values = np.full((len(series.t), len(names)), np.nan)
    for i, name in enumerate(names):
        if name in series.raw:
            values[:, i] = series.raw[name] * series.factors[name]
    columns = {name: values[:, i] for i, name in enumerate(names)}  # views: what follows changes `values`
    values[~np.isfinite(values)] = np.nan
    for name, absent in _UNKNOWN.get(series.kind, {}).items():
        for value in absent:
            columns[name][np.isclose(columns[name], value, atol=1e-6)] = np.nan
    if series.kind == "gps":
        _without_fix(columns)
    if series.kind == "range" and series.source.startswith("DISTANCE_SENSOR"):
        quality = columns["quality"]
        quality[quality == 0.0] = np.nan  # "unknown", as of a sender without the field
        quality[quality == 1.0] = 0.0  # "invalid signal"
    if series.kind == "battery":
        columns["remaining"][~((columns["remaining"] >= 0.0) & (columns["remaining"] <= 1.0))] = np.nan
    if series.kind == "barometer" and np.isnan(columns["altitude_m"]).all():
        columns["altitude_m"][:] = pressure_altitude(columns["pressure_pa"])
    good = np.isfinite(series.t) & ~np.isnan(values).all(axis=1)
    if series.kind == "temperature":
        good &= values[:, 0] != 0.0  # MAVLink: 0 is "no thermometer", and a true 0 °C is sent as 0.01
    keep = increasing(series.t, np.asarray(good))
    return Series(series.t[keep], values[keep], names, series.source, series.instance)


def _without_fix(gps: Mapping[str, Array]) -> None:
    """NaN for what a receiver does not know without a fix, or without one in three dimensions."""
    for name in SIGMAS:
        gps[name][~(gps[name] > 0.0)] = np.nan  # 0 is "not known": the extension fields of an older sender
    nowhere = (gps["fix_type"] < _FIX_2D) | ((gps["lat_rad"] == 0.0) & (gps["lon_rad"] == 0.0))
    nowhere |= ~(np.abs(gps["lat_rad"]) < _POLE)
    for name in ("lat_rad", "lon_rad", "height_m", "course_rad", "speed_mps", "vn_mps", "ve_mps", "vd_mps", *SIGMAS):
        gps[name][nowhere] = np.nan
    gps["height_m"][gps["fix_type"] < _FIX_3D] = np.nan


def pressure_altitude(pressure: Array) -> Array:
    """m, where the standard atmosphere has this pressure (ICAO Doc 7488, below 11 km)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(44330.77 * (1.0 - (pressure / 101325.0) ** 0.1902632))
