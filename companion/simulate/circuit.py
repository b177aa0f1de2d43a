"""A quadrotor's flight in closed form: take-off, squares with yaw turns at the corners, landing.

The path is a sum of smooth steps, three times differentiable everywhere. A multicopter's thrust stands along its own
down axis, so the path and the heading fix its attitude and, by their derivatives, its rates (differential flatness:
Mellinger & Kumar, "Minimum snap trajectory generation and control for quadrotors", ICRA 2011, §III).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.model import STANDARD_GRAVITY, Array
from companion.strapdown import Motion, quaternion

SIDE = 28.0  # m
HEIGHT = 10.0  # m

_REST_S, _CLIMB_S, _HOVER_S, _LEG_S, _TURN_S, _PAUSE_S, _DESCENT_S = 6.0, 7.0, 4.0, 7.0, 3.0, 0.5, 9.0
_LAP_S = 4 * (_LEG_S + _TURN_S + 2 * _PAUSE_S)
_ONCE_S = 2 * _REST_S + _CLIMB_S + 2 * _HOVER_S + _DESCENT_S
_STEP = np.polynomial.Polynomial([0, 0, 0, 0, 35, -84, 70, -20])  # 0 → 1 with three derivatives zero at both ends
_DERIVATIVES = [_STEP.deriv(order) if order else _STEP for order in range(4)]


@dataclass(frozen=True, slots=True)
class _Move:
    """A smooth step."""

    begin: float  # s
    duration: float  # s
    by: tuple[float, float, float]  # north, east, down, m
    turn: float = 0.0  # yaw, rad


def square(t: Array) -> Motion:
    """At times t (N,) s, from rest at t = 0 to rest at the end: as many laps as fit, at least one.

    A flight of less than 75 s ends in the air.
    """
    t = np.asarray(t, dtype=np.float64)
    laps = max(1, int((float(t[-1]) - _ONCE_S) // _LAP_S))
    states = np.zeros((4, len(t), 4))  # order of the derivative, time, (north, east, down, yaw)
    for move in _moves(laps):
        first, last = np.searchsorted(t, [move.begin, move.begin + move.duration])
        u, by = (t[first:last] - move.begin) / move.duration, np.array([*move.by, move.turn])
        for order, polynomial in enumerate(_DERIVATIVES):
            states[order, first:last] += (polynomial(u) / move.duration**order)[:, None] * by
        states[0, last:] += by
    return _flown(t, *states[..., :3], *states[:2, :, 3])


def _moves(laps: int) -> list[_Move]:
    moves = [_Move(_REST_S, _CLIMB_S, (0.0, 0.0, -HEIGHT))]
    now = _REST_S + _CLIMB_S + _HOVER_S
    for leg in range(4 * laps):
        north, east = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[leg % 4]
        moves.append(_Move(now, _LEG_S, (SIDE * north, SIDE * east, 0.0)))
        now += _LEG_S + _PAUSE_S
        moves.append(_Move(now, _TURN_S, (0.0, 0.0, 0.0), np.pi / 2))
        now += _TURN_S + _PAUSE_S
    moves.append(_Move(now + _HOVER_S, _DESCENT_S, (0.0, 0.0, HEIGHT)))
    return moves


def _flown(
    t: Array, position: Array, velocity: Array, acceleration: Array, jerk: Array, yaw: Array, yaw_rate: Array
) -> Motion:
    """The attitude that this path and heading need, its rates, and what an accelerometer reads on the way."""
    thrust = np.array([0.0, 0.0, STANDARD_GRAVITY]) - acceleration  # per mass, along the body's down axis
    size = np.linalg.norm(thrust, axis=1, keepdims=True)
    down = thrust / size
    down_rate = (-jerk - down * _dot(down, -jerk)) / size
    ahead = np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)])
    ahead_rate = yaw_rate[:, None] * np.column_stack([-np.sin(yaw), np.cos(yaw), np.zeros_like(yaw)])
    across = np.cross(down, ahead)
    across_size = np.linalg.norm(across, axis=1, keepdims=True)
    right = across / across_size
    forward = np.cross(right, down)
    across_rate = np.cross(down_rate, ahead) + np.cross(down, ahead_rate)
    gyro = np.hstack([-_dot(right, down_rate), _dot(forward, down_rate), -_dot(forward, across_rate) / across_size])
    q = quaternion.continuous_sign(quaternion.from_matrix(np.stack([forward, right, down], axis=-1)))
    accel = np.column_stack([np.zeros((len(t), 2)), -size])
    return Motion(t, q, velocity, position, gyro, accel)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.sum(a * b, axis=1, keepdims=True))
