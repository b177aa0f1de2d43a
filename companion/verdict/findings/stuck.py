"""Findings about an axis, or a whole sensor, that reads the same while the vehicle moves.

Also here: findings about an axis that reads the same while the other sensors say that the vehicle moved along it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from companion.comparison import (
    Comparison,
    Span,
    down_in_body,
    judged_at,
    length,
    run_edges,
    standing_still,
    turn_between,
    unchanged,
    within,
)
from companion.constants import check, harm, healthy, priors
from companion.estimation import BestEstimate, Explained, motion_between
from companion.model import (
    STANDARD_GRAVITY,
    Array,
    BoolArray,
    Flight,
    ImuTrack,
    IntArray,
    NoEstimateError,
    nearest,
)
from companion.verdict.finding import Cause, Finding
from companion.verdict.findings.readings import beside, by_second, evened, never_repeats, read_by, swing, turns_back


class Sensor:
    """A gyro or an accelerometer: what changes from sample to sample."""

    def __init__(self, track: ImuTrack, name: str) -> None:
        self.t, self.rate_hz, self.name = track.t, track.rate_hz, name
        self.window_s = still_window_s(track)
        self.readings, self.step = read_by(track, name)
        self.change = np.abs(np.diff(self.readings, axis=0))  # (N-1, 3)
        self.same = unchanged(self.readings)  # (N-1, 3)


def still_window_s(track: ImuTrack) -> float:
    """How long are the windows in which it is sought whether a track stands still, s: slow ones show few samples."""
    return max(1.0, check.STUCK_SAMPLES / track.rate_hz)


@dataclass(frozen=True, slots=True, eq=False)
class _Axes:
    """Some axes of a sensor that stop together, and those beside them that go on."""

    sensor: Sensor
    axes: tuple[int, ...]  # one of them, beside its neighbours; or all three, beside the other sensor
    same: BoolArray  # (N-1,) where none of them changes
    beside: Array  # (N-1, m) changes of those beside them
    beside_same: BoolArray  # (N-1, m)


def _all_axes(track: ImuTrack) -> Iterator[_Axes]:
    """Each axis of each sensor, and each sensor as a whole."""
    sensors = Sensor(track, "gyro"), Sensor(track, "accel")
    for one, other in (sensors, sensors[::-1]):
        for axis in range(3):
            rest = [i for i in range(3) if i != axis]
            yield _Axes(one, (axis,), one.same[:, axis], one.change[:, rest], one.same[:, rest])
        yield _Axes(one, (0, 1, 2), np.asarray(one.same.all(axis=1)), other.change, other.same)


def stuck_findings(
    comparison: Comparison,
    imus: Collection[ImuTrack],
    sensors: Collection[str] = ("gyro", "accel"),
    armed: BoolArray | None = None,
) -> Iterator[Finding]:
    """An axis that reads the same for half a second or more while its neighbours go on and the vehicle moves about it.

    Or all three of a sensor, while the other sensor goes on. What shows noise in every second is stuck when it stops.
    All else takes a second, and nothing is stuck at rest: whole milli-units read the same for long when nothing
    happens. Another IMU has to move along it, as it does where this one is seldom still; a finer message of this one
    must not go on. An accelerometer that does not even feel its weight needs no other.
    imus: all of the flight. armed: (N,) at the samples of the track; None where that is not known. Once the motors have
    stopped, what they shook stands still, in a fall too: a simulated sensor has no noise of its own.
    """
    track = comparison.track
    stopped = np.zeros(len(track), np.bool_) if armed is None else np.logical_or.accumulate(armed) & ~armed
    others = [one for one in imus if one.instance != track.instance]
    same = [one for one in imus if one.instance == track.instance and one.source != track.source]
    for axes in (one for one in _all_axes(track) if one.sensor.name in sensors):
        for first, last in _stopped(comparison, others, axes):
            stretch = slice(first, last + 1)
            if not stopped[stretch].all() and not any(_only_rounded(axes, stretch, finer) for finer in same):
                yield stuck_finding(axes.sensor, axes.axes, first, last)


def stuck_finding(sensor: Sensor, axes: tuple[int, ...], first: int, last: int) -> Finding:
    name, axis, what = sensor.name, "xyz"[axes[0]], "lost an axis"
    start, end = float(sensor.t[first]), float(sensor.t[last])
    reads = ", ".join(f"{value:.4g}" for value in sensor.readings[first, axes])
    unit = "rad/s" if name == "gyro" else "m/s²"
    evidence = f"{name} {axis} reads {reads} {unit} for {end - start:.1f} s while the other axes go on"
    if len(axes) == 3:
        other, axis, what = "accel" if name == "gyro" else "gyro", "", "stopped"
        evidence = f"{name} reads ({reads}) {unit} for {end - start:.1f} s while the {other} goes on"
    advice = f"The sensor or its driver has {what}: do not fly on it. Look at its wiring and driver."
    cause = Cause("stuck_axis", "imu", start, end, sensor=name, axis=axis)
    return Finding("stuck_axis", "imu", "error", start, end, evidence, advice, cause=cause)


def _only_rounded(axes: _Axes, stretch: slice, finer: ImuTrack) -> bool:
    """Whether axes that seem stuck are read by a finer message of the same IMU, which goes on within their step."""
    sensor, chosen, t = axes.sensor, list(axes.axes), axes.sensor.t[stretch]
    meanwhile, finer_step = read_by(finer, sensor.name)
    during = within(finer.t, (t[0], t[-1]))
    if finer_step >= sensor.step or during.sum() <= check.STUCK_MIN_SAMPLES:
        return False
    goes_on = not unchanged(meanwhile[during])[:, chosen].all(axis=0).any()
    apart = np.abs(meanwhile[during] - sensor.readings[nearest(sensor.t, finer.t[during])])[:, chosen]
    return goes_on and bool((apart <= sensor.step).all(axis=1).mean() >= check.STUCK_KNOWN)


def _stopped(comparison: Comparison, others: Sequence[ImuTrack], axes: _Axes) -> Iterator[tuple[int, int]]:
    """First and last sample of the stretches in which some axes are stuck."""
    sensor, known = axes.sensor, comparison.reference.attitude_known
    first, last = run_edges(axes.same & ~comparison.gaps)
    lasted = sensor.t[last + 1] - sensor.t[first]
    stuck_s = healthy.STUCK_S * sensor.window_s
    even = np.flatnonzero(lasted > healthy.FROZEN_S * sensor.window_s)
    if not len(even):
        return
    change = sensor.change[:, axes.axes].max(axis=1)
    elsewhere = beside(len(change), first[even], last[even])
    samples = sensor.rate_hz * sensor.window_s
    noisy = len(axes.axes) == 1 and turns_back(np.diff(sensor.readings[:, axes.axes[0]])[elsewhere], samples)
    restless = never_repeats(axes.same[elsewhere], samples)
    if sensor.step and len(axes.axes) == 1:  # a turn changes whole steps too, and need not go on
        restless &= noisy
    quietest = 0.0 if sensor.step else _quietest(change[elsewhere], samples)
    usual = np.median(axes.beside, axis=0)
    spreads = _beside_others(axes, others) if sensor.step and (lasted > stuck_s).any() else []
    for i in even:
        stretch = slice(int(first[i]), int(last[i]) + 2)
        goes_on = axes.beside_same[stretch].all(axis=1).mean() <= check.BESIDE  # else it is the whole sensor, or all
        if goes_on and any(_never_so_still(windows, sensor.t[first[i]], sensor.t[last[i] + 1]) for windows in spreads):
            yield stretch.start, stretch.stop - 1
            continue
        if axes.beside_same[stretch].mean(axis=0).max() > check.BESIDE:
            continue
        changes = slice(stretch.start, stretch.stop - 1)
        # a correction that drifts with the heat is taken off what is stuck, too
        silent = noisy and change[changes].mean() < check.STUCK_QUIETER * quietest
        if not silent and _goes_somewhere(sensor.readings[stretch, axes.axes]):
            continue
        reads = np.abs(sensor.readings[stretch.start, axes.axes]).max()
        # a low-pass takes its time to settle
        flickers = not silent and np.quantile(change[changes], 0.9) > check.FLOAT32_BIT * reads
        # the motors shake all axes: where another one is calm too, none need show any noise
        calm = (np.median(axes.beside[changes], axis=0) < check.STUCK_CALM * usual).any()
        if flickers or calm or not restless:
            # while it goes on, the newest readings are newer than the autopilot's newest attitude
            if lasted[i] <= stuck_s or known[stretch].mean() < check.STUCK_KNOWN:
                continue
            if sensor.step and not (_feels_no_weight(axes, stretch) or _another_moved(others, axes, stretch)):
                continue
            if not sensor.step and not _is_quieter_than_ever(comparison, axes, change[changes], stretch, quietest):
                continue
        yield stretch.start, stretch.stop - 1


def _goes_somewhere(readings: Array) -> bool:
    """Whether readings (n, m) get further in the second half of a stretch than what flickers in its place."""
    later = readings[len(readings) // 2 :]
    return bool((np.ptp(later, axis=0) > check.STUCK_FAR * np.abs(np.diff(later, axis=0)).mean(axis=0)).any())


def _is_quieter_than_ever(comparison: Comparison, axes: _Axes, change: Array, stretch: slice, quietest: float) -> bool:
    """Whether axes change far less in a stretch of samples than in their quietest seconds, though the vehicle moves.

    change: (n,) from sample to sample in the stretch. Only while it turns, or is tilted away, for half of it or more:
    at rest nothing changes, a simulated sensor has no noise of its own, and an aligned heading is a step. And a gyro's
    only where they do not read what it turns.
    """
    sensor, q = axes.sensor, comparison.reference.at(np.arange(len(comparison.track))[stretch]).q_ned_frd
    down, span = down_in_body(q), max(1, round(check.TURN_PART * len(q)))
    turned = turn_between(q[:-span], q[span:])
    moves = max(np.median(length(np.cross(down, down[:1]))), np.median(length(turned))) >= harm.MOVED_RAD
    if sensor.name == "gyro":
        lasted = sensor.t[stretch][span:] - sensor.t[stretch][:-span]
        missed = np.abs(turned - sensor.readings[stretch].mean(axis=0) * lasted[:, None])
        moves &= np.quantile(missed[:, axes.axes].max(axis=1), check.STUCK_MISSED) >= harm.MOVED_RAD
    return bool(moves) and float(change.mean()) < check.STUCK_QUIETER * quietest


def _quietest(change: Array, rate_hz: float) -> float:
    """How little an axis changes from sample to sample (n,) in its quietest seconds; infinite where these are few."""
    seconds = by_second(change, rate_hz).mean(axis=1)
    return float(np.percentile(seconds, 5.0)) if len(seconds) >= check.MIN_SECONDS else np.inf


def _feels_no_weight(axes: _Axes, stretch: slice) -> bool:
    """Whether a whole accelerometer reads less than half of gravity, the same all the while: what falls so is shaken.

    No other sensor has to say that there was something to be felt.
    """
    force = length(axes.sensor.readings[stretch])
    whole = axes.sensor.name == "accel" and len(axes.axes) == 3
    return whole and bool((force < STANDARD_GRAVITY / check.UNIT_MIN_FACTOR).all())


def _another_moved(others: Sequence[ImuTrack], axes: _Axes, stretch: slice) -> bool:
    """Whether another IMU moved along an axis that reads the same whole steps, or along two of a whole sensor.

    In steady flight nothing changes, and the autopilot, whose attitude says what was to be felt, may be wrong itself.
    """
    sensor, fewest = axes.sensor, min(2, len(axes.axes))
    t = sensor.t[stretch]
    for other in others:
        meanwhile = read_by(other, sensor.name)[0][within(other.t, (t[0], t[-1]))]
        if len(meanwhile) > check.STUCK_MIN_SAMPLES:
            # what changed: a bias may step between its usual reading and this one, and a scale makes another level
            swings = np.array([swing(evened(meanwhile[:, i], check.TURN_PART)) for i in axes.axes])
            if (swings >= check.SOME_STEPS * sensor.step).sum() >= fewest:
                return True
    return False


@dataclass(frozen=True, slots=True, eq=False)
class _Windows:
    """Whole or half seconds, longer for slow readings, and how far an axis of two IMUs moves in each of them."""

    length: float  # s
    start: Array  # (S,) s, boot clock
    own: Array  # (S,) largest reading minus smallest
    other: Array  # (S,) in steps of both


def _beside_others(axes: _Axes, others: Sequence[ImuTrack]) -> list[_Windows]:
    """Some axes beside the same ones of every other IMU.

    Only windows in which one of the other's moves by more than a step of each: what moves less can be read as one whole
    step, or none, for as long as it lies in the middle of one. And by means over a while, less what the noise of its
    quietest windows makes of these: its noise is none of this one's.
    """
    sensor, chosen = axes.sensor, list(axes.axes)
    out = []
    for track, part in itertools.product(others, (1.0, healthy.FROZEN_S)):  # of a second: a slow turn takes it whole
        window = part * max(sensor.window_s, still_window_s(track))
        start, own = _spread_by_window(sensor.t, sensor.readings[:, chosen], window)
        readings, step = read_by(track, sensor.name)
        span = max(1, round(check.MOTION_MEAN_S * window * track.rate_hz))
        means = np.column_stack([evened(readings[:, axis], span / len(track)) for axis in chosen])
        when, other = _spread_by_window(track.t[len(track) - len(means) :], means, window)
        changes = by_second(np.abs(np.diff(readings[:, chosen], axis=0)).max(axis=1), window * track.rate_hz)
        noise = float(np.percentile(changes.mean(axis=1), 5.0)) if len(changes) else 0.0
        steps = np.maximum(other - check.NOISE_RANGE * noise / np.sqrt(span), 0.0) / (sensor.step + step)
        moved = steps > check.STEP_ROUNDING
        both, i, j = np.intersect1d(start, when[moved], assume_unique=True, return_indices=True)
        out.append(_Windows(window, window * both.astype(np.float64), own[i], steps[moved][j]))
    return out


def _spread_by_window(t: Array, readings: Array, window: float) -> tuple[IntArray, Array]:
    """The windows (S,) in which there are readings (n, m), and how far the liveliest of these goes in each (S,)."""
    windows, first = np.unique(np.floor(t / window).astype(np.intp), return_index=True)
    spread = np.maximum.reduceat(readings, first, axis=0) - np.minimum.reduceat(readings, first, axis=0)
    return windows, spread.max(axis=1)


def _never_so_still(windows: _Windows, begin: float, end: float) -> bool:
    """Whether an axis does not read the same from begin to end (s) by chance, of a flight of so many windows.

    The odds of each are told by the others in which another IMU moves along the axis as it does, or half as far:
    at rest, and where a vehicle turns about other axes alone, this one stands still in most of them. By Laplace's rule
    of succession, where what moves by m steps counts as m more in which it did not stand still.
    """
    during = (windows.start >= begin) & (windows.start + windows.length <= end)
    if not during.any():
        return False
    steps, order = windows.other[during], np.argsort(windows.other[~during])
    others, still = windows.other[~during][order], windows.own[~during][order] == 0
    first, last = np.searchsorted(others, 0.5 * steps), np.searchsorted(others, steps, side="right")
    stood = np.concatenate([[0], np.cumsum(still)])
    log_p = np.log((1.0 + stood[last] - stood[first]) / (2.0 + last - first + steps)).sum()
    return bool(np.log(len(windows.start)) + log_p < np.log(priors.FALSE_ALARM))


_AIDING = ("compass", "gps")  # that tell a turn, each with gravity


@dataclass(frozen=True, slots=True, eq=False)
class _Missed:
    """One axis that reads the same while the estimate moves along it."""

    sensor: Sensor
    axis: int
    first: int  # sample
    last: int
    size: float  # rad/s or m/s², 1σ of what it missed

    @property
    def span(self) -> Span:
        """From when to when, s."""
        return float(self.sensor.t[self.first]), float(self.sensor.t[self.last])


def missed_findings(
    comparison: Comparison, best: BestEstimate, flight: Flight, smooth: Callable[[Flight], BestEstimate]
) -> Iterator[Finding]:
    """One axis that reads the same for a second or more, in which all other sensors say that it moved along that axis.

    Of a gyro two have to say so, each without the other: a compass is turned by iron and by the motors' current, and a
    healthy gyro then rightly reads zero. The gyros of the other IMUs decide where there are any. Else the gyro is to
    blame without the compass, and without GPS: each of them once with gravity alone.
    smooth: the estimate of other sensors with the same IMU.
    """
    others = [track for track in flight.imus.values() if track.instance != comparison.track.instance]
    apart = cache(lambda aiding: _without(aiding, best, flight, smooth))
    for one in _missed(comparison, best, judged_at(flight, best.t)):
        if one.sensor.name == "gyro":
            begin, end = one.span
            meanwhile = [o for o in others if o.t[0] <= begin and o.t[-1] >= end]
            if meanwhile and not any(_turned_too(o, one, best) for o in meanwhile):
                continue
            if not meanwhile and not all((own := apart(aiding)) and _blames(own, one) for aiding in _AIDING):
                continue
        yield stuck_finding(one.sensor, (one.axis,), one.first, one.last)


def _without(
    aiding: str, best: BestEstimate, flight: Flight, smooth: Callable[[Flight], BestEstimate]
) -> BestEstimate | None:
    """The estimate without an aiding sensor; None where it had no such sensor, or where none is left without it."""
    if not any(name.startswith(aiding) for name in best.residuals):
        return None
    try:
        return smooth(replace(flight, compasses=()) if aiding == "compass" else replace(flight, gps=()))
    except NoEstimateError:
        return None


def _blames(best: BestEstimate, missed: _Missed) -> bool:
    """Whether an estimate moves along an axis too, or explains something of the gyro, while that reads the same."""
    sizes = [one.size for one in _explained(best, "gyro", *missed.span)]
    if any(abs(size[missed.axis]) > check.MISSED_CONFIRMED * np.linalg.norm(size) for size in sizes):
        return True
    (moved, read), _ = motion_between(best)
    inside = (best.t[:-1] >= missed.span[0]) & (best.t[1:] <= missed.span[1])
    return _size_missed(moved - read, inside, missed.axis, missed.sensor.step) is not None


def _size_missed(off: Array, inside: BoolArray, axis: int, step: float) -> float | None:
    """1σ of what readings miss along an axis inside, of what they are off by (K-1, 3); None where it is no more than
    elsewhere, or along other axes too. Its variation, for a bias is missed all the time.
    """
    if min(inside.sum(), (~inside).sum()) < check.MISSED_MIN:
        return None
    size, usual = (off[part].std(axis=0) for part in (inside, ~inside))
    least = max(check.SOME_STEPS * step, check.MISSED_BEYOND_USUAL * usual[axis])
    alone = size[axis] > check.MISSED_ALONG * length(size)
    return float(size[axis]) if alone and size[axis] > least else None


def _explained(best: BestEstimate, sensor: str, begin: float, end: float) -> list[Explained]:
    """What was explained of a sensor between two times (s); a shock is felt for a second."""
    begun = [one for one in best.explained if one.kind.startswith(sensor) and one.onset < end]
    return [one for one in begun if begin < (one.onset + 1.0 if one.shape == "shock" else one.end)]


def _turned_too(other: ImuTrack, missed: _Missed, best: BestEstimate) -> bool:
    """Whether another IMU's gyro moved along an axis by half of what this one missed, between the same keyframes."""
    at = best.t[within(best.t, missed.span)]
    steps = np.diff(other.t) * 0.5 * (other.gyro[1:, missed.axis] + other.gyro[:-1, missed.axis])
    angle = np.interp(at, other.t, np.concatenate([[0.0], np.cumsum(steps)]))
    return float((np.diff(angle) / np.diff(at)).std()) > check.MISSED_CONFIRMED * missed.size


