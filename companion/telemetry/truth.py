"""What a simulator knows of itself: the truth of a flight, for tests and benchmarks."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from companion.mavlink import Messages
from companion.model import Array, Origin, PositionTrack, TruthTrack, from_euler
from companion.telemetry.samples import attitudes, ned_about
from companion.telemetry.sources import SI

MESSAGES = {
    "SIM_STATE": ("vn ve vd", "lat_int lon_int alt"),  # `lat` and `lon` are degE7 too, cut to 24 bits
    "HIL_STATE_QUATERNION": ("vx vy vz", "lat lon alt"),
    "SIMSTATE": ("", "lat lng"),
}
"""The one that says most first → its velocity, NED, and its place."""


def message_truth(
    messages: Mapping[str, Messages], origin: Origin | None, track: PositionTrack | None
) -> TruthTrack | None:
    """The truth in a boot's messages, at their boot times; see `truth_track` for origin and track."""
    name = next((name for name in MESSAGES if name in messages), None)
    if name is None:
        return None
    told = messages[name]
    velocity, place = (np.full((len(told), 3), np.nan) for _ in range(2))
    for values, fields in zip((velocity, place), MESSAGES[name], strict=True):
        for i, field in enumerate(fields.split()):
            values[:, i] = told[field] * SI[told.layout.units[field]]
    if name == "SIM_STATE" and not place[:, 0].any():
        place[:] = np.nan
    if name == "HIL_STATE_QUATERNION":
        q = told["attitude_quaternion"].astype(np.float64)
    else:
        q = from_euler(told["roll"], told["pitch"], told["yaw"])
    return truth_track(name, told.t, q, velocity, place, origin, track)


def truth_track(
    source: str, t: Array, q: Array, velocity: Array, place: Array, origin: Origin | None, track: PositionTrack | None
) -> TruthTrack | None:
    """A simulator's own poses at boot times t (N,) s, in any order; None without any.

    velocity: (N, 3) NED, m/s; place: (N, 3) latitude and longitude in rad, height in m; NaN where it is not told. They
    become NED about the zero of `track`, the autopilot's position, which `origin` places on Earth.
    """
    keep, when, attitude = attitudes(t, q)
    if not len(when):
        return None
    position = np.full((len(t), 3), np.nan)
    if origin is not None:
        latitude, longitude, height = place.T
        unknown = np.isnan(height)
        position = ned_about(origin, latitude, longitude, np.where(unknown, origin.height, height))
        position[unknown, 2] = np.nan
        if origin.t is not None and track is not None:
            position = position + [np.interp(origin.t, track.t, axis) for axis in track.position.T]
    return TruthTrack(when, attitude, velocity[keep], position[keep], source)
