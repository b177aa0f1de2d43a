"""Faults that stand: while a flight is listened to, each is a hypothesis of its own until its end is shown.

A piece of some tens of seconds that begins after an onset fits the fault as a bias of the part, a turned field or a
moved origin, and agrees with the autopilot that was misled by it. So a fault that was accepted is kept with the
probability p that it is still there, and what each later piece says of it is weighed by Bayes:

    log p / (1 - p) = log odds that it stays + log N(d; u, Σ) - log N(d; 0, Σ)

u: its size as measured while the piece still had its onset, d: the sensor's error now minus that before the onset. It
is over below 5 %, as it was accepted above 95 %: hysteresis in probability. What is not measured in units of its own
(noise, a deviation of the estimate) is over when enough has been judged in which it would have been found.

What could not be told, but is likely, stands in the same way: it takes as long to go as its probability asks for.

Also here: whether an IMU reads what it is accused of: what has only begun may be taken for something that cannot be.

Also here: what an IMU reads too much by a piece of a flight: before a time, and at its end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log

import numpy as np

from companion.comparison import unchanged
from companion.constants import check, healthy, num, priors
from companion.estimation import (
    AIDING,
    HYPOTHESES,
    BestEstimate,
    allowing,
    hypothesis_of,
    probabilities,
)
from companion.model import STANDARD_GRAVITY, Array, Flight
from companion.verdict.fault_interval import (
    BIAS_UNITS,
    FaultInterval,
    fault_intervals,
    percent,
    probability_by_imu,
    share_at,
)
from companion.verdict.finding import Cause, Finding
from companion.verdict.findings.readings import read_by
from companion.verdict.findings.stuck import still_window_s
from companion.verdict.verdict import SUSPECT, WHOSE, Verdict, headline_of, stated_cause

Reading = tuple[Array, Array]
"""(m,) what a sensor reads too much, and its covariance (m, m): three biases, or these and three scales."""


def reads(cause: Cause, flight: Flight, best: BestEstimate | None, until: float | None = None) -> Reading | None:
    """What the IMU of a cause reads too much at the end of a piece.

    until: s, boot clock: then, instead of at the end, and without what began there.

    A scale beside the biases, for a vehicle that turns the same way all the time shows their sum alone, and by what the
    piece says of it: that it is small in most parts is no evidence that it has become so. None where it is no error
    that is measured so.
    """
    if best is None or not cause.kind.endswith(("_bias", "_scale")) or cause.sensor not in BIAS_UNITS:
        return None
    if cause.imu is not None and cause.imu != best.imu.instance:
        return _apart(cause, flight, best, until)
    if cause.kind.endswith("_bias"):
        value = np.median(getattr(best.states, cause.kind), axis=0)
        covariance = np.diag(np.median(getattr(best, f"{cause.kind}_sigma"), axis=0) ** 2)
    else:
        at = slice(0, 3) if cause.sensor == "gyro" else slice(3, 6)
        scales = 6 + 3 * at.start + np.arange(0, 9, 4)  # of the diagonal
        which = np.r_[at, scales]
        possible = max(healthy.USUAL_SCALE, cause.size or 0.0)
        errors = allowing(best.errors, possible, possible)
        value, covariance = errors.values[which].copy(), errors.covariance[np.ix_(which, which)].copy()
    for part in (one for one in best.explained if one.kind == cause.kind and one.imu is None):
        share = share_at(part, float(best.t[-1]))
        if until is None or part.onset < until - check.NEAR_S:
            value[-3:] += share * part.size
            covariance[-3:, -3:] += np.diag((share * part.sigma) ** 2)
    return value, covariance


def _apart(cause: Cause, flight: Flight, best: BestEstimate, until: float | None) -> Reading | None:
    """What another IMU reads more than that of the estimate: by means of seconds, from which true motion cancels."""
    other = next((track for track in flight.imus.values() if track.instance == cause.imu and len(track) > 1), None)
    if other is None or cause.kind.endswith("_scale"):
        return None
    means = []
    for track in (other, best.imu):
        second = np.floor(track.t).astype(np.intp)
        which, first, count = np.unique(second, return_index=True, return_counts=True)
        means.append((which, np.add.reduceat(read_by(track, cause.sensor)[0], first) / count[:, None]))
    both, i, j = np.intersect1d(means[0][0], means[1][0], assume_unique=True, return_indices=True)
    apart = means[0][1][i] - means[1][1][j]
    chosen = apart[-round(num.JUDGED_S) :] if until is None else apart[both + 1 < until]
    if len(chosen) < 2:
        return None
    return chosen.mean(axis=0), np.diag(chosen.var(axis=0) / len(chosen))


def believable(verdict: Verdict, flight: Flight) -> Verdict:
    """The verdict without an accelerometer that is off by more than gravity, and does not read so.

    A vehicle that leans may hide less than that from it. What has just begun may look so: a position that has jumped by
    50 m two seconds ago, as a push of 25 m/s².
    """
    absurd = [f for f in verdict.findings if f.severity == "error" and _does_not_read(stated_cause(f), flight)]
    if not absurd:
        return verdict
    left = tuple(f for f in verdict.findings if f not in absurd)
    if any(f.severity == "error" and f.side != "data" for f in left):
        return replace(verdict, findings=left)
    differ = f"the sensors differ since {absurd[0].start_s:.1f} s, and it is not known yet which of them is wrong"
    return Verdict("insufficient_data", f"Cannot tell: {differ}.", left, probability=verdict.probability)


def _does_not_read(cause: Cause, flight: Flight) -> bool:
    """Whether it says of an accelerometer what its readings do not show."""
    if cause.kind != "accel_bias" or cause.size is None or cause.size < STANDARD_GRAVITY:
        return False
    track = next((one for one in flight.imus.values() if cause.imu in (None, one.instance)), flight.imu())
    before = track.t <= cause.onset_s
    during = ~before & (track.t <= (np.inf if cause.end_s is None else cause.end_s))
    if not before.any() or not during.any():
        return False
    changed = float(np.linalg.norm(track.accel[during].mean(axis=0) - track.accel[before].mean(axis=0)))
    return changed < cause.size - STANDARD_GRAVITY


_KINDS = {kind.name for kind in HYPOTHESES}


@dataclass(frozen=True, slots=True, eq=False)
class StandingFault:
    """A fault that was accepted, and what is known of it since."""

    finding: Finding  # as it was told last, with a cause
    probability: float  # that it is still there
    seen_s: float  # boot clock, until when it was found by itself
    before: Reading | None = None  # of the sensor, before its onset; None where that was not measured
    size: Array | None = None  # (m,) while it was found; of a sensor beside the IMU in the unit of its kind
    over_s: float | None = None  # s, boot clock, by when it was seen to be over; None: it stands

    @property
    def cause(self) -> Cause:
        """What is wrong."""
        assert self.finding.cause is not None
        return self.finding.cause


def carried_on(
    standing: Sequence[StandingFault], flight: Flight, verdict: Verdict, best: BestEstimate | None
) -> tuple[StandingFault, ...]:
    """The faults that stand after another piece of a flight, the first first.

    And those that are over, while a piece still has their end in it, which looks like another fault.
    standing: before. verdict, best: of the piece by itself.
    """
    end = flight.start + flight.duration
    errors = [f for f in verdict.findings if f.severity == "error" and f.side != "data"]
    outages = [_outage(f) for f in verdict.findings if f.kind in _OUTAGES and f.severity == "warning"]
    errors += [f for f in outages if f.end_s > end - check.NEAR_S and not _comes_again(stated_cause(f), flight, end)]
    new = sorted((_named(replace(f, cause=stated_cause(f)), best) for f in errors), key=lambda f: f.start_s)
    judged = verdict.status != "insufficient_data"
    kept: list[StandingFault] = []
    for fault in standing:
        own = [f for f in new if _same(fault.finding, f) or _is_beside(fault.cause, stated_cause(f), best)]
        over = fault.over_s
        if over is not None and fault.cause.kind in (*_OUTAGES, *_STILL):  # their end looks like no other fault
            over = fault.seen_s
        mine = [f for f in own if over is None or f.start_s < over]
        new, again = [f for f in new if f not in mine], next(iter(mine), None)
        if again is not None and _was_there(again, flight):  # of its onset this piece knows nothing
            kept.append(replace(fault, probability=1.0, seen_s=end))
        elif again is not None and _together(fault.finding, again):
            kept.append(_as_seen(again, flight, best, end, fault))
        else:  # what the sensor does later is the end of it, or more of it
            kept.append(_weighed(fault, flight, best, end, judged=judged))
    while new:
        first, new = new[0], [f for f in new[1:] if not _same(new[0], f)]
        cause = stated_cause(first)
        of_estimate_alone = cause.side == "autopilot" and not cause.sensor  # a fault that stands has misled it
        if not (of_estimate_alone and any(one.over_s is None for one in kept)):
            kept.append(_as_seen(first, flight, best, end, None))
    judged_now = (_with_hysteresis(one, flight.start, end) for one in kept)
    return tuple(one for one in judged_now if one.over_s is None or one.over_s > flight.start)


def _with_hysteresis(fault: StandingFault, begin: float, end: float) -> StandingFault:
    """The fault, over where it is still there with less than 5 %, and standing again from 95 % on.

    By a piece that begins after it was over: what is measured over a piece with some of the fault in it tells nothing.
    """
    if fault.over_s is None and fault.probability <= 1.0 - priors.ACCUSED:
        return replace(fault, over_s=end)
    if fault.over_s is not None and fault.over_s <= begin and fault.probability >= priors.ACCUSED:
        return replace(fault, over_s=None)
    return fault


_OUTAGES = ("position_lost", "dead_reckoned")


def _outage(finding: Finding) -> Finding:
    """That there is no position, or that nothing supports it: in flight an alarm for as long as it lasts."""
    cause = Cause(finding.kind, "autopilot", finding.start_s, finding.end_s, sensor="gps")
    return replace(finding, side="autopilot", severity="error", undecided=False, cause=cause)


def standing_verdict(standing: Sequence[StandingFault], verdict: Verdict) -> Verdict:
    """The verdict on a piece of a flight, beside the faults that stand: it is they that make somebody suspect."""
    up = [fault for fault in standing if fault.over_s is None]
    if not up:
        if verdict.status not in SUSPECT.values():
            return verdict
        over = verdict.summary.removeprefix("Suspect ").removesuffix(".")
        return replace(verdict, status="consistent", summary=f"No fault now: {over}, which is over.", cause=None)
    first, side = up[0], up[0].cause.side
    headline = headline_of(first.finding).replace(" to the end", " until now")
    sure = "" if first.probability >= priors.ACCUSED else f"; still there: {percent(first.probability)}"
    more = f", and {len(up) - 1} more" if len(up) > 1 else ""
    summary = f"Suspect {WHOSE[side]}: {headline}{sure}{more}."
    return replace(verdict, status=SUSPECT[side], summary=summary, cause=first.cause)


@dataclass(frozen=True, slots=True)
class Doubt:
    """A fault that is likely, but was not told from its rivals, or from none."""

    verdict: Verdict  # that could not tell
    probability: float  # then, that there is a fault
    seen_s: float  # boot clock, at the end of that piece


def beside_doubt(verdict: Verdict, end: float, before: Doubt | None) -> tuple[Verdict, Doubt | None]:
    """The verdict on a piece that ends at `end`, s, boot clock, beside a doubt, and the doubt that stands after it.

    verdict: beside the faults that stand. A doubt goes as a fault goes that no later piece shows, or when somebody is
    suspect; until then it is not said that all is well.
    """
    if verdict.status == "insufficient_data":
        fault = min(1.0 - verdict.probability.get("nobody", 1.0), priors.ACCUSED)
        return verdict, Doubt(verdict, fault, end) if fault > 1.0 - priors.ACCUSED else before
    if before is None or verdict.status != "consistent":
        return verdict, None
    left = _unseen(end - before.seen_s, log(before.probability / (1.0 - before.probability)))
    if left <= 1.0 - priors.ACCUSED:
        return verdict, None
    since = f"not found in the {end - before.seen_s:.0f} s since: {percent(left)}"
    return replace(before.verdict, summary=f"{before.verdict.summary.removesuffix('.')}; {since}."), before


def _same(one: Finding, other: Finding) -> bool:
    """Whether two findings are of one fault: of the same sensor, or of the same side and onset.

    Which IMU it is may be told otherwise as more is known of it.
    """
    a, b = one.cause, other.cause
    if a is None or b is None or a.side != b.side:
        return False
    same = a.kind == b.kind
    if a.sensor and b.sensor:
        same = a.sensor == b.sensor and (a.imu is None or b.imu is None or a.imu == b.imu)
    return same or _together(one, other)


def _is_beside(fault: Cause, other: Cause, best: BestEstimate | None) -> bool:
    """Whether another IMU is accused beside the estimate's, of a sensor in which that one has a fault.

    What two IMUs differ by changes as well where the faulty one recovers.
    """
    if best is None or fault.side != "imu" or not fault.sensor or fault.sensor != other.sensor:
        return False
    return other.imu not in (None, best.imu.instance) and fault.imu in (None, best.imu.instance)


def _together(one: Finding, other: Finding) -> bool:
    """Whether two findings begin together."""
    a, b = stated_cause(one), stated_cause(other)
    sigma = float(np.hypot(a.onset_sigma_s or 0.0, b.onset_sigma_s or 0.0))
    return abs(a.onset_s - b.onset_s) <= check.NEAR_S + num.SIGMAS * sigma


def _was_there(finding: Finding, flight: Flight) -> bool:
    """Whether a piece found a fault without its onset: it is there from the first sample on."""
    begins = max((track.t[0] for track in flight.imus.values() if len(track)), default=0.0)
    return stated_cause(finding).onset_s <= begins


def _interval(finding: Finding, best: BestEstimate | None) -> FaultInterval | None:
    """What the best estimate had to explain, that a finding tells of."""
    if best is None or finding.kind not in _KINDS:
        return None
    intervals = (one for one in fault_intervals(best) if one.kind == finding.kind)
    return next((one for one in intervals if abs(one.start - finding.start_s) < check.NEAR_S), None)


def _named(finding: Finding, best: BestEstimate | None) -> Finding:
    """The finding; where it is not known yet which IMU it is, without the name of one."""
    interval, cause = _interval(finding, best), stated_cause(finding)
    if interval is None or best is None or interval.device != "imu":
        return finding
    shares = probability_by_imu(interval, best)
    if next(iter(shares.values()), 1.0) >= priors.ACCUSED or cause.sensor not in BIAS_UNITS:
        return finding
    who = " and ".join(f"IMU {k}" for k, share in sorted(shares.items()) if share > 1.0 - priors.ACCUSED)
    unit, scale, decimals = BIAS_UNITS[cause.sensor] if cause.kind.endswith("_bias") else ("%", 100.0, 1)
    by = f"{(cause.size or 0.0) * scale:.{decimals}f} {unit}" + (f" in {cause.axis}" if cause.axis else "")
    words = f"{who} differ by {by} since {cause.onset_s:.0f} s: which one is not known yet"
    return replace(finding, evidence=words, headline=words, cause=replace(cause, imu=None))


def _as_seen(
    finding: Finding, flight: Flight, best: BestEstimate | None, end: float, fault: StandingFault | None
) -> StandingFault:
    """A fault that a piece shows by itself."""
    cause = stated_cause(finding)
    last = end if cause.end_s is None else min(cause.end_s, end)
    before, now = reads(cause, flight, best, until=cause.onset_s), reads(cause, flight, best)
    interval = _interval(finding, best)
    size = None if interval is None else interval.size
    known = StandingFault(finding, 1.0, last, size=size if cause.sensor in AIDING else None)
    if before is not None and now is not None:
        if fault is not None and fault.cause.kind != cause.kind:  # measured in other units
            fault = None
        if fault is not None and fault.before is not None and np.trace(fault.before[1]) < np.trace(before[1]):
            before = fault.before  # more of the time before the onset was in an earlier piece
        if cause.end_s is None:
            return replace(known, before=before, size=now[0] - before[0])
        if fault is not None and fault.size is not None:
            sure = _doubted(fault, _stays(fault.size, before, now, cause), end)
            return replace(known, before=before, size=fault.size, probability=sure)
        if size is not None:  # seen when it was over, it is not what is read at the end
            return replace(known, before=before, size=np.append(np.zeros(len(before[0]) - len(size)), size))
    if _reads_again(cause, flight):
        return replace(known, probability=0.0)
    over = last < end - check.NEAR_S and cause.kind not in _OUTAGES
    return replace(known, probability=_unseen(end - last)) if over else known


def _weighed(
    fault: StandingFault, flight: Flight, best: BestEstimate | None, end: float, *, judged: bool
) -> StandingFault:
    """A fault that a piece does not show by itself: where that begins after the onset, it cannot."""
    cause, sure = fault.cause, fault.probability
    explained = best is not None and cause.kind in _KINDS and fault.over_s is None
    by_onset = _by_its_onset(best, cause) if best is not None and explained else None
    if cause.kind in _STILL:
        sure = 0.0 if _reads_again(cause, flight) else sure
    elif cause.kind in _OUTAGES:
        sure = 0.0 if _comes_again(cause, flight, end) else sure
    elif judged and by_onset is not None:
        sure = _doubted(fault, by_onset, end)
    elif fault.before is not None and fault.size is not None:
        if (now := reads(cause, flight, best)) is None:
            return fault
        stays = _stays(fault.size, fault.before, now, cause)
        sure = _doubted(fault, max(stays, by_onset or 0.0), end)  # by its onset also where it is another error of it
        if sure > priors.ACCUSED and cause.kind.endswith("_bias"):  # a bias may go on growing
            fault = replace(fault, size=now[0] - fault.before[0])
    elif cause.sensor in AIDING and cause.end_s is None:
        sure = 0.0 if _came_back(fault, best) else sure
    elif judged:
        sure = _unseen(end - fault.seen_s)
    return fault if sure == fault.probability else replace(fault, probability=sure)


def _doubted(fault: StandingFault, sure: float, end: float) -> float:
    """The probability by a piece; not small at once where it shares most with a piece that had found the fault."""
    just_found = fault.probability == 1.0 or end - fault.seen_s < 0.5 * num.JUDGED_S
    return max(sure, num.DOUBTED_ONCE) if just_found else sure


def _by_its_onset(best: BestEstimate, cause: Cause) -> float | None:
    """The probability that a sensor has a fault since then, by a piece that has more of what came after.

    None where less came before the onset than a verdict needs: that it does not show there tells nothing.
    """
    unsure = num.SIGMAS * (cause.onset_sigma_s or 0.0)
    if cause.onset_s - unsure <= float(best.t[0]) + num.MIN_WINDOWS * num.JUDGED_S:
        return None
    near = [one for one in fault_intervals(best) if abs(one.start - cause.onset_s) <= check.NEAR_S + unsure]
    whose = "imu" if cause.side == "imu" else cause.sensor
    return max((probabilities(rivals)[whose] for rivals in (best.further, *(one.rivals for one in near))), default=0.0)


def _comes_again(cause: Cause, flight: Flight, end: float) -> bool:
    """Whether the position, or a GPS fix, has come lately."""
    if cause.kind == "position_lost":
        return flight.position is not None and float(flight.position.t[-1]) > end - check.NEAR_S
    fixed = (one.t[one.fix_type >= check.FIX_3D] for one in flight.gps)
    return any(len(t) and float(t[-1]) > end - check.NEAR_S for t in fixed)


_STILL = ("stuck_axis", "frozen")


def _stays(size: Array, before: Reading, now: Reading, cause: Cause) -> float:
    """The probability that an error is still there, of what the sensor reads too much now and did before its onset."""
    # what parts in order change by in a flight is a third of what harms
    kinds = (f"{cause.sensor}_bias", cause.kind)[-len(size) // 3 :]
    drifts = np.repeat([hypothesis_of(one).harmful("step") / num.SIGMAS for one in kinds], 3)
    information = np.linalg.inv(before[1] + now[1] + np.diag(drifts**2))
    error = now[0] - before[0]
    left = error - size
    log_odds = -np.log(priors.RECOVERING_SHARE) + 0.5 * float(error @ information @ error - left @ information @ left)
    return float(1.0 / (1.0 + np.exp(-np.clip(log_odds, -500.0, 500.0))))


def _unseen(seconds: float, log_odds: float = priors.ACCUSED_ODDS) -> float:
    """The probability that what was found is still there, though so much has been judged since that would show it.

    It is found in 95 % of pieces as long as a verdict needs. log_odds: of it when it was found last.
    """
    log_odds -= priors.ACCUSED_ODDS * max(seconds, 0.0) / (num.MIN_WINDOWS * num.JUDGED_S)
    return float(1.0 / (1.0 + np.exp(-log_odds)))


def _reads_again(cause: Cause, flight: Flight) -> bool:
    """Whether an axis or IMU that stood moves again: in every message of that IMU, for as long as it takes to stand."""
    if cause.kind not in _STILL:
        return False
    tracks = [track for track in flight.imus.values() if cause.imu in (None, track.instance) and len(track) > 1]
    sensors = (cause.sensor,) if cause.sensor in BIAS_UNITS else tuple(BIAS_UNITS)
    axes = ["xyz".index(cause.axis)] if cause.axis in tuple("xyz") else [0, 1, 2]
    for track in tracks:
        newest = track.t > track.t[-1] - healthy.STUCK_S * still_window_s(track)
        for sensor in sensors:
            readings = read_by(track, sensor)[0][newest]
            if len(readings) < 2 or unchanged(readings)[:, axes].all(axis=0).any():
                return False
    return bool(tracks)


def _came_back(fault: StandingFault, best: BestEstimate | None) -> bool:
    """Whether a sensor beside the IMU has changed back, by all that it had changed: nothing else tells that.

    What goes on in the same direction is more of the fault: of a creep a later piece sees no other part.
    """
    cause = fault.cause
    if best is None or fault.size is None or not (size := float(np.linalg.norm(fault.size))):
        return False
    back = [
        one for one in fault_intervals(best)
        if one.kind == cause.kind and one.start > fault.seen_s - check.NEAR_S and not np.isfinite(one.end)
    ]  # fmt: skip
    if not back:
        return False
    against = -float(back[-1].size @ fault.size) / size
    return against > size - num.SIGMAS * float(np.hypot(back[-1].sigma, cause.sigma or 0.0))
