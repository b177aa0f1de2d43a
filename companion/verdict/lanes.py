"""Which lane of a redundant estimator should have been flown: each against the best estimate, each switch judged.

Not judged is what the controller would have done with another lane. A lane is called off where another one is
surely nearer to the truth and it is surely further off than a healthy one: what all lanes share is no lane's fault.

Also here: how far each lane is from the best estimate, and which of two lanes is nearer to the truth.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from statistics import NormalDist
from typing import Literal

import numpy as np

from companion.comparison import Span, attitude_error, flight_of, judged_at, judged_parts, known_at, length, phases
from companion.constants import check, healthy, num, priors
from companion.estimation import ATTITUDE, HEIGHTS, POSITION, VELOCITY, BestEstimate, Correlation
from companion.model import Array, BoolArray, EstimatorLane, Flight, IntArray, SensorInUse, longest_step, nearest
from companion.noise import chi_square
from companion.verdict.deviations import COMPONENTS, at_first, keyframe_at_first
from companion.verdict.fault_interval import DEVIATION_UNITS
from companion.verdict.finding import Cause, Finding

Judgement = Literal["right", "wrong", "indifferent", "undecided"]

FLOWN = "as flown"


@dataclass(frozen=True, slots=True)
class LaneError:
    """One quantity of a lane over a span: the size of its difference from the best estimate."""

    quantity: str  # "tilt", "heading", "velocity", "position" (both horizontal), "height"
    unit: str  # "rad", "m/s", "m"
    samples: int
    rms: float
    p95: float
    worst: float
    worst_s: float  # s, boot clock
    sigma: float  # 1σ of the best estimate itself, its median


@dataclass(frozen=True, slots=True)
class LaneInSpan:
    """A lane over a span."""

    lane: str
    errors: tuple[LaneError, ...]
    nearest: float | None  # least probability that it is nearer than each other lane that may fly; None: not observable
    off: bool  # whether it is surely further off than a healthy one, and another lane surely nearer


@dataclass(frozen=True, slots=True)
class LaneSpan:
    """The lanes over the whole flight, or while something was wrong."""

    start_s: float
    end_s: float
    what: str  # "flight", or the kind of the fault
    flown: tuple[str, ...]  # the lanes that flew in it
    lanes: tuple[LaneInSpan, ...]
    right: str | None  # the lane that none is surely nearer than, nor differs from by what matters, where one that
    # flew was off; None elsewhere
    readers: tuple[str, ...] | None = None  # the lanes that read the sensor that was wrong; None: not known, or none
    as_good: tuple[str, ...] = ()  # the others that nothing tells from the right one, or that are alike


@dataclass(frozen=True, slots=True)
class LaneSwitch:
    """A change of the lane that flies, judged by both lanes in the seconds after it."""

    t: float
    before: str
    after: str
    end_s: float  # until when both were compared
    judgement: Judgement = "undecided"
    probability: float | None = None  # that the new lane is nearer to the truth than the old one; None: not known
    quantity: str = ""  # in which they differ most, in units of a healthy estimator's error
    before_size: float = np.nan  # rms after the switch, of the lane that was left, in that quantity: rad, m/s, m
    after_size: float = np.nan
    sigma: float = np.nan  # 1σ of the best estimate itself
    reset_s: float | None = None  # s before the switch, that the new lane announced a reset; None: none shortly before
    why: str = ""  # why nothing is known


_BLOCKS: Mapping[str, slice] = {"turn": ATTITUDE, "velocity": VELOCITY, "position": POSITION}
"""What a quantity is of → the block of the estimate's error."""


