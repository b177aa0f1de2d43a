"""What is lost of an IMU's signal: by its low-pass, between readings that are far apart, at the end of the range.

Where a vehicle shakes at some hertz, by a controller that oscillates, its sensors cone and scull: turns about two axes
add up to one about the third, however small each of them is (P. G. Savage 1998, Strapdown Inertial Navigation
Integration Algorithm Design). A low-pass makes the shaking smaller, not what it adds up to, so an integration of what
it lets through turns too little, as if the gyro were biased by some mrad/s while it is shaken. It is given back as far
as the rate allows.

Over readings that are far apart the motion is interpolated: what a reading changes by from one sample to the next it
may have changed by at any time between: of a step D at an unknown time in an interval g the integral is uncertain by
D g / √12, and as much of a Brownian bridge whose increments are D. Across a gap it may also have gone and come back: D
is no less than what the track changes by elsewhere in such a time (its structure function). In a long gap the estimate
begins anew.

What readings at the end of an accelerometer's range take from a velocity is known by the vehicle's own counters.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from companion.constants import healthy, num
from companion.model import (
    GAP_S,
    Array,
    BoolArray,
    Flight,
    ImuTrack,
    IntArray,
    NoEstimateError,
    Series,
    interpolated,
    nearest,
    of_kind,
)


def undelayed(track: ImuTrack) -> ImuTrack:
    """The track at the times that its gyro speaks of, with what the accelerometer felt then.

    A low-pass of second order delays by √2 / (2π f).
    """
    known = low_passes(track)
    if known is None:
        return track
    gyro, accel = (np.sqrt(2.0) / (2.0 * np.pi * f) if f > 0 else 0.0 for f in known)
    force = track.accel
    if gyro != accel:
        force = interpolated(track.t + accel - gyro, track.t, track.accel)
    return replace(track, t=track.t - gyro, accel=force)


def restored(track: ImuTrack, gaps: BoolArray) -> ImuTrack:
    """The readings of before the low-pass, but for its delay, which the track's times do without.

    gaps: (N-1,) whether samples are missing between two; beside one the readings stay as they are.
    """
    known = low_passes(track)
    if known is None:
        return track
    gyro, accel = (_given_back(track, *one, gaps) for one in zip((track.gyro, track.accel), known, strict=True))
    return replace(track, gyro=gyro, accel=accel)


def low_passes(track: ImuTrack) -> tuple[float, float] | None:
    """Those of gyro and accelerometer, Hz, 0 for none. Where one of both is not known, it is as the other."""
    known = [f for f in (track.gyro_low_pass_hz, track.accel_low_pass_hz) if f is not None]
    return (known[0], known[-1]) if known else None


def _given_back(track: ImuTrack, read: Array, corner_hz: float, gaps: BoolArray) -> Array:
    """Readings (N, 3) with the amplitudes that they had before a Butterworth low-pass of second order."""
    highest = min(num.RESTORED_OF_RATE * track.rate_hz, num.RESTORED_OF_CORNER * corner_hz)
    if corner_hz <= 0 or highest < num.RESTORED_MIN_OF_CORNER * corner_hz:
        return read
    kernel = _kernel(corner_hz, highest, track.rate_hz)
    reach = len(kernel) // 2
    padded = np.pad(read, ((reach, reach), (0, 0)), mode="edge")
    out = np.column_stack([np.convolve(column, kernel, mode="valid") for column in padded.T])
    passed = np.concatenate([[0], np.cumsum(gaps)])
    first, last = np.clip(np.arange(len(read)) + np.array([[-reach], [reach]]), 0, len(read) - 1)
    return np.where((passed[first] == passed[last])[:, None], out, read)


def _kernel(corner_hz: float, highest_hz: float, rate_hz: float) -> Array:
    """(2 M + 1,) whose convolution undoes the low-pass up to a frequency, and leaves what is constant as it is."""
    f = np.fft.rfftfreq(2 * num.FILTER_FREQUENCIES, 1.0 / rate_hz)
    s = 1j * f / corner_hz
    undone = (1.0 + np.sqrt(2.0) * s + s**2) * np.exp(-np.sqrt(2.0) * s)  # without the delay, by which times are moved
    response = 1.0 + (undone - 1.0) / (1.0 + (f / highest_hz) ** num.RESTORED_ORDER)
    reach = min(int(np.ceil(num.FILTER_LASTS * rate_hz / corner_hz)), num.FILTER_FREQUENCIES - 1)
    kernel = np.roll(np.fft.irfft(response), reach)[: 2 * reach + 1] * np.hanning(2 * reach + 3)[1:-1]
    return np.asarray(kernel / kernel.sum())


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
    flight: Flight, track: ImuTrack, index: IntArray, longest: float, untrusted: Sequence[tuple[float, float]]
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
