"""How far each lane of an estimator is from the best estimate, and which of two lanes is nearer to the truth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import NormalDist

import numpy as np

from companion.analysis.deviations import COMPONENTS, at_first, keyframe_at_first
from companion.analysis.finding import IntArray
from companion.analysis.phases import flown, judged_at, phases
from companion.analysis.reference import BoolArray, attitude_error, length
from companion.constants import healthy, num, priors
from companion.estimation import ATTITUDE, HEIGHTS, POSITION, VELOCITY, BestEstimate, Correlation, chi_square
from companion.model import Array, EstimatorLane, Flight, nearest

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

    @property
    def by_change(self) -> bool:
        """Whether headings are counted from where the lanes had them at first."""
        return "heading" in self.since

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


def compare_lanes(flight: Flight, best: BestEstimate, lanes: Sequence[EstimatorLane]) -> Compared:
    """Each lane at its sample beside each keyframe, to which the IMU carries the best estimate.

    Positions begin where those of the lanes do that have a number: cores share an origin, or it has been taken out.
    """
    judged = judged_at(flight, best.t)
    which = np.searchsorted([begin for begin, _ in flown(phases(flight))][1:], best.t, side="right")
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
        name: best.covariance[:, block, block][:, own, own]
        for name, (of, own) in COMPONENTS.items()
        for block in (_BLOCKS[of],)
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
    near = away <= max(num.FIX_SAMPLES_S, 0.5 * float(np.median(np.diff(lane.t))))
    q, velocity, position = best.at(np.where(near, lane.t[row], best.t))
    turn = attitude_error(lane.q_ned_frd[row], q)
    sources = {"turn": turn, "velocity": lane.velocity[row] - velocity, "position": lane.position[row] - position}
    if "gps_position" not in best.residuals:
        sources |= {"velocity": np.full_like(turn, np.nan), "position": np.full_like(turn, np.nan)}
    errors = {name: np.where(near[:, None], sources[of][:, own], np.nan) for name, (of, own) in COMPONENTS.items()}
    if HEIGHTS.isdisjoint(best.residuals):
        errors["height"] = np.full_like(errors["height"], np.nan)
    if best.heading_from == "first guess":  # nothing but the autopilot's own attitude has it
        errors["heading"] = np.full_like(errors["heading"], np.nan)
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