def any_stands_still(comparison: Comparison, flight: Flight) -> bool:
    """Whether an axis of a sensor reads exactly the same for so long in the air that it may be stuck."""
    track, judged = comparison.track, judged_at(flight, comparison.track.t)
    least_s = healthy.STUCK_S * still_window_s(track)
    return any(
        judged[first] and judged[last]
        for readings in (track.gyro, track.accel)
        for same in (readings[1:] == readings[:-1]).T
        for first, last in standing_still(same, track.t, least_s)
    )


def _missed(comparison: Comparison, best: BestEstimate, judged: BoolArray) -> Iterator[_Missed]:
    """Axes that read the same while the estimate moves along them by far more than they miss elsewhere.

    Only where something of that sensor had to be explained: a shock, or noise, which accuse nobody; but they move every
    reading. judged: (K,) keyframes in the air: on the ground a sensor without noise rightly reads the same.
    """
    track = comparison.track
    sensors = {one.kind.partition("_")[0] for one in best.explained} & {"gyro", "accel"}
    if not sensors:
        return
    for name, (moved, read) in zip(("gyro", "accel"), motion_between(best), strict=True):
        if name not in sensors:
            continue
        sensor, missed = Sensor(track, name), moved - read
        for axis in range(3):
            for first, last in standing_still(sensor.same[:, axis], track.t, healthy.STUCK_S * sensor.window_s):
                begin, end = float(track.t[first]), float(track.t[last])
                inside = (best.t[:-1] >= begin) & (best.t[1:] <= end) & judged[:-1] & judged[1:]
                if not _explained(best, name, begin, end):
                    continue
                if (size := _size_missed(missed, inside, axis, sensor.step)) is not None:
                    yield _Missed(sensor, axis, first, last, size)
