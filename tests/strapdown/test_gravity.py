"""Normal gravity against the values that NIMA TR8350.2 prints."""

from __future__ import annotations

import numpy as np
import pytest

from companion.model import STANDARD_GRAVITY
from companion.strapdown import normal_gravity


def test_values_of_the_standard() -> None:
    assert normal_gravity(0.0) == pytest.approx(9.7803253359, abs=1e-10)
    assert normal_gravity(np.pi / 2) == pytest.approx(9.8321849378, abs=1e-9)
    # The mean over the ellipsoid, weighted by area, is 9.7976432222 m/s² in the same table.
    latitude = np.linspace(-np.pi / 2, np.pi / 2, 20_001)
    e2 = 6.69437999014e-3
    area = np.cos(latitude) / (1 - e2 * np.sin(latitude) ** 2) ** 2
    assert (normal_gravity(latitude) * area).sum() / area.sum() == pytest.approx(9.7976432222, abs=1e-7)


def test_it_falls_with_height_by_the_free_air_gradient_and_is_standard_at_middle_latitudes() -> None:
    assert normal_gravity(0.8, 1000.0) - normal_gravity(0.8) == pytest.approx(-3.086e-3, rel=2e-3)
    assert normal_gravity(np.radians(45.5)) == pytest.approx(STANDARD_GRAVITY, abs=1e-3)
    np.testing.assert_allclose(normal_gravity([-0.5, 0.5], [[0.0], [10.0]]).shape, (2, 2))


def test_height_agrees_with_the_field_of_an_oblate_earth_above_the_equator() -> None:
    """GM/r² (1 + 3/2 J2 (a/r)²) - ω² r, with the WGS-84 constants; the change with height needs no J4."""

    def field(height: float) -> float:
        r = 6378137.0 + height
        attraction = 3.986004418e14 / r**2 * (1 + 1.5 * 1.08262982e-3 * (6378137.0 / r) ** 2)
        return attraction - 7.292115e-5**2 * r

    for height in (1_000.0, 20_000.0):
        expected = field(height) - field(0.0)
        assert normal_gravity(0.0, height) - normal_gravity(0.0) == pytest.approx(expected, abs=5e-6)


def test_degrees_are_refused() -> None:
    with pytest.raises(ValueError, match="degrees"):
        normal_gravity(47.0)
