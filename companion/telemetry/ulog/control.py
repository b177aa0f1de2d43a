"""What PX4's controllers want of the vehicle, and what they ask of the motors."""

from __future__ import annotations

import numpy as np

from companion.model import ActuatorTrack, Array, ControlTrack, from_euler
from companion.telemetry.control import control_of
from companion.telemetry.samples import increasing
from companion.telemetry.ulog.topics import Topic, Topics, finite, instances, sampled

_MOST_OUTPUTS = 16
_PULSE = (1000.0, 2000.0)  # µs, of PWM and, in the same numbers, of PX4's simulators
_PULSE_MOST = 2200.0
_ESC_MOST = 8191.0  # of UAVCAN's esc.RawCommand


def control_track(topics: Topics) -> ControlTrack | None:
    """vehicle_attitude_setpoint; where it has no quaternion (before PX4 1.9 not always) by its Euler angles."""
    if "vehicle_attitude_setpoint" not in topics:
        return None
    topic = topics["vehicle_attitude_setpoint"]
    t, q = topic.seconds(), topic.array("q_d", range(4))
    angles = topic.columns("roll_body", "pitch_body", "yaw_body")
    told = np.asarray(np.abs(np.linalg.norm(np.nan_to_num(q), axis=1) - 1.0) < 0.1) & topic.flag("q_d_valid")
    by_angles = np.logical_and(~told, finite(angles))
    q[by_angles] = from_euler(*angles[by_angles].T)
    return control_of("vehicle_attitude_setpoint", t, q, np.logical_or(told, by_angles))


def actuator_track(topics: Topics) -> ActuatorTrack | None:
    """actuator_motors, else of the instances of actuator_outputs the one with the most outputs that move."""
    if "actuator_motors" in topics:
        topic = topics["actuator_motors"]
        output = np.clip(topic.array("control", range(12)), 0.0, 1.0)
        if np.isfinite(output).any():
            return _track("actuator_motors", sampled(topic), output)
    outputs = [(name, topic, _outputs(topic)) for _, name, topic in instances(topics, "actuator_outputs")]
    outputs = [one for one in outputs if one[2].shape[1]]
    if not outputs:
        return None
    name, topic, output = max(outputs, key=lambda one: int((np.nanstd(one[2], axis=0) > 0.0).sum()))
    return _track(name, topic.seconds(), output)


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


def _track(source: str, t: Array, output: Array) -> ActuatorTrack | None:
    keep = increasing(t, np.asarray(np.isfinite(output).any(axis=1)))
    return ActuatorTrack(t[keep], output[keep], source) if len(t[keep]) else None
