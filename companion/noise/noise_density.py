"""White noise of an IMU from the spectrum of its readings, whatever filter, mean or rate they came through.

Second differences of neighbouring samples understate the noise of a low-passed IMU 2 to 9 times, and a stream that is
slower than the filter folds the rest down. Here the density is read where the filter passes it, and what folding adds
follows from the filter:

    S(f) = 2 (N² G(f) + q² / 12 r),   G(f) = Σ_k |H(f + k r)|²

with one-sided density S, rate r, quantisation step q and H the low-pass (second order, Butterworth, as ArduPilot's
LowPassFilter2p) or the mean over the sample's interval. N is in the convention of Kalibr and `strapdown`: a sample
of an IMU that averages between samples has the standard deviation N √r. Where nothing is known of what came before the
sampling, G is 1 and N is that of the readings as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Literal

import numpy as np
import numpy.typing as npt

from companion.constants import harm, healthy, num
from companion.model import Array, BoolArray, ImuTrack, IntArray, integrated
from companion.noise.chi_square import chi_square
from companion.noise.losses import low_passes
from companion.noise.spectrum import frequencies, neighbourhoods, periodograms, segment_length, segments

_WINDOW = "blackmanharris"  # its side lobes are 92 dB down: noise of a ten-thousandth of the motion is seen beside it
_NORMAL = NormalDist()

SensorName = Literal["gyro", "accel"]


@dataclass(frozen=True, slots=True)
class Aliased:
    """What motion that is faster than the sampling may read like, as an error of some kind, in its unit."""

    beating: float  # 1σ, for seconds
    lasting: float = 0.0  # 1σ, for as long as it moves so

    def sigma(self, lasted: Array) -> Array:
        """(T,) 1σ of its mean over times (T,), s."""
        share = np.minimum(num.BEAT_S / np.maximum(lasted, 1e-3), 1.0)
        return np.asarray(np.maximum(self.beating * share, self.lasting))


@dataclass(frozen=True, slots=True)
class Sampling:
    """How readings were taken from the sensor's signal."""

    kind: Literal["filtered", "averaged", "point"]
    corner_hz: float | None = None  # of the low-pass; of averaged samples, one that the spectrum shows before the mean
    interval_s: float | None = None  # over which a sample is averaged
    source: Literal["log", "spectrum", "assumed"] = "assumed"
    confirmed: bool | None = None  # whether a spectrum at rest shows what the log says; None where it cannot


@dataclass(frozen=True, slots=True, eq=False)
class WhiteNoise:
    """White-noise density of one sensor, unit u/√Hz with u rad/s or m/s²."""

    sampled: Array  # (3,) of the readings as they are: what an integration of them meets
    sensor: Array | None  # (3,) before filter and folding; None where the log and the spectrum do not tell them
    sigma: Array  # (3,) standard error of `sampled`, from how it varies over the flight
    band_hz: tuple[float, float]  # in which it was read
    hidden: npt.NDArray[np.bool_]  # (3,) below the steps of the readings: then `sampled` is an upper bound


def sampling_of(track: ImuTrack, sensor: SensorName | None = None) -> Sampling:
    """What the log says of how a sensor was sampled; "point" where it says nothing.

    Either sensor has its own low-pass. Without a sensor: behind the lower one of both.
    """
    corner = track.low_pass_hz
    if sensor is not None and (known := low_passes(track)) is not None:
        corner = known[0 if sensor == "gyro" else 1]
    if corner:
        return Sampling("filtered", corner_hz=float(corner), source="log")
    if track.interval is not None and len(track) and float(np.median(track.interval)) > 0:
        return Sampling("averaged", interval_s=float(np.median(track.interval)), source="log")
    return Sampling("point")


def folded_gain(frequency_hz: Array, rate_hz: float, sampling: Sampling) -> Array:
    """G(f): how strongly white noise before the sampling shows at frequencies (F,), with all that folds onto them."""
    f = np.asarray(frequency_hz, dtype=np.float64)
    if sampling.corner_hz:
        reach = int(np.ceil(8.0 * sampling.corner_hz / rate_hz)) + 4
        k = np.arange(-reach, reach + 1)[:, None] * rate_hz
        return np.asarray(np.sum(1.0 / (1.0 + ((f + k) / sampling.corner_hz) ** 4), axis=0))
    if sampling.interval_s:
        k = np.arange(-400, 401)[:, None] * rate_hz
        return np.asarray(np.sum(np.sinc((f + k) * sampling.interval_s) ** 2, axis=0))
    return np.ones_like(f)


