"""Where what is known by latitude and longitude lies in the picture: home, GPS fixes, best estimate, tiles of a map.

Maps are in Web Mercator (EPSG:3857), as all tile servers cut them: tile (x, y) of zoom z is one of 2^z by 2^z squares
of the world, x from the antimeridian to the east, y from about 85° north to the south (OpenStreetMap, "Slippy map
tilenames").
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

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


MOST_TILES = 16
DEEPEST = 18
"""Zoom: 0.6 m a pixel at the equator. Few servers have more."""
_FARTHEST = np.radians(85.0)  # latitude, where the map ends


@dataclass(frozen=True, slots=True)
class Tiles:
    """A rectangle of tiles."""

    zoom: int
    x: int  # of the western ones; may be outside of [0, 2^zoom) by a turn around the world
    y: int  # of the northern ones
    columns: int
    rows: int

    def __iter__(self) -> Iterator[tuple[int, int, int, int]]:
        """Row and column here; x and y on the server."""
        for row in range(self.rows):
            for column in range(self.columns):
                yield row, column, (self.x + column) % 2**self.zoom, self.y + row

    @property
    def corners(self) -> tuple[float, float, float, float]:
        """South, west, north, east, rad."""
        n = 2.0**self.zoom
        north, south = (float(np.arctan(np.sinh(np.pi * (1 - 2 * y / n)))) for y in (self.y, self.y + self.rows))
        west, east = (2 * np.pi * (x / n - 0.5) for x in (self.x, self.x + self.columns))
        return south, west, north, east


@dataclass(frozen=True, slots=True, eq=False)
class MapPicture:
    """A picture of the ground."""

    pixels: npt.NDArray[np.uint8]  # (H, W, 3), north up
    centre: Array  # (2,) north, east of the flight's zero, m
    size: Array  # (2,) to the north, to the east, m
    credit: str  # whose map it is


def tiles_over(south: float, west: float, north: float, east: float) -> Tiles:
    """The finest tiles, at most 16, that cover a piece of the world (rad; east may be beyond π)."""
    south, north = (float(np.clip(latitude, -_FARTHEST, _FARTHEST)) for latitude in (south, north))
    for zoom in range(DEEPEST, -1, -1):
        n = 2**zoom
        left, right = (int(np.floor(n * (0.5 + longitude / (2 * np.pi)))) for longitude in (west, east))
        top, bottom = (int(np.floor(n * (0.5 - np.arcsinh(np.tan(lat)) / (2 * np.pi)))) for lat in (north, south))
        tiles = Tiles(zoom, left, top, right - left + 1, bottom - top + 1)
        if tiles.columns * tiles.rows <= MOST_TILES and tiles.columns <= n:
            return tiles
    return Tiles(0, 0, 0, 1, 1)
