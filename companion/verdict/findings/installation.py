"""How the IMU sits in the vehicle: turned, late, off the origin. No fault of the sensor, and to be taken out first.

A board trim that the log does not name, ArduPilot's filter and a lever arm all make windows drift, and none of them is
a bias. Each is linear in the error of a short window; a robust fit to all windows with gyro and accelerometer bias
beside them tells them apart as far as the flight can. The lag is fitted to the turns alone: where the autopilot's
heading is wrong, its velocity points past every force, and looks late.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from companion.comparison import (
    ATTITUDE,
    VELOCITY,
    Comparison,
    Correction,
    ImuSpec,
    ReferenceSpec,
    Windows,
    ends_of,
    errors,
    lever_jacobian,
    turn_jacobian,
    window_noise,
    windows,
)
from companion.constants import check, harm, healthy
from companion.model import Array, Flight, ImuTrack
from companion.strapdown import Propagation
from companion.verdict.finding import Finding, Severity

_GYRO_BIAS = slice(9, 12)  # places in the 15-state error of `propagate`
_ACCEL_BIAS = slice(12, 15)


@dataclass(frozen=True, slots=True, eq=False)
class Installation:
    """What is certain about it; zero is what is not."""

    mounting: Array  # (3,) rad, as in `Correction`
    lag: float  # s
    lag_sigma: float
    lever: Array  # (3,) m, FRD, from the body's origin to the IMU

    @property
    def tilted(self) -> tuple[float, float]:
        """Roll and pitch of the IMU, rad."""
        return float(self.mounting[0]), float(self.mounting[1])

    def level(self, track: ImuTrack) -> ImuTrack:
        """The track with the installation taken out: the IMU turned, in time and at the body's origin."""
        return Correction(mounting=self.mounting, time_offset=self.lag, lever_arm=self.lever).apply(track)


def installation(comparison: Comparison, imu: ImuSpec, autopilot: ReferenceSpec) -> Installation | None:
    """Fit it; None with too few windows."""
    residuals = _residuals(comparison)
    if len(residuals.span) < check.INSTALLED_MIN_WINDOWS:
        return None
    turning = _turns(comparison, residuals, imu, autopilot)
    lag, lag_sigma = float(turning.x[6]), float(turning.sigma[6])
    if abs(lag) < max(harm.ATTITUDE_LAG_S, 3.0 * lag_sigma):
        lag = 0.0
    fit, part = turning, slice(3, 6)
    lever, lever_sigma = np.zeros(3), np.full(3, healthy.LEVER_ARM_M)
    if comparison.has_position:
        fit, part = _turns_and_forces(comparison, residuals, imu, autopilot), slice(6, 9)
        lever, lever_sigma = fit.x[9:12], fit.sigma[9:12]
    mounting = fit.x[part]
    turned = harm.MOUNTING_MIN_RAD < np.linalg.norm(mounting) < healthy.TRIM_RAD
    if not (turned and fit.certain(part, check.MOUNTING_SIGMAS)):
        mounting = np.zeros(3)
    sure = (np.abs(lever) > check.LEVER_SIGMAS * lever_sigma) & (np.abs(lever) > harm.LEVER_ARM_M)
    lever = np.where(lever_sigma < 0.3 * healthy.LEVER_ARM_M, lever, 0.0) if sure.any() else np.zeros(3)
    return Installation(mounting, lag, lag_sigma, lever)


def installation_findings(flight: Flight, track: ImuTrack, fitted: Installation) -> Iterator[Finding]:
    """What is said of how the IMU sits in the vehicle."""
    begin, end = ends_of(track.t)
    if fitted.lag:
        evidence = f"the IMU lags {fitted.lag * 1e3:.1f} ± {fitted.lag_sigma * 1e3:.1f} ms behind the attitude"
        advice = "Usual: a low-pass of 20 Hz makes 12 ms. It matters in fast turns alone; the calibration takes it out."
        yield Finding("imu_lag", "data", "info", begin, end, evidence, advice)
    if fitted.mounting.any():
        severity: Severity = "warning" if np.linalg.norm(fitted.mounting) > harm.MOUNTING_RAD else "info"
        roll, pitch, yaw = np.degrees(fitted.mounting)
        turned = f"the IMU is turned by ({roll:.1f}, {pitch:.1f}, {yaw:.1f})°"
        evidence = f"{turned} against the axes of the attitude, throughout"
        trim = f"A board trim ({flight.settings.board_trim}) that the log does not name, or the board sits askew."
        advice = f"{trim} A flight that stays level cannot tell it from an accelerometer's offset."
        yield Finding("mounting", "data", severity, begin, end, evidence, advice)
    if fitted.lever.any():
        x, y, z = fitted.lever
        evidence = f"the IMU sits ({x:.2f}, {y:.2f}, {z:.2f}) m from the point that the position speaks of"
        advice = f"Set {flight.settings.imu_place} to where the IMU is, so that the autopilot knows too."
        yield Finding("lever_arm", "data", "info", begin, end, evidence, advice)