def white_noise(
    track: ImuTrack, sensor: SensorName, gap_s: float, sampling: Sampling | None = None
) -> WhiteNoise | None:
    """The white noise of an IMU in motion or at rest; None where no band or too little time is left to read it in.

    In each frequency the median over time, so that a manoeuvre does not count; over the frequencies from 3 Hz to half
    the filter's corner (at most 10 Hz) the lower quartile, so that vibration does not: both corrected for
    what they are of white noise. What shakes all of the band all of the time counts as noise: it is to the integration.
    """
    rate, how = track.rate_hz, sampling or sampling_of(track, sensor)
    band = _band(rate, how)
    if band is None:
        return None
    length = max(round(num.NOISE_SEGMENT_S * rate), 2)
    begin = _segments(track.t, gap_s, length, num.NOISE_MAX_SEGMENTS)
    if len(begin) < num.NOISE_MIN_SEGMENTS:
        return None
    values, step = (track.gyro, track.gyro_step) if sensor == "gyro" else (track.accel, track.accel_step)
    f = frequencies(length, rate)
    inside = (f >= band[0]) & (f <= band[1])
    power = periodograms(values, begin, rate, length, _WINDOW)[:, inside]
    gain = folded_gain(f[inside], rate, how)
    grid = step**2 / (12.0 * rate)
    density = _density(power, gain, grid)
    blocks = np.array_split(np.arange(len(begin)), min(num.NOISE_BLOCKS, len(begin) // 2))
    without = np.array([_density(np.delete(power, block, axis=0), gain, grid) for block in blocks])
    sigma = np.sqrt((1.0 - 1.0 / len(blocks)) * np.square(without - without.mean(axis=0)).sum(axis=0))  # jackknife
    total = float(np.sqrt(folded_gain(np.zeros(1), rate, how)[0]))
    hidden = density**2 < grid  # less than the steps' own noise: it cannot be told from it
    # more than this would show through the steps
    half = num.HIDDEN * step * total / np.sqrt(_bandwidth(rate, how))
    sampled = np.where(hidden, np.maximum(half, np.sqrt(density**2 + grid)), density * total)
    known = how.kind != "point" or how.source == "spectrum"
    return WhiteNoise(sampled, density if known else None, sigma * total, band, hidden)


def spectral_noise(track: ImuTrack, gap_s: float) -> tuple[float, float]:
    """Densities (rad/s/√Hz, m/s²/√Hz) of gyro and accelerometer by their spectra, all axes together.

    Where no band is left to read them in, by how neighbouring samples differ. Not all that a gyro shows is noise.
    """

    def of(noise: WhiteNoise | None, readings: Array) -> float:
        if noise is None:
            return scatter_between_samples(readings, track.rate_hz)
        return float(np.sqrt(np.mean(np.square(noise.sampled))))

    gyro, accel = (white_noise(track, sensor, gap_s) for sensor in ("gyro", "accel"))
    return healthy.GYRO_SHARE * of(gyro, track.gyro), of(accel, track.accel)


def _segments(t: Array, gap_s: float, length: int, most: int) -> IntArray:
    """As `segments`: at most so many of them, spread evenly over the flight."""
    begin = segments(t, gap_s, length)
    return begin[np.linspace(0, len(begin) - 1, min(len(begin), most)).round().astype(np.int64)]


def scatter_between_samples(readings: Array, rate_hz: float) -> float:
    """Density u/√Hz of the noisiest axis of readings (N, 3), by second differences: as if they were white."""
    return float(between_samples(readings).max() / np.sqrt(rate_hz))


def between_samples(readings: Array) -> Array:
    """(3,) 1σ of each axis of readings (N, 3), by second differences: as if they were white."""
    rough = np.array([np.diff(axis, n=2).std() for axis in readings.T])
    return np.asarray(rough / np.sqrt(6.0))  # of white noise: 1 + 4 + 1


def confirmed_sampling(track: ImuTrack, gap_s: float, sensor: SensorName | None = None) -> Sampling:
    """How a sensor at rest was sampled, by the log and by its spectrum; without one, by those of both.

    Noise of a sensor at rest is white; where it falls off with frequency as a second-order low-pass does, there is one.
    The mean over an interval cannot be seen: its noise is white.
    """
    logged, rate, length = sampling_of(track, sensor), track.rate_hz, segment_length(max(track.rate_hz, 1.0))
    begin = _segments(track.t, gap_s, length, num.NOISE_MAX_SEGMENTS)
    if len(begin) < 2 * num.NOISE_MIN_SEGMENTS or rate < 4.0 * num.NOISE_MIN_BAND_HZ:
        return logged
    f = frequencies(length, rate)
    used = slice(2, len(f) - 1)
    clear: list[Array] = []
    both = {"gyro": (track.gyro, track.gyro_step), "accel": (track.accel, track.accel_step)}
    for values, step in both.values() if sensor is None else (both[sensor],):
        power = 0.5 * periodograms(values, begin, rate, length).mean(axis=0)[used] - step**2 / (12.0 * rate)
        clear += [axis for axis in power.T if (axis > step**2 / (12.0 * rate)).all()]
    if not clear:
        return logged
    tried = np.geomspace(0.01 * rate, 0.35 * rate, 60)
    shapes = np.log([folded_gain(f[used], rate, Sampling("filtered", corner_hz=corner)) for corner in tried])
    seen = [tried[best] for axis in clear if (best := _best_shape(axis, shapes, len(begin))) is not None]
    corner = float(np.median(seen)) if len(seen) > len(clear) / 2 else None
    return _judged(logged, corner, rate)


def quantisation_bound(readings: Array, step: float, rate_hz: float, sampling: Sampling) -> float | None:
    """Upper bound (95 %) of the white-noise density of readings (N,) whose steps hide their noise; None if they do not.

    They do where two values make up nearly all of the readings, or where most are 0: autopilots cut towards zero, so
    that zero is two steps wide. The noise can be as large as leaves so few readings outside of the commonest value when
    the truth lies in its middle.
    """
    if step <= 0 or not len(readings):
        return None
    values, counts = np.unique(np.round(readings / step), return_counts=True)
    order = np.argsort(counts)[::-1]
    share = float(counts[order[0]] / len(readings))
    zero = values[order[0]] == 0
    if counts[order[:2]].sum() < num.TWO_VALUES_SHARE * len(readings) and not (zero and share > num.MOSTLY_ZERO_SHARE):
        return None
    outside = 1.0 - share  # none of n seen: less than 3/n, with 95 %
    outside += (3.0 + 2.0 * np.sqrt(outside * len(readings))) / len(readings)
    wide = 2.0 if zero else 1.0
    sigma = step * float(np.std(readings / step))
    if zero or outside < 0.2:
        sigma = 0.5 * wide * step / -_NORMAL.inv_cdf(0.5 * min(outside, 0.7))
    return sigma * float(np.sqrt(folded_gain(np.zeros(1), rate_hz, sampling)[0] / _bandwidth(rate_hz, sampling)))


def _bandwidth(rate: float, sampling: Sampling) -> float:
    """Variance of a sample over N² of the noise before the sampling, Hz."""
    if sampling.corner_hz:
        return float(np.pi / np.sqrt(2.0) * sampling.corner_hz)  # of a Butterworth filter of second order
    return 1.0 / sampling.interval_s if sampling.interval_s else rate


def _judged(logged: Sampling, corner: float | None, rate: float) -> Sampling:
    if logged.corner_hz is not None:
        if logged.corner_hz > 0.35 * rate:  # too near to half the rate to be seen
            return logged
        agrees = corner is not None and 0.5 < corner / logged.corner_hz < 2.0
        return replace(logged, confirmed=agrees)
    if logged.kind == "averaged":
        return replace(logged, corner_hz=corner)  # the sensor's own low-pass comes before the mean
    if corner is not None:
        return Sampling("filtered", corner_hz=corner, source="spectrum")
    return Sampling("point", source="spectrum")


def _best_shape(power: Array, shapes: Array, count: int) -> int | None:
    """Which of the logarithms of shapes (S, F) a density (F,) of `count` segments follows; None where it is flat."""
    smooth = np.median(neighbourhoods(power, 9), axis=-1)
    fallen = np.flatnonzero(smooth < smooth[: max(len(power) // 50, 9)].mean() / num.FILTER_VISIBLE)
    end = int(fallen[0]) if len(fallen) else len(power)
    logarithm = np.log(power[:end])
    costs = np.var(logarithm - shapes[:, :end], axis=1)
    best = int(np.argmin(costs))
    noise = 1.0 / count  # variance of the logarithm of a density from so many segments
    flat = float(np.var(logarithm))
    falls = flat - costs[best] > 25.0 * noise / end and costs[best] < 0.3 * flat
    return best if falls else None


def _band(rate: float, sampling: Sampling) -> tuple[float, float] | None:
    """From 3 Hz to half the filter's corner, at most 10 Hz and below half the rate; None where that is too narrow."""
    fastest = min(num.NOISE_MAX_HZ, max(0.5 * sampling.corner_hz, 5.0) if sampling.corner_hz else np.inf, 0.45 * rate)
    return (num.VEHICLE_MOTION_HZ, fastest) if fastest - num.VEHICLE_MOTION_HZ >= num.NOISE_MIN_BAND_HZ else None


def _density(power: Array, gain: Array, grid: float) -> Array:
    """N (3,) before folding from one-sided densities (S, F, 3), G (F,) and what the steps of the readings add, N²."""
    typical = np.median(power, axis=0) / np.log(2.0)  # the median of an exponential variable of mean 1 is ln 2
    each = (0.5 * typical - grid) / gain[:, None]
    freedom = max(2.0 * len(power) * num.MEDIAN_EFFICIENCY, 1.0)
    lower = chi_square(freedom, _NORMAL.inv_cdf(num.NOISE_QUANTILE)) / freedom
    return np.asarray(np.sqrt(np.maximum(np.quantile(each, num.NOISE_QUANTILE, axis=0) / lower, 0.0)))


def aliasing(track: ImuTrack, index: IntArray, gap_s: float) -> dict[str, Aliased]:
    """Kind → what sampling may make of motion that is faster (rad/s, m/s², 1); index: (K,) samples of the keyframes.

    A line of vibration at a multiple of the sampling rate beats slowly with it, by up to its own amplitude. None of
    readings that are means over the whole of their interval, or filtered well below the sampling rate.
    gap_s: sample intervals that are longer than this are gaps.
    """
    out = {}
    sensors: tuple[tuple[SensorName, Array, float], ...] = (
        ("gyro", track.gyro, healthy.SCALE_SHOWS_RPS),
        ("accel", track.accel, 0.0),
    )
    for sensor, readings, least in sensors:
        how = sampling_of(track, sensor)
        averaged = (how.interval_s or 0.0) > num.MEAN_OF_INTERVAL / track.rate_hz
        if averaged or (how.corner_hz and how.corner_hz < num.ALIASED_CORNER * track.rate_hz):
            continue
        beating = _strongest_line(track, readings, gap_s)
        out[f"{sensor}_bias"] = Aliased(beating)
        of_scale = beating / max(float(np.sqrt((readings**2).sum(axis=1).mean())), least, 1e-9)
        out[f"{sensor}_scale"] = Aliased(of_scale, _attenuation(track.t, readings, index, harm.LIVELY[sensor]))
    return out


def _strongest_line(track: ImuTrack, readings: Array, gap_s: float) -> float:
    """Root mean square of the strongest line of vibration in readings (N, 3), all axes together, in their unit.

    In a spectrum over the seconds for which one may keep its sign, what is within one cell is what its mean there would
    be, were it folded onto zero. Beyond what noise makes: the largest of F exponential variables of mean 1 is
    1 + 1/2 + ... + 1/F on average. In the upper half of the band, for in the lower it may be the vehicle's own motion;
    where that is all of it, a part of how the readings scatter.
    """
    rate, length = track.rate_hz, max(round(num.BEAT_S * track.rate_hz), 2)
    f = frequencies(length, rate)
    inside = f >= max(num.VEHICLE_MOTION_HZ, num.LINES_FROM * rate)
    begin = _segments(track.t, gap_s, length, num.PSD_BATCH)
    if f[-1] - num.VEHICLE_MOTION_HZ < num.NOISE_MIN_BAND_HZ or not len(begin):
        return healthy.ALIASED * float(np.linalg.norm(between_samples(readings)))
    power = periodograms(readings, begin, rate, length)[:, inside]
    by_chance = (1.0 / np.arange(1, power.shape[1] + 1)).sum() * np.median(power, axis=1) / np.log(2.0)
    line = np.maximum(power.max(axis=1) - by_chance, 0.0).sum(axis=-1).mean()
    return float(np.sqrt(num.HANN_BANDWIDTH * rate / length * line))


def _attenuation(t: Array, readings: Array, index: IntArray, least: float) -> float:
    """By what share readings (N, 3) are smaller between samples (K,) where every other one of them is left out.

    A straight line between two samples cuts off what is faster. How much is missing of every sample is not known: it is
    less than what is missing of half of them (of white noise a third, of slow motion a quarter). The axes count that
    are moved by more than `least` (root of the mean square): of others no scale is told. A touch of the ground, which
    would outweigh all else, does not count.
    """
    even = np.unique(index // 2 * 2)
    if len(even) < num.SCATTER_MIN_DIFFERENCES or not len(t):
        return 0.0
    turned = [integrated(t[::by], readings[::by])[even // by] for by in (1, 2)]
    whole, half = (np.diff(one, axis=0) / np.diff(t[even])[:, None] for one in turned)
    shares = [0.0]
    for i in range(3):
        usual, square = _but_for_shocks(whole[:, i] ** 2), readings[:, i] ** 2
        if np.sqrt(square[_but_for_shocks(square)].mean()) > least:
            shares.append(1.0 - float((whole * half)[usual, i].sum() / (whole[usual, i] ** 2).sum()))
    return float(np.clip(max(shares), 0.0, 1.0))


def _but_for_shocks(square: Array) -> BoolArray:
    """(N,) all but the few largest."""
    return np.asarray(square <= np.quantile(square, 1.0 - num.SHOCKS_SHARE))


def relative_scatter(track: ImuTrack, t: Array, longest_s: float) -> Array:
    """(K-1, 2) the scatter of gyro and accelerometer about each interval between times t (K,) s, over its median.

    By second differences, in which steady motion cancels; of readings in whole steps no less than the steps' own noise.
    Differences across gaps longer than longest_s are left out.
    """
    middle, dt = 0.5 * (t[1:] + t[:-1]), np.diff(track.t)
    around = max(num.SCATTER_S, 0.6 * num.SCATTER_MIN_DIFFERENCES / track.rate_hz)
    whole = np.maximum(dt[1:], dt[:-1]) <= longest_s
    when = track.t[1:-1]
    first, last = (np.searchsorted(when, middle + apart) for apart in (-around, around))
    count = np.concatenate([[0], np.cumsum(whole)])
    out = np.ones((len(middle), 2))
    for column, (readings, step) in enumerate(((track.gyro, track.gyro_step), (track.accel, track.accel_step))):
        square = (np.diff(readings, n=2, axis=0) ** 2).sum(axis=1) * whole / 6.0  # of white noise: 1 + 4 + 1
        total = np.concatenate([[0.0], np.cumsum(square)])
        number = count[last] - count[first]
        variance = (total[last] - total[first]) / np.maximum(number, 1) + 3.0 * step**2 / 12.0
        known = (number >= num.SCATTER_MIN_DIFFERENCES) & (variance > 0.0)
        if known.any():
            scatter = np.sqrt(np.where(known, variance, 1.0))
            usual = np.median(scatter[known])
            out[known, column] = np.clip(scatter[known] / usual, *num.SCATTER_RANGE)
    return out
