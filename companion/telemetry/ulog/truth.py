"""A simulator's truth in a PX4 ULog."""

from __future__ import annotations

import numpy as np

from companion.model import Array, Origin, TruthTrack, geodetic_from_ned, ned_from_geodetic
from companion.telemetry.samples import attitudes, increasing
from companion.telemetry.ulog.topics import Topic, Topics, column, columns, finite, sampled, seconds

_GAP_S = 0.2  # across a longer one the truth is not interpolated


def truth(topics: Topics, origin: Origin | None) -> TruthTrack | None:
    """The simulator's attitude, with its velocity and position interpolated to the attitude's times.

    Position by the cubic of position and velocity, about `origin` where both know their place on Earth; NaN where the
    log does not tell it.
    """
    if "vehicle_attitude_groundtruth" not in topics:
        return None
    topic = topics["vehicle_attitude_groundtruth"]
    t, q = sampled(topic), columns(topic, *(f"q[{i}]" for i in range(4)))
    _, t, q = attitudes(t, q)
    if not len(t):
        return None
    place = topics.get("vehicle_local_position_groundtruth")
    velocity, position = (np.full((len(t), 3), np.nan),) * 2 if place is None else _moved(t, place, origin)
    return TruthTrack(t, q, velocity, position, "vehicle_attitude_groundtruth", _faults(topics))


def _faults(topics: Topics) -> tuple[float, ...]:
    """When RflyMAD's simulator switched a fault on: `id` of rfly_ctrl_lxl is 0 without one (arXiv 2311.11340)."""
    topic = topics.get("rfly_ctrl_lxl")
    if topic is None or "id" not in topic:
        return ()
    on = np.flatnonzero(np.diff((column(topic, "id") != 0.0).astype(np.int8), prepend=0) > 0)
    return tuple(seconds(topic)[on].tolist())


def _moved(t: Array, topic: Topic, origin: Origin | None) -> tuple[Array, Array]:
    """Velocity and position (N, 3) at times t (N,)."""
    own, at = sampled(topic), columns(topic, "x", "y", "z")
    speed = columns(topic, "vx", "vy", "vz")
    zero = columns(topic, "ref_lat", "ref_lon", "ref_alt")
    known = np.flatnonzero(np.isfinite(zero).all(axis=1) & zero[:, :2].any(axis=1))
    if origin is not None and len(known):
        latitude, longitude, height = zero[known[0]]
        there = geodetic_from_ned(at, (np.radians(latitude), np.radians(longitude), height))
        at = ned_from_geodetic(
            there[:, 0], there[:, 1], there[:, 2], (origin.latitude, origin.longitude, origin.height)
        )
    keep = increasing(own, finite(at, speed))
    own, at, speed = own[keep], at[keep], speed[keep]
    if len(own) < 2:
        return np.full((len(t), 3), np.nan), np.full((len(t), 3), np.nan)
    i = np.clip(np.searchsorted(own, t) - 1, 0, len(own) - 2)
    h = (own[i + 1] - own[i])[:, None]
    u = (t[:, None] - own[i][:, None]) / h
    gap = (u < 0.0) | (u > 1.0) | (h > _GAP_S)
    velocity = speed[i] + u * (speed[i + 1] - speed[i])
    position = (
        (1 + 2 * u) * (1 - u) ** 2 * at[i] + u * (1 - u) ** 2 * h * speed[i]
        + u * u * (3 - 2 * u) * at[i + 1] + u * u * (u - 1) * h * speed[i + 1]
    )  # fmt: skip
    return np.where(gap, np.nan, velocity), np.where(gap, np.nan, position)
