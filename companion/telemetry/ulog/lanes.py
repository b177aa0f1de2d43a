"""Every instance of PX4's EKF2 in a ULog as a lane of its own, and which of them flew.

Sources: PX4 `msg/EstimatorStates.msg`, `msg/EstimatorSensorBias.msg`, `src/modules/ekf2/EKF2Selector.cpp`.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from companion.model import Array, EstimatorLane, Origin, SensorInUse
from companion.telemetry.samples import attitudes, in_use, ned_about
from companion.telemetry.ulog.estimator import commonest_gyro
from companion.telemetry.ulog.topics import Topic, Topics, instances, sampled

_SELECTOR = "estimator_selector_status"
_LONGEST_WAIT_S = 0.3  # from a position to the attitude beside it: a log has an instance's states at 2 Hz or more


def lane_in_use(topics: Topics) -> SensorInUse | None:
    """The instance that flew, from each change on; None where the log has no selector."""
    topic = topics.get(_SELECTOR)
    if topic is None or "primary_instance" not in topic:
        return None
    instance = np.asarray(topic["primary_instance"]).astype(np.int64)
    return in_use(_SELECTOR, topic.seconds(), instance, instance < 255)  # INVALID_INSTANCE


def lanes(topics: Topics, origin: Origin | None, by_device: Mapping[int, int]) -> tuple[EstimatorLane, ...]:
    """By estimator_attitude and estimator_local_position; where these are not there by estimator_states."""
    moved = {instance: topic for instance, _, topic in instances(topics, "estimator_local_position")}
    gyros = {
        instance: by_device.get(commonest_gyro(topic))
        for instance, _, topic in instances(topics, "estimator_sensor_bias")
        if "gyro_device_id" in topic
    }
    made = []
    for instance, name, topic in [*instances(topics, "estimator_attitude")] or [*instances(topics, "estimator_states")]:
        states = name.startswith("estimator_states")
        q = topic.array("states" if states else "q", range(4))
        _, t, q = attitudes(sampled(topic), q)
        velocity, position = _states(t, topic) if states else _moved(t, moved.get(instance), origin)
        named = f"EKF2 instance {instance}"
        made.append(EstimatorLane(t, q, velocity, position, named, instance, name, gyros.get(instance)))
    return tuple(lane for lane in made if len(lane) > 1)


def _states(t: Array, topic: Topic) -> tuple[Array, Array]:
    """Velocity and position (N, 3) of the state vector, about the origin of the EKF."""
    own = sampled(topic)
    row = np.clip(np.searchsorted(own, t), 0, len(own) - 1)
    return topic.array("states", range(4, 7))[row], topic.array("states", range(7, 10))[row]


def _moved(t: Array, topic: Topic | None, origin: Origin | None) -> tuple[Array, Array]:
    """Velocity and position (N, 3) at times t (N,), interpolated where they are valid; else NaN.

    Each instance has an origin of its own: positions are moved to the flight's.
    """
    unknown = np.full((len(t), 3), np.nan)
    if topic is None or topic.count < 2 or not len(t):
        return unknown, unknown
    own, columns = sampled(topic), topic.columns("vx", "vy", "vz", "x", "y", "z")
    valid = np.logical_and.reduce([topic.flag(name) for name in ("xy_valid", "z_valid", "v_xy_valid", "v_z_valid")])
    columns = np.where(valid[:, None], columns, np.nan)
    if origin is not None and "xy_global" in topic and len(known := np.flatnonzero(topic["xy_global"])):
        latitude, longitude, height = (topic[f"ref_{name}"][known[-1:]].astype(np.float64) for name in _PLACE)
        columns[:, 3:] += ned_about(origin, np.radians(latitude), np.radians(longitude), height)
    row = np.clip(np.searchsorted(own, t), 1, len(own) - 1)
    before = t - own[row - 1]
    share = before / np.maximum(own[row] - own[row - 1], 1e-9)
    near = (share >= 0.0) & (share <= 1.0) & (own[row] - own[row - 1] < 2.0 * _LONGEST_WAIT_S)
    at = columns[row - 1] + share[:, None] * (columns[row] - columns[row - 1])
    at[~near] = np.nan
    return at[:, :3], at[:, 3:]


_PLACE = ("lat", "lon", "alt")
