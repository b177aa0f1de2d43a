"""A click into the picture: which instant of the flight lies there."""

from __future__ import annotations

import numpy as np

from companion.model import Array
from companion.view.state.trajectory import DisplayTrajectory

REACH = np.radians(0.8)
"""How far from a path a click may be, as an angle at the camera: 16 pixels of a window 900 high."""
_MOST = 200_000  # samples that are looked at


def picked(display: DisplayTrajectory, origin: Array, direction: Array) -> float | None:
    """The time, s, of the place on either path that a ray passes closest to, seen from its origin; NED, m.

    None where both paths are farther away than a click can mean, and without a position.
    """
    if not display.replay.has_position or not np.linalg.norm(direction) > 0:
        return None
    some = slice(None, None, len(display.replay.t) // _MOST + 1)
    t = display.replay.t[some]
    nearest = [_nearest(p[some], origin, direction) for p in (display.replay.position_ref, display.replay.position_imu)]
    angle, at = min(nearest)
    return float(t[at]) if angle < REACH else None


def _nearest(points: Array, origin: Array, direction: Array) -> tuple[float, int]:
    """The least angle, rad, between the ray and what is seen from its origin, and which of `points` (N, 3) that is."""
    offsets = points - origin
    along = offsets @ (direction / np.linalg.norm(direction))
    aside = np.sqrt(np.maximum(np.einsum("ij,ij->i", offsets, offsets) - along**2, 0.0))
    angles = np.arctan2(aside, along)
    at = int(np.argmin(angles))
    return float(angles[at]), at
