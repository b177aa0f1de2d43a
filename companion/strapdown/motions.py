"""Motions in closed form: exact attitude, velocity, position, rates and specific force at any times.

The truth of the tests, the benchmark and the simulator. World NED, body FRD, gravity standard and down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.model import STANDARD_GRAVITY, Array, ImuTrack, NavState
from companion.strapdown import quaternion


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """True states and what an ideal IMU at them measures."""

    t: Array  # (N,) s
    q_ned_frd: Array  # (N, 4) wxyz
    velocity: Array  # (N, 3) NED, m/s
    position: Array  # (N, 3) NED, m
    gyro: Array  # (N, 3) angular rate, FRD, rad/s
    accel: Array  # (N, 3) specific force, FRD, m/s²

    @property
    def imu(self) -> ImuTrack:
        """The readings of an ideal IMU."""
        return ImuTrack(self.t, self.gyro, self.accel, "ideal")

    @property
    def start(self) -> NavState:
        """The state at the first time."""
        return NavState(float(self.t[0]), self.q_ned_frd[0], self.velocity[0], self.position[0])


def rest(t: Array, q_ned_frd: Array = quaternion.IDENTITY) -> Motion:
    """Standing still at the origin with a constant attitude (4,)."""
    still = np.zeros((len(t), 3))
    return _motion(t, np.tile(q_ned_frd, (len(t), 1)), gyro=still, path=(still, still, still))


def free_fall(t: Array, rate: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Motion:
    """Falling from rest at t = 0 while turning at a constant body rate (rad/s): the accelerometer reads zero."""
    t = np.asarray(t, dtype=np.float64)
    down = np.array([0.0, 0.0, STANDARD_GRAVITY])
    gyro = np.tile(np.array(rate), (len(t), 1))
    q = quaternion.exp(gyro * t[:, None])
    return Motion(t, q, down * t[:, None], 0.5 * down * t[:, None] ** 2, gyro, np.zeros((len(t), 3)))


def spin(t: Array, rate: tuple[float, float, float] = (0.3, -0.2, 1.0)) -> Motion:
    """Turning on the spot at a constant body rate (rad/s), level at t = 0."""
    still = np.zeros((len(t), 3))
    gyro = np.tile(np.array(rate), (len(t), 1))
    q = quaternion.exp(gyro * np.asarray(t)[:, None])
    return _motion(t, q, gyro=gyro, path=(still, still, still))


def coning(
    t: Array,
    *,
    angle: float = 0.4,
    frequency: float = 1.5,
    amplitude: tuple[float, float, float] = (3.0, 2.0, 1.0),
    swing: tuple[float, float, float] = (0.2, 0.35, 0.5),
) -> Motion:
    """Coning while moving: the hardest smooth motion for an attitude integrator, on a path of metres.

    The body is tilted by `angle` (rad) about a horizontal axis that turns at `frequency` (Hz), without net rotation:
    `q = [cos a/2, sin a/2 cos Ωt, sin a/2 sin Ωt, 0]`, whose rate is
    `w = (-Ω sin a sin Ωt, Ω sin a cos Ωt, -Ω (1 - cos a))`. The position swings sinusoidally along north, east and
    down with amplitudes in m and frequencies `swing` in Hz.
    """
    t = np.asarray(t, dtype=np.float64)
    turn = 2.0 * np.pi * frequency
    c, s = np.cos(turn * t), np.sin(turn * t)
    q = np.stack((np.full_like(t, np.cos(angle / 2)), np.sin(angle / 2) * c, np.sin(angle / 2) * s, 0 * t), axis=1)
    gyro = turn * np.stack((-np.sin(angle) * s, np.sin(angle) * c, np.full_like(t, np.cos(angle) - 1.0)), axis=1)
    size, omega = np.array(amplitude), 2.0 * np.pi * np.array(swing)
    phase = omega * t[:, None]
    path = (size * np.sin(phase), size * omega * np.cos(phase), -size * omega**2 * np.sin(phase))
    return _motion(t, q, gyro=gyro, path=path)


def circle(
    t: Array, *, radius: float = 20.0, speed: float = 8.0, bank: float = 0.3, heave: float = 1.0, frequency: float = 0.5
) -> Motion:
    """A banked circle to the right, nose along the path, while heaving up and down.

    radius in m, speed in m/s, bank in rad, heave amplitude in m at `frequency` in Hz. Yaw turns at the constant rate
    speed / radius about down, seen from a body that is rolled by `bank`.
    """
    t = np.asarray(t, dtype=np.float64)
    turn, omega = speed / radius, 2.0 * np.pi * frequency
    yaw, phase = turn * t, omega * t
    north, east = np.cos(yaw), np.sin(yaw)
    position = np.stack((radius * east, -radius * north, heave * np.sin(phase)), axis=1)
    velocity = np.stack((speed * north, speed * east, heave * omega * np.cos(phase)), axis=1)
    acceleration = np.stack((-speed * turn * east, speed * turn * north, -heave * omega**2 * np.sin(phase)), axis=1)
    gyro = np.tile(turn * np.array([0.0, np.sin(bank), np.cos(bank)]), (len(t), 1))
    q = quaternion.from_euler(np.full_like(t, bank), np.zeros_like(t), yaw)
    return _motion(t, q, gyro=gyro, path=(position, velocity, acceleration))


def _motion(t: Array, q: Array, *, gyro: Array, path: tuple[Array, Array, Array]) -> Motion:
    """A motion on a path of position, velocity and acceleration a, whose accelerometer reads C(q)ᵀ (a - g)."""
    position, velocity, acceleration = path
    accel = quaternion.rotate(quaternion.conjugate(q), acceleration - np.array([0.0, 0.0, STANDARD_GRAVITY]))
    return Motion(np.asarray(t, dtype=np.float64), q, velocity, position, gyro, accel)
