"""Which tiles lie under a flight."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from companion.view.state.places import DEEPEST, MOST_TILES, Tiles, tiles_over

LATITUDES = st.floats(np.radians(-84.0), np.radians(84.0))
LONGITUDES = st.floats(-np.pi, np.pi - 1e-9)
SIZES = st.floats(1e-6, 0.5)


@given(LATITUDES, LONGITUDES, SIZES, SIZES)
def test_they_cover_it_with_few_tiles(south: float, west: float, high: float, wide: float) -> None:
    north, east = min(south + high, np.radians(84.9)), west + wide
    tiles = tiles_over(south, west, north, east)
    assert 1 <= tiles.columns * tiles.rows <= MOST_TILES
    assert tiles.zoom <= DEEPEST
    low, left, top, right = tiles.corners
    assert low - 1e-12 <= south <= north <= top + 1e-12
    assert left - 1e-12 <= west <= east <= right + 1e-12
    on_server = [(x, y) for _, _, x, y in tiles]
    assert len(set(on_server)) == tiles.columns * tiles.rows
    assert all(0 <= x < 2**tiles.zoom and 0 <= y < 2**tiles.zoom for x, y in on_server)


def test_a_known_tile() -> None:
    """OpenStreetMap's wiki, "Slippy map tilenames": 35.6590699° N 139.7006793° E is in 18/232798/103246."""
    place = np.radians([35.6590699, 139.7006793])
    tiles = tiles_over(place[0], place[1], place[0], place[1])
    assert tiles == Tiles(18, 232798, 103246, 1, 1)


def test_the_whole_world_is_one_piece() -> None:
    tiles = tiles_over(-1.6, -np.pi, 1.6, np.pi - 1e-9)
    assert tiles.zoom == 2
    assert tiles.columns * tiles.rows == 16
