"""A flight with known truth: what really happened, what the IMU measured of it, what the autopilot made of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from companion.errors import SettingsError
from companion.simulate.faults import Faults
from companion.strapdown import ImuModel, Motion, Sensor, motions, quaternion, simulate
from companion.tracks import Array, ImuTrack

LOOP_US = 2500
"""Period of the autopilot's main loop: ArduCopter's 400 Hz."""

MOTIONS: dict[str, Callable[[Array], Motion]] = {
    "circle": motions.circle,
    "coning": motions.coning,
    "spin": motions.spin,
    "rest": motions.rest,
}

TYPICAL = ImuModel(
    gyro=Sensor(noise_density=5e-5, bias_walk=5e-6, bias=np.array([4e-4, -3e-4, 2e-4])),
    accel=Sensor(noise_density=7e-4, bias_walk=3e-5, bias=np.array([0.01, -0.015, 0.02])),
)
"""A calibrated MEMS IMU of the better sort: ICM-42688-P's noise, and the biases that calibration leaves."""


@dataclass(frozen=True, slots=True, eq=False)
class Flown:
    """A flight at every step of the autopilot's loop, LOOP_US apart, from t = 0."""

    truth: Motion
    imu: ImuTrack  # as measured: with the sensor's errors, not yet cut to whole units
    q_ned_frd: Array  # (N, 4) the autopilot's estimate of attitude,
    rates: Array  # (N, 3) of the body rates, FRD, rad/s,
    velocity: Array  # (N, 3) of velocity, NED, m/s,
    position: Array  # (N, 3) and of position, NED, m

    def __len__(self) -> int:
        return len(self.truth.t)

    @property
    def duration(self) -> float:
        """s"""
        return (len(self) - 1) * LOOP_US * 1e-6


def fly(
    duration_s: float,
    *,
    motion: str = "circle",
    model: ImuModel = TYPICAL,
    faults: Faults = Faults(),  # noqa: B008  (frozen)
    seed: int = 0,
) -> Flown:
    """Fly a closed-form motion of `MOTIONS` for a time. The same seed gives the same flight.

    The estimate is the truth with white noise of 0.2 mrad, 5 mm/s and 1 cm: better than any autopilot's, so what
    drifts against it is the IMU. Raises SettingsError for an unknown motion or a duration that is not positive.
    """
    if motion not in MOTIONS:
        raise SettingsError(f"there is no motion {motion!r}: choose one of {', '.join(MOTIONS)}.")
    if not 0 < duration_s <= 7200:
        raise SettingsError(f"a simulated flight lasts up to 7200 s, got {duration_s:g}.")
    t = np.arange(round(duration_s * 1e6 / LOOP_US) + 1, dtype=np.float64) * (LOOP_US * 1e-6)
    truth = MOTIONS[motion](t)
    rng = np.random.default_rng(seed)
    imu = simulate(truth.imu, model, rng)
    gyro = imu.gyro.copy()
    if faults.imu_bias:
        begin, bias = faults.imu_bias
        gyro[t >= begin, 2] += bias
    angle, rate, speed, place = rng.standard_normal((4, len(t), 3))
    position = truth.position + 0.01 * place
    if faults.ekf_reset:
        begin, jump = faults.ekf_reset
        position[t >= begin, 0] += jump
    return Flown(
        truth=truth,
        imu=ImuTrack(t, gyro, imu.accel, "measured"),
        q_ned_frd=quaternion.multiply(quaternion.exp(2e-4 * angle), truth.q_ned_frd),
        rates=truth.gyro + 2e-3 * rate,
        velocity=truth.velocity + 5e-3 * speed,
        position=position,
    )
