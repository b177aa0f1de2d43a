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
from companion.model import Array, Flight, Origin, geodetic_from_ned, interpolated, radii_of_curvature

_FIX_3D = 3  # GPS_FIX_TYPE


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Positions over time, about the zero of the flight's own positions."""

    t: Array  # (N,) s, boot clock
    position: Array  # (N, 3) NED, m


@dataclass(frozen=True, slots=True, eq=False)
class LocalFrame:
    """Where latitudes and longitudes lie about the zero of a flight's positions.

    As autopilots work out their local position: along meridian and parallel with the radii of curvature at the origin,
    1 m off at 50 km, and down without the curvature of the Earth.
    """

    origin: Origin
    zero: Array  # (3,) where the origin is, NED, m
    scale: Array  # (2,) m per rad along meridian and parallel

    def ground(self, places: Array) -> Array:
        """North and east (..., 2), m, of latitudes and longitudes (..., 2), rad."""
        here = np.array([self.origin.latitude, self.origin.longitude])
        return np.asarray(self.zero[:2] + (places - here) * self.scale)

    def places(self, ground: Array) -> Array:
        """The inverse of `ground`."""
        return np.array([self.origin.latitude, self.origin.longitude]) + (ground - self.zero[:2]) / self.scale

    def ned(self, latitude: Array, longitude: Array, height: Array) -> Array:
        """Places (...,) rad, rad, m as (..., 3) m."""
        east = (longitude - self.origin.longitude + np.pi) % (2 * np.pi) - np.pi
        ground = self.ground(np.stack([latitude, self.origin.longitude + east], axis=-1))
        down = self.zero[2] + self.origin.height - np.asarray(height)
        return np.concatenate([ground, down[..., None]], axis=-1)


def local_frame(flight: Flight) -> LocalFrame | None:
    """None where the log does not tell where its positions count from."""
    origin, positions = flight.origin, flight.position
    if origin is None or positions is None:
        return None
    zero = np.zeros(3)
    if origin.t is not None:  # the vehicle was there then; it is not the zero itself
        zero = interpolated(np.array([origin.t]), positions.t, positions.position)[0]
    radii = radii_of_curvature(origin.latitude)
    return LocalFrame(origin, zero, radii * np.array([1.0, np.cos(origin.latitude)]))


def home_position(flight: Flight) -> Array | None:
    """Home, NED, (3,) m; None where the log does not tell it, or not where its positions count from."""
    home, local = flight.home, local_frame(flight)
    if home is None or local is None:
        return None
    return local.ned(*(np.array(x) for x in (home.latitude, home.longitude, home.height)))


def gps_path(flight: Flight) -> Path | None:
    """The 3D fixes of the first receiver that has any, as it sent them; None where there is none."""
    local = local_frame(flight)
    for receiver in flight.gps:
        fixed = (receiver.fix_type >= _FIX_3D) & np.isfinite(receiver.latitude + receiver.longitude + receiver.height)
        if local is not None and np.count_nonzero(fixed) > 1:
            fixes = local.ned(receiver.latitude[fixed], receiver.longitude[fixed], receiver.height[fixed])
            return Path(receiver.t[fixed], fixes)
    return None


def best_path(flight: Flight, best: BestEstimate) -> Path | None:
    """The best estimate; None where it does not know its place on Earth, or the flight not that of its origin."""
    zero, local = best.origin, local_frame(flight)
    if zero is None or local is None or "gps_position" not in best.residuals:
        return None
    place = geodetic_from_ned(best.position, (zero.latitude, zero.longitude, zero.height))
    return Path(best.t, local.ned(*place.T))


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
