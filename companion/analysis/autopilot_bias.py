"""The gyro bias that the autopilot itself believes in: what it takes off before it sends its body rates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.analysis.navigation_error import length
from companion.model import Array, Flight, ImuTrack, interpolated

_BLOCK_S = 1.0
_FEWEST = 5  # blocks
_SLOW = 0.15  # rad/s: a board trim turns fast rates into false biases, since ATTITUDE's rates are not turned by it
_NEWEST = 0.25  # part of the flight, at its end: an estimator learns


@dataclass(frozen=True, slots=True, eq=False)
class AutopilotBias:
    """An estimator's own gyro bias towards the end of a flight."""

    gyro: Array  # (3,) rad/s, FRD
    sigma: Array  # (3,) from its scatter, and from the steps of the readings
    start_s: float  # boot clock
    end_s: float


def autopilot_bias(flight: Flight, track: ImuTrack) -> AutopilotBias | None:
    """Readings of the gyro less the rates of ATTITUDE; None where those say nothing of this gyro.

    They are the first IMU's. Where the log has no rates but the gyro's own, or the bias has been taken off the readings
    already, there is nothing to compare.
    """
    attitude = flight.attitude
    if attitude is None or not attitude.rates_told or not attitude.rates.any():
        return None
    if track.instance != 0 or track.bias_removed:
        return None
    inside = (attitude.t >= track.t[0]) & (attitude.t <= track.t[-1])
    t, rates = attitude.t[inside], attitude.rates[inside]
    if len(t) < 2:
        return None
    gyro = interpolated(t, track.t, track.gyro)
    slow = length(rates) < _SLOW
    block = ((t - t[0]) / _BLOCK_S).astype(np.intp)
    count = np.bincount(block[slow], minlength=block[-1] + 1)
    full = np.flatnonzero(count >= 0.9 * np.bincount(block).clip(1))
    if len(full) < _FEWEST:
        return None
    sums = [np.bincount(block[slow], (gyro - rates)[slow, axis], minlength=len(count))[full] for axis in range(3)]
    means = np.column_stack(sums) / count[full, None]
    newest = means[-max(_FEWEST, round(_NEWEST * len(means))) :]
    used = full[-len(newest) :]
    middle = np.median(newest, axis=0)
    scatter = 1.4826 * np.median(np.abs(newest - middle), axis=0)
    return AutopilotBias(
        gyro=middle,
        sigma=np.hypot(scatter, 0.5 * track.gyro_step),
        start_s=float(t[0] + used[0] * _BLOCK_S),
        end_s=float(min(t[0] + (used[-1] + 1) * _BLOCK_S, t[-1])),
    )
