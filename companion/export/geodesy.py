"""NED about a point on Earth → latitude, longitude, height (WGS-84): what a map wants."""

from __future__ import annotations

import numpy as np

from companion.tracks import Array, Flight

_A = 6_378_137.0  # m, semi-major axis
_E2 = 6.694_379_990_14e-3  # first eccentricity squared
_B = _A * np.sqrt(1 - _E2)
_SECOND_E2 = _E2 / (1 - _E2)


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
    return _from_ned(origin.latitude, origin.longitude, origin.height, position - there)


def _from_ned(latitude: float, longitude: float, height: float, ned: Array) -> Array:
    """Through Earth-centred axes, and back by Bowring (1985): exact to a micrometre near the ground."""
    sa, ca, so, co = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    radius = _A / np.sqrt(1 - _E2 * sa**2)
    origin = [(radius + height) * ca * co, (radius + height) * ca * so, (radius * (1 - _E2) + height) * sa]
    to_ecef = np.array([[-sa * co, -so, -ca * co], [-sa * so, co, -ca * so], [ca, 0.0, -sa]])
    x, y, z = (np.asarray(origin) + ned @ to_ecef.T).T
    from_axis = np.hypot(x, y)
    reduced = np.arctan2(_A * z, _B * from_axis)
    lat = np.arctan2(z + _SECOND_E2 * _B * np.sin(reduced) ** 3, from_axis - _E2 * _A * np.cos(reduced) ** 3)
    up = from_axis * np.cos(lat) + z * np.sin(lat) - _A * np.sqrt(1 - _E2 * np.sin(lat) ** 2)
    return np.column_stack([np.degrees(lat), np.degrees(np.arctan2(y, x)), up])
