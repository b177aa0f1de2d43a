"""How the IMU sits in the vehicle: turned, late, off the origin. No fault of the sensor, and to be taken out first.

A board trim that the log does not name, ArduPilot's filter and a lever arm all make windows drift, and none of them is
a bias. Each is linear in the error of a short window; a robust fit to all windows with gyro and accelerometer bias
beside them tells them apart as far as the flight can. The lag is fitted to the turns alone: where the autopilot's
heading is wrong, its velocity points past every force, and looks late.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.analysis.budget import ATTITUDE, VELOCITY, turn_jacobian
from companion.analysis.calibrate import lever_jacobian
from companion.analysis.comparison import Comparison
from companion.analysis.correction import Correction
from companion.analysis.findings.residuals import ACCEL_BIAS, GYRO_BIAS, Residuals
from companion.analysis.imu_spec import ImuSpec, ReferenceSpec
from companion.constants import check, harm, healthy
from companion.model import Array, ImuTrack


@dataclass(frozen=True, slots=True, eq=False)
class Installation:
    """What is certain about it; zero is what is not."""

    mounting: Array  # (3,) rad, as in `Correction`
    lag: float  # s
    lag_sigma: float
    lever: Array  # (3,) m, FRD, from the body's origin to the IMU

    @property
    def moved(self) -> bool:
        """Whether there is anything to take out."""
        return bool(self.mounting.any() or self.lag or self.lever.any())


def installation(
    comparison: Comparison, residuals: Residuals, imu: ImuSpec, autopilot: ReferenceSpec, trusted_until: float
) -> Installation | None:
    """Fit it; None with too few windows. trusted_until: s, from when on the autopilot's heading is known to be off."""
    if len(residuals) < check.INSTALLED_MIN_WINDOWS:
        return None
    turning = _turns(comparison, residuals, imu, autopilot)
    lag, lag_sigma = float(turning.x[6]), float(turning.sigma[6])
    if abs(lag) < max(harm.ATTITUDE_LAG_S, 3.0 * lag_sigma):
        lag = 0.0
    fit, part = turning, slice(3, 6)
    lever, lever_sigma = np.zeros(3), np.full(3, healthy.LEVER_ARM_M)
    if comparison.has_position and (residuals.end < trusted_until).sum() >= check.INSTALLED_MIN_WINDOWS:
        fit, part = _turns_and_forces(comparison, residuals, imu, autopilot, trusted_until), slice(6, 9)
        lever, lever_sigma = fit.x[9:12], fit.sigma[9:12]
    mounting = fit.x[part]
    turned = harm.MOUNTING_MIN_RAD < np.linalg.norm(mounting) < healthy.TRIM_RAD
    if not (turned and fit.certain(part, check.MOUNTING_SIGMAS)):
        mounting = np.zeros(3)
    sure = (np.abs(lever) > check.LEVER_SIGMAS * lever_sigma) & (np.abs(lever) > harm.LEVER_ARM_M)
    lever = np.where(lever_sigma < 0.3 * healthy.LEVER_ARM_M, lever, 0.0) if sure.any() else np.zeros(3)
    return Installation(mounting, lag, lag_sigma, lever)


def level(track: ImuTrack, fitted: Installation) -> ImuTrack:
    """The track with the installation taken out: the IMU turned, in time and at the body's origin."""
    return Correction(mounting=fitted.mounting, time_offset=fitted.lag, lever_arm=fitted.lever).apply(track)


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    x: Array
    covariance: Array

    @property
    def sigma(self) -> Array:
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def certain(self, part: slice, errors: float) -> bool:
        """Whether some figures together are farther from zero than so many standard errors."""
        return bool(self.x[part] @ np.linalg.solve(self.covariance[part, part], self.x[part]) > errors**2)


