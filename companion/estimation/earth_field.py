"""The Earth's magnetic field at a place and time, by the World Magnetic Model (pygeomag), and compasses beside it.

Some are mounted, or set, in another orientation than their readings are taken for. The autopilots' orientations are 45°
and more apart, far from anything that a signature of first order explains. So each of them is tried on the readings
themselves, beside the field in the body by an estimate that no compass took part in: that has the heading of GPS and
acceleration.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from companion.constants import check, healthy, num
from companion.estimation.model import ATTITUDE, BestEstimate
from companion.model import Array, CompassTrack, Epoch, Flight, NoEstimateError, Origin, orientations
from companion.strapdown import quaternion


@dataclass(frozen=True, slots=True, eq=False)
class EarthField:
    """The field by the model."""

    ned: Array  # (3,) tesla
    sigma: Array  # (3,) tesla, 1σ: anomalies of the place, and what a compass calibration leaves of its scale
    declination: float  # rad
    inclination: float  # rad


def field_at(origin: Origin | None, epoch: Epoch | None) -> EarthField | None:
    """The field at the flight's origin; None where the place is not known or the model has none.

    Within 5° of a magnetic pole the field has no useful horizontal part; it is given as the model has it.
    """
    if origin is None or not np.isfinite([origin.latitude, origin.longitude, origin.height]).all():
        return None
    year = 1970.0 + epoch.unix_s / num.YEAR_S if epoch is not None and np.isfinite(epoch.unix_s) else num.UNDATED_YEAR
    year = float(np.clip(year, num.WMM_FIRST, num.WMM_LAST - 0.1)) if year >= num.WMM_FIRST else num.UNDATED_YEAR
    latitude, longitude = float(np.degrees(origin.latitude)), float(np.degrees(origin.longitude))
    if abs(latitude) > 89.99:
        return None
    return _model(round(latitude, 4), round((longitude + 180.0) % 360.0 - 180.0, 4), round(origin.height, -1), year)


@lru_cache(maxsize=64)
def _model(latitude: float, longitude: float, height: float, year: float) -> EarthField:
    from pygeomag import GeoMag  # noqa: PLC0415  (reads its coefficients when it is imported)

    base = int(5 * (year // 5))
    geomag = GeoMag(base_year=None if base >= 2025 else base)
    result = geomag.calculate(
        glat=latitude, glon=longitude, alt=height * 1e-3, time=year, allow_date_outside_lifespan=True
    )
    ned = np.array([result.x, result.y, result.z]) * 1e-9
    sigma = np.full(3, healthy.FIELD_ANOMALY * float(np.linalg.norm(ned)))
    return EarthField(ned, sigma, float(np.radians(result.d)), float(np.radians(result.i)))


@dataclass(frozen=True, slots=True)
class TurnedCompass:
    """One whose readings fit the Earth's field in another orientation."""

    source: str
    instance: int
    orientation: int  # of ORIENTATIONS, by which its readings have to be turned
    off: float  # rad, median angle between what it reads and the field, or between their level parts
    left: float  # rad, the same of the readings turned so


def turned_compasses(
    flight: Flight, best: BestEstimate, without_compass: Callable[[Flight], BestEstimate]
) -> tuple[TurnedCompass, ...]:
    """Those of a flight; empty where none is, and where its heading is not known without them.

    best: the estimate of the flight, by which a compass in order reads the Earth's field; where each does, nothing else
    is looked at. without_compass: how to make it of a flight whose compasses are left out; may raise NoEstimateError.
    """
    if not any(_off(*fields) > num.ORIENTATION_HALF_RAD for _, fields in _fields(flight, best)):
        return ()
    try:
        alone = without_compass(replace(flight, compasses=()))
    except NoEstimateError:
        return ()
    known = num.SIGMAS * float(np.median(alone.sigma(ATTITUDE)[:, 2])) < num.ORIENTATION_HALF_RAD
    return tuple(_turned(flight, alone)) if known and alone.heading_from != "first guess" else ()


def righted(flight: Flight, turned: tuple[TurnedCompass, ...]) -> Flight:
    """The flight with the readings of these compasses turned as they have to be."""
    by = {one.source: orientations()[one.orientation] for one in turned}
    compasses = [
        replace(one, field=quaternion.rotate(by[one.source], one.field)) if one.source in by else one
        for one in flight.compasses
    ]
    return replace(flight, compasses=tuple(compasses))


Fields = tuple[Array, Array, Array]


def _fields(flight: Flight, best: BestEstimate) -> list[tuple[CompassTrack, Fields]]:
    """What each compass reads and the Earth's field at the same times, (N, 3) µT each, and down, all in the body.

    Without those of too few readings, or in the sensor's own axes, and without any where the field is not known.
    """
    earth = field_at(best.origin or flight.origin, flight.epoch)
    fewest, most = check.ORIENTATION_READINGS
    read = []
    for one in flight.compasses if earth is not None else ():
        good = one.calibrated & np.isfinite(one.field).all(axis=1) & (one.t >= best.t[0]) & (one.t <= best.t[-1])
        rows = np.flatnonzero(good)
        if len(rows) >= fewest:
            read.append((one, rows[:: max(1, len(rows) // most)]))
    if earth is None or not read:
        return []
    to_body = quaternion.conjugate(best.at(np.concatenate([one.t[rows] for one, rows in read]))[0])
    field, down = (quaternion.rotate(to_body, v) for v in (earth.ned * num.MICROTESLA, np.array([0.0, 0.0, 1.0])))
    ends = np.cumsum([len(rows) for _, rows in read])[:-1]
    pairs = zip(read, np.split(field, ends), np.split(down, ends), strict=True)
    return [(one, (one.field[rows] * num.MICROTESLA, there, below)) for (one, rows), there, below in pairs]


def _off(read: Array, body: Array, down: Array) -> float:
    """Median angle between two fields (N, 3), rad, or between their level parts, if that is more."""
    level = ((v - (v * down).sum(axis=1)[:, None] * down) for v in (read, body))
    return max(_between(read, body), _between(*level))


def _between(one: Array, other: Array) -> float:
    """Median angle between vectors (N, 3), rad."""
    along = (one * other).sum(axis=1) / np.maximum(np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1), 1e-9)
    return float(np.median(np.arccos(np.clip(along, -1.0, 1.0))))


def _turned(flight: Flight, alone: BestEstimate) -> Iterator[TurnedCompass]:
    """Those that one orientation fits: far better than any other, by what changes as the vehicle turns before all.

    A constant field of iron on the vehicle, however strong, leaves what changes as it is.
    """
    list_of = orientations()
    for one, (read, body, down) in _fields(flight, alone):
        left = quaternion.rotate(list_of[:, None], read[None]) - body
        iron = left.mean(axis=1)
        scatter = np.sqrt(((left - iron[:, None]) ** 2).sum(axis=2).mean(axis=1))
        misfit = np.hypot(scatter, np.linalg.norm(iron, axis=1))
        best = int(np.argmin(misfit))
        same = np.abs(list_of @ list_of[best]) > 1.0 - 1e-9
        best = int(np.argmax(same))
        if (
            not same[0]
            and misfit[best] < check.ORIENTATION_BETTER * misfit[~same].min()
            and scatter[best] < check.ORIENTATION_BETTER * scatter[0]
            and np.linalg.norm(iron[best]) < healthy.USUAL_IRON
        ):
            after = _off(quaternion.rotate(list_of[best], read), body, down)
            yield TurnedCompass(one.source, one.instance, best, _off(read, body, down), after)
