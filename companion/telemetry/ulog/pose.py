"""PX4's own attitude, position, origin and home in a ULog. Source: PX4 `msg/VehicleLocalPosition.msg`."""

from __future__ import annotations

import numpy as np

from companion.model import AttitudeTrack, Epoch, Origin, PositionTrack, interpolated
from companion.telemetry import samples
from companion.telemetry.clock import epoch_of
from companion.telemetry.samples import attitudes
from companion.telemetry.ulog.topics import Topic, Topics, columns, flag, sampled, seconds, xyz


def attitude_track(topics: Topics, notes: list[str]) -> AttitudeTrack | None:
    """vehicle_attitude, with the bias-corrected rates of vehicle_angular_velocity (before PX4 1.11 its own).

    Where neither is logged the attitude itself tells how it turns. What is left out is added to the notes.
    """
    if "vehicle_attitude" not in topics:
        return None
    topic = topics["vehicle_attitude"]
    t = sampled(topic)
    q = columns(topic, *(f"q[{i}]" for i in range(4)))
    keep, t, q = attitudes(t, q)
    body, rates = topics.get("vehicle_angular_velocity"), None
    if body is not None:
        rates = np.nan_to_num(interpolated(t, sampled(body), xyz(body, "xyz")))
    elif "rollspeed" in topic:
        rates = np.nan_to_num(columns(topic, "rollspeed", "pitchspeed", "yawspeed")[keep])
    return samples.attitude_track("vehicle_attitude", t, q, rates, notes)


def position_track(topics: Topics, notes: list[str]) -> PositionTrack | None:
    """vehicle_local_position where it calls itself valid. What is left out is added to the notes."""
    if "vehicle_local_position" not in topics:
        return None
    topic = topics["vehicle_local_position"]
    t = sampled(topic)
    position, velocity = columns(topic, "x", "y", "z"), columns(topic, "vx", "vy", "vz")
    valid = np.logical_and.reduce([flag(topic, name) for name in ("xy_valid", "z_valid", "v_xy_valid", "v_z_valid")])
    return samples.position_track("vehicle_local_position", t, position, velocity, valid, notes)


def origin(topics: Topics) -> Origin | None:
    """The reference point of vehicle_local_position, where it says that it is global."""
    return _place(topics.get("vehicle_local_position", {}), "xy_global", ("ref_lat", "ref_lon", "ref_alt"), 0)


def home(topics: Topics) -> Origin | None:
    """The last home_position that calls itself valid."""
    return _place(topics.get("home_position", {}), "valid_hpos", ("lat", "lon", "alt"), -1)


def _place(topic: Topic, valid: str, names: tuple[str, str, str], which: int) -> Origin | None:
    """One of the rows that are valid."""
    known = np.flatnonzero(np.asarray(topic.get(valid, ())))
    return samples.place(*(float(topic[name][known[which]]) for name in names)) if len(known) else None


def epoch(topics: Topics) -> Epoch | None:
    """By the receiver's UTC; zero where it does not know it yet."""
    for name in ("vehicle_gps_position", "sensor_gps"):
        if name in topics and "time_utc_usec" in topics[name]:
            return epoch_of(seconds(topics[name], "time_utc_usec"), seconds(topics[name], "timestamp"), "GPS")
    return None
