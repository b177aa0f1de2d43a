"""The paths of a flight as lines for maps and 3D views: few points, one colour per source."""

from __future__ import annotations

import numpy as np

from companion.analysis import Replay
from companion.estimation import BestEstimate
from companion.model import Array

MOST_POINTS = 5000
"""A line of more is slow to draw in Foxglove and Google Earth, and looks the same."""

COLOURS = {"autopilot": (0, 114, 178), "imu": (230, 97, 1), "best": (0, 158, 115)}
"""As in the viewer: blue, vermillion, bluish green (Okabe and Ito)."""


def paths(shown: Replay, best: BestEstimate | None) -> dict[str, Array]:
    """Source → its path (N, 3) NED m of the flight's origin; none where the log has no position.

    The best estimate counts from its own origin, which is the flight's only where that is a fix: see `BestEstimate`.
    """
    if not shown.has_position:
        return {}
    found = {"autopilot": shown.position_ref, "imu": shown.position_imu}
    if best is not None and "gps_position" in best.residuals:
        found["best"] = best.position
    return {name: _few(path) for name, path in found.items()}


def _few(path: Array) -> Array:
    finite = path[np.isfinite(path).all(axis=1)]
    return finite[np.unique(np.linspace(0, len(finite) - 1, MOST_POINTS).round().astype(np.intp))]
