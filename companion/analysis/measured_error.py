"""What an IMU reads too much by a piece of a flight: before a time, and at its end."""

from __future__ import annotations

import numpy as np

from companion.analysis.fault_interval import BIAS_UNITS, share_at
from companion.analysis.finding import Cause
from companion.constants import check, num
from companion.estimation import CONSTANTS, BestEstimate
from companion.model import Array, Flight

Reading = tuple[Array, Array]
"""(m,) what a sensor reads too much, and 1σ of it."""


def reads(cause: Cause, flight: Flight, best: BestEstimate | None, until: float | None = None) -> Reading | None:
    """What the IMU of a cause reads too much at the end of a piece; or until then, s, without what began there.

    None where it is no error that is measured so.
    """
    if best is None or not cause.kind.endswith(("_bias", "_scale")) or cause.sensor not in BIAS_UNITS:
        return None
    if cause.imu is not None and cause.imu != best.imu.instance:
        return _apart(cause, flight, best, until)
    if cause.kind.endswith("_bias"):
        value = np.median(getattr(best.states, cause.kind), axis=0)
        variance = np.median(getattr(best, f"{cause.kind}_sigma"), axis=0) ** 2
    else:
        place, _ = CONSTANTS[f"{cause.sensor}_matrix"]
        value, variance = best.states.constants[place][::4], best.constants_sigma[place][::4] ** 2  # of the diagonal
    for part in (one for one in best.explained if one.kind == cause.kind and one.imu is None):
        share = share_at(part, float(best.t[-1]))
        if until is None or part.onset < until - check.NEAR_S:
            value, variance = value + share * part.size, variance + (share * part.sigma) ** 2
    return value, np.sqrt(variance)


def _apart(cause: Cause, flight: Flight, best: BestEstimate, until: float | None) -> Reading | None:
    """What another IMU reads more than that of the estimate: by means of seconds, from which true motion cancels."""
    other = next((track for track in flight.imus.values() if track.instance == cause.imu and len(track) > 1), None)
    if other is None or cause.kind.endswith("_scale"):
        return None
    means = []
    for track in (other, best.imu):
        second = np.floor(track.t).astype(np.intp)
        which, first, count = np.unique(second, return_index=True, return_counts=True)
        readings = track.gyro if cause.sensor == "gyro" else track.accel
        means.append((which, np.add.reduceat(readings, first) / count[:, None]))
    both, i, j = np.intersect1d(means[0][0], means[1][0], assume_unique=True, return_indices=True)
    apart = means[0][1][i] - means[1][1][j]
    chosen = apart[-round(num.JUDGED_S) :] if until is None else apart[both + 1 < until]
    if len(chosen) < 2:
        return None
    return chosen.mean(axis=0), chosen.std(axis=0) / np.sqrt(len(chosen))
