"""The bias that the autopilot's EKF holds, against the bias that the IMU has."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from companion.analysis.compare import length
from companion.analysis.figures import ImuFigures
from companion.analysis.finding import Finding, digits, runs
from companion.analysis.findings.residuals import Residuals
from companion.tracks import STANDARD_GRAVITY, Array, Flight, ImuTrack

_FEWEST = 4  # windows
_OWN = 0.5  # part of what is held that the IMU has to have, for the EKF to be right


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """What the EKF takes from an IMU's readings, in the short windows; NaN where that is not known."""

    gyro: Array  # (W, 3) rad/s, FRD
    accel: Array  # (W, 3) m/s²
    how: str  # how that is known, in words


def held(flight: Flight, track: ImuTrack, found: Residuals, own: Array) -> Held | None:
    """PX4 sends HIGHRES_IMU without its EKF's biases and SCALED_IMU with them; ATTITUDE's rates are without, too.

    own: `blame.own_rates`. None where nothing tells.
    """
    freed = flight.imus.get("HIGHRES_IMU")
    if flight.vehicle.autopilot == "PX4" and freed is not None and track.source.startswith("SCALED_IMU"):
        if freed.instance != track.instance or len(freed) < 2:
            return None
        gyro, accel = (_means(track, x, found) - _means(freed, y, found) for x, y in _pairs(track, freed))
        return Held(gyro, accel, "SCALED_IMU less HIGHRES_IMU")
    if not np.isfinite(own).any():
        return None
    return Held(found.rate - own, np.full_like(own, np.nan), "the gyro less ATTITUDE's rates")


def held_findings(found: Residuals, known: Held, imu: ImuFigures) -> Iterator[Finding]:
    """A bias that the EKF takes out and the IMU does not have: then it is the estimate that drifts by it."""
    for first, last in _beyond(known.gyro, 4.0 * imu.gyro.residual_bias):
        bias, truth = (np.median(x[first : last + 1], axis=0) for x in (known.gyro, found.rate))
        if length(bias - truth) > np.maximum(_OWN * length(bias), 4.0 * imu.gyro.residual_bias):
            yield _false(found, first, last, f"({digits(bias * 1e3, 1)}) mrad/s from the gyro", known.how,
                         f"({digits(truth * 1e3, 1)}) mrad/s against the attitude")  # fmt: skip
    # A false bias of the accelerometer and a tilt that goes with it explain one another: only before can tell.
    for first, last in _beyond(known.accel, 2.5 * imu.accel.residual_bias):
        if first < _FEWEST:
            continue
        bias = np.median(known.accel[first : last + 1], axis=0)
        before, truth = (np.median(x[:_FEWEST], axis=0) for x in (known.accel, found.force))
        small = 0.25 * length(bias)
        if np.isfinite(before).all() and length(before) < small and length(truth) < small:
            lean = np.degrees(length(bias[:2]) / STANDARD_GRAVITY)
            yield _false(found, first, last, f"({digits(bias, 2)}) m/s² from the accelerometer", known.how,
                         f"({digits(truth, 2)}) m/s² when the log began: it leans by {lean:.1f}°")  # fmt: skip


def _beyond(each: Array, usual: float) -> Iterator[tuple[int, int]]:
    """First and last window of each stretch in which more is held than is usual."""
    over = np.isfinite(each).all(axis=1) & (length(np.nan_to_num(each)) > usual)
    for first, last in runs(np.asarray(over)):
        if last - first >= _FEWEST - 1 and length(np.median(each[first : last + 1], axis=0)) > usual:
            yield first, last


def _false(found: Residuals, first: int, last: int, taken: str, how: str, truth: str) -> Finding:
    return Finding(
        "ekf_bias",
        "autopilot",
        "warning",
        *found.between(first, last),
        f"its EKF takes {taken} ({how}), which is off by {truth}",
        "The estimator has learned a false bias, from vibration, a tilted start or a wrong aid. Let it settle at rest "
        "before take-off; believe the IMU without its corrections.",
    )


def _pairs(track: ImuTrack, freed: ImuTrack) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    return (track.gyro, freed.gyro), (track.accel, freed.accel)


def _means(track: ImuTrack, readings: Array, found: Residuals) -> Array:
    """(W, 3) mean of the readings in each window; NaN where the track does not cover it."""
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(readings, axis=0)])
    first, last = np.searchsorted(track.t, found.begin), np.searchsorted(track.t, found.end)
    count = (last - first)[:, None]
    enough = count > 0.5 * track.rate_hz * found.span
    return np.where(enough, (total[last] - total[first]) / np.maximum(count, 1), np.nan)
