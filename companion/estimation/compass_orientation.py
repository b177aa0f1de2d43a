"""Compasses that are mounted, or set, in another orientation than their readings are taken for.

The autopilots' orientations are 45° and more apart, far from anything that a signature of first order explains. So
each of them is tried on the readings themselves, beside the Earth's field in the body (World Magnetic Model) by an
estimate that no compass took part in: that has the heading of GPS and acceleration.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from companion.constants import check, healthy, num
from companion.estimation.earth_field import field_at
from companion.estimation.model import ATTITUDE, BestEstimate
from companion.model import Array, CompassTrack, Flight, NoEstimateError, orientations
from companion.strapdown import quaternion


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
    return replace(
        flight,
        compasses=tuple(
            replace(one, field=quaternion.rotate(by[one.source], one.field)) if one.source in by else one
            for one in flight.compasses
        ),
    )


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
