"""The seconds around what went wrong: what the sensors did, what the estimator believed, what was desired and achieved.

A moment is the first loss of control or crash, else a failsafe, else the onset of the verdict's cause, else a lane
switch.

Also here: why control was lost: every cause by the evidence for and against it, each with its probability, none forced.
Naive Bayes over the table `priors.INCIDENT`: what each cause shows of each kind of evidence. The sensors and the
estimator count by the probability that the verdict gives them before the moment. Evidence that the log lacks counts for
nobody, and "none of these" is always among them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from companion.comparison import down_in_body, in_the_air, length, phases, window, within
from companion.constants import check, harm, priors
from companion.estimation import AIDING
from companion.model import DataError, Flight, ImuTrack
from companion.verdict.assessment import Assessment
from companion.verdict.findings.detect import output_name

MomentKind = Literal["requested", "loss_of_control", "failsafe", "cause", "lane_switch"]


@dataclass(frozen=True, slots=True)
class Moment:
    """What the page is about."""

    t: float  # s, boot clock
    kind: MomentKind
    text: str  # untrusted


@dataclass(frozen=True, slots=True)
class TimelineRow:
    """Something that was announced or happened. The text is untrusted."""

    after_s: float  # s, after the moment; negative before it
    what: str  # "text", "mode", "armed", "error", "reset", "lane", "parameter", "finding"
    text: str


@dataclass(frozen=True, slots=True)
class Reached:
    """What one IMU read at most in the window."""

    imu: str
    rate: float  # rad/s, length of the rate
    force: float  # m/s², length of the specific force
    rate_before: float  # in the part before the moment
    force_before: float


@dataclass(frozen=True, slots=True)
class Tracking:
    """Desired against achieved attitude: the angle between both third axes, rad."""

    before: float  # median, up to two seconds before the moment
    worst: float  # at most, from then on
    worst_s: float  # s, after the moment
    left_s: float | None  # s, after the moment, from when on it was beyond half of what overturns; None: never
    desired: float  # rad, the greatest tilt that was desired in the two seconds before


@dataclass(frozen=True, slots=True)
class Output:
    """A motor or servo that stood at an end of its range about the moment, and seldom before."""

    name: str
    end: Literal["full", "zero"]
    since_s: float  # s, after the moment
    usual: float  # share of its range, before


@dataclass(frozen=True, slots=True, eq=False)
class Incident:
    """All that is known of one moment."""

    moment: Moment
    start_s: float  # boot clock, the window
    end_s: float
    causes: tuple[ProbableCause, ...]  # the likeliest first; together 1
    timeline: tuple[TimelineRow, ...]
    imus: tuple[Reached, ...]
    tracking: Tracking | None  # None: no desired attitude in the log
    outputs: tuple[Output, ...]
    missing: tuple[str, ...]  # what is not in the log


def moments(flight: Flight, assessment: Assessment | None) -> tuple[Moment, ...]:
    """Everything that a page could be about, the most serious kind first, each in order of time."""
    lost = [Moment(p.start, "loss_of_control", p.reason) for p in phases(flight) if p.kind == "impact"]
    failsafes = [Moment(e.t, "failsafe", e.text) for e in flight.events if e.kind == "error" and "failsafe" in e.text]
    errors = [] if assessment is None else [f for f in assessment.verdict.findings if f.severity == "error"]
    causes = [Moment(f.cause.onset_s, "cause", f.headline or f.evidence) for f in errors if f.cause is not None]
    lanes = [Moment(r.t, "lane_switch", r.text) for r in flight.resets if r.kind == "lane"]
    return tuple(one for kind in (lost, failsafes, causes, lanes) for one in sorted(kind, key=lambda m: m.t))


def incident(flight: Flight, assessment: Assessment | None, at: float | None = None) -> Incident:
    """What happened about a moment: at a boot time (s), else at the most serious. Raises DataError without any."""
    begin, end = flight.start, flight.start + flight.duration
    every = moments(flight, assessment)
    if at is not None:
        if not begin <= at <= end:
            raise DataError(f"--at {at:g}: the flight is from {begin:.1f} to {end:.1f} s after boot.")
        near = next((m for m in every if abs(m.t - at) <= check.SUDDEN_S), Moment(at, "requested", "as requested"))
        moment = replace(near, t=at)
    elif every:
        moment = every[0]
    else:
        nothing = "nothing went wrong in this log: no loss of control, failsafe, fault or lane switch"
        raise DataError(f"{nothing}. Name a time with --at SECONDS (boot clock).")
    start, stop = max(begin, moment.t - check.INCIDENT_BEFORE_S), min(end, moment.t + check.INCIDENT_AFTER_S)
    tracking, outputs = _tracking(flight, moment.t, stop), tuple(_outputs(flight, moment.t, stop))
    lost = moment.kind == "loss_of_control" or (tracking is not None and tracking.left_s is not None)
    causes = of_loss(flight, assessment, moment.t, tracking, outputs) if lost else of_verdict(assessment)
    looked_for = (
        (flight.control, "the desired attitude"),
        (flight.actuators, "motors and servos"),
        (flight.imus or None, "the IMU"),
        (flight.gps or None, "GPS"),
        (None, "battery voltage and current, motor speeds"),
    )
    missing = tuple(name for there, name in looked_for if there is None)
    timeline = tuple(sorted(_timeline(flight, assessment, moment.t, start, stop), key=lambda row: row.after_s))
    imus = tuple(_reached(flight, moment.t, start, stop))
    return Incident(moment, start, stop, causes, timeline, imus, tracking, outputs, missing)


def _timeline(
    flight: Flight, assessment: Assessment | None, t: float, start: float, stop: float
) -> Iterator[TimelineRow]:
    rows = [(one.t, "lane" if one.kind == "lane" else "reset", one.text or one.kind) for one in flight.resets]
    rows += [(one.t, one.kind, one.text) for one in flight.events]
    rows += [(one.t, "text", one.text) for one in flight.texts]
    rows += [(one.t, "parameter", f"{one.name} = {one.value:g}") for one in flight.parameter_changes]
    if assessment is not None:
        rows += [(f.start_s, "finding", f.evidence) for f in assessment.verdict.findings if f.severity != "info"]
    seen = set[tuple[float, str]]()
    for when, what, text in rows:
        key = (round(when, 1), text)
        if start <= when <= stop and key not in seen:
            seen.add(key)
            yield TimelineRow(when - t, what, text)


def _reached(flight: Flight, t: float, start: float, stop: float) -> Iterator[Reached]:
    for one in flight.each_imu():
        inside, before = within(one.t, (start, stop)), (one.t >= start) & (one.t < t - check.WORTHLESS_S)
        if inside.any():
            parts = (length(values[where]) for where in (inside, before) for values in (one.gyro, one.accel))
            yield Reached(one.source, *(float(sizes.max()) if len(sizes) else math.nan for sizes in parts))


def _tracking(flight: Flight, t: float, stop: float) -> Tracking | None:
    """By the third axes: heading may be anything without control being lost. From two seconds before the moment."""
    attitude, control = flight.attitude, flight.control
    if attitude is None or control is None or not len(control):
        return None
    since = t - check.LOST_BEFORE_S
    inside = within(attitude.t, (since, stop))
    last = np.maximum(np.searchsorted(control.t, attitude.t, side="right") - 1, 0)
    inside &= np.abs(attitude.t - control.t[last]) < check.DESIRED_FRESH_S
    if inside.sum() < 2:
        return None
    desired = down_in_body(control.q_ned_frd)[last][inside]
    alike = (down_in_body(attitude.q_ned_frd)[inside] * desired).sum(axis=1)
    angle, when = np.arccos(np.clip(alike, -1.0, 1.0)), attitude.t[inside]
    tilt = np.arccos(np.clip(desired[:, 2], -1.0, 1.0))
    early = when < t
    left = np.flatnonzero(angle > check.NOT_FOLLOWED_RAD)
    worst = int(np.argmax(angle))
    at_worst, left_s = (float(angle[worst]), float(when[worst] - t)), float(when[left[0]] - t) if len(left) else None
    if not early.any():
        early[0] = True
    return Tracking(float(np.median(angle[early])), *at_worst, left_s, float(tilt[early].max()))


def _outputs(flight: Flight, t: float, stop: float) -> Iterator[Output]:
    """Outputs at an end for half of a second about the moment, and in less than a twentieth of the time before."""
    track = flight.actuators
    if track is None:
        return
    usual_part = (track.t >= t - check.INCIDENT_BEFORE_S) & (track.t < t - check.AROUND_S)
    around = (track.t >= t - check.AROUND_S) & (track.t <= min(t + check.AROUND_S, stop))
    if not usual_part.any() or not around.any():
        return
    for i, column in enumerate(track.output.T):
        if not np.isfinite(column[around]).any() or np.nanstd(column) == 0.0:
            continue
        for end, at_end in (("full", column >= check.OUTPUT_FULL), ("zero", column <= 1.0 - check.OUTPUT_FULL)):
            if at_end[around].mean() >= check.AT_END_SHARE and at_end[usual_part].mean() < check.AT_END_USUAL:
                first = float(track.t[around][at_end[around]][0])
                yield Output(output_name(flight, i), end, first - t, float(np.nanmedian(column[usual_part])))  # type: ignore[arg-type]


def imus_within(flight: Flight, start: float, stop: float) -> Sequence[ImuTrack]:
    """Each IMU within a window, s, those that have two samples or more in it."""
    cut = [one[window(one.t, start, stop)] for one in flight.each_imu()]
    return [one for one in cut if len(one) > 1]


_WORDS: Mapping[str, re.Pattern[str]] = {
    "power_announced": re.compile(r"batter|brown.?out|power.*(?:fail|low)|low volt", re.IGNORECASE),
    "thrust_announced": re.compile(r"thrust loss|motor.*(?:fail|stop|desync)|ESC.*(?:fail|error)", re.IGNORECASE),
}
"""What a vehicle announces itself: ArduCopter `thrust_loss_check`, PX4 `FailureDetector`."""

_SIDES = {"imu": ("imu",), "aiding": AIDING, "estimator": ("autopilot",)}
"""Cause → the sides of the verdict that it stands for."""


@dataclass(frozen=True, slots=True)
class ProbableCause:
    """One cause, its probability, and what speaks for and against it."""

    name: str  # of `priors.INCIDENT`; where control was not lost a side of the verdict
    probability: float
    evidence: tuple[str, ...] = ()


def of_verdict(assessment: Assessment | None) -> tuple[ProbableCause, ...]:
    """Where control was not lost: the probabilities of the verdict, side by side; none where it has weighed nothing."""
    if assessment is None:
        return ()
    shares, reported = _shares(assessment, math.inf)
    return _by_probability(shares, reported) if reported or assessment.verdict.probability else ()


def _shares(assessment: Assessment, until: float) -> tuple[dict[str, float], dict[str, list[str]]]:
    """Side → its probability and the errors of it that began before a time, s; together 1 with "nobody".

    Faults that a plain check of the readings shows, as of a stuck axis, are not among the hypotheses that the verdict
    weighs: they count as an accusation. What the estimator does while an aiding sensor is the verdict's cause is that
    sensor's doing.
    """
    led = assessment.verdict.cause
    if led is not None and led.sensor not in AIDING:
        led = None
    shares = dict(assessment.verdict.probability) or {"nobody": 1.0}
    reported: dict[str, list[str]] = {}
    for f in assessment.verdict.findings:
        if f.severity != "error" or f.side == "data" or f.start_s >= until:
            continue
        cause = f.cause
        side = f.side if cause is None or cause.sensor not in AIDING else cause.sensor
        if led is not None and side == "autopilot" and led.onset_s <= f.start_s <= (led.end_s or math.inf):
            continue
        reported.setdefault(side, []).append(f.evidence)
        sure = cause.side_probability if cause is not None and cause.side_probability is not None else priors.ACCUSED
        if sure > shares.get(side, 0.0):
            others = sum(share for name, share in shares.items() if name != side)
            shares = {name: share * (1.0 - sure) / max(others, 1e-12) for name, share in shares.items()} | {side: sure}
    total = sum(shares.values())
    return {side: share / total for side, share in shares.items()}, reported


def of_loss(
    flight: Flight, assessment: Assessment | None, t: float, tracking: Tracking | None, outputs: Sequence[Output]
) -> tuple[ProbableCause, ...]:
    """Why control was lost at a time, s."""
    seen = _evidence(flight, t, tracking, outputs)
    log_odds = {cause: math.log(row["prior"]) for cause, row in priors.INCIDENT.items()}
    reasons: dict[str, list[str]] = {cause: [] for cause in log_odds}
    for name, (there, text) in seen.items():
        for cause, row in priors.INCIDENT.items():
            log_odds[cause] += math.log(row[name] if there else 1.0 - row[name])
            if there and row[name] > priors.INCIDENT["other"][name]:
                reasons[cause].append(text)
    for cause, (share, text) in _sensors(assessment, t).items():
        bounded = min(max(share, priors.SENSOR_CLEARED), priors.ACCUSED)
        log_odds[cause] += math.log(bounded / (1.0 - bounded))
        if share >= priors.PROBABLY_HARMFUL:
            reasons[cause].append(text)
    most = max(log_odds.values())
    weights = {cause: math.exp(value - most) for cause, value in log_odds.items()}
    total = sum(weights.values())
    return _by_probability({cause: weight / total for cause, weight in weights.items()}, reasons)


def _by_probability(shares: Mapping[str, float], reasons: Mapping[str, Sequence[str]]) -> tuple[ProbableCause, ...]:
    made = (ProbableCause(name, share, tuple(reasons.get(name, ()))) for name, share in shares.items())
    return tuple(sorted(made, key=lambda one: -one.probability))


def _evidence(
    flight: Flight, t: float, tracking: Tracking | None, outputs: Sequence[Output]
) -> dict[str, tuple[bool, str]]:
    """Name → whether it is there, and in words; what the log does not show is not among it."""
    seen: dict[str, tuple[bool, str]] = {}
    for end, words in (("full", "upper"), ("zero", "lower")) if flight.actuators is not None else ():
        names = [one.name for one in outputs if one.end == end]
        seen[f"output_{end}"] = bool(names), f"{', '.join(names) or 'no output'} at the {words} end of its range"
    if tracking is not None:
        worst, desired = math.degrees(tracking.worst), math.degrees(tracking.desired)
        off = f"the attitude is up to {worst:.0f}° from the desired one"
        seen["not_followed"] = tracking.left_s is not None, off
        seen["desired_steep"] = tracking.desired > harm.OVERTURNED_RAD, f"a tilt of {desired:.0f}° was desired"
    texts = [one.text for one in flight.texts if t - check.INCIDENT_BEFORE_S <= one.t <= t]  # later it may follow
    for name, pattern in _WORDS.items():
        announced = next((text for text in texts if pattern.search(text)), "")
        if flight.texts:
            seen[name] = bool(announced), f"the vehicle reported “{announced}”" if announced else "no report of it"
    recovered = {part.end for part in phases(flight) if part.kind == "impact"}  # in the air, without a take-off
    took_off = [part.start for part in in_the_air(flight) if part.start <= t and part.start not in recovered]
    young = bool(took_off) and t - took_off[-1] < check.TAKING_OFF_S
    seen["taking_off"] = young, f"{t - took_off[-1]:.1f} s after it took off" if young else "well after take-off"
    aloft = any(part.end > t - check.LOST_BEFORE_S for part in in_the_air(flight))
    ends = flight.start + flight.duration - t < check.WORTHLESS_S
    seen["log_ends"] = aloft and ends, "the log ends in the air" if ends else "the log goes on after it"
    return seen


def _sensors(assessment: Assessment | None, t: float) -> dict[str, tuple[float, str]]:
    """Cause → the probability of its sides by the verdict, for what began before the moment."""
    if assessment is None:
        return {}
    shares, reported = _shares(assessment, t)
    made = {}
    for cause, sides in _SIDES.items():
        texts = [text for side in sides for text in reported.get(side, ())]
        share = sum(shares.get(side, 0.0) for side in sides)
        made[cause] = (share, texts[0]) if texts else (min(share, priors.SENSOR_CLEARED), "")
    return made