@dataclass(frozen=True, slots=True, eq=False)
class _Residuals:
    """The errors of short windows."""

    chosen: Windows
    span: Array  # (W,) s
    attitude: Array  # (W, 3) error at the end, autopilot minus IMU: rotation vector in NED, rad
    velocity: Array  # (W, 3) likewise, NED m/s
    growth: Propagation
    noise: Array  # (W, 2) what white noise makes of the error, 1σ: rad, m/s
    interpolated: Array  # (W, 2) 1σ of what the ends' interpolation makes of the error per axis: rad, m/s


def _residuals(comparison: Comparison) -> _Residuals:
    chosen = windows(comparison, check.SHORT_S)
    off = errors(comparison, chosen)
    span = off.end_s - off.anchor_s
    ends = [comparison.reference.interpolation_error(i, comparison.path) for i in (chosen.start, chosen.end)]
    between = np.sqrt(sum(np.column_stack([end.attitude, end.velocity]) ** 2 for end in ends))
    density = window_noise(comparison.reading_means(chosen), comparison.track.rate_hz)
    noise = density / np.sqrt(span[:, None]) * span[:, None]
    return _Residuals(chosen, span, off.attitude, off.velocity, comparison.growth(chosen), noise, between)


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


def _turns(comparison: Comparison, residuals: _Residuals, imu: ImuSpec, autopilot: ReferenceSpec) -> _Fit:
    """Gyro bias, mounting, lag from the turns alone."""
    growth = residuals.growth
    turned = growth.transition[:, ATTITUDE, _GYRO_BIAS], turn_jacobian(growth)[:, ATTITUDE]
    jacobian = np.concatenate([*turned, growth.time_offset[:, ATTITUDE, None]], axis=2)
    biased = healthy.GYRO_TIMES * imu.gyro.residual_bias
    prior = np.array([*[biased] * 3, *[healthy.MOUNTING_RAD] * 3, healthy.ATTITUDE_LAG_S])
    return _robust([(jacobian, residuals.attitude, _turn_sigma(comparison, residuals, autopilot))], prior)


def _turns_and_forces(comparison: Comparison, residuals: _Residuals, imu: ImuSpec, autopilot: ReferenceSpec) -> _Fit:
    """Gyro bias, accelerometer bias, mounting, lever arm, lag, the autopilot's attitude from turns and velocities.

    Without the last, a heading that is two degrees off would look like a mounting that is.
    """
    growth = residuals.growth
    rows = slice(0, 6)
    biases = growth.transition[:, rows, _GYRO_BIAS], growth.transition[:, rows, _ACCEL_BIAS]
    installed = turn_jacobian(growth)[:, rows], lever_jacobian(comparison, residuals.chosen)[:, rows]
    lasting = growth.time_offset[:, rows, None], growth.transition[:, rows, ATTITUDE] - np.eye(6, 3)
    jacobian = np.concatenate([*biases, *installed, *lasting], axis=2)
    of_axes = (
        healthy.GYRO_TIMES * imu.gyro.residual_bias, imu.accel.residual_bias, healthy.MOUNTING_RAD, healthy.LEVER_ARM_M,
    )  # fmt: skip
    common = [healthy.ATTITUDE_LAG_S, autopilot.tilt, autopilot.tilt, healthy.AP_HEADING_RAD]
    prior = np.concatenate([np.repeat(of_axes, 3), common])
    noise, between = residuals.noise[:, 1], residuals.interpolated[:, 1]
    speed = np.sqrt(2.0 * autopilot.velocity**2 + noise**2 + between**2)
    turns = jacobian[:, ATTITUDE], residuals.attitude, _turn_sigma(comparison, residuals, autopilot)
    return _robust([turns, (jacobian[:, VELOCITY], residuals.velocity, speed)], prior)


def _turn_sigma(comparison: Comparison, residuals: _Residuals, autopilot: ReferenceSpec) -> Array:
    """(W,) rad, 1σ of each axis."""
    step = 0.3 * comparison.track.gyro_step * residuals.span
    noise, between = residuals.noise[:, 0], residuals.interpolated[:, 0]
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
            misfit.append(normalised)
            weight = 1.0 / (sigma**2 * (1.0 + normalised / 6.0))
            information = information + np.einsum("w,wij,wik->jk", weight, jacobian, jacobian)
            pull = pull + np.einsum("w,wij,wi->j", weight, jacobian, error)
        x = np.linalg.solve(information, pull)
        spread = float(np.median(np.concatenate(misfit))) / 2.4  # the median of chi-square with three degrees
    return _Fit(x, np.asarray(np.linalg.inv(information) * max(1.0, spread)))
