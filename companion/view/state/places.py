"""Where what is known by latitude and longitude lies in the picture: home, the GPS fixes, the best estimate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.estimation import BestEstimate
from companion.model import (
    ECCENTRICITY_SQUARED,
    SEMI_MAJOR_AXIS,
    Array,
    Flight,
    Origin,
    PositionTrack,
    geodetic_from_ned,
)

_FIX_3D = 3  # GPS_FIX_TYPE


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Positions over time, about the zero of the flight's own positions."""

    t: Array  # (N,) s, boot clock
    position: Array  # (N, 3) NED, m


def home_position(flight: Flight) -> Array | None:
    """Home, NED, (3,) m; None where the log does not tell it, or not where its positions count from."""
    home = flight.home
    if home is None:
        return None
    located = _located(flight, *(np.array([x]) for x in (home.latitude, home.longitude, home.height)))
    return None if located is None else np.asarray(located[0])


def gps_path(flight: Flight) -> Path | None:
    """The 3D fixes of the first receiver that has any, as it sent them; None where there is none."""
    for receiver in flight.gps:
        fixed = (receiver.fix_type >= _FIX_3D) & np.isfinite(receiver.latitude + receiver.longitude + receiver.height)
        position = _located(flight, *(x[fixed] for x in (receiver.latitude, receiver.longitude, receiver.height)))
        if position is not None and len(position) > 1:
            return Path(receiver.t[fixed], position)
    return None


def best_path(flight: Flight, best: BestEstimate) -> Path | None:
    """The best estimate; None where it does not know its place on Earth, or the flight not that of its origin."""
    zero = best.origin
    if zero is None or "gps_position" not in best.residuals:
        return None
    place = geodetic_from_ned(best.position, (zero.latitude, zero.longitude, zero.height))
    position = _located(flight, *place.T)
    return None if position is None else Path(best.t, position)


def _located(flight: Flight, latitude: Array, longitude: Array, height: Array) -> Array | None:
    """Places (N,) rad, rad, m as NED (N, 3) m about the zero of the flight's positions; None where that is not known.

    As autopilots reckon their local position: along meridian and parallel with the radii of curvature at the origin,
    1 m off at 50 km, and down without the curvature of the Earth.
    """
    origin = flight.origin
    if origin is None or flight.position is None:
        return None
    zero, meridian, parallel = _scale(origin, flight.position)
    east = (longitude - origin.longitude + np.pi) % (2 * np.pi) - np.pi
    there = [(latitude - origin.latitude) * meridian, east * parallel, origin.height - height]
    return np.asarray(zero + np.stack(there, axis=1), dtype=np.float64)


def degrees_of(flight: Flight, low: Array, high: Array) -> tuple[float, float, float, float] | None:
    """South, west, north and east, rad, of the ground between two corners NED, m, of which south is the least north.

    None where the log does not tell where it flew. The inverse of `ground_of`.
    """
    origin = flight.origin
    if origin is None or flight.position is None:
        return None
    zero, meridian, parallel = _scale(origin, flight.position)
    (south, north), (west, east) = (
        origin.latitude + (np.array([low[0], high[0]]) - zero[0]) / meridian,
        origin.longitude + (np.array([low[1], high[1]]) - zero[1]) / parallel,
    )
    return float(south), float(west), float(north), float(east)


def ground_of(flight: Flight, south: float, west: float, north: float, east: float) -> tuple[Array, Array] | None:
    """Least and most north, east (2,), m, of a piece of the world (rad) about the zero of the flight's positions."""
    origin = flight.origin
    if origin is None or flight.position is None:
        return None
    zero, meridian, parallel = _scale(origin, flight.position)
    scale, at = np.array([meridian, parallel]), np.array([origin.latitude, origin.longitude])
    low, high = (zero[:2] + (np.array(corner) - at) * scale for corner in ((south, west), (north, east)))
    return low, high


def _scale(origin: Origin, positions: PositionTrack) -> tuple[Array, float, float]:
    """Where the origin is about the zero of the flight's positions, NED, m; m per rad along meridian and parallel."""
    zero = np.zeros(3)
    if origin.t is not None:  # the vehicle was there then; it is not the zero itself
        zero = np.array([np.interp(origin.t, positions.t, column) for column in positions.position.T])
    sine = 1.0 - ECCENTRICITY_SQUARED * np.sin(origin.latitude) ** 2
    meridian = SEMI_MAJOR_AXIS * (1.0 - ECCENTRICITY_SQUARED) / sine**1.5
    return zero, float(meridian), float(SEMI_MAJOR_AXIS / np.sqrt(sine) * np.cos(origin.latitude))
