"""Findings about shaking: as the vehicle measures it, as the samples show it, and as noise beyond the data sheet.

Also here: findings about an axis that becomes noisier for a while, beside its neighbours and beside itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import NormalDist

import numpy as np

from companion.comparison import Comparison, Expected, FlightDensity, ImuSpec, ends_of, runs
from companion.constants import check, harm, healthy, priors
from companion.model import STANDARD_GRAVITY, Array, BoolArray, Flight, ImuTrack, Series, counted, of_kind
from companion.noise import clip_counters, vibration
from companion.verdict.fault_interval import SENSOR_WORDS
from companion.verdict.finding import Cause, Finding, Severity
from companion.verdict.findings.readings import read_by


def noisier_findings(track: ImuTrack, others: Sequence[ImuTrack], changes: Sequence[float] = ()) -> Iterator[Finding]:
    """One axis of a sensor that is noisier for 6 s or more than at any other time, while its neighbours are not.

    Its noise is that between samples, from fourth differences, which no manoeuvre moves. The test statistic is the
    logarithm of its ratio to that of the noisier neighbour: shaking and motors change all axes of a sensor. Among B
    blocks of 2 s it scatters with a standard deviation that the other blocks tell, so that its excess has Student's t
    distribution; over all six axes and all blocks nothing is said by chance in 999 of 1000 flights of an IMU in order.

    A resonance may shake one axis too: only an IMU beside it, which does not feel it, makes it the sensor's fault.
    changes: s, in order, between which it is compared with itself: motors shake the axes of a sensor unequally.
    """
    for name in ("gyro", "accel"):
        start, whole = _levels(track, name)
        for since, until in pairwise([-np.inf, *changes, np.inf]):
            at = int(np.searchsorted(start[:-1], since))
            level = whole[at : max(at, int(np.searchsorted(start, until, side="right")) - 1)]
            for axis in range(3):
                for first, last in _noisier(level, axis):
                    begin, end = float(start[at + first]), float(start[at + last + 1])
                    factor = float(np.exp(np.median(level[first : last + 1, axis]) - np.median(level[:, axis])))
                    yield _finding(name, axis, begin, end, factor, _alone(name, axis, begin, end, others))


def _levels(track: ImuTrack, name: str) -> tuple[Array, Array]:
    """Start of each block (B+1,) s, the end of the last with them, and log of the noise (1σ) of each axis (B, 3)."""
    readings, step = read_by(track, name)
    size = max(check.NOISIER_BLOCK, round(check.NOISIER_BLOCK_S * track.rate_hz))
    changes = np.diff(readings, check.NOISIER_ORDER, axis=0)
    blocks = len(changes) // size
    if blocks < 1:
        return track.t[:1], np.zeros((0, 3))
    squares = changes[: blocks * size].reshape(blocks, size, 3) ** 2
    variance = squares.mean(axis=1) / check.NOISIER_GAIN + step**2 / 12.0
    return track.t[: blocks * size + 1 : size], 0.5 * np.log(np.maximum(variance, 1e-300))


def _noisier(level: Array, axis: int) -> Iterator[tuple[int, int]]:
    """First and last block of stretches in which the noise (log, (B, 3)) of an axis has no chance to be usual."""
    if len(level) < check.NOISIER_OTHERS + check.NOISIER_MIN_BLOCKS:
        return
    own, ratio = level[:, axis], level[:, axis] - np.delete(level, axis, axis=1).max(axis=1)
    doubled = [one > np.median(one) + np.log(2.0) for one in (own, ratio)]  # a quiet neighbour doubles the ratio alone
    for i, j in runs(np.logical_and(*doubled)):
        outside = np.ones(len(level), np.bool_)
        outside[max(i - 1, 0) : j + 2] = False
        stretch = _longest(level, axis, slice(i, j + 1), outside)
        # from the start on it became nothing
        if stretch is None or outside.sum() < check.NOISIER_OTHERS or stretch[0] == 0:
            continue
        begin, end = stretch
        others = ratio[outside]
        spread = max(float(others.std(ddof=1)), check.NOISIER_MIN_SPREAD) * np.sqrt(1.0 + 1.0 / len(others))
        excess = (float(ratio[begin : end + 1].min()) - float(others.mean())) / spread
        if _tail(excess, len(others) - 1) * 6 * len(level) < priors.FALSE_ALARM:
            yield begin, end


def _longest(level: Array, axis: int, part: slice, outside: BoolArray) -> tuple[int, int] | None:
    """The longest stretch in a part of the blocks in which the axis is noisier than in any block outside."""
    if not outside.any():
        return None
    noisier = runs(np.asarray(level[part, axis] > level[outside, axis].max()))
    first, last = max(noisier, key=lambda run: run[1] - run[0], default=(0, -1))
    long = last - first + 1 >= check.NOISIER_MIN_BLOCKS
    return (part.start + first, part.start + last) if long else None


def _tail(t: float, freedom: int) -> float:
    """P(T > t) of Student's t distribution, by the approximation of D. L. Wallace (1959)."""
    z = (8.0 * freedom + 1.0) / (8.0 * freedom + 3.0) * np.sqrt(freedom * np.log1p(t * t / freedom))
    return NormalDist().cdf(-float(z)) if t > 0.0 else 1.0


def _alone(name: str, axis: int, begin: float, end: float, others: Sequence[ImuTrack]) -> bool:
    """Whether another IMU tells of that time, and the same axis of none is noisier then."""
    levels, fewest = [_levels(other, name) for other in others], check.NOISIER_OTHERS + check.NOISIER_MIN_BLOCKS
    told = [
        (start, level) for start, level in levels if len(level) >= fewest and start[0] <= begin and start[-1] >= end
    ]
    noisier = (start[i] < end and start[j + 1] > begin for start, level in told for i, j in _noisier(level, axis))
    return bool(told) and not any(noisier)