def _turns(
    comparison: Comparison,
    residuals: Residuals,
    imu: ImuSpec,
    autopilot: ReferenceSpec,
) -> _Fit:
    """Gyro bias, mounting, lag from the turns alone."""
    growth = residuals.growth
    jacobian = np.concatenate(
        [
            growth.transition[:, ATTITUDE, GYRO_BIAS],
            turn_jacobian(growth)[:, ATTITUDE],
            growth.time_offset[:, ATTITUDE, None],
        ],
        axis=2,
    )
    biased = healthy.GYRO_TIMES * imu.gyro.residual_bias
    prior = np.array([*[biased] * 3, *[healthy.MOUNTING_RAD] * 3, healthy.ATTITUDE_LAG_S])
    return _robust([(jacobian, residuals.attitude, _turn_sigma(comparison, residuals, autopilot))], prior)


def _turns_and_forces(
    comparison: Comparison, residuals: Residuals, imu: ImuSpec, autopilot: ReferenceSpec, trusted_until: float
) -> _Fit:
    """Gyro bias, accelerometer bias, mounting, lever arm, lag, the autopilot's attitude from turns and velocities.

    Without the last, a heading that is two degrees off would look like a mounting that is.
    """
    growth = residuals.growth
    rows = slice(0, 6)
    jacobian = np.concatenate(
        [
            growth.transition[:, rows, GYRO_BIAS],
            growth.transition[:, rows, ACCEL_BIAS],
            turn_jacobian(growth)[:, rows],
            lever_jacobian(comparison, residuals.chosen)[:, rows],
            growth.time_offset[:, rows, None],
            growth.transition[:, rows, ATTITUDE] - np.eye(6, 3),
        ],
        axis=2,
    )
    prior = np.concatenate(
        [
            np.full(3, healthy.GYRO_TIMES * imu.gyro.residual_bias),
            np.full(3, imu.accel.residual_bias),
            np.full(3, healthy.MOUNTING_RAD),
            np.full(3, healthy.LEVER_ARM_M),
            [healthy.ATTITUDE_LAG_S, autopilot.tilt, autopilot.tilt, healthy.AP_HEADING_RAD],
        ]
    )
    noise = residuals.noise[:, 1] * residuals.span[:, 0]
    speed = np.sqrt(2.0 * autopilot.velocity**2 + noise**2 + residuals.interpolated[:, 1] ** 2)
    speed = np.where(residuals.end < trusted_until, speed, np.inf)
    return _robust(
        [
            (jacobian[:, ATTITUDE], residuals.attitude, _turn_sigma(comparison, residuals, autopilot)),
            (jacobian[:, VELOCITY], residuals.velocity, speed),
        ],
        prior,
    )


def _turn_sigma(comparison: Comparison, residuals: Residuals, autopilot: ReferenceSpec) -> Array:
    """(W,) rad, 1σ of each axis."""
    step = 0.3 * comparison.track.gyro_step * residuals.span[:, 0]
    noise = residuals.noise[:, 0] * residuals.span[:, 0]
    between = residuals.interpolated[:, 0]
    return np.asarray(np.sqrt(2.0 * autopilot.attitude_noise**2 + noise**2 + step**2 + between**2))


def _robust(blocks: list[tuple[Array, Array, Array]], prior: Array) -> _Fit:
    """Least squares over windows, (W, k, n) Jacobian, (W, k) error, (W,) 1σ, with Cauchy's weights in each block.

    Windows that a fault spoils pull with a weight that falls with the square of how far off they are.
    """
    x = np.zeros(len(prior))
    information, spread = np.zeros((len(prior), len(prior))), 1.0
    for _ in range(check.INSTALLED_ROUNDS):
        information, pull = np.diag(prior**-2.0), np.zeros(len(prior))
        misfit = []
        for jacobian, error, sigma in blocks:
            normalised = np.einsum("wi,wi->w", error - jacobian @ x, error - jacobian @ x) / sigma**2
            misfit.append(normalised[np.isfinite(sigma)])
            weight = 1.0 / (sigma**2 * (1.0 + normalised / 6.0))
            information = information + np.einsum("w,wij,wik->jk", weight, jacobian, jacobian)
            pull = pull + np.einsum("w,wij,wi->j", weight, jacobian, error)
        x = np.linalg.solve(information, pull)
        spread = float(np.median(np.concatenate(misfit))) / 2.4  # the median of chi-square with three degrees
    return _Fit(x, np.asarray(np.linalg.inv(information) * max(1.0, spread)))
