"""A bias that the autopilot's estimator knows and takes off the readings: information, and no fault."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from companion.analysis.finding import Finding
from companion.analysis.navigation_error import length
from companion.estimation import BestEstimate
from companion.model import Array, Flight

_LARGE = {"gyro": 3e-3, "accel": 0.1}  # rad/s, m/s²: of a real, calibrated part
_LEAST_SIGMA = {"gyro": 3e-4, "accel": 0.02}
_SIGMAS = 3.0
_SAID = {"gyro": ("gyro", "mrad/s", 1e3, 1), "accel": ("accelerometer", "m/s²", 1.0, 2)}
_NEWEST = 0.25  # part of the flight, at its end: an estimator learns


def known_biases(flight: Flight, best: BestEstimate) -> Iterator[Finding]:
    """Where the best estimate and an estimator of the vehicle find the same large bias in the IMU that was judged."""
    own = [b for b in flight.biases if b.imu_instance == best.imu.instance and len(b)]
    if not own:
        return
    held = own[0]
    begin, end = float(best.t[0]), float(best.t[-1])
    since = end - _NEWEST * (end - begin)
    late, newest = held.t >= since, best.t >= since
    for sensor, large in _LARGE.items():
        values: Array = getattr(held, sensor)[late]
        estimate: Array = getattr(best.states, f"{sensor}_bias")[newest]
        if not len(values) or not np.isfinite(values).all():
            continue
        theirs, ours = np.median(values, axis=0), np.median(estimate, axis=0)
        sigma = np.hypot(
            np.nan_to_num(np.median(getattr(held, f"{sensor}_sigma")[late], axis=0)),
            np.median(getattr(best, f"{sensor}_bias_sigma")[newest], axis=0),
        )
        sigma = np.maximum(sigma, _LEAST_SIGMA[sensor])
        if float(length(ours)) < large or (np.abs(ours - theirs) > _SIGMAS * sigma).any():
            continue
        axis = int(np.argmax(np.abs(ours)))
        if abs(theirs[axis]) < 0.5 * abs(ours[axis]):
            continue  # it does not know it: it is only unsure
        name, unit, factor, decimals = _SAID[sensor]
        reads, takes = (f"{v[axis] * factor:.{decimals}f}" for v in (ours, theirs))
        yield Finding(
            f"{sensor}_bias_known",
            "data",
            "info",
            begin,
            end,
            f"{name} {'xyz'[axis]} reads {reads} {unit} too much; the autopilot's estimator takes {takes} off "
            f"({held.source})",
            "No fault: the estimator knows it and removes it. A calibration at rest would spare it the work.",
        )
