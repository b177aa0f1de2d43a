"""What the other sensors of a simulated vehicle read: GPS receiver, two compasses, barometer. Deterministic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.model import Array, interpolated
from companion.strapdown import Motion, quaternion

HOME = (float(np.radians(47.0)), float(np.radians(8.0)), 500.0)
"""Where simulated vehicles fly: latitude and longitude in rad, m above mean sea level."""

EARTH_FIELD = np.array([21.765e-6, 1.232e-6, 42.914e-6])
"""The Earth's field at HOME, NED, tesla: World Magnetic Model 2020, end of 2023."""

FIX_PERIOD_S, FIX_LATENCY_S = 0.2, 0.1
GPS_SIGMA = (0.3, 0.5, 0.1)
"""1σ of a fix: horizontal and vertical, m; of its velocity, m/s."""

_COMPASS_SIGMA = 0.5e-6  # tesla
_SECOND_IRON = np.array([0.8e-6, -0.5e-6, 0.3e-6])  # what calibration has left of the second compass' hard iron
_BAROMETER_SIGMA = 0.1  # m


@dataclass(frozen=True, slots=True, eq=False)
class Witnesses:
    """Readings at the N times of a motion, and fixes as they come."""

    fixed: Array  # (M,) s, when a fix reached the autopilot: FIX_LATENCY_S after the time that it speaks of
    place: Array  # (M, 3) m, NED about HOME
    velocity: Array  # (M, 3) m/s, NED
    fields: tuple[Array, Array]  # (N, 3) tesla, FRD, of either compass
    height: Array  # (N,) m above HOME, by the barometer


def witness(truth: Motion, seed: int) -> Witnesses:
    """What the sensors read of a motion. The same seed gives the same readings."""
    rng = np.random.default_rng([seed, 1])  # the IMU's noise has draws of its own
    t = truth.t
    fixed = np.arange(t[0], t[-1] + 1e-9, FIX_PERIOD_S)
    horizontal, vertical, speed = GPS_SIGMA
    place, velocity = (interpolated(fixed - FIX_LATENCY_S, t, of) for of in (truth.position, truth.velocity))
    felt = quaternion.rotate(quaternion.conjugate(truth.q_ned_frd), EARTH_FIELD)
    first, second = felt + _COMPASS_SIGMA * rng.standard_normal((2, len(t), 3))
    return Witnesses(
        fixed=fixed,
        place=place + [horizontal, horizontal, vertical] * rng.standard_normal(place.shape),
        velocity=velocity + speed * rng.standard_normal(velocity.shape),
        fields=(first, second + _SECOND_IRON),
        height=-truth.position[:, 2] + _BAROMETER_SIGMA * rng.standard_normal(len(t)),
    )


def pressure(height: Array) -> Array:
    """Pa at heights (N,) m above HOME, by the standard atmosphere (ISO 2533)."""
    return np.asarray(101_325.0 * (1.0 - 2.25577e-5 * (HOME[2] + height)) ** 5.25588)
