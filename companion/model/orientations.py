"""The ways in which a sensor may be mounted: MAVLink's MAV_SENSOR_ORIENTATION, by which vehicles set their boards."""

from __future__ import annotations

from functools import cache

import numpy as np

from companion.model.geodesy import from_euler
from companion.model.tracks import Array

ORIENTATIONS: tuple[tuple[float, float, float], ...] = (
    (0, 0, 0), (0, 0, 45), (0, 0, 90), (0, 0, 135), (0, 0, 180), (0, 0, 225), (0, 0, 270), (0, 0, 315),
    (180, 0, 0), (180, 0, 45), (180, 0, 90), (180, 0, 135), (0, 180, 0), (180, 0, 225), (180, 0, 270), (180, 0, 315),
    (90, 0, 0), (90, 0, 45), (90, 0, 90), (90, 0, 135), (270, 0, 0), (270, 0, 45), (270, 0, 90), (270, 0, 135),
    (0, 90, 0), (0, 270, 0), (0, 180, 90), (0, 180, 270), (90, 90, 0), (180, 90, 0), (270, 90, 0), (90, 180, 0),
    (270, 180, 0), (90, 270, 0), (180, 270, 0), (270, 270, 0), (90, 180, 90), (90, 0, 270), (90, 68, 293),
    (0, 315, 0), (90, 315, 0),
)  # fmt: skip
"""Number → roll, pitch and yaw in degrees, by which readings are turned into the body: yaw last."""


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
