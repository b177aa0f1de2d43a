"""Geodetic positions and NED are the same place, and that place is where other libraries have it."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from companion.model import SEMI_MAJOR_AXIS, geodetic_from_ned, ned_from_geodetic

places = st.tuples(
    st.floats(-np.pi / 2 + 1e-3, np.pi / 2 - 1e-3), st.floats(-np.pi + 1e-3, np.pi - 1e-3), st.floats(-400.0, 9000.0)
)
offsets = st.tuples(*[st.floats(-3000.0, 3000.0)] * 3)


@given(places, offsets)
def test_there_and_back(origin: tuple[float, float, float], offset: tuple[float, float, float]) -> None:
    ned = np.array([offset])
    latitude, longitude, height = geodetic_from_ned(ned, origin).T
    np.testing.assert_allclose(ned_from_geodetic(latitude, longitude, height, origin), ned, atol=1e-4)


def test_small_steps_on_the_equator_are_arcs_of_the_ellipsoid() -> None:
    """East along the equator is a circle of the semi-major axis; north there has the radius a (1 - e²)."""
    step = 1e-6
    (east,) = ned_from_geodetic(np.zeros(1), np.array([step]), np.zeros(1), (0.0, 0.0, 0.0))
    np.testing.assert_allclose(east, [0.0, SEMI_MAJOR_AXIS * step, 0.0], atol=1e-5)
    (north,) = ned_from_geodetic(np.array([step]), np.zeros(1), np.zeros(1), (0.0, 0.0, 0.0))
    np.testing.assert_allclose(north, [6335439.327 * step, 0.0, 0.0], atol=1e-5)  # NIMA TR8350.2: a (1 - e²)
    (up,) = ned_from_geodetic(np.full(1, 0.8), np.full(1, 0.1), np.full(1, 25.0), (0.8, 0.1, 5.0))
    np.testing.assert_allclose(up, [0.0, 0.0, -20.0], atol=1e-6)