@dataclass(frozen=True, slots=True, eq=False)
class LaneErrors:
    """One lane less the best estimate at its K keyframes, by quantity; NaN where either does not know."""

    lane: EstimatorLane
    error: Mapping[str, Array]  # (K, n) NED: rad, m/s, m

    def known(self, quantity: str) -> BoolArray:
        """(K,) where its error is known."""
        return np.asarray(np.isfinite(self.error[quantity]).all(axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """All lanes beside the best estimate."""

    t: Array  # (K,) s, its keyframes
    judged: BoolArray  # (K,) whether an estimator is held responsible there
    covariance: Mapping[str, Array]  # (K, n, n) of the best estimate's own error, by quantity
    lanes: tuple[LaneErrors, ...]
    correlation: Correlation  # of it between keyframes
    since: Mapping[str, IntArray] = field(default_factory=dict)  # quantity → (K,) the keyframe that it is counted from
    at_first: Mapping[str, float] = field(default_factory=dict)  # quantity → 1σ of what all lanes are off by there

    def within(self, start: float, end: float) -> BoolArray:
        """(K,) which keyframes of a span, s, are judged."""
        return np.asarray(self.judged & (self.t >= start) & (self.t <= end))

    def sigma(self, quantity: str) -> Array:
        """(K,) 1σ of the length of the best estimate's own error."""
        return np.asarray(np.sqrt(np.trace(self.covariance[quantity], axis1=1, axis2=2)))

    def sigma_of_sum(self, weights: Mapping[str, Array]) -> float:
        """1σ of the sum of the best estimate's own errors over all keyframes, each times its weight (K, n)."""
        whole, variance = np.zeros((len(self.t), POSITION.stop)), 0.0
        for quantity, own in weights.items():
            of, part = COMPONENTS[quantity]
            moved = own.copy()
            if quantity in self.since:
                np.subtract.at(moved, self.since[quantity], own)
            variance += float((own.sum(axis=0) ** 2).sum()) * self.at_first.get(quantity, 0.0) ** 2
            whole[:, _BLOCKS[of]][:, part] += moved
        return math.sqrt(variance + self.correlation.variance_of_sum(whole))


@dataclass(frozen=True, slots=True, eq=False)
class Lanes:
    """Every lane of a flight, which of them flew when, each switch, and the spans in which they are compared."""

    lanes: tuple[EstimatorLane, ...]
    in_use: SensorInUse | None
    spans: tuple[LaneSpan, ...]  # the whole flight first
    switches: tuple[LaneSwitch, ...]
    compared: Compared
    notes: tuple[str, ...]


def judge_lanes(flight: Flight, best: BestEstimate, findings: Sequence[Finding] = ()) -> Lanes:
    """Every lane of a flight against its best estimate. findings: those of the verdict, whose causes are spans."""
    numbered = tuple(lane for lane in flight.lanes if lane.core is not None)
    own = _as_flown(flight, numbered)
    lanes = (*numbered, *(() if own is None else (own,)), *(lane for lane in flight.lanes if lane.core is None))
    used = flight.lane_in_use if numbered else None
    compared = _with_flown(compare_lanes(flight, best, lanes), used)
    parts = judged_parts(phases(flight))
    begin, end = (parts[0].start, parts[-1].end) if parts else (np.inf, -np.inf)
    begin, end = max(begin, float(best.t[0])), min(end, float(best.t[-1]))
    spans = [_span(compared, used, (begin, end), "flight")] if compared.within(begin, end).any() else []
    for span, cause in _faults(findings, best):
        if compared.within(*span).any():
            spans.append(_span(compared, used, span, cause.kind, readers(numbered, cause, *span)))
    switches = tuple(_switches(flight, compared))
    return Lanes(lanes, used, tuple(spans), switches, compared, tuple(_notes(flight, numbered, best, compared)))


def _as_flown(flight: Flight, numbered: Sequence[EstimatorLane]) -> EstimatorLane | None:
    """What flew, where the lanes beside it are not in the log: the attitude with the velocity and position there.

    In a gap of the positions they are not known.
    """
    if numbered or flight.attitude is None:
        return None
    attitude, position = flight.attitude, flight.position
    moved = np.full((len(attitude), 6), np.nan)
    if position is not None and len(position) > 1:
        inside = known_at(position.t, attitude.t, longest_step(position.t))
        values = np.column_stack([position.velocity, position.position])
        moved[inside] = np.column_stack([np.interp(attitude.t[inside], position.t, one) for one in values.T])
    return EstimatorLane(attitude.t, attitude.q_ned_frd, moved[:, :3], moved[:, 3:], FLOWN, None, attitude.source)


def _with_flown(compared: Compared, used: SensorInUse | None) -> Compared:
    """With what flew beside the lanes, where it was now one and now another of them."""
    by_core = {one.lane.core: one for one in compared.lanes if one.lane.core is not None}
    if used is None or len(by_core) < 2 or len({core for _, core in used.changes} & by_core.keys()) < 2:
        return compared
    core, first = used.at(compared.t), next(iter(by_core.values()))
    error = {name: np.full_like(values, np.nan) for name, values in first.error.items()}
    for number, one in by_core.items():
        for name, values in one.error.items():
            error[name][core == number] = values[core == number]
    flown = LaneErrors(replace(first.lane, name=FLOWN, core=None, source=used.source, imu=None), error)
    return replace(compared, lanes=(*compared.lanes, flown))


def _faults(findings: Sequence[Finding], best: BestEstimate) -> Iterator[tuple[Span, Cause]]:
    """From when to when something was wrong, of the causes that are stated; each kind once at a time."""
    until: dict[str, float] = {}
    for one in sorted(findings, key=lambda f: f.start_s):
        if one.cause is None or one.severity == "info" or one.end_s <= one.start_s:
            continue
        if one.start_s >= until.get(one.cause.kind, -np.inf):
            until[one.cause.kind] = min(one.end_s, float(best.t[-1]))
            yield (one.start_s, until[one.cause.kind]), one.cause


def _span(
    compared: Compared, used: SensorInUse | None, span: Span, what: str, sharing: tuple[str, ...] | None = None
) -> LaneSpan:
    where = compared.within(*span)
    names = {one.lane.core: one.lane.name for one in compared.lanes if one.lane.core is not None}
    flown = () if used is None else tuple(name for core, name in names.items() if used.uses(core, *span))
    misled = sharing or ()
    ranked = [_in_span(one, compared, where, misled) for one in compared.lanes if len(one.lane)]
    known = [one for one in ranked if one.errors]
    errors = {one.lane.name: one for one in compared.lanes}
    by_rank = sorted(known, key=lambda one: -(one.nearest or 0.0))
    best = _nearest([errors[one.lane] for one in by_rank], compared, where, misled)
    made = LaneSpan(*span, what, flown, tuple(known), None, sharing)
    flew = [errors[name] for name in flown]
    if best is None or not any(worse(one, best, compared, where, _odds(misled, best, one)) for one in flew):
        return made
    others = ((one, one.nearest) for one in known if one.lane != best.lane.name and one.nearest is not None)
    may = (one.lane for one, p in others if p > 1.0 - priors.ACCUSED or alike(best, errors[one.lane], where))
    return replace(made, right=best.lane.name, as_good=tuple(may))


def _nearest(
    lanes: Sequence[LaneErrors], compared: Compared, where: BoolArray, sharing: Sequence[str]
) -> LaneErrors | None:
    """The first of the lanes, if it is surely nearer than each other, or differs from it by less than healthy ones err.

    Of three lanes two may be equally good. lanes: the likeliest to be the nearest first.
    """
    may_fly = [one for one in lanes if one.lane.core is not None]
    told = False
    for other in may_fly[1:]:
        p = nearer_probability(may_fly[0], other, compared, where, _odds(sharing, may_fly[0], other))
        told |= p is not None
        if p is not None and p < priors.ACCUSED and max(apart(may_fly[0], other, where).values()) > 1.0:
            return None
    return may_fly[0] if told else None


def _odds(sharing: Sequence[str], one: LaneErrors, other: LaneErrors) -> float:
    """That one of two lanes is the nearer: a faulty sensor misleads the lanes that share it oftener than the others."""
    mine, theirs = (lane.lane.name in sharing for lane in (one, other))
    return priors.MISLED_ODDS ** (int(theirs) - int(mine))


def _in_span(one: LaneErrors, compared: Compared, where: BoolArray, sharing: Sequence[str]) -> LaneInSpan:
    errors = tuple(_error(one, name, compared, where) for name in one.error if (where & one.known(name)).any())
    others = [other for other in compared.lanes if None not in (one.lane.core, other.lane.core) and other is not one]
    told = (nearer_probability(one, other, compared, where, _odds(sharing, one, other)) for other in others)
    pairs = [p for p in told if p is not None]
    beaten = any(p <= 1.0 - priors.ACCUSED for p in pairs)
    off = beaten and off_probability(one, compared, where) >= priors.ACCUSED
    return LaneInSpan(one.lane.name, errors, min(pairs, default=None), off)


def _error(one: LaneErrors, quantity: str, compared: Compared, where: BoolArray) -> LaneError:
    known = where & one.known(quantity)
    size = length(one.error[quantity][known])
    worst, rms, p95 = int(np.argmax(size)), float(np.sqrt((size**2).mean())), float(np.percentile(size, 95.0))
    at_worst = float(size[worst]), float(compared.t[known][worst])
    sigma = float(np.median(compared.sigma(quantity)[known]))
    return LaneError(quantity, DEVIATION_UNITS[quantity][0], len(size), rms, p95, *at_worst, sigma)


def _switches(flight: Flight, compared: Compared) -> Iterator[LaneSwitch]:
    """Every change of the lane that flies; by the announced ones where the log does not have the lane in use."""
    used = flight.lane_in_use
    announced = sorted((one.t, one.core) for one in flight.resets if one.kind == "lane" and one.core is not None)
    changes = [(flight.start, -1), *announced] if used is None else used.changes
    by_core = {one.lane.core: one for one in compared.lanes if one.lane.core is not None}
    for (_, before), (t, after) in pairwise(changes):
        later = min((at for at, _ in changes if at > t), default=np.inf)
        end = min(later, t + check.SWITCH_JUDGED_S, float(compared.t[-1]))
        yield _switch(flight, compared, (t, end), (before, by_core.get(before)), (after, by_core.get(after)))


_Core = tuple[int, LaneErrors | None]
"""The number of a lane, and how far it is off; None where the log does not have it."""


def _switch(flight: Flight, compared: Compared, span: Span, before: _Core, after: _Core) -> LaneSwitch:
    (t, end), (old_core, old), (new_core, new) = span, before, after
    names = [f"core {core}" if one is None else one.lane.name for core, one in (before, after)]
    names[0] = names[0] if old_core >= 0 else "the lane before"
    resets = [r.t for r in flight.resets if r.core == new_core and r.kind != "lane" and t - check.NEAR_S <= r.t <= t]
    unknown = LaneSwitch(t, names[0], names[1], end, reset_s=t - resets[-1] if resets else None)
    if old is None or new is None:
        return replace(unknown, why="the log does not have both lanes")
    where = compared.within(t, end)
    p = nearer_probability(new, old, compared, where)
    if p is None:
        return replace(unknown, why="the best estimate does not cover the time after it")
    off = [off_probability(one, compared, where) for one in (old, new)]
    judgement: Judgement = "indifferent" if max(off) < 1.0 - priors.ACCUSED else "undecided"
    if worse(old, new, compared, where):
        judgement = "right"
    elif worse(new, old, compared, where):
        judgement = "wrong"
    differ = apart(old, new, where)
    quantity = max(differ, key=lambda name: differ[name])
    left, taken = (_error(one, quantity, compared, where) for one in (old, new))
    judged = replace(unknown, judgement=judgement, probability=p, quantity=quantity)
    return replace(judged, before_size=left.rms, after_size=taken.rms, sigma=left.sigma)


def readers(lanes: Sequence[EstimatorLane], cause: Cause, start: float, end: float) -> tuple[str, ...] | None:
    """The lanes that read the sensor that was wrong between two times, s; None where the log does not have them.

    A cause names no instance of GPS, compass or barometer: all lanes read it where all of them read the same one.
    """
    if not lanes:
        return None
    if cause.imu is not None:
        known = [lane for lane in lanes if lane.imu is not None]
        return tuple(lane.name for lane in known if lane.imu == cause.imu) if len(known) == len(lanes) else None
    used = [lane.sensors.get({"gps": "GPS"}.get(cause.sensor, cause.sensor)) for lane in lanes]
    instances = {k for one in used if one is not None for k in one.instance.tolist() if one.uses(k, start, end)}
    return tuple(lane.name for lane in lanes) if None not in used and len(instances) == 1 else None


def _notes(flight: Flight, numbered: Sequence[EstimatorLane], best: BestEstimate, compared: Compared) -> Iterator[str]:
    if not numbered:
        others = "it says nothing" if flight.on_board else "their on-board log tells"
        yield f"the log has only the estimate that flew: of the other lanes {others}"
    elif len(numbered) == 1:
        yield f"the estimator has one lane, {numbered[0].name}: there was nothing to switch to"
    imus = [lane.imu for lane in numbered if lane.imu is not None]
    if len(imus) > len(set(imus)):
        yield "several lanes read the same IMU: what is wrong with it is wrong with all of them"
    if "heading" in compared.since:
        yield "headings are counted from where the lanes had them at first: their change is better known"
    if "gps_position" not in best.residuals:
        yield "without a GPS velocity and position of the lanes cannot be judged"
    if best.heading_from == "first guess":
        yield "the heading is not observable: that of the lanes cannot be judged"


def compare_lanes(flight: Flight, best: BestEstimate, lanes: Sequence[EstimatorLane]) -> Compared:
    """Each lane at its sample beside each keyframe, to which the IMU carries the best estimate.

    Positions begin where those of the lanes do that have a number: cores share an origin, or it has been taken out.
    """
    judged = judged_at(flight, best.t)
    which = flight_of(phases(flight), best.t)
    made = [LaneErrors(lane, _errors(lane, best)) for lane in lanes]
    since, lanes_at_first = dict[str, IntArray](), dict[str, float]()
    zero = next((one for one in made if one.known("position")[judged].any()), None)
    if zero is not None:
        for part in ("position", "height"):
            known = judged & zero.known(part)
            first = at_first(zero.error[part], known, which)
            since[part] = keyframe_at_first(known, which)
            for one in made:
                one.error[part][...] -= first
    covariance = {
        name: best.covariance[:, _BLOCKS[of], _BLOCKS[of]][:, own, own] for name, (of, own) in COMPONENTS.items()
    }
    if (first_heading := _heading_by_change(made, best, judged)) is not None:
        lanes_at_first["heading"] = healthy.AP_SIGMA["heading"]
        since["heading"] = np.full(len(best.t), first_heading)
        changed = np.hypot(best.change_sigma(ATTITUDE, first_heading)[:, 2], lanes_at_first["heading"])
        covariance["heading"] = changed[:, None, None] ** 2
    for one in made:  # what is known no better than a healthy lane distinguishes none
        for name, error in one.error.items():
            error[np.trace(covariance[name], axis1=1, axis2=2) >= healthy_bound(name) ** 2] = np.nan
    return Compared(best.t, judged, covariance, tuple(made), best.correlation, since, lanes_at_first)


def _heading_by_change(made: Sequence[LaneErrors], best: BestEstimate, judged: BoolArray) -> int | None:
    """The keyframe at which the lanes had the headings that all are counted from, where those are better known so.

    A compass that is not calibrated turns the best estimate as a whole, and its change is known far better. The lanes,
    as long as they agree, are off by what healthy ones are. The errors are moved to there, all by the same; None where
    nothing is moved.
    """
    numbered = [one for one in made if one.lane.core is not None]
    if len(numbered) < 2:
        return None
    known = np.flatnonzero(judged & np.logical_and.reduce([one.known("heading") for one in numbered]))
    early = known[: max(num.MIN_FIXES, int(num.POSITION_ORIGIN_SHARE * len(known)))]
    if len(early) < num.MIN_FIXES:
        return None
    first = [float(np.median(one.error["heading"][early])) for one in numbered]
    usual = healthy.AP_SIGMA["heading"]
    middle = int(early[len(early) // 2])
    changed = np.hypot(best.change_sigma(ATTITUDE, middle)[judged, 2], usual)
    if np.ptp(first) > usual or np.median(changed) >= np.median(best.sigma(ATTITUDE)[judged, 2]):
        return None
    for one in made:
        one.error["heading"][...] -= np.median(first)
    return middle


def _errors(lane: EstimatorLane, best: BestEstimate) -> dict[str, Array]:
    """(K, n) by quantity. Without GPS the best estimate knows no velocity nor position, without both no height."""
    row = nearest(lane.t, best.t)
    away = np.abs(lane.t[row] - best.t)
    usual = float(np.median(np.diff(lane.t))) if len(lane) > 1 else 0.0
    near = away <= max(num.FIX_SAMPLES_S, 0.5 * usual)
    q, velocity, position = best.at(np.where(near, lane.t[row], best.t))
    turn = attitude_error(lane.q_ned_frd[row], q)
    sources = {"turn": turn, "velocity": lane.velocity[row] - velocity, "position": lane.position[row] - position}
    errors = {name: np.where(near[:, None], sources[of][:, own], np.nan) for name, (of, own) in COMPONENTS.items()}
    unknown = [] if "gps_position" in best.residuals else ["velocity", "position", "height"]
    unknown += ["height"] if HEIGHTS.isdisjoint(best.residuals) else []
    unknown += ["heading"] if best.heading_from == "first guess" else []  # but the autopilot's own attitude none has it
    for name in unknown:
        errors[name][...] = np.nan
    return errors


def known_share(best: BestEstimate) -> float:
    """Share of the keyframes at which a best estimate knows its tilt better than what a healthy estimator is off by."""
    return float((length(best.sigma(ATTITUDE)[:, :2]) < healthy_bound("tilt")).mean())


def healthy_bound(quantity: str) -> float:
    """What a healthy estimator is off by in 5 % of all cases at most: rad, m/s, m."""
    _, own = COMPONENTS[quantity]
    return float(healthy.AP_SIGMA[quantity] * np.sqrt(chi_square(own.stop - own.start, num.Z_95)))


def off_probability(one: LaneErrors, compared: Compared, where: BoolArray) -> float:
    """That a lane is further off than a healthy one, in the mean square over keyframes (K,), in any quantity.

    With the best estimate's error δ the root mean square of e - δ is to first order that of e less a weighted sum of δ:
    what of δ is across e, or changes its sign while e does not, hardly counts. The mean square of δ itself, which adds
    to that of e, is taken off.
    """
    most = 0.0
    for quantity, error in one.error.items():
        known = where & one.known(quantity)
        own = compared.sigma(quantity)[known] ** 2
        square = float(((error[known] ** 2).sum(axis=1) - own).mean()) if known.any() else 0.0
        if square > 0.0:
            size = math.sqrt(square)
            weights = np.where(known[:, None], error, 0.0) / (known.sum() * size)
            beyond = size - healthy_bound(quantity)
            most = max(most, _probability(beyond, compared.sigma_of_sum({quantity: weights})))
    return most


def _probability(value: float, sigma: float) -> float:
    """That what is known to be a value with 1σ is above zero."""
    return NormalDist().cdf(value / sigma) if sigma > 0.0 else 0.5  # the same to the last bit


def nearer_probability(
    one: LaneErrors, other: LaneErrors, compared: Compared, where: BoolArray, odds: float = 1.0
) -> float | None:
    """That a lane is nearer to the truth than another over keyframes (K,), in the mean square; None: not observable.

    The difference e - f of two lanes is logged, and has no error of the best estimate in it: with its error δ between
    them, |f - δ|² - |e - δ|² = |f|² - |e|² + 2 (e - f)·δ, which is linear in δ, and so is its mean over time: its
    variance is that of a weighted sum of δ, which is known with all its correlations. Each quantity counts in units of
    what a healthy estimator is off by. odds: that the lane is the nearer one, before the best estimate has spoken.
    """
    gain, weights = 0.0, dict[str, Array]()
    for quantity, e in one.error.items():
        f, known = other.error[quantity], where & one.known(quantity) & other.known(quantity)
        if known.any():
            unit = healthy.AP_SIGMA[quantity] ** 2
            gain += float(((f[known] ** 2).sum(axis=1) - (e[known] ** 2).sum(axis=1)).mean()) / unit
            weights[quantity] = np.where(known[:, None], 2.0 * (e - f), 0.0) / (known.sum() * unit)
    if not weights:
        return None
    share = _probability(gain, compared.sigma_of_sum(weights))
    return share * odds / (share * odds + 1.0 - share)


def worse(one: LaneErrors, other: LaneErrors, compared: Compared, where: BoolArray, odds: float = 1.0) -> bool:
    """Whether a lane is surely the worse of two over keyframes (K,), by so much that it matters.

    The other one is surely nearer to the truth. And it is surely further off than a healthy one; or that is likelier
    than not, and the two are not alike, which is logged and known without any σ: how far off the worse one is need not
    be certain, where that the other one was the better choice is. odds: that the other one is nearer, before the best
    estimate has spoken.
    """
    nearer = nearer_probability(other, one, compared, where, odds)
    if nearer is None or nearer < priors.ACCUSED:
        return False
    off = off_probability(one, compared, where)
    return off >= priors.ACCUSED or (off >= priors.PROBABLY_HARMFUL and not alike(one, other, where))


def apart(one: LaneErrors, other: LaneErrors, where: BoolArray) -> dict[str, float]:
    """By how much two lanes differ, rms over keyframes (K,), in units of what a healthy one is off by; 0: not known."""
    sizes = dict.fromkeys(one.error, 0.0)
    for quantity, e in one.error.items():
        known = where & one.known(quantity) & other.known(quantity)
        if known.any():
            difference = (e - other.error[quantity])[known]
            sizes[quantity] = float(np.sqrt((difference**2).sum(axis=1).mean())) / healthy_bound(quantity)
    return sizes


def alike(one: LaneErrors, other: LaneErrors, where: BoolArray) -> bool:
    """Whether two lanes differ by less than 1σ of a healthy one in every quantity over keyframes (K,).

    Which of them is nearer may be known all the same: what both have in common does not hide it.
    """
    differ = apart(one, other, where)
    return all(size * healthy_bound(name) < healthy.AP_SIGMA[name] for name, size in differ.items())
