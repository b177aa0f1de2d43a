"""What a simulator knows of itself: the truth of a flight, for tests and benchmarks."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from companion.mavlink import Messages
from companion.model import Array, Origin, PositionTrack, TruthTrack, from_euler, ned_from_geodetic
from companion.telemetry.samples import attitudes
from companion.telemetry.sources import SI


def truth_track(
    source: str,
    t: Array,
    q_ned_frd: Array,
    velocity: Array,
    place: tuple[Array, Array, Array],
    origin: Origin | None,
    track: PositionTrack | None,
) -> TruthTrack | None:
    """A simulator's own poses at boot times t (N,) s, in any order; None without any.

    velocity: NED, m/s; place: latitude and longitude in rad, height in m; each (N,), NaN where it is not told. They
    become NED about the zero of `track`, the autopilot's position, which `origin` places on Earth.
    """
    keep, when, q = attitudes(t, q_ned_frd)
    if not len(when):
        return None
    position = np.full((len(t), 3), np.nan)
    if origin is not None:
        latitude, longitude, height = place
        unknown = np.isnan(height)
        position = ned_from_geodetic(
            latitude,
            longitude,
            np.where(unknown, origin.height, height),
            (origin.latitude, origin.longitude, origin.height),
        )
        position[unknown, 2] = np.nan
        if origin.t is not None and track is not None:
            position = position + [np.interp(origin.t, track.t, axis) for axis in track.position.T]
    return TruthTrack(when, q, velocity[keep], position[keep], source)


TRUTH_MESSAGES = ("SIM_STATE", "HIL_STATE_QUATERNION", "SIMSTATE")
"""The one that says most first."""


def message_truth(
    messages: Mapping[str, Messages], origin: Origin | None, track: PositionTrack | None
) -> TruthTrack | None:
    """The truth in a boot's messages, at their boot times; see `truth_track` for origin and track."""
    name = next((name for name in TRUTH_MESSAGES if name in messages), None)
    if name is None:
        return None
    told = messages[name]
    nowhere = np.full(len(told), np.nan)
    if name == "HIL_STATE_QUATERNION":
        q = told["attitude_quaternion"].astype(np.float64)
        velocity = np.column_stack([_si(told, field) for field in ("vx", "vy", "vz")])
        place = _si(told, "lat"), _si(told, "lon"), _si(told, "alt")
    else:
        q = from_euler(told["roll"], told["pitch"], told["yaw"])
        velocity = np.full((len(told), 3), np.nan)
        place = nowhere, nowhere, nowhere
    if name == "SIM_STATE":
        velocity = np.column_stack([_si(told, field) for field in ("vn", "ve", "vd")])
        if told["lat_int"].any():  # `lat` and `lon` are degE7 too, whatever their unit says, cut to 24 bits
            place = _si(told, "lat_int"), _si(told, "lon_int"), _si(told, "alt")
    elif name == "SIMSTATE":
        place = _si(told, "lat"), _si(told, "lng"), nowhere
    return truth_track(name, told.t, q, velocity, place, origin, track)


def _si(messages: Messages, field: str) -> Array:
    return np.asarray(messages[field] * SI[messages.layout.units[field]])
