"""What an IMU does to the truth, forwards to simulate it and backwards to correct it (docs/mathematics.md, "The IMU").

    measured = quantise(saturate(matrix · true + bias + walk + noise))

Units are continuous-time densities, as data sheets have them: white noise per √Hz, so that a sample at rate r has the
standard deviation N √r; a bias walk per √s, which grows by K √h in h seconds (Allan deviation N/√τ and K √(τ/3)).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from companion.model import Array, ImuTrack


@dataclass(frozen=True, slots=True, eq=False)
class Sensor:
    """One three-axis sensor. Its unit u is rad/s for a gyro and m/s² for an accelerometer.

    Raises ValueError for shapes that do not match, negative or non-finite values and a matrix without an inverse.
    """

    noise_density: float = 0.0  # N, u/√Hz, white noise
    bias_walk: float = 0.0  # K, u/√s, random walk of the bias
    bias: Array = field(default_factory=lambda: np.zeros(3))  # (3,) u, constant
    matrix: Array = field(default_factory=lambda: np.eye(3))  # (3, 3) identity plus scale (diagonal) and misalignment
    step: float = 0.0  # u, quantisation: readings are cut towards zero to a multiple of it; 0 for none
    full_scale: float = np.inf  # u, readings saturate at ± this

    def __post_init__(self) -> None:
        for name in ("noise_density", "bias_walk", "step"):
            if not 0 <= getattr(self, name) < np.inf:
                raise ValueError(f"Sensor.{name} must be finite and not negative, got {getattr(self, name)}")
        if not self.full_scale > 0:
            raise ValueError(f"full_scale must be positive, got {self.full_scale}")
        if np.shape(self.bias) != (3,) or np.shape(self.matrix) != (3, 3):
            raise ValueError(f"bias must be (3,) and matrix (3, 3), got {np.shape(self.bias)}, {np.shape(self.matrix)}")
        if not (np.isfinite(self.bias).all() and np.isfinite(self.matrix).all()):
            raise ValueError("bias and matrix must be finite")
        if abs(np.linalg.det(self.matrix)) < 1e-6:
            raise ValueError("matrix has no inverse: it must be the identity plus small scale and misalignment errors")


@dataclass(frozen=True, slots=True, eq=False)
class ImuModel:
    """The error model of an IMU."""

    gyro: Sensor = field(default_factory=Sensor)  # rad/s
    accel: Sensor = field(default_factory=Sensor)  # m/s²


def simulate(truth: ImuTrack, model: ImuModel, seed: int | np.random.Generator) -> ImuTrack:
    """What an IMU with this model reads where an ideal one reads `truth` (e.g. `motions.coning(t).imu`).

    The same seed gives the same readings. The steps of the model are noted on the track.
    """
    rng = np.random.default_rng(seed)
    gyro = _measured(truth.t, truth.gyro, model.gyro, rng)
    accel = _measured(truth.t, truth.accel, model.accel, rng)
    return replace(truth, gyro=gyro, accel=accel, gyro_step=model.gyro.step, accel_step=model.accel.step)


def correct(imu: ImuTrack, model: ImuModel) -> ImuTrack:
    """The readings freed from what is constant in the model: `matrix⁻¹ (measured - bias)`."""

    def freed(measured: Array, sensor: Sensor) -> Array:
        return np.asarray(np.linalg.solve(sensor.matrix, (measured - sensor.bias).T).T)

    return replace(imu, gyro=freed(imu.gyro, model.gyro), accel=freed(imu.accel, model.accel))


def _measured(t: Array, true: Array, sensor: Sensor, rng: np.random.Generator) -> Array:
    """Readings (N, 3) of one sensor; noise is drawn in any case, so that a zero changes no other draw."""
    n = len(t)
    if n == 0:
        return true
    h = np.diff(t)
    first = h[:1] if n > 1 else np.ones(1)  # the interval that ended in the first sample is not known
    white, walk, _ = rng.standard_normal((3, n, 3))  # the third keeps the flights of a seed as they have always been
    reading = true @ sensor.matrix.T + sensor.bias
    reading += sensor.noise_density / np.sqrt(np.concatenate((first, h)))[:, None] * white
    walk[0] = 0.0
    walk[1:] *= sensor.bias_walk * np.sqrt(h)[:, None]
    reading += np.cumsum(walk, axis=0)
    reading = np.clip(reading, -sensor.full_scale, sensor.full_scale)
    return np.asarray(np.trunc(reading / sensor.step) * sensor.step) if sensor.step > 0 else reading
