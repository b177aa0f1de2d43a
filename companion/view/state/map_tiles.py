"""Which tiles of a web map lie under a flight, and where: Web Mercator (EPSG:3857), as all tile servers cut it.

Tile (x, y) of zoom z is one of 2^z by 2^z squares of the world, x from the antimeridian to the east, y from about
85° north to the south (OpenStreetMap, "Slippy map tilenames").
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from companion.model import Array

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
