"""Conversions from and to the frames of messages, sensors and maps: Euler angles, mounting orientations, WGS-84.

Ground floor: used where messages come in, where positions go out, and by the gravity of the ellipsoid.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from companion.model.errors import DataError, floats

Array = npt.NDArray[np.float64]

# NIMA TR8350.2 (2000), tables 3.1 and 3.3
SEMI_MAJOR_AXIS = 6378137.0  # m
ECCENTRICITY_SQUARED = 6.69437999014e-3  # of the first eccentricity

_SEMI_MINOR_AXIS = SEMI_MAJOR_AXIS * float(np.sqrt(1 - ECCENTRICITY_SQUARED))
_SECOND = ECCENTRICITY_SQUARED / (1 - ECCENTRICITY_SQUARED)


def from_euler(roll: npt.ArrayLike, pitch: npt.ArrayLike, yaw: npt.ArrayLike) -> Array:
    """q_ned_frd (..., 4) wxyz of MAVLink's ATTITUDE angles in rad: yaw about down, then pitch, then roll (z-y-x).

    Raises DataError for what is no number, and for shapes that do not fit.
    """
    named = (("roll", roll), ("pitch", pitch), ("yaw", yaw))
    given = [floats(name, np.asarray(angle), np.shape(angle), finite=False) for name, angle in named]
    try:
        half = 0.5 * np.stack(np.broadcast_arrays(*given))
    except ValueError:
        raise DataError(f"roll, pitch and yaw have shapes that do not fit: {[a.shape for a in given]}") from None
    (cr, cp, cy), (sr, sp, sy) = np.cos(half), np.sin(half)
    return np.stack(
        (
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ),
        axis=-1,
    )


ORIENTATIONS: tuple[tuple[float, float, float], ...] = (
    (0, 0, 0), (0, 0, 45), (0, 0, 90), (0, 0, 135), (0, 0, 180), (0, 0, 225), (0, 0, 270), (0, 0, 315),
    (180, 0, 0), (180, 0, 45), (180, 0, 90), (180, 0, 135), (0, 180, 0), (180, 0, 225), (180, 0, 270), (180, 0, 315),
    (90, 0, 0), (90, 0, 45), (90, 0, 90), (90, 0, 135), (270, 0, 0), (270, 0, 45), (270, 0, 90), (270, 0, 135),
    (0, 90, 0), (0, 270, 0), (0, 180, 90), (0, 180, 270), (90, 90, 0), (180, 90, 0), (270, 90, 0), (90, 180, 0),
    (270, 180, 0), (90, 270, 0), (180, 270, 0), (270, 270, 0), (90, 180, 90), (90, 0, 270), (90, 68, 293),
    (0, 315, 0), (90, 315, 0),
)  # fmt: skip
"""Number → roll, pitch and yaw in degrees, by which readings are turned into the body: yaw last.

MAVLink's MAV_SENSOR_ORIENTATION: the ways in which a sensor may be mounted, by which vehicles set their boards.
"""


@cache
def orientations() -> Array:
    """(41, 4) wxyz: body FRD from the sensor's axes, of each number."""
    return from_euler(*np.radians(ORIENTATIONS).T)


def orientation_name(number: int) -> str:
    """In words: "roll 180°, yaw 90°"; "none" for none."""
    angles = zip(("roll", "pitch", "yaw"), ORIENTATIONS[number], strict=True)
    return ", ".join(f"{axis} {angle:g}°" for axis, angle in angles if angle) or "none"


def orientation_number(q: Array) -> tuple[int, float]:
    """The first of the list that is nearest to a rotation (4,) wxyz, and by what angle (rad) it is off."""
    along = np.abs(orientations() @ q)
    best = int(np.argmax(along > along.max() - 1e-9))
    return best, float(2.0 * np.arccos(min(along[best], 1.0)))


def ned_from_geodetic(latitude: Array, longitude: Array, height: Array, origin: tuple[float, float, float]) -> Array:
    """Positions (N,) rad, rad, m as NED (N, 3) m about an origin in rad, rad, m."""
    offset = _ecef(latitude, longitude, height) - _ecef(*origin)
    return np.asarray(offset @ _ned_axes(origin[0], origin[1]))


def geodetic_from_ned(ned: Array, origin: tuple[float, float, float]) -> Array:
    """NED (N, 3) m about an origin in rad, rad, m as latitude rad, longitude rad, height m: (N, 3).

    By Bowring (1985): exact to a micrometre near the ground.
    """
    x, y, z = (_ecef(*origin) + ned @ _ned_axes(origin[0], origin[1]).T).T
    from_axis = np.hypot(x, y)
    reduced = np.arctan2(SEMI_MAJOR_AXIS * z, _SEMI_MINOR_AXIS * from_axis)
    latitude = np.arctan2(
        z + _SECOND * _SEMI_MINOR_AXIS * np.sin(reduced) ** 3,
        from_axis - ECCENTRICITY_SQUARED * SEMI_MAJOR_AXIS * np.cos(reduced) ** 3,
    )
    surface = SEMI_MAJOR_AXIS * np.sqrt(1 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2)
    height = from_axis * np.cos(latitude) + z * np.sin(latitude) - surface
    return np.column_stack([latitude, np.arctan2(y, x), height])


def radii_of_curvature(latitude: float) -> Array:
    """(2,) m, of the ellipsoid at a latitude in rad: along the meridian, and across it (the prime vertical)."""
    flattened = 1.0 - ECCENTRICITY_SQUARED * float(np.sin(latitude)) ** 2
    across = SEMI_MAJOR_AXIS / np.sqrt(flattened)
    return np.array([across * (1.0 - ECCENTRICITY_SQUARED) / flattened, across])


def _ecef(latitude: Array | float, longitude: Array | float, height: Array | float) -> Array:
    """Earth-centred, Earth-fixed positions (..., 3), m."""
    sa, ca, so, co = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    radius = SEMI_MAJOR_AXIS / np.sqrt(1 - ECCENTRICITY_SQUARED * sa**2)  # of curvature in the prime vertical
    out = (radius + height) * ca
    return np.stack([out * co, out * so, (radius * (1 - ECCENTRICITY_SQUARED) + height) * sa], axis=-1)


def _ned_axes(latitude: float, longitude: float) -> Array:
    """(3, 3): the directions of north, east and down in ECEF, as columns."""
    sa, ca, so, co = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    return np.array([[-sa * co, -so, -ca * co], [-sa * so, co, -ca * so], [ca, 0.0, -sa]])
