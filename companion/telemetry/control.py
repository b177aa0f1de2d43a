"""The controller's setpoints, and its outputs to the motors: ATTITUDE_TARGET, SERVO_OUTPUT_RAW and their like.

Also here: what a simulator knows of itself: the truth of a flight, for tests and benchmarks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from companion.mavlink import Messages
from companion.model import (
    ActuatorTrack,
    Array,
    AttitudeTrack,
    ControlTrack,
    Origin,
    PositionTrack,
    TruthTrack,
    from_euler,
)
from companion.telemetry.samples import BoolArray, attitudes, increasing, ned_about
from companion.telemetry.sources import SI

TRUTH_MESSAGES = {
    "SIM_STATE": ("vn ve vd", "lat_int lon_int alt"),  # `lat` and `lon` are degE7 too, cut to 24 bits
    "HIL_STATE_QUATERNION": ("vx vy vz", "lat lon alt"),
    "SIMSTATE": ("", "lat lng"),
}
"""The one that says most first → its velocity, NED, and its place."""


def message_truth(
    messages: Mapping[str, Messages], origin: Origin | None, track: PositionTrack | None
) -> TruthTrack | None:
    """The truth in a boot's messages, at their boot times; see `truth_track` for origin and track."""
    name = next((name for name in TRUTH_MESSAGES if name in messages), None)
    if name is None:
        return None
    truth = messages[name]
    velocity, place = (np.full((len(truth), 3), np.nan) for _ in range(2))
    for values, fields in zip((velocity, place), TRUTH_MESSAGES[name], strict=True):
        for i, field in enumerate(fields.split()):
            values[:, i] = truth[field] * SI[truth.layout.units[field]]
    if name == "SIM_STATE" and not place[:, 0].any():
        place[:] = np.nan
    if name == "HIL_STATE_QUATERNION":
        q = truth["attitude_quaternion"].astype(np.float64)
    else:
        q = from_euler(truth["roll"], truth["pitch"], truth["yaw"])
    return truth_track(name, truth.t, q, velocity, place, origin, track)


def truth_track(
    source: str, t: Array, q: Array, velocity: Array, place: Array, origin: Origin | None, track: PositionTrack | None
) -> TruthTrack | None:
    """A simulator's own poses at boot times t (N,) s, in any order; None without any.

    velocity: (N, 3) NED, m/s; place: (N, 3) latitude and longitude in rad, height in m; NaN where it is not sent. They
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


CONTROL_MESSAGES = ("ATTITUDE_TARGET", "NAV_CONTROLLER_OUTPUT", "SERVO_OUTPUT_RAW")

_NO_ATTITUDE = 128  # ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
_PORTS = (0, 1)  # SERVO_OUTPUT_RAW.port: outputs 1 to 16, and 17 to 32
_SERVOS = 16
_PULSES_US = (1000.0, 2000.0)  # where SERVOn_MIN and SERVOn_MAX are not in the log
_NO_PULSE = (0, 65535)
_TOGETHER_S, _STALE_S = 0.01, 1.0  # banks of outputs that are sent one after the other; and how long each holds
_MOTORS = frozenset({*range(33, 41), *range(82, 86), *range(160, 164)})  # SRV_Channel::Function, k_motor1 ...


def control_track(messages: Mapping[str, Messages], attitude: AttitudeTrack | None) -> ControlTrack | None:
    """The desired attitude: ATTITUDE_TARGET; else roll and pitch of NAV_CONTROLLER_OUTPUT with the present heading."""
    if (target := messages.get("ATTITUDE_TARGET")) is not None:
        q = target["q"].astype(np.float64)
        valid = (target["type_mask"] & _NO_ATTITUDE) == 0
    elif (target := messages.get("NAV_CONTROLLER_OUTPUT")) is not None and attitude is not None:
        w, x, y, z = (np.interp(target.t, attitude.t, part) for part in attitude.q_ned_frd.T)
        heading = np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
        q = from_euler(np.radians(target["nav_roll"]), np.radians(target["nav_pitch"]), heading)
        valid = (target.t >= attitude.t[0]) & (target.t <= attitude.t[-1])
    else:
        return None
    return control_of(target.name, target.t, q, valid)


def control_of(source: str, t: Array, q: Array, good: BoolArray | bool = True) -> ControlTrack | None:
    """Quaternions (N, 4) at times t (N,) s; None without any that is an attitude."""
    _, t, q = attitudes(t, q, good)
    return ControlTrack(t, q, source) if len(t) else None


def actuator_track(messages: Mapping[str, Messages], parameters: Mapping[str, float]) -> ActuatorTrack | None:
    """SERVO_OUTPUT_RAW; None where none of the outputs is in use."""
    if (outputs := messages.get("SERVO_OUTPUT_RAW")) is None:
        return None
    pulses = outputs.columns(*(f"servo{i}_raw" for i in range(1, _SERVOS + 1)))
    banks = []
    for port in _PORTS:
        keep = increasing(outputs.t, np.isfinite(outputs.t) & (outputs["port"] == port))
        banks.append((outputs.t[keep], pulses[keep]))
    return actuators_of(outputs.name, banks, parameters)


def _side_by_side(banks: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Times (N,) s and pulses (N, K) of the first bank of outputs, with those of the others as they were then.

    banks: times, increasing, and pulses of outputs that go on counting; those without a sample are left out where none
    follows. A pulse is NaN where its bank said nothing for a second.
    """
    t, columns = banks[0][0], [banks[0][1]]
    last = max((i for i, (when, _) in enumerate(banks) if len(when)), default=0)
    for when, pulses in banks[1 : last + 1]:
        shown = np.full((len(t), pulses.shape[1]), np.nan)
        if len(when):
            row = np.searchsorted(when, t + _TOGETHER_S, side="right") - 1
            known = (row >= 0) & (t - when[row] < _STALE_S)
            shown[known] = pulses[row[known]]
        columns.append(shown)
    return t, np.hstack(columns)


