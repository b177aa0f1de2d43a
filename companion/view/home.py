"""Where home is in the picture."""

from __future__ import annotations

import numpy as np

from companion.model import ECCENTRICITY_SQUARED, SEMI_MAJOR_AXIS, Array, Flight


def home_position(flight: Flight) -> Array | None:
    """Home in NED about the zero of the flight's positions, (3,) m; None where the log does not tell both.

    On the tangent plane with the radii of curvature at the origin: 1 m off at 50 km, in a marker on a map.
    """
    home, origin = flight.home, flight.origin
    if home is None or origin is None or flight.position is None:
        return None
    zero = np.zeros(3)
    if origin.t is not None:  # the vehicle was there then; it is not the zero itself
        zero = np.array([np.interp(origin.t, flight.position.t, column) for column in flight.position.position.T])
    sine = 1.0 - ECCENTRICITY_SQUARED * np.sin(origin.latitude) ** 2
    meridian = SEMI_MAJOR_AXIS * (1.0 - ECCENTRICITY_SQUARED) / sine**1.5
    parallel = SEMI_MAJOR_AXIS / np.sqrt(sine) * np.cos(origin.latitude)
    east = (home.longitude - origin.longitude + np.pi) % (2 * np.pi) - np.pi
    there = [(home.latitude - origin.latitude) * meridian, east * parallel, origin.height - home.height]
    return np.asarray(zero + np.array(there), dtype=np.float64)
