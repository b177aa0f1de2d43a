"""Findings about an axis that reads the same while the other sensors say that the vehicle moved along it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from companion.analysis.comparison import Comparison
from companion.analysis.finding import Finding, run_edges
from companion.analysis.findings.stuck import Sensor, stuck_finding
from companion.analysis.phases import judged_at
from companion.analysis.reference import BoolArray, length
from companion.constants import check, healthy
from companion.estimation import BestEstimate, Explained, motion_between
from companion.model import Flight, ImuTrack, NoEstimateError

_AIDING = ("compass", "gps")  # that tell a turn, each with gravity


@dataclass(frozen=True, slots=True, eq=False)
class _Missed:
    """One axis that reads the same while the estimate moves along it."""

    sensor: Sensor
    axis: int
    first: int  # sample
    last: int
    size: float  # rad/s or m/s², 1σ of what it missed


def missed_findings(
    comparison: Comparison,
    best: BestEstimate,
    flight: Flight,
    smooth: Callable[[Flight], BestEstimate],
) -> Iterator[Finding]:
    """One axis that reads the same for a second or more, in which all other sensors say that it moved along that axis.

    Of a gyro two have to say so, each without the other: a compass is turned by iron and by the motors' current, and a
    healthy gyro then rightly reads zero. The gyros of the other IMUs decide where there are any. Else the gyro is to
    blame without the compass, and without GPS: each of them once with gravity alone.
    smooth: the estimate of other sensors with the same IMU.
    """
    others = [track for track in flight.imus.values() if track.instance != comparison.track.instance]
    apart: list[BestEstimate | None] = []
    for one in _missed(comparison, best, judged_at(flight, best.t)):
        if one.sensor.name == "gyro":
            meanwhile = [o for o in others if _read_throughout(o, one)]
            if meanwhile and not any(_turned_too(o, one, best) for o in meanwhile):
                continue
            if not meanwhile:
                apart = apart or [_without(aiding, best, flight, smooth) for aiding in _AIDING]
                if not all(other is not None and _blames(other, one) for other in apart):
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
    """Whether an estimate has to explain something of the gyro along an axis, in a time in which it reads the same."""
    begin, end = missed.sensor.t[missed.first], missed.sensor.t[missed.last]
    return any(
        abs(one.size[missed.axis]) > check.MISSED_CONFIRMED * np.linalg.norm(one.size)
        for one in _explained(best, "gyro", begin, end)
    )


def _explained(best: BestEstimate, sensor: str, begin: float, end: float) -> list[Explained]:
    """What was explained of a sensor between two times (s); a shock is felt for a second."""
    return [
        one
        for one in best.explained
        if one.kind.startswith(sensor)
        and one.onset < end
        and begin < (one.onset + 1.0 if one.shape == "shock" else one.end)
    ]


def _read_throughout(other: ImuTrack, missed: _Missed) -> bool:
    t = missed.sensor.t
    return other.rate_hz >= check.STUCK_RATE_HZ and other.t[0] <= t[missed.first] and other.t[-1] >= t[missed.last]


def _turned_too(other: ImuTrack, missed: _Missed, best: BestEstimate) -> bool:
    """Whether another IMU's gyro moved along an axis by half of what this one missed, between the same keyframes."""
    begin, end = missed.sensor.t[missed.first], missed.sensor.t[missed.last]
    at = best.t[(best.t >= begin) & (best.t <= end)]
    steps = np.diff(other.t) * 0.5 * (other.gyro[1:, missed.axis] + other.gyro[:-1, missed.axis])
    angle = np.interp(at, other.t, np.concatenate([[0.0], np.cumsum(steps)]))
    return float((np.diff(angle) / np.diff(at)).std()) > check.MISSED_CONFIRMED * missed.size


def _missed(comparison: Comparison, best: BestEstimate, judged: BoolArray) -> Iterator[_Missed]:
    """Axes that read the same while the estimate moves along them by far more than they miss elsewhere.

    Only where something of that sensor had to be explained: a shock, or noise, which accuse nobody; but they move every
    reading. judged: (K,) keyframes in the air: on the ground a sensor without noise rightly reads the same.
    """
    track = comparison.track
    sensors = {one.kind.partition("_")[0] for one in best.explained} & {"gyro", "accel"}
    if track.rate_hz < check.STUCK_RATE_HZ or not sensors:
        return
    for name, (moved, read) in zip(("gyro", "accel"), motion_between(best), strict=True):
        if name not in sensors:
            continue
        sensor, missed = Sensor(track, name), moved - read
        for axis in range(3):
            first, last = run_edges(np.asarray(sensor.same[:, axis]))
            for i in np.flatnonzero(track.t[last + 1] - track.t[first] > healthy.STUCK_S):
                begin, end = float(track.t[first[i]]), float(track.t[last[i] + 1])
                inside = (best.t[:-1] >= begin) & (best.t[1:] <= end) & judged[:-1] & judged[1:]
                few = min(inside.sum(), (~inside).sum()) < check.MISSED_MIN
                if few or not _explained(best, name, begin, end):
                    continue
                # Its variation, for a bias is missed all the time.
                size, usual = (missed[part].std(axis=0) for part in (inside, ~inside))
                alone = size[axis] > check.MISSED_ALONG * length(size)
                if alone and size[axis] > max(check.SOME_STEPS * sensor.step, check.MISSED_BEYOND_USUAL * usual[axis]):
                    yield _Missed(sensor, axis, int(first[i]), int(last[i]) + 1, float(size[axis]))
