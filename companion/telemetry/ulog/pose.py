"""PX4's own attitude, position, origin and home in a ULog. Source: PX4 `msg/VehicleLocalPosition.msg`."""

from __future__ import annotations

import numpy as np

from companion.model import Array, AttitudeTrack, Epoch, Origin, PositionTrack, interpolated
from companion.telemetry.clock import epoch_of
from companion.telemetry.convert import continuous, increasing
from companion.telemetry.outliers import lone, lone_turns, uncontradicted
from companion.telemetry.ulog.topics import Topics, columns, sampled, seconds, xyz


def attitude_track(topics: Topics, notes: list[str]) -> AttitudeTrack | None:
    """vehicle_attitude, with the bias-corrected rates of vehicle_angular_velocity (before PX4 1.11 its own).

    Where neither is logged the attitude itself tells how it turns. What is left out is added to the notes.
    """
    if "vehicle_attitude" not in topics:
        return None
    topic = topics["vehicle_attitude"]
    t = sampled(topic)
    q = columns(topic, *(f"q[{i}]" for i in range(4)))
    keep = increasing(t, np.isfinite(q).all(axis=1) & (np.abs(np.linalg.norm(q, axis=1) - 1.0) < 0.1))
    t, q = t[keep], continuous(q[keep])
    body, rates = topics.get("vehicle_angular_velocity"), None
    if body is not None:
        turned = xyz(body, "xyz")
        rates = np.nan_to_num(interpolated(t, sampled(body), turned))
    elif "rollspeed" in topic:
        rates = np.nan_to_num(columns(topic, "rollspeed", "pitchspeed", "yawspeed")[keep])
    kept = uncontradicted("vehicle_attitude", notes, lone_turns(t, q, rates))
    if not kept.all():
        t, q, rates = t[kept], continuous(q[kept]), None if rates is None else rates[kept]
    if len(t) < 2:
        return None
    return AttitudeTrack(t, q, _turning(t, q) if rates is None else rates, "vehicle_attitude")


def _turning(t: Array, q: Array) -> Array:
    """Body rates (N, 3) between attitudes q (N, 4) of about unit length at times t (N,), interpolated to t."""
    a, b = q[:-1], q[1:]
    w = np.einsum("ij,ij->i", a, b)
    v = a[:, :1] * b[:, 1:] - b[:, :1] * a[:, 1:] - np.cross(a[:, 1:], b[:, 1:])
    size = np.linalg.norm(v, axis=1)
    angle = 2.0 * np.arctan2(size, np.abs(w)) * np.where(w < 0.0, -1.0, 1.0)
    rate = v * (angle / np.where(size > 0.0, size, 1.0) / np.diff(t))[:, None]
    return interpolated(t, 0.5 * (t[1:] + t[:-1]), rate)


def position_track(topics: Topics, notes: list[str]) -> PositionTrack | None:
    """vehicle_local_position where it calls itself valid. What is left out is added to the notes."""
    if "vehicle_local_position" not in topics:
        return None
    topic = topics["vehicle_local_position"]
    t = sampled(topic)
    position, velocity = columns(topic, "x", "y", "z"), columns(topic, "vx", "vy", "vz")
    valid = np.asarray(np.isfinite(np.column_stack([position, velocity])).all(axis=1))
    for flag in ("xy_valid", "z_valid", "v_xy_valid", "v_z_valid"):
        valid &= np.asarray(topic[flag], np.bool_)
    keep = increasing(t, valid)
    t, position, velocity = t[keep], position[keep], velocity[keep]
    kept = uncontradicted("vehicle_local_position", notes, lone(position), lone(velocity))
    track = PositionTrack(t[kept], position[kept], velocity[kept], "vehicle_local_position")
    return track if len(track) > 1 else None


def origin(topics: Topics) -> Origin | None:
    """The reference point of vehicle_local_position, where it says that it is global."""
    topic = topics.get("vehicle_local_position", {})
    known = np.flatnonzero(np.asarray(topic.get("xy_global", ())))
    if not len(known):
        return None
    latitude, longitude, height = (float(topic[name][known[0]]) for name in ("ref_lat", "ref_lon", "ref_alt"))
    return Origin(float(np.radians(latitude)), float(np.radians(longitude)), height)


def home(topics: Topics) -> Origin | None:
    """The last home_position that calls itself valid."""
    topic = topics.get("home_position", {})
    known = np.flatnonzero(np.asarray(topic.get("valid_hpos", ())))
    if not len(known):
        return None
    latitude, longitude, height = (float(topic[name][known[-1]]) for name in ("lat", "lon", "alt"))
    return Origin(float(np.radians(latitude)), float(np.radians(longitude)), height)


def epoch(topics: Topics) -> Epoch | None:
    """By the receiver's UTC; zero where it does not know it yet."""
    for name in ("vehicle_gps_position", "sensor_gps"):
        if name in topics and "time_utc_usec" in topics[name]:
            return epoch_of(seconds(topics[name], "time_utc_usec"), seconds(topics[name], "timestamp"), "GPS")
    return None
