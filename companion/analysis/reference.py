"""The autopilot's attitude, velocity and position at any time, where they cannot be known, and errors against them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from companion.model import Array, AttitudeTrack, PositionTrack
from companion.strapdown import quaternion


def attitude_error(q_ref: Array, q: Array) -> Array:
    """Rotation vector of q_ref ⊗ q⁻¹, (..., 3) NED, rad: x and y are the tilt error, z the heading error."""
    return quaternion.log(quaternion.multiply(q_ref, quaternion.conjugate(q)))


def length(vectors: Array) -> Array:
    """Euclidean length along the last axis: (..., 3) to (...)."""
    return np.asarray(np.linalg.norm(vectors, axis=-1))


BoolArray = npt.NDArray[np.bool_]

_BLOCK = 4096  # samples at a time


@dataclass(frozen=True, slots=True)
class Limits:
    """What makes a stretch of samples unusable. A stretch is left out and counted, never patched over."""

    gap_periods: float = 3.0  # a hole is longer than so many median sample periods ...
    gap_s: float = 0.1  # ... and longer than this, s
    position_jump_m: float = 1.0  # step that the velocity does not explain
    attitude_jump_deg: float = 5.0  # step that the body rates do not explain

    def hole(self, t: Array) -> float:
        """The longest sample interval, s, of a track with times t (N,) that is not a hole.

        Integrating across a hole is the largest false error there is: 1 s in a turn is 30° of attitude.
        """
        return max(self.gap_s, self.gap_periods * float(np.median(np.diff(t)))) if len(t) > 1 else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The autopilot's state at given times; meaningless where the matching `known` is False."""

    t: Array  # (N,) s
    q_ned_frd: Array  # (N, 4)
    velocity: Array  # (N, 3) NED m/s
    position: Array  # (N, 3) NED m
    attitude_known: BoolArray  # (N,)
    position_known: BoolArray  # (N,) position and velocity
    attitude_bend: Array  # (N,) rad, how far the attitude may be from the slerp between two samples


def reference_at(attitude: AttitudeTrack, position: PositionTrack | None, t: Array, limits: Limits) -> Reference:
    """The state at times t (N,): slerp for attitude, cubic Hermite (position and velocity) for position.

    Velocity is linear between samples. Nothing is extrapolated, nothing is known inside a hole (`Limits.hole`).
    Between two samples the body may have turned otherwise than at one rate: by a steady angular acceleration, which the
    rates at both ends tell, it is off by u (1 - u) h |Δω| / 2.
    Raises ValueError for an attitude track without samples.
    """
    if not len(attitude):
        raise ValueError("an attitude track needs a sample")
    count = len(t)
    if position is not None and not len(position):
        position = None
    out = Reference(
        t,
        np.empty((count, 4)),
        np.zeros((count, 3)),
        np.zeros((count, 3)),
        np.zeros(count, np.bool_),
        np.zeros(count, np.bool_),
        np.empty(count),
    )
    change = np.append(0.5 * np.diff(attitude.t) * length(np.diff(attitude.rates, axis=0)), 0.0)
    holes = limits.hole(attitude.t), limits.hole(position.t) if position is not None else 0.0
    for first in range(0, count, _BLOCK):  # what is made on the way stays in the processor's cache
        part = slice(first, first + _BLOCK)
        i, u, out.attitude_known[part] = _bracket(attitude.t, t[part], holes[0])
        after = attitude.q_ned_frd[np.minimum(i + 1, len(attitude) - 1)]
        out.q_ned_frd[part] = quaternion.slerp(attitude.q_ned_frd[i], after, u)
        out.attitude_bend[part] = u * (1 - u) * change[i]
        if position is not None:
            i, u, known = _bracket(position.t, t[part], holes[1])
            out.position_known[part] = known & out.attitude_known[part]
            out.velocity[part], out.position[part] = _between(position, i, u[:, None])
    return out


def _between(track: PositionTrack, i: npt.NDArray[np.intp], u: Array) -> tuple[Array, Array]:
    """Velocity and position (N, 3) at the parts u (N, 1) of the way from samples i (N,) to the next."""
    j = np.minimum(i + 1, len(track) - 1)
    h = (track.t[j] - track.t[i])[:, None]
    p0, p1, v0, v1 = track.position[i], track.position[j], track.velocity[i], track.velocity[j]
    # Hermite as a correction to the straight line, so that large coordinates lose no digits
    bend = u * (1 - u) * ((1 - u) * (h * v0 - (p1 - p0)) + u * ((p1 - p0) - h * v1))
    return v0 + u * (v1 - v0), p0 + u * (p1 - p0) + bend


def attitude_jumps(track: AttitudeTrack, limits: Limits) -> Array:
    """Steps of the attitude that the body rates do not explain, (J, 2): the times s of the samples on either side.

    Yaw resets, a restarted filter.
    Half of the turn that the rates predict and all of their change are allowed on top, because they are samples of a
    motion that goes on between them: a board turned by hand at 4 Hz is not a filter that jumps.
    """
    h = np.diff(track.t)[:, None]
    turn = 0.5 * (track.rates[1:] + track.rates[:-1]) * h
    predicted = quaternion.multiply(track.q_ned_frd[:-1], quaternion.exp(turn))
    step = length(attitude_error(track.q_ned_frd[1:], predicted))
    allowed = np.radians(limits.attitude_jump_deg) + 0.5 * length(turn) + length(np.diff(track.rates, axis=0) * h)
    return _intervals(track.t, step > allowed)


def position_jumps(track: PositionTrack, limits: Limits) -> Array:
    """Steps of the position that the velocity does not explain, (J, 2) as for attitude: GPS glitches, EKF resets.

    A quarter of what the change of velocity makes in the interval is allowed on top: at 2 Hz a manoeuvre between two
    messages moves the vehicle by more than the trapezoid says.
    """
    h = np.diff(track.t)[:, None]
    predicted = 0.5 * (track.velocity[1:] + track.velocity[:-1]) * h
    step = length(np.diff(track.position, axis=0) - predicted)
    allowed = limits.position_jump_m + 0.25 * length(np.diff(track.velocity, axis=0) * h)
    return _intervals(track.t, step > allowed)


def _intervals(t: Array, flags: BoolArray) -> Array:
    return np.column_stack([t[:-1][flags], t[1:][flags]])


def _bracket(samples: Array, t: Array, hole: float) -> tuple[npt.NDArray[np.intp], Array, BoolArray]:
    """Index of the sample before each t, the fraction of the way to the next, and whether there is no hole, s."""
    i = np.clip(np.searchsorted(samples, t, side="right") - 1, 0, max(len(samples) - 2, 0))
    h = samples[np.minimum(i + 1, len(samples) - 1)] - samples[i]
    u = np.clip((t - samples[i]) / np.where(h > 0, h, 1.0), 0.0, 1.0)
    inside = (t >= samples[0]) & (t <= samples[-1])
    return i, u, inside & (h <= hole)
