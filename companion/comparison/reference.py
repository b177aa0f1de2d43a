"""The autopilot's attitude, velocity and position at any time, where they cannot be known, and errors against them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from functools import cached_property, partial

import numpy as np

from companion.constants import num
from companion.model import (
    GAP_PERIODS,
    GAP_S,
    Array,
    AttitudeTrack,
    BoolArray,
    DataError,
    IntArray,
    PositionTrack,
    check_number,
    longest_step,
    nearest,
)
from companion.strapdown import Preintegration, bend, quaternion


def attitude_error(q_ref: Array, q: Array) -> Array:
    """Rotation vector of q_ref ⊗ q⁻¹, (..., 3) NED, rad: x and y are the tilt error, z the heading error."""
    return quaternion.log(quaternion.multiply(q_ref, quaternion.conjugate(q)))


def length(vectors: Array) -> Array:
    """Euclidean length along the last axis: (..., 3) to (...)."""
    return np.asarray(np.linalg.norm(vectors, axis=-1))


def wrapped(angle: Array) -> Array:
    """The same angles, rad, in -π..π."""
    return np.asarray(np.mod(angle + np.pi, 2.0 * np.pi) - np.pi)


def within(t: Array, span: tuple[float, float]) -> BoolArray:
    """(N,) which times (N,) are not before the first and not after the last of a span, s."""
    return np.asarray((t >= span[0]) & (t <= span[1]))


def within_any(t: Array, spans: Iterable[tuple[float, float]]) -> BoolArray:
    """(N,) which are in any of some spans."""
    return np.asarray(sum((within(t, span) for span in spans), np.zeros(len(t), np.bool_)))


def window(t: Array, start: float, stop: float) -> slice:
    """The samples at times t (N,) from one time on and before another, s."""
    first, last = np.searchsorted(t, [start, stop])
    return slice(int(first), int(last))


def block_means(block: IntArray, values: Array) -> Array:
    """(B, n) means of values (N, n) over the blocks (N,) that they are in; zero of one without any."""
    sums = np.column_stack([np.bincount(block, column) for column in values.T])
    return np.asarray(sums / np.maximum(np.bincount(block), 1)[:, None])


@dataclass(frozen=True, slots=True)
class Limits:
    """What makes a stretch of samples unusable. A stretch is left out and counted, never patched over.

    Raises SettingsError for what is no number, 0 or more.
    """

    gap_periods: float = GAP_PERIODS
    gap_s: float = GAP_S
    position_jump_m: float = 1.0  # step that the velocity does not explain
    attitude_jump_deg: float = 5.0  # step that the body rates do not explain

    def __post_init__(self) -> None:
        for limit in fields(self):
            check_number(limit.name, getattr(self, limit.name), least=0.0)

    def longest_step(self, t: Array) -> float:
        """The longest sample interval, s, of a track with times t (N,) that is not a gap."""
        return longest_step(t, self.gap_periods, self.gap_s)


@dataclass(frozen=True, slots=True, eq=False)
class States:
    """The autopilot's state at N samples."""

    q_ned_frd: Array  # (N, 4)
    velocity: Array  # (N, 3) NED m/s
    position: Array  # (N, 3) NED m

    def rows(self, index: IntArray) -> States:
        """Some of them."""
        return States(self.q_ned_frd[index], self.velocity[index], self.position[index])


@dataclass(frozen=True, slots=True, eq=False)
class InterpolationError:
    """1σ per axis of N states that lie between two samples of the autopilot; zero at a sample."""

    attitude: Array  # (N,) rad
    velocity: Array  # (N,) m/s
    position: Array  # (N,) m


@dataclass(frozen=True, eq=False)  # without slots: the states at all times are kept
class Reference:
    """The autopilot's state at given times; meaningless where the matching `known` is False.

    Where a few samples are wanted, as the ends of windows, `at` spares the rest.
    """

    t: Array  # (N,) s
    attitude_known: BoolArray  # (N,)
    position_known: BoolArray  # (N,) position and velocity
    at: Callable[[IntArray], States]  # the states at some of the times, by their index
    interpolation_error: Callable[[IntArray, Preintegration], InterpolationError]
    """Of the states at some of the times, by their index, beside the motion that an IMU felt meanwhile."""

    @property
    def has_position(self) -> bool:
        """Whether the position is known anywhere."""
        return bool(self.position_known.any())

    @property
    def known(self) -> BoolArray:
        """(N,) all that is compared: the position too, where it is known anywhere."""
        return self.position_known if self.has_position else self.attitude_known

    @property
    def q_ned_frd(self) -> Array:
        """(N, 4)"""
        return self._all.q_ned_frd

    @property
    def velocity(self) -> Array:
        """(N, 3) NED m/s"""
        return self._all.velocity

    @property
    def position(self) -> Array:
        """(N, 3) NED m"""
        return self._all.position

    @cached_property
    def _all(self) -> States:
        return self.at(np.arange(len(self.t)))


def reference_at(attitude: AttitudeTrack, position: PositionTrack | None, t: Array, limits: Limits) -> Reference:
    """The state at times t (N,): slerp for attitude, cubic Hermite (position and velocity) for position.

    Velocity is linear between samples. Nothing is extrapolated, nothing is known inside a gap (`Limits.longest_step`).
    Raises DataError for an attitude track without samples.
    """
    if not len(attitude):
        raise DataError("an attitude track needs a sample")
    position = position if position is not None and len(position) else None
    attitude_known = known_at(attitude.t, t, limits.longest_step(attitude.t))
    position_known = np.zeros(len(t), np.bool_)
    if position is not None:
        position_known = attitude_known & known_at(position.t, t, limits.longest_step(position.t))
    states, error = partial(_states, attitude, position, t), partial(_interpolation_error, attitude, position, t)
    return Reference(t, attitude_known, position_known, states, error)


