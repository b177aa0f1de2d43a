"""NED about a point on Earth → latitude, longitude, height (WGS-84): what a map wants."""

from __future__ import annotations

import numpy as np

from companion.model import Array, Flight, Origin, geodetic_from_ned


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