def _finding(name: str, axis: int, begin: float, end: float, factor: float, alone: bool) -> Finding:
    kind = f"{name}_noise"
    words = f"{SENSOR_WORDS[name]} {'xyz'[axis]} is {factor:.0f} times noisier than usual, and its other axes are not"
    advice = "Look at its power and wiring, or what was loose at that time; a second IMU in the log tells which."
    if alone:
        cause = Cause(kind, "imu", begin, end, sensor=name, axis="xyz"[axis])
        return Finding(kind, "imu", "error", begin, end, words, advice, cause=cause)
    words += "; a resonance about one axis does this too"
    return Finding(kind, "imu", "warning", begin, end, words, advice, undecided=True)


@dataclass(frozen=True, slots=True)
class Clips:
    """One counter of a vehicle over a flight."""

    column: str
    readings: float  # by how much it grew
    start_s: float  # boot clock, where it began to grow, and where it ended; the first sample for both where it did not
    end_s: float


def clip_counts(series: Series) -> Iterator[Clips]:
    """Every counter of a "vibration" series that the vehicle tells."""
    for name, t, clipped in clip_counters(series):
        at = np.flatnonzero(np.diff(clipped))
        first, last = (at[0], at[-1] + 1) if len(at) else (0, 0)
        yield Clips(name, float(clipped[-1]), float(t[first]), float(t[last]))


def vibration_findings(comparison: Comparison, flight: Flight) -> Iterator[Finding]:
    """How strongly the vehicle shakes, m/s² as ArduPilot's VIBE defines it: what is above 5 Hz, root mean square.

    The vehicle's own VIBRATION or VIBE is from the IMU at its full rate. Without it, the samples say the least that it
    can be.
    """
    reported = False
    for series in of_kind(flight.series, "vibration"):
        if "x_mps2" in series.columns and len(series):
            reported = True
            yield from _level(series.t, series.values[:, :3], series.source, harm.VIBRATION_HIGH)
        yield from _clips(series)
    level = vibration(comparison.track, comparison.how.limits.longest_step(comparison.track.t))
    if not reported and level is not None:
        yield from _level(
            level.t, level.accel, f"what the samples of {comparison.track.source} show of it", harm.VIBRATION_SAMPLED
        )


def _level(t: Array, each: Array, source: str, high: float) -> Iterator[Finding]:
    each = np.where(np.isfinite(each), each, 0.0)  # an axis that is not told
    worst = each.max(axis=1)
    strong = worst > high
    if strong.mean() < 0.05:
        return
    usual, most = np.percentile(worst[strong], [50, 100])
    severity: Severity = "warning" if most > harm.VIBRATION_LIMIT or high < harm.VIBRATION_HIGH else "info"
    x, y, z = np.median(each[strong], axis=0)
    more = "" if high == harm.VIBRATION_HIGH else "; the vehicle shakes more than they show"
    shakes = f"vibration {usual:.0f} m/s² typical, {most:.0f} peak (limit {harm.VIBRATION_LIMIT:.0f}), by {source}"
    evidence = f"{shakes}: x {x:.0f}, y {y:.0f}, z {z:.0f}{more}"
    damp = "Balance propellers and motors, and damp the mounting of the autopilot."
    advice = f"{damp} Shaking that the samples fold down looks like motion."
    yield Finding("vibration", "imu", severity, *ends_of(t[strong]), evidence, advice)


def _clips(series: Series) -> Iterator[Finding]:
    """Counts of readings at the end of the range, which the vehicle takes at its full rate."""
    advice = "Damp the mounting: clipped samples are lost and add drift."
    for one in clip_counts(series):
        if one.readings:
            readings, counter = counted(round(one.readings), "reading"), f"{series.source}, {one.column}"
            evidence = f"{readings} at the end of the accelerometer's range ({counter})"
            yield Finding("clipping_counted", "imu", "warning", one.start_s, one.end_s, evidence, advice)


def noise_findings(
    comparison: Comparison, measured: FlightDensity, imu: ImuSpec, allowed: Expected | None
) -> Iterator[Finding]:
    """Readings far noisier than the data sheet: vibration, or a simulator that shakes.

    A warning where it limits what the verdict can tell: where it is the dominant source of the expected drift.
    """
    track = comparison.track
    for name, density, sheet, factor, unit, quantity in (
        ("gyro", measured.gyro, imu.gyro.noise_density, 1e3 * np.degrees(1.0), "mdps/√Hz", "attitude"),
        ("accel", measured.accel, imu.accel.noise_density, 1e6 / STANDARD_GRAVITY, "µg/√Hz", "velocity"),
    ):
        if density is None or density <= healthy.NOISE_OVER_DATA_SHEET * sheet:
            continue
        shares = allowed.shares.get(quantity, {}) if allowed else {}
        kind = f"{name}_noise"
        limits = max(shares, key=lambda cause: shares[cause], default="") == kind
        times = f"{density / sheet:.0f} times the {sheet * factor:.3g} of {imu.name}"
        evidence = f"noise of {density * factor:.0f} {unit} in flight, {times}"
        advice = "Vibration reaches the sensor: check vibration levels and damping. The verdict takes it into account."
        yield Finding(kind, "imu", "warning" if limits else "info", *ends_of(track.t), evidence, advice)