def actuators_of(
    source: str, banks: Sequence[tuple[Array, Array]], parameters: Mapping[str, float]
) -> ActuatorTrack | None:
    """ArduPilot's outputs 1 to K, of banks as of `_side_by_side`; None where none of them is in use."""
    t, pulses = _side_by_side(banks)
    return outputs_of(source, t, share_of_range(pulses, parameters))


def outputs_of(source: str, t: Array, share: Array) -> ActuatorTrack | None:
    """Outputs (N, K) as shares of their range at times t (N,) s; None where none of them is in use."""
    keep = increasing(t, np.isfinite(t) & np.isfinite(share).any(axis=1))
    return ActuatorTrack(t[keep], share[keep], source) if len(t[keep]) else None


def share_of_range(pulses: Array, parameters: Mapping[str, float]) -> Array:
    """ArduPilot's outputs 1 to K, µs (N, K), as a share of the range of each, 0 to 1; NaN for those not in use."""
    outputs = range(1, pulses.shape[1] + 1)
    limits = np.array([_limits(i, parameters) for i in outputs]).reshape(-1, 2)
    share = np.clip((pulses - limits[:, 0]) / (limits[:, 1] - limits[:, 0]), 0.0, 1.0)
    # Beyond the sixteenth there are parameters only where SERVO_32_ENABLE is set; ArduPilot logs 1000 µs without.
    absent = 0.0 if f"SERVO{_SERVOS}_FUNCTION" in parameters else None
    unused = [parameters.get(f"SERVO{i}_FUNCTION", None if i <= _SERVOS else absent) == 0 for i in outputs]
    return np.where(np.isin(pulses, _NO_PULSE) | np.array(unused, np.bool_), np.nan, share)


def _limits(number: int, parameters: Mapping[str, float]) -> tuple[float, float]:
    """µs at 0 and at 1: of a motor MOT_PWM_MIN and MOT_PWM_MAX, of a servo its own."""
    names = [(f"SERVO{number}_MIN", f"SERVO{number}_MAX")]
    if parameters.get(f"SERVO{number}_FUNCTION") in _MOTORS:
        names.insert(0, ("MOT_PWM_MIN", "MOT_PWM_MAX"))
    for low, high in names:
        ends = parameters.get(low, 0.0), parameters.get(high, 0.0)
        if 0 < ends[0] < ends[1] < _NO_PULSE[1]:  # which is not so with NaN either
            return ends
    return _PULSES_US
