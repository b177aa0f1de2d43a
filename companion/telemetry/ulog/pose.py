"""PX4's own attitude, position, origin and home in a ULog, a simulator's truth, and the controllers' demands.

Also every instance of EKF2 as a lane of its own. Sources: PX4 `msg/VehicleLocalPosition.msg`,
`msg/EstimatorStates.msg`, `msg/EstimatorSensorBias.msg`.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from companion.model import (
    ActuatorTrack,
    Array,
    AttitudeTrack,
    ControlTrack,
    Epoch,
    EstimatorLane,
    Origin,
    PositionTrack,
    TruthTrack,
    from_euler,
    geodetic_from_ned,
    interpolated,
)
from companion.telemetry import samples
from companion.telemetry.clock import epoch_of
from companion.telemetry.control import control_of, outputs_of
from companion.telemetry.samples import BoolArray, attitudes, finite_rows, increasing, ned_about
from companion.telemetry.ulog.topics import Topic, Topics, commonest_device, instances, sampled

_MOST_OUTPUTS = 16
_PULSE = (1000.0, 2000.0)  # µs, of PWM and, in the same numbers, of PX4's simulators
_PULSE_MOST = 2200.0
_ESC_MOST = 8191.0  # of UAVCAN's esc.RawCommand


def control_track(topics: Topics) -> ControlTrack | None:
    """vehicle_attitude_setpoint; where it has no quaternion (before PX4 1.9 not always) by its Euler angles."""
    if (topic := topics.get("vehicle_attitude_setpoint")) is None:
        return None
    t, q = topic.seconds(), topic.array("q_d", range(4))
    angles = topic.columns("roll_body", "pitch_body", "yaw_body")
    valid = np.asarray(np.abs(np.linalg.norm(np.nan_to_num(q), axis=1) - 1.0) < 0.1) & topic.flag("q_d_valid")
    by_angles = np.logical_and(~valid, finite_rows(angles))
    q[by_angles] = from_euler(*angles[by_angles].T)
    return control_of("vehicle_attitude_setpoint", t, q, np.logical_or(valid, by_angles))


def actuator_track(topics: Topics) -> ActuatorTrack | None:
    """actuator_motors, else of the instances of actuator_outputs the one with the most outputs that move."""
    if (topic := topics.get("actuator_motors")) is not None:
        output = np.clip(topic.array("control", range(12)), 0.0, 1.0)
        if np.isfinite(output).any():
            return outputs_of("actuator_motors", sampled(topic), output)
    outputs = [(name, topic, _outputs(topic)) for _, name, topic in instances(topics, "actuator_outputs")]
    outputs = [one for one in outputs if one[2].shape[1]]
    if not outputs:
        return None
    name, topic, output = max(outputs, key=lambda one: int((np.nanstd(one[2], axis=0) > 0.0).sum()))
    return outputs_of(name, topic.seconds(), output)


def _outputs(topic: Topic) -> Array:
    """Pulses in µs, an ESC's counts or shares, as shares (N, K) of the range; NaN where an output is off."""
    used = int(np.nanmax(topic.columns("noutputs"), initial=_MOST_OUTPUTS if "noutputs" not in topic else 0.0))
    raw = topic.array("output", range(min(used, _MOST_OUTPUTS)))
    raw = raw[:, np.isfinite(raw).any(axis=0) & np.nan_to_num(raw).any(axis=0)]
    most = float(np.nanmax(raw, initial=0.0))
    if most <= 1.0:
        return np.asarray(np.clip(raw, 0.0, 1.0))
    if most > _PULSE_MOST:
        return np.asarray(np.clip(raw / _ESC_MOST, 0.0, 1.0))
    low, high = _PULSE
    raw[raw <= 0.0] = np.nan
    return np.asarray(np.clip((raw - low) / (high - low), 0.0, 1.0))


def attitude_track(topics: Topics, notes: list[str]) -> AttitudeTrack | None:
    """vehicle_attitude, with the bias-corrected rates of vehicle_angular_velocity (before PX4 1.11 its own).

    Where neither is logged the attitude itself tells how it turns. What is left out is added to the notes.
    """
    if (topic := topics.get("vehicle_attitude")) is None:
        return None
    keep, t, q = attitudes(sampled(topic), topic.array("q", range(4)))
    body, rates = topics.get("vehicle_angular_velocity"), None
    if body is not None:
        rates = np.nan_to_num(interpolated(t, sampled(body), body.array("xyz")))
    elif "rollspeed" in topic:
        rates = np.nan_to_num(topic.columns("rollspeed", "pitchspeed", "yawspeed")[keep])
    return samples.attitude_track("vehicle_attitude", t, q, rates, notes)


def position_track(topics: Topics, notes: list[str]) -> PositionTrack | None:
    """vehicle_local_position where it calls itself valid. What is left out is added to the notes."""
    if (topic := topics.get("vehicle_local_position")) is None:
        return None
    position, velocity = topic.columns("x", "y", "z"), topic.columns("vx", "vy", "vz")
    good = _is_valid(topic)
    return samples.position_track("vehicle_local_position", sampled(topic), position, velocity, good, notes)


def _is_valid(topic: Topic) -> BoolArray:
    """(N,) whether a local position calls all of itself valid."""
    flags = [topic.flag(name) for name in ("xy_valid", "z_valid", "v_xy_valid", "v_z_valid")]
    return np.asarray(np.logical_and.reduce(flags))


def origin(topics: Topics) -> Origin | None:
    """The reference point of vehicle_local_position, where it says that it is global."""
    return _place(topics.get("vehicle_local_position"), "xy_global", ("ref_lat", "ref_lon", "ref_alt"), 0)


