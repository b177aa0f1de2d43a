"""What an IMU shakes with: power spectral densities by Welch's method, their peaks, and the vibration over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.constants import num
from companion.model import Array, ImuTrack, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """One-sided power spectral densities of an IMU's readings, FRD. White noise of density N is 2 N² in them."""

    frequency_hz: Array  # (F,)
    gyro: Array  # (F, 3) (rad/s)²/Hz
    accel: Array  # (F, 3) (m/s²)²/Hz
    segments: int  # how many were averaged, half overlapping


@dataclass(frozen=True, slots=True)
class Peak:
    """A line in a spectrum that stands out of what is around it."""

    axis: int  # 0, 1, 2: forward, right, down
    frequency_hz: float  # as sampled: what vibrates faster than half the rate is folded down to it
    amplitude: float  # root mean square of what is in the peak, rad/s or m/s²


@dataclass(frozen=True, slots=True, eq=False)
class Vibration:
    """How strongly an IMU shakes, over time."""

    t: Array  # (M,) s, boot clock, middle of each second
    accel: Array  # (M, 3) standard deviation of the specific force about its moving mean, FRD, m/s²


def imu_spectrum(track: ImuTrack, gap_s: float) -> Spectrum | None:
    """The spectra of an IMU (Welch 1967), over all the stretches of it without a gap; None where none is long enough.

    gap_s: sample intervals that are longer than this are gaps. Samples are taken as even within a segment: device
    clocks jitter by less than a tenth of a period.
    """
    rate = track.rate_hz
    if not rate:
        return None
    length = segment_length(rate)
    begin = segments(track.t, gap_s, length)
    if not len(begin):
        return None
    parts = np.array_split(begin, -(-len(begin) // num.PSD_BATCH))

    def mean(values: Array) -> Array:
        total = sum(periodograms(values, some, rate, length).sum(axis=0) for some in parts)
        return np.asarray(total / len(begin))

    return Spectrum(frequencies(length, rate), mean(track.gyro), mean(track.accel), len(begin))


def segment_length(rate_hz: float) -> int:
    """Samples of a segment at a rate, Hz: a power of two, about four seconds."""
    return int(np.clip(2 ** np.floor(np.log2(num.PSD_SEGMENT_S * rate_hz)), *num.PSD_SAMPLES))


def segments(t: Array, gap_s: float, length: int) -> IntArray:
    """The first samples (S,) of segments of `length` samples that overlap by half and have no gap in them."""
    begin = [np.arange(a, b - length + 1, length - length // 2) for a, b in stretches(t, gap_s)]
    return np.concatenate([*begin, np.zeros(0, np.int64)]).astype(np.int64)


def stretches(t: Array, gap_s: float) -> list[tuple[int, int]]:
    """Where samples at times t (N,) s follow one another without a gap: [first, end) of each stretch."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(t) > gap_s) + 1, [len(t)]])
    return [(a, b) for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True) if b - a > 1]


def frequencies(length: int, rate_hz: float) -> Array:
    """The frequencies (F,), Hz, of a segment of `length` samples."""
    return np.asarray(np.fft.rfftfreq(length, 1 / rate_hz), dtype=np.float64)


def periodograms(values: Array, begin: IntArray, rate_hz: float, length: int, window: str = "hann") -> Array:
    """One-sided power spectral density (S, F, ...) of each of the segments of values (N, ...) that start at `begin`.

    Each without its mean and under a spectral window; it integrates to the variance.
    """
    parts = values[begin[:, None] + np.arange(length)]
    phase = 2.0 * np.pi * np.arange(length) / length
    weights = sum((a * np.cos(k * phase) for k, a in enumerate(num.SPECTRAL_WINDOWS[window])), np.zeros(length))
    flat = parts - parts.mean(axis=1, keepdims=True)
    power = np.square(np.abs(np.fft.rfft(flat * weights.reshape(-1, *[1] * (values.ndim - 1)), axis=1)))
    power[:, 1 : (length + 1) // 2] *= 2.0  # the negative frequencies' share: neither 0 nor half the rate has one
    return np.asarray(power / (rate_hz * np.sum(weights**2)), dtype=np.float64)


def neighbourhoods(values: Array, size: int) -> Array:
    """(N, ..., size) of values (N, ...): each with its neighbours, an odd number in all; the ends are repeated."""
    half = size // 2
    padded = np.concatenate((values[:1].repeat(half, axis=0), values, values[-1:].repeat(half, axis=0)))
    return np.lib.stride_tricks.sliding_window_view(padded, size, axis=0)


def peaks(spectrum: Spectrum, density: Array, most: int = 3) -> tuple[Peak, ...]:
    """The strongest lines in a density (F, 3) of a spectrum, up to `most` an axis, the strongest first.

    A line is four times as strong as the median within 6 Hz, and more than chance makes of so few segments.
    """
    resolution = float(spectrum.frequency_hz[1])
    threshold = num.PSD_PEAK * (1.0 + 6.0 / np.sqrt(max(spectrum.segments, 1)))
    lines = []
    for axis in range(3):
        line = density[:, axis]
        around = np.median(neighbourhoods(line, 2 * round(num.PSD_AROUND_HZ / resolution) + 1), axis=-1)
        ratio = line / np.maximum(around, 1e-30)
        highest = neighbourhoods(ratio, 2 * max(round(1.0 / resolution), 1) + 1).max(axis=-1)
        stands_out = (ratio == highest) & (ratio >= threshold) & (spectrum.frequency_hz >= num.VEHICLE_MOTION_HZ)
        for top in (1 + np.flatnonzero(stands_out[1:-1])).tolist():
            near = slice(max(top - 2, 0), top + 3)  # a line under a Hann window is four bins wide
            power = float(np.sum(np.maximum(line[near] - around[near], 0.0))) * resolution
            lines.append(Peak(axis, float(spectrum.frequency_hz[top]), float(np.sqrt(power))))
    lines.sort(key=lambda peak: -peak.amplitude)
    return tuple(p for i, p in enumerate(lines) if sum(q.axis == p.axis for q in lines[:i]) < most)


def folded_onto(frequency_hz: float, rate_hz: float, count: int = 3) -> tuple[float, ...]:
    """The frequencies above half the rate that sampling at `rate_hz` shows at `frequency_hz`, the lowest first."""
    both = [abs(k * rate_hz + sign * frequency_hz) for k in range(1, count + 1) for sign in (-1, 1)]
    return tuple(sorted(both)[:count])


def vibration(track: ImuTrack, gap_s: float) -> Vibration | None:
    """The specific force that is left above about 5 Hz, second by second; None below 20 Hz.

    After ArduPilot's VIBE, which is the same from the IMU at its full rate; what the stream's own low-pass and rate
    have lost is missing here.
    """
    rate = track.rate_hz
    if rate < 4 / num.VEHICLE_MOTION_S:
        return None
    slow, second = round(num.VEHICLE_MOTION_S * rate) | 1, round(num.AVERAGED_S * rate)
    times, levels = [], []
    for a, b in stretches(track.t, gap_s):
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
