"""Normal gravity of the WGS-84 ellipsoid, for those who do not take the standard 9.80665 m/s².

ArduPilot's and PX4's estimators and ArduPilot's SITL use the standard value, so it is the default everywhere. The real
one differs by up to 0.03 m/s² (0.3 %) with latitude and 3.1e-6 m/s² per metre of height: over 30 s that is 12 m down.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from companion.model import ECCENTRICITY_SQUARED, SEMI_MAJOR_AXIS, Array

# NIMA TR8350.2 (2000), tables 3.1, 3.3 and 3.4
EQUATOR = 9.7803253359  # m/s²
SOMIGLIANA = 0.00193185265241
FLATTENING = 1 / 298.257223563
CENTRIFUGAL_RATIO = 0.00344978650684  # m = ω² a² b / GM


def normal_gravity(latitude: npt.ArrayLike, height: npt.ArrayLike = 0.0) -> Array:
    """Gravity in m/s² (down) at geodetic latitude (rad) and height above the ellipsoid (m), broadcast.

    Somigliana's formula on the ellipsoid and the second-order series in height (NIMA TR8350.2, eqs. 4-1 and 4-3); the
    latter holds to some 20 km. Raises ValueError for latitudes beyond the poles, as degrees would be.
    """
    latitude, height = np.asarray(latitude, dtype=np.float64), np.asarray(height, dtype=np.float64)
    if not (np.abs(latitude) <= np.pi / 2).all():
        raise ValueError(f"latitude must lie within ±π/2 rad, got {np.ravel(latitude)[:3]}; is it in degrees?")
    s2 = np.sin(latitude) ** 2
    surface = EQUATOR * (1 + SOMIGLIANA * s2) / np.sqrt(1 - ECCENTRICITY_SQUARED * s2)
    ratio = height / SEMI_MAJOR_AXIS
    slope = 1 + FLATTENING + CENTRIFUGAL_RATIO - 2 * FLATTENING * s2
    return np.asarray(surface * (1 - 2 * slope * ratio + 3 * ratio**2))
