"""What is not known of the motion between two readings that are far apart, over which they are interpolated.

What a reading changes by from one sample to the next it may have changed by at any time between: of a step D at an
unknown time in an interval g the integral is uncertain by D g / √12, and as much of a Brownian bridge whose increments
are D. Across a gap it may also have gone and come back: D is no less than what the track changes by elsewhere in
such a time (its structure function). In a long gap the estimate begins anew.

Also here: what readings at the end of an accelerometer's range take from a velocity, by the vehicle's own counters.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from companion.constants import healthy, num
from companion.estimation.low_pass import BoolArray
from companion.estimation.system import Index
from companion.model import GAP_S, Array, Flight, ImuTrack, NoEstimateError, Series, nearest, of_kind


def lost_by_clipping(flight: Flight, track: ImuTrack, t: Array, density: float) -> Array:
    """(K-1,) how noisy clipped readings make the velocity between times t (K,), s; zero without counters.

    In times of a white noise of some density, m/s²/√Hz.
    """
    lost = np.zeros(len(t) - 1)
    for series in of_kind(flight.series, "vibration"):
        for name, when, clipped in clip_counters(series):
            axis = name.removeprefix("clips_")
            if axis == str(track.instance) or (not axis.isdigit() and series.instance == track.instance):
                lost = np.maximum(lost, healthy.CLIPPED_MPS * np.diff(np.interp(t, when, clipped)))
    return lost / (max(density, healthy.MIN_DENSITY["accel"]) * np.sqrt(np.diff(t)))


def clip_counters(series: Series) -> Iterator[tuple[str, Array, Array]]:
    """Every counter of a "vibration" series that is told: its column, times (N,) s, readings since the first (N,).

    One that begins anew is not counted backwards, and one of a damaged message not at all: it cannot grow faster than
    an IMU reads.
    """
    for name in (column for column in series.columns if column.startswith("clips_")):
        known = np.isfinite(series[name])
        if known.any():
            t, count = series.t[known], series[name][known]
            possible = np.append(True, np.diff(count) <= healthy.FASTEST_IMU_HZ * np.diff(t))
            grown = np.maximum(np.diff(count[possible]), 0.0)
            yield name, t[possible], np.append(0.0, np.cumsum(grown))


def broken_intervals(
    flight: Flight, track: ImuTrack, index: Index, longest: float, untrusted: Sequence[tuple[float, float]]
) -> BoolArray:
    """(K-1,) whether readings are missing between two keyframes for long, or not to be trusted."""
    gap, t = np.concatenate([[0], np.cumsum(np.diff(track.t) > max(longest, num.BRIDGED_GAP_S))]), track.t[index]
    broken = np.diff(gap[index]) > 0
    for first, last in untrusted:
        broken |= (t[1:] > first) & (t[:-1] < last)
    whole = len(broken) - int(broken.sum())
    if whole < num.MIN_INTERVALS:
        needed = f"{num.MIN_INTERVALS} without gaps are needed"
        why = f"it has readings to trust in {whole} of {len(broken)} intervals, and {needed}"
        raise NoEstimateError(track.source, why, f"{flight.how_to_record}.")
    return np.asarray(broken)


def lost_in_gaps(track: ImuTrack, t: Array, longest_s: float, densities: tuple[float, float]) -> Array:
    """(K-1, 2) how noisy readings far apart make the integrals of gyro and accelerometer between times t (K,) s.

    In times of white noises of some densities, rad/s/√Hz and m/s²/√Hz; zero where no two are further apart than GAP_S.
    longest_s: a longer interval is a gap.
    """
    dt = np.diff(track.t)
    at = np.flatnonzero((dt > GAP_S) & (dt <= max(num.BRIDGED_GAP_S, longest_s)))
    out = np.zeros((len(t) - 1, 2))
    if not len(at):
        return out
    interval = np.clip(np.searchsorted(t, track.t[at], side="right") - 1, 0, len(t) - 2)
    gaps = dt[at] > longest_s
    lags = np.unique(np.geomspace(dt[at].min(), dt[at].max(), num.BRIDGED_LAGS)) if gaps.any() else np.zeros(0)
    usual = zip((track.gyro, track.accel), densities, healthy.MIN_DENSITY.values(), strict=True)
    for column, (readings, density, least) in enumerate(usual):
        change = np.abs(readings[at + 1] - readings[at]).max(axis=1)
        if gaps.any():
            elsewhere = np.interp(dt[at], lags, [_change(track.t, readings, lag) for lag in lags])
            change[gaps] = np.maximum(change, elsewhere)[gaps]
        variance = np.bincount(interval, (change * dt[at]) ** 2 / 12.0, len(out))
        out[:, column] = np.sqrt(variance / np.diff(t)) / max(density, least)
    return out


def _change(t: Array, readings: Array, lag: float) -> float:
    """By how much an axis of readings (N, 3) at times t (N,) changes within a lag (s), rms."""
    later = nearest(t, t + lag)
    apart = t[later] - t
    there = (apart > 0.5 * lag) & (apart < 1.5 * lag)
    if not there.any():
        return 0.0
    return float(np.sqrt(((readings[later] - readings)[there] ** 2).mean()))