def _states(attitude: AttitudeTrack, position: PositionTrack | None, t: Array, index: IntArray) -> States:
    count = len(index)
    out = States(np.empty((count, 4)), np.zeros((count, 3)), np.zeros((count, 3)))
    for first in range(0, count, num.SAMPLES_AT_ONCE):  # what is made on the way stays in the processor's cache
        part = slice(first, first + num.SAMPLES_AT_ONCE)
        when = t[index[part]]
        i, u = _bracket(attitude.t, when)
        j = np.minimum(i + 1, len(attitude) - 1)
        out.q_ned_frd[part] = quaternion.slerp(attitude.q_ned_frd[i], attitude.q_ned_frd[j], u)
        if position is not None:
            i, u = _bracket(position.t, when)
            out.velocity[part], out.position[part] = _between(position, i, u[:, None])
    return out


def _between(track: PositionTrack, i: IntArray, u: Array) -> tuple[Array, Array]:
    """Velocity and position (N, 3) at the parts u (N, 1) of the way from samples i (N,) to the next."""
    j = np.minimum(i + 1, len(track) - 1)
    h = (track.t[j] - track.t[i])[:, None]
    p0, p1, v0, v1 = track.position[i], track.position[j], track.velocity[i], track.velocity[j]
    return v0 + u * (v1 - v0), p0 + u * (p1 - p0) + bend(p1 - p0, h * v0, h * v1, u)


def _interpolation_error(
    attitude: AttitudeTrack, position: PositionTrack | None, t: Array, index: IntArray, path: Preintegration
) -> InterpolationError:
    """What the motion between two samples of the autopilot makes of the states at times t (N,).

    By the attitude's own rates, where a steady angular acceleration makes u (1 - u) h |Δω| / 2, and by what the IMU
    felt meanwhile: how far its path is from one that is interpolated as the autopilot's is, from its own states at the
    same two times. A constant error of the IMU cancels there.
    """
    when = t[index]
    i, u = _bracket(attitude.t, when)
    j = np.minimum(i + 1, len(attitude) - 1)
    change = (attitude.t[j] - attitude.t[i]) * length(attitude.rates[j] - attitude.rates[i])
    bend = 0.5 * u * (1 - u) * change
    strayed, _, _ = _between_samples(attitude.t, path, when)
    nothing = np.zeros(len(when))
    _, speed, place = (nothing,) * 3 if position is None else _between_samples(position.t, path, when)
    return InterpolationError(np.maximum(bend, strayed), speed, place)


def _between_samples(samples: Array, path: Preintegration, when: Array) -> tuple[Array, Array, Array]:
    """How far an IMU's own path is, at times (N,), from what interpolates it between the autopilot's samples.

    rad, m/s, m. Lengths alone are the same in every frame, and gravity is interpolated exactly.
    """
    i, _ = _bracket(samples, when)
    a, b = (nearest(path.t, samples[np.minimum(k, len(samples) - 1)]) for k in (i, i + 1))
    k = np.clip(nearest(path.t, when), a, b)
    h = path.t[b] - path.t[a]
    u = ((path.t[k] - path.t[a]) / np.where(h > 0, h, 1.0))[:, None]
    turned = length(turn_between(quaternion.slerp(path.q[a], path.q[b], u[:, 0]), path.q[k]))
    speed = length(path.v[k] - path.v[a] - u * (path.v[b] - path.v[a]))
    line = path.p[b] - path.p[a]
    bent = bend(line, h[:, None] * path.v[a], h[:, None] * path.v[b], u)
    return turned, speed, length(path.p[k] - path.p[a] - u * line - bent)


def turn_between(q: Array, later: Array) -> Array:
    """(N, 3) rotation vector from one attitude (N, 4) to another, in the body."""
    return quaternion.log(quaternion.multiply(quaternion.conjugate(q), later))


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
    return np.asarray(np.column_stack([track.t[:-1], track.t[1:]])[step > allowed])


def position_jumps(track: PositionTrack, limits: Limits) -> Array:
    """Steps of the position that the velocity does not explain, (J, 2) as for attitude: GPS glitches, EKF resets.

    A quarter of what the change of velocity makes in the interval is allowed on top: at 2 Hz a manoeuvre between two
    messages moves the vehicle by more than the trapezoid says.
    """
    h = np.diff(track.t)[:, None]
    predicted = 0.5 * (track.velocity[1:] + track.velocity[:-1]) * h
    step = length(np.diff(track.position, axis=0) - predicted)
    allowed = limits.position_jump_m + 0.25 * length(np.diff(track.velocity, axis=0) * h)
    return np.asarray(np.column_stack([track.t[:-1], track.t[1:]])[step > allowed])


def _before(samples: Array, t: Array) -> IntArray:
    """Index of the sample before each t; of the last but one at the end."""
    return np.clip(np.searchsorted(samples, t, side="right") - 1, 0, max(len(samples) - 2, 0))


def _bracket(samples: Array, t: Array) -> tuple[IntArray, Array]:
    """Index of the sample before each t, and the fraction of the way to the next."""
    i = _before(samples, t)
    h = samples[np.minimum(i + 1, len(samples) - 1)] - samples[i]
    return i, np.clip((t - samples[i]) / np.where(h > 0, h, 1.0), 0.0, 1.0)


def known_at(samples: Array, t: Array, gap: float) -> BoolArray:
    """Whether each t lies between two samples without a gap, s, between them."""
    whole = np.append(np.diff(samples) <= gap, gap >= 0.0)
    return np.asarray((t >= samples[0]) & (t <= samples[-1]) & whole[_before(samples, t)])