def home(topics: Topics) -> Origin | None:
    """The last home_position that calls itself valid."""
    return _place(topics.get("home_position"), "valid_hpos", ("lat", "lon", "alt"), -1)


def _place(topic: Topic | None, valid: str, names: tuple[str, str, str], which: int) -> Origin | None:
    """One of the rows that are valid."""
    known = [] if topic is None or valid not in topic else np.flatnonzero(topic[valid]).tolist()
    return samples.place(*(float(topic[name][known[which]]) for name in names)) if known and topic is not None else None


def epoch(topics: Topics) -> Epoch | None:
    """By the receiver's UTC; zero where it does not know it yet."""
    for name in ("vehicle_gps_position", "sensor_gps"):
        if name in topics and "time_utc_usec" in topics[name]:
            return epoch_of(topics[name].seconds("time_utc_usec"), topics[name].seconds("timestamp"), "GPS")
    return None


_GAP_S = 0.2  # across a longer one the truth is not interpolated


def truth(topics: Topics, origin: Origin | None) -> TruthTrack | None:
    """The simulator's attitude, with its velocity and position interpolated to the attitude's times.

    Position by the cubic of position and velocity, about `origin` where both know their place on Earth; NaN where the
    log does not tell it.
    """
    if (topic := topics.get("vehicle_attitude_groundtruth")) is None:
        return None
    _, t, q = attitudes(sampled(topic), topic.array("q", range(4)))
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
    on = np.flatnonzero(np.diff((topic.column("id") != 0.0).astype(np.int8), prepend=0) > 0)
    return tuple(topic.seconds()[on].tolist())


def _moved(t: Array, topic: Topic, origin: Origin | None) -> tuple[Array, Array]:
    """Velocity and position (N, 3) at times t (N,)."""
    own, at = sampled(topic), topic.columns("x", "y", "z")
    speed = topic.columns("vx", "vy", "vz")
    zero = topic.columns("ref_lat", "ref_lon", "ref_alt")
    known = np.flatnonzero(np.isfinite(zero).all(axis=1) & zero[:, :2].any(axis=1))
    if origin is not None and len(known):
        latitude, longitude, height = zero[known[0]]
        there = geodetic_from_ned(at, (np.radians(latitude), np.radians(longitude), height))
        at = samples.ned_about(origin, *there.T)
    keep = increasing(own, finite_rows(at, speed))
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


_LANE_WAIT_S = 0.3  # from a position to the attitude beside it: a log has an instance's states at 2 Hz or more


def lanes(topics: Topics, origin: Origin | None, by_device: Mapping[int, int]) -> tuple[EstimatorLane, ...]:
    """By estimator_attitude and estimator_local_position; where these are not there by estimator_states."""
    moved = {instance: topic for instance, _, topic in instances(topics, "estimator_local_position")}
    gyros = {
        instance: by_device.get(commonest_device(topic, "gyro_device_id"))
        for instance, _, topic in instances(topics, "estimator_sensor_bias")
        if "gyro_device_id" in topic
    }
    made = []
    for instance, name, topic in [*instances(topics, "estimator_attitude")] or [*instances(topics, "estimator_states")]:
        states = name.startswith("estimator_states")
        q = topic.array("states" if states else "q", range(4))
        _, t, q = attitudes(sampled(topic), q)
        velocity, position = _states(t, topic, origin) if states else _lane_moved(t, moved.get(instance), origin)
        named = f"EKF2 instance {instance}"
        made.append(EstimatorLane(t, q, velocity, position, named, instance, name, gyros.get(instance)))
    return tuple(lane for lane in made if len(lane) > 1)


def _states(t: Array, topic: Topic, origin: Origin | None) -> tuple[Array, Array]:
    """Velocity and position (N, 3) of the state vector, about the origin of the EKF.

    Since PX4 1.16 its position is 0, 0 and minus the height above the sea (Ekf::predictState, `_state.pos(2) =
    -_gpos.altitude()`): north and east are not logged, and down is known where that of the origin is.
    """
    own = sampled(topic)
    row = np.clip(np.searchsorted(own, t), 0, len(own) - 1)
    position = topic.array("states", range(7, 10))[row]
    if not position[:, :2].any():
        position[:, :2] = np.nan
        position[:, 2] += np.nan if origin is None else origin.height
    return topic.array("states", range(4, 7))[row], position


def _lane_moved(t: Array, topic: Topic | None, origin: Origin | None) -> tuple[Array, Array]:
    """Velocity and position (N, 3) at times t (N,), interpolated where they are valid; else NaN.

    Each instance has an origin of its own: positions are moved to the flight's.
    """
    unknown = np.full((len(t), 3), np.nan)
    if topic is None or len(topic) < 2 or not len(t):
        return unknown, unknown
    own, columns = sampled(topic), topic.columns("vx", "vy", "vz", "x", "y", "z")
    columns = np.where(_is_valid(topic)[:, None], columns, np.nan)
    if origin is not None and "xy_global" in topic and len(known := np.flatnonzero(topic["xy_global"])):
        latitude, longitude, height = (topic[f"ref_{name}"][known[-1:]].astype(np.float64) for name in _PLACE)
        columns[:, 3:] += ned_about(origin, np.radians(latitude), np.radians(longitude), height)
    row = np.clip(np.searchsorted(own, t), 1, len(own) - 1)
    before = t - own[row - 1]
    share = before / np.maximum(own[row] - own[row - 1], 1e-9)
    near = (share >= 0.0) & (share <= 1.0) & (own[row] - own[row - 1] < 2.0 * _LANE_WAIT_S)
    at = columns[row - 1] + share[:, None] * (columns[row] - columns[row - 1])
    at[~near] = np.nan
    return at[:, :3], at[:, 3:]


_PLACE = ("lat", "lon", "alt")
