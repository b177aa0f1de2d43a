"""How far the time stamps of an IMU's samples may be off."""

from __future__ import annotations

import numpy as np

from companion.analysis.comparison import Windows
from companion.model import Array, ImuTrack
from companion.strapdown import Propagation

_FINEST = 4  # a stream may be sent at every second or third tick of the autopilot's loop, as it comes
_REGULAR = 0.1  # part of a tick that regular stamps keep to
_FEWEST = 20  # intervals


def stamp_jitter(track: ImuTrack) -> float:
    """1σ, s, of the error of one stamp against its neighbours'.

    From how irregular the intervals are, once whole ticks are taken off: an interval that is one tick longer holds one
    sample less, and its stamps are right. Never less than the resolution of the message's clock allows.
    """
    least = float(track.t_step / np.sqrt(12.0))
    intervals = np.diff(track.t)
    if len(intervals) < _FEWEST:
        return least
    period = float(np.percentile(intervals, 10.0))
    near = intervals[intervals < 5.5 * period]
    spreads = []
    for pieces in range(1, _FINEST + 1):
        tick = period / pieces
        low, high = np.percentile(near - tick * np.round(near / tick), [16.0, 84.0])
        spreads.append(0.5 * float(high - low))
        if spreads[-1] < _REGULAR * tick:
            return float(max(least, spreads[-1] / np.sqrt(2.0)))  # an interval has two stamps
    return float(max(least, spreads[0] / np.sqrt(2.0)))


def jitter_covariance(track: ImuTrack, chosen: Windows, growth: Propagation) -> Array:
    """(W, 9, 9) covariance at the end of each window of stamps that are off, each by itself.

    A reading at the wrong time is wrong by its rate of change, which acts like white noise. That the window begins and
    ends at wrong times cancels: the intervals are wrong by as much as the times that the autopilot's state is taken at.
    """
    total = np.zeros((len(chosen.start), 9, 9))
    sigma = stamp_jitter(track)
    if sigma > 0.0:
        for name, readings in (("gyro_noise", track.gyro), ("accel_noise", track.accel)):
            power = sigma**2 * _mean_square_rate(track.t, readings, chosen) / track.rate_hz
            total += power[:, None, None] * growth.noise[name][:, :9, :9]
    return total


def _mean_square_rate(t: Array, readings: Array, chosen: Windows) -> Array:
    """Mean square of the readings' rate of change in each window, mean over axes, (W,)."""
    rate = np.zeros(len(t))
    rate[1:-1] = (((readings[2:] - readings[:-2]) / (t[2:] - t[:-2])[:, None]) ** 2).mean(axis=1)
    total = np.concatenate([[0.0], np.cumsum(rate)])
    return np.asarray((total[chosen.end + 1] - total[chosen.start]) / (chosen.end + 1 - chosen.start))
