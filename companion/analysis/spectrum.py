"""What an IMU shakes with: power spectral densities by Welch's method, and the vibration over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.analysis.finding import IntArray, run_edges
from companion.analysis.reference import Limits
from companion.tracks import Array, ImuTrack

_SEGMENT_S = 4.0  # s: a resolution of a quarter of a hertz
_FEWEST, _MOST = 32, 4096  # samples of a segment
_AT_ONCE = 128  # segments in memory, so that a day's log needs no more than a minute's
_VIBRATION_S = 1.0  # s, over which the vibration is averaged
_SLOW_S = 0.2  # s, the moving mean that is taken for the vehicle's own motion: 5 Hz


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """One-sided power spectral densities of an IMU's readings, FRD."""

    frequency_hz: Array  # (F,)
    gyro: Array  # (F, 3) (rad/s)²/Hz
    accel: Array  # (F, 3) (m/s²)²/Hz
    segments: int  # how many were averaged, half overlapping


@dataclass(frozen=True, slots=True, eq=False)
class Vibration:
    """How strongly an IMU shakes, over time."""

    t: Array  # (M,) s, boot clock, middle of each second
    accel: Array  # (M, 3) standard deviation of the specific force about its moving mean, FRD, m/s²


def welch(values: Array, rate_hz: float, length: int) -> tuple[Array, Array]:
    """Frequencies (F,) Hz and one-sided power spectral density (F, ...) of evenly sampled values (N, ...).

    Welch 1967: segments of `length` samples that overlap by half, each without its mean and under a Hann window; the
    mean of their periodograms, so that the density integrates to the variance. Raises ValueError for fewer than
    `length` samples or a length below 2.
    """
    if length < 2 or len(values) < length:
        raise ValueError(f"a segment of {length} samples does not fit into {len(values)}")
    begin = np.arange(0, len(values) - length + 1, length - length // 2)
    return _frequencies(length, rate_hz), _density(values, begin, rate_hz, length)


def imu_spectrum(track: ImuTrack, limits: Limits) -> Spectrum | None:
    """The spectra of an IMU, over all the stretches of it that have no hole; None where none is long enough.

    Samples are taken as even within a segment: device clocks jitter by less than a tenth of a period.
    """
    rate = track.rate_hz
    if not rate:
        return None
    length = int(np.clip(2 ** np.floor(np.log2(_SEGMENT_S * rate)), _FEWEST, _MOST))
    step = length // 2
    runs = [(a, b) for a, b in _stretches(track, limits) if b - a >= length]
    if not runs:
        return None
    begin = np.concatenate([np.arange(a, b - length + 1, step) for a, b in runs])
    gyro, accel = (_density(values, begin, rate, length) for values in (track.gyro, track.accel))
    return Spectrum(_frequencies(length, rate), gyro, accel, len(begin))


def vibration(track: ImuTrack, limits: Limits) -> Vibration | None:
    """The specific force that is left above about 5 Hz, second by second; None below 20 Hz.

    After ArduPilot's VIBE, which is the same from the IMU at its full rate; what the stream's own low-pass and rate
    have lost is missing here.
    """
    rate = track.rate_hz
    if rate < 4 / _SLOW_S:
        return None
    slow, second = round(_SLOW_S * rate) | 1, round(_VIBRATION_S * rate)
    times, levels = [], []
    for a, b in _stretches(track, limits):
        if b - a < slow + second:
            continue
        running = np.cumsum(np.vstack([np.zeros(3), track.accel[a:b]]), axis=0)
        mean = (running[slow:] - running[:-slow]) / slow
        fast = track.accel[a + slow // 2 : b - slow // 2] - mean
        whole = len(fast) // second
        parts = fast[: whole * second].reshape(whole, second, 3)
        levels.append(np.sqrt(np.mean(np.square(parts), axis=1)))
        times.append(track.t[a + slow // 2 + second // 2 :][: whole * second : second])
    return Vibration(np.concatenate(times), np.concatenate(levels)) if times else None


def _stretches(track: ImuTrack, limits: Limits) -> list[tuple[int, int]]:
    """Where the samples follow one another without a hole: [begin, end)."""
    first, last = run_edges(np.diff(track.t) <= limits.hole(track.t))
    return [(a, b + 2) for a, b in zip(first.tolist(), last.tolist(), strict=True)]


def _frequencies(length: int, rate_hz: float) -> Array:
    return np.asarray(np.fft.rfftfreq(length, 1 / rate_hz), dtype=np.float64)


def _density(values: Array, begin: IntArray, rate_hz: float, length: int) -> Array:
    """The mean periodogram (F, ...) of the segments that begin at `begin` (S,)."""
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(length) / length)  # Hann, periodic
    window = window.reshape(length, *[1] * (values.ndim - 1))
    total = np.zeros((length // 2 + 1, *values.shape[1:]))
    for some in np.array_split(begin, -(-len(begin) // _AT_ONCE)):
        parts = values[some[:, None] + np.arange(length)]
        parts = (parts - parts.mean(axis=1, keepdims=True)) * window
        total += np.square(np.abs(np.fft.rfft(parts, axis=1))).sum(axis=0)
    power = total / (len(begin) * rate_hz * np.square(window).sum())
    power[1 : None if length % 2 else -1] *= 2.0  # one-sided: the mean and Nyquist's frequency have no twin
    return np.asarray(power)
