"""The paths of a flight as lines for maps and 3D views: few points, one colour per source; NED to WGS-84."""

from __future__ import annotations

import numpy as np

from companion.analysis import Replay
from companion.estimation import BestEstimate
from companion.model import Array, Flight, Origin, geodetic_from_ned

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
    by_source = {"autopilot": shown.position_ref, "imu": shown.position_imu}
    if best is not None and "gps_position" in best.residuals:
        by_source["best"] = best.position
    return {name: _few(path) for name, path in by_source.items()}


def _few(path: Array) -> Array:
    finite = path[np.isfinite(path).all(axis=1)]
    return finite[np.unique(np.linspace(0, len(finite) - 1, MOST_POINTS).round().astype(np.intp))]


def geodetic(flight: Flight, position: Array) -> Array | None:
    """Where NED positions (N, 3) m of the flight lie: latitude °, longitude °, height m above mean sea level (N, 3).

    None when the flight does not know where on Earth it is. Its origin may be the zero of the positions or a fix on the
    way (`Origin.t`): then the position at that time is where the fix was.
    """
    origin, track = flight.origin, flight.position
    if origin is None or track is None:
        return None
    there = np.zeros(3)
    if origin.t is not None:
        there = np.array([np.interp(origin.t, track.t, axis) for axis in track.position.T])
    return places(position - there, origin)


def places(position: Array, origin: Origin) -> Array:
    """NED positions (N, 3) m about an origin as latitude °, longitude °, height m above mean sea level: (N, 3)."""
    place = geodetic_from_ned(position, (origin.latitude, origin.longitude, origin.height))
    return np.column_stack([np.degrees(place[:, :2]), place[:, 2]])
