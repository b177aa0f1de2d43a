"""The IMU errors that best explain a flight: biases, mounting, time offset, with their uncertainty.

Each window's error is linear in them, r = J x + ε, with the Jacobians of the error propagation and the budget of
everything else as the covariance of ε. Solved by weighted least squares with the sensor's tolerances as prior, robust
against single windows (Huber on the normalised error), and again about the corrected track until it stands still. What
the flight does not tell is said: a hover cannot tell an accelerometer bias from a tilt.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from companion.analysis.budget import Budget, budget, chi_square_95, nees, stacked, turn_jacobian
from companion.analysis.comparison import Comparison, Windows, windows
from companion.analysis.figures import ImuFigures, ReferenceFigures
from companion.tracks import Array, ImuTrack

GYRO_BIAS, ACCEL_BIAS, MOUNTING, TIME_OFFSET = slice(0, 3), slice(3, 6), slice(6, 9), 9
NAMES = ("gyro_bias_x", "gyro_bias_y", "gyro_bias_z", "accel_bias_x", "accel_bias_y", "accel_bias_z",
         "mounting_x", "mounting_y", "mounting_z", "time_offset")  # fmt: skip

_SOLVED_FOR = ("gyro_bias", "accel_bias", "misalignment", "time_offset")  # causes that the unknowns replace
_MOUNTING_PRIOR, _TIME_PRIOR = 0.1, 0.05  # rad, s
_OBSERVABLE = 0.3
"""A figure is observable when its standard error is below this part of what was possible beforehand."""


@dataclass(frozen=True, slots=True, eq=False)
class Correction:
    """What is taken from an IMU's readings: true = (1 + [mounting]x) (measured - bias), at t - time_offset."""

    gyro_bias: Array  # (3,) rad/s, FRD
    accel_bias: Array  # (3,) m/s², FRD
    mounting: Array  # (3,) rad, small rotation of the IMU's axes into those of the attitude
    time_offset: float  # s by which the IMU's times lag behind the autopilot's estimate

    def apply(self, track: ImuTrack) -> ImuTrack:
        """The track freed of these errors."""
        turn = np.eye(3) + np.cross(np.eye(3), -self.mounting)
        return replace(
            track,
            t=track.t - self.time_offset,
            gyro=(track.gyro - self.gyro_bias) @ turn.T,
            accel=(track.accel - self.accel_bias) @ turn.T,
        )


NO_CORRECTION = Correction(np.zeros(3), np.zeros(3), np.zeros(3), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """The correction that explains the flight best."""

    correction: Correction
    values: Array  # (10,) in the order of NAMES
    sigma: Array  # (10,) standard errors
    observable: tuple[bool, ...]  # (10,)
    windows: int  # fitted
    horizon_s: float
    residual: float  # median normalised error of the windows after the fit, per degree of freedom; about 1 is right


Compare = Callable[[ImuTrack], Comparison]
"""Holds a track in place of the flight's own against the autopilot."""


def calibrate(
    track: ImuTrack,
    compare_with: Compare,
    imu: ImuFigures,
    autopilot: ReferenceFigures,
    *,
    horizon: float = 5.0,
    fitted: slice = slice(None),
    iterations: int = 4,
) -> Calibration | None:
    """Fit the errors of `track` to windows of `horizon` seconds, or to some of them. None without windows."""
    prior = np.concatenate(
        [np.full(3, imu.gyro.offset), np.full(3, imu.accel.offset), np.full(3, _MOUNTING_PRIOR), [_TIME_PRIOR]]
    )
    values = np.zeros(10)
    weight_of = np.ones(0)
    for _ in range(iterations):
        comparison = compare_with(_correction(values).apply(track))
        chosen = windows(comparison, horizon)
        chosen = Windows(chosen.horizon, chosen.start[fitted], chosen.end[fitted], chosen.excluded)
        if not len(chosen.start):
            return None
        size = 9 if comparison.has_position else 3
        expected = budget(comparison, chosen, imu, autopilot)
        jacobian, covariance = _jacobian(expected)[:, :size], _rest(expected)[:, :size, :size]
        error = stacked(comparison, chosen)[:, :size]
        if len(weight_of) != len(error):
            weight_of = np.ones(len(error))
        information, pull = np.diag(prior**-2.0), -values * prior**-2.0
        step, information = _solve(error, jacobian, covariance, weight_of, information, pull)
        normalised = nees(error - jacobian @ step, covariance)
        weight_of = np.minimum(1.0, np.sqrt(chi_square_95(size) / np.maximum(normalised, 1e-12)))
        values = values + step
    spread = float(np.median(normalised)) / size
    sigma = np.sqrt(np.diag(np.linalg.inv(information)) * max(1.0, spread))
    return Calibration(
        correction=_correction(values),
        values=values,
        sigma=sigma,
        observable=tuple((sigma < _OBSERVABLE * prior).tolist()),
        windows=len(error),
        horizon_s=horizon,
        residual=spread,
    )


def _correction(values: Array) -> Correction:
    return Correction(values[GYRO_BIAS], values[ACCEL_BIAS], values[MOUNTING], float(values[TIME_OFFSET]))


def _jacobian(expected: Budget) -> Array:
    """(W, 9, 10) change of the error per unit of each unknown."""
    growth = expected.propagation
    return np.concatenate(
        [growth.transition[:, :9, 9:15], turn_jacobian(growth), growth.time_offset[:, :, None]], axis=2
    )


def _rest(expected: Budget) -> Array:
    """(W, 9, 9) covariance of everything that is not solved for."""
    return np.asarray(sum(c for name, c in expected.causes.items() if name not in _SOLVED_FOR))


def _solve(
    error: Array, jacobian: Array, covariance: Array, weight: Array, information: Array, pull: Array
) -> tuple[Array, Array]:
    """One Gauss-Newton step and the information matrix after it."""
    whitened = np.linalg.solve(covariance, np.concatenate([jacobian, error[..., None]], axis=2))
    sums = np.einsum("w,wij,wik->jk", weight, jacobian, whitened)
    information = information + sums[:, :-1]
    return np.linalg.solve(information, sums[:, -1] + pull), information
