"""Every hypothesis of the table, in every shape and at all times, at one linear problem and one noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.constants import num
from companion.estimation.differences import Differences, score_of_own
from companion.estimation.evidence import Trial, joined, kept, least_found, trial
from companion.estimation.hypotheses import HYPOTHESES, SECANTS, Hypothesis, hypothesis_of
from companion.estimation.model import ACCEL_BIAS, ATTITUDE, GYRO_BIAS, VELOCITY
from companion.estimation.scan import Scan, jumps, scan, score, velocity_impulses
from companion.estimation.shapes import ENDING
from companion.estimation.system import Problem
from companion.model import Array

_AT_EVERY_KEYFRAME = {
    ("gyro_bias", "step"): GYRO_BIAS, ("accel_bias", "step"): ACCEL_BIAS,
    ("gyro_shock", "shock"): ATTITUDE, ("accel_shock", "shock"): VELOCITY,
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """One hypothesis in one shape at T pairs of times, what its score is there, and the cells that they stand for."""

    hypothesis: Hypothesis
    shape: str
    onset: Array  # (T,) s
    end: Array  # (T,) s, of what ends; infinite for what stays
    weight: Array  # (T,) prior probability of the cell
    b: Array  # (T, m); of D data sets (T, m, D)
    v: Array  # (T, m, m)
    imu: int | None = None  # the IMU whose it is; None for that of the estimate, and for what is no IMU's

    def at(self, which: npt.NDArray[np.bool_]) -> Cells:
        """The same at some of its times alone."""
        some = {name: getattr(self, name)[which] for name in ("onset", "end", "weight", "b", "v")}
        return replace(self, **some)

    def weighed(self, problem: Problem, b: Array | None = None) -> Trial:
        """The evidence; b: in place of its own, of D data sets (T, m, D)."""
        span, times = (float(problem.t[0]), float(problem.t[-1])), (self.onset, self.end, self.weight)
        aliased = None if self.imu is not None else problem.aliased.get(self.hypothesis.name)
        return trial(self.hypothesis, self.shape, times, span, self.b if b is None else b, self.v, aliased, self.imu)


def trials(problem: Problem, hypotheses: Sequence[Hypothesis] = HYPOTHESES) -> tuple[Trial, ...]:
    """Every hypothesis and shape with its evidence, the likeliest first; of all of them those of other IMUs too."""
    rows = (*hypotheses, *(row for row in SECANTS if any(row.name == one.name for one in hypotheses)))
    grid = scan(problem, num.SCAN_STRETCHES, rows)
    every = [
        one
        for hypothesis in rows
        for shape in hypothesis.shapes
        if (one := _on_the_grid(problem, grid, hypothesis, shape)) is not None
    ]
    every.sort(key=lambda one: -one.log_bayes.max())
    least = max(num.REFINED_OF_BEST * every[0].log_bayes.max(), num.REFINED_LOG_BAYES) if every else 0.0
    fine = [
        _refined(problem, one, grid) if i < num.REFINED_KINDS and one.log_bayes.max() > least else one
        for i, one in enumerate(every)
    ]
    fine = _together(fine)
    if hypotheses is HYPOTHESES:
        fine += (one.weighed(problem) for one in of_other_imus(problem))
    return tuple(sorted(fine, key=lambda one: -one.log_odds))


def _together(each: Sequence[Trial]) -> list[Trial]:
    """What is about several sizes as one of each hypothesis and shape."""
    parts: dict[tuple[str, str], list[Trial]] = {}
    for one in each:
        parts.setdefault((one.hypothesis.name, one.shape), []).append(one)
    return [replace(joined(some), hypothesis=hypothesis_of(name)) for (name, _), some in parts.items()]


def times_of_change(t: Array) -> tuple[float, float]:
    """From when to when something may be seen to change, of keyframes at t (K,), s.

    What is wrong from the first seconds on is a constant: nothing before it can be compared. What has only begun can
    be, though little is known of it: without it another hypothesis would have to explain it.
    """
    begin, end = float(t[0]), float(t[-1])
    margin = min(num.CHANGE_MARGIN_S, num.CHANGE_MARGIN * (end - begin))
    return begin + margin, max(begin + margin, float(t[-2]))


def _on_the_grid(problem: Problem, grid: Scan, hypothesis: Hypothesis, shape: str) -> Trial | None:
    """A kind and shape at the cuts of the grid, and where its readings step."""
    parts = [on_cuts(problem, grid, hypothesis, shape)]
    if hypothesis.has_aiding(problem) and hypothesis.device != "imu" and shape in ("step", "pulse"):
        first, last = times_of_change(problem.t)  # what steps between two readings is told to the reading
        sudden = np.sort(velocity_impulses(problem) if hypothesis.integrated else jumps(problem, hypothesis))
        sudden = sudden[(sudden >= first) & (sudden <= last)]
        begin, end = _pairs(sudden) if shape == "pulse" else (sudden, np.full(len(sudden), np.inf))
        lasts = end - begin >= num.PULSE_MIN_S[hypothesis.device]
        width = float(np.median(np.diff(problem.t)))
        parts.append(at_times(problem, hypothesis, shape, begin[lasts], end[lasts], width))
    weighed = [one.weighed(problem) for one in parts if one is not None]
    return joined(weighed) if weighed else None


def on_cuts(problem: Problem, grid: Scan, hypothesis: Hypothesis, shape: str) -> Cells | None:
    """A kind and shape at the cuts of the grid, or at every keyframe; None where the flight tells nothing of it."""
    if not hypothesis.has_aiding(problem):
        return None
    t = problem.t
    first, last = times_of_change(t)
    if (hypothesis.name, shape) in _AT_EVERY_KEYFRAME:
        block = _AT_EVERY_KEYFRAME[hypothesis.name, shape]
        e, d = problem.solution.disturbances
        onset = 0.5 * (t[:-1] + t[1:]) if shape == "shock" else t[1:]
        judged = (onset >= first) & (onset <= last)
        weight = np.diff(t) / (last - first)
        if shape == "shock":
            weight = weight * problem.shock_rate[:, int(hypothesis.sensor == "accel")]
        if not judged.any():
            return None
        never = np.full(len(e), np.inf)
        times = onset[judged], never[judged], weight[judged]
        own = np.diagonal(problem.motion.weight, axis1=1, axis2=2)[judged, block]
        known = _beyond_rounding(-e[judged, block], d[judged, block, block], own.max(axis=1))
        return _scored(problem, hypothesis, shape, times, known)
    inside = np.flatnonzero((grid.cuts >= first) & (grid.cuts <= last))
    begin, end = inside, None
    if shape in ENDING:
        begin, end = _pairs(inside)
        lasts = grid.cuts[end] - grid.cuts[begin] >= num.PULSE_MIN_S[hypothesis.device]
        begin, end = begin[lasts], end[lasts]
    scores = grid.score(hypothesis, shape, begin, end)
    if scores is None:
        return None
    width = float(np.diff(grid.cuts).max()) if len(grid.cuts) > 1 else num.CHANGE_MIN_S
    onset = grid.cuts[begin]
    final = np.full(len(onset), np.inf) if end is None else grid.cuts[end]
    return _scored(problem, hypothesis, shape, (onset, final, _weight(problem, onset, final, width)), scores)


def _beyond_rounding(b: Array, v: Array, own: Array) -> tuple[Array, Array]:
    """Scores b (T, m) with information v (T, m, m), without the directions in which rounding is all that is left of v.

    It is the difference of own (T,) and what is about as large: where that is indefinite, evidence would be anything.
    """
    value, vector = np.linalg.eigh(v)
    known = value > num.ROUNDED_BLOCK * own[:, None]
    kept = vector * known[:, None, :]
    inverse = vector.swapaxes(1, 2)
    return np.einsum("tij,tj...->ti...", kept @ inverse, b), kept * value[:, None, :] @ inverse


def at_times(
    problem: Problem, hypothesis: Hypothesis, shape: str, onset: Array, end: Array, width: float
) -> Cells | None:
    """At any times; width: s, of the cells about onset and end."""
    scores = score(problem, hypothesis, shape, onset, end) if len(onset) else None
    if scores is None:
        return None
    return _scored(problem, hypothesis, shape, (onset, end, _weight(problem, onset, end, width)), scores)


def _scored(
    problem: Problem, hypothesis: Hypothesis, shape: str, times: tuple[Array, Array, Array], scores: tuple[Array, Array]
) -> Cells:
    """With what the other IMUs tell of it too."""
    b, v = scores
    if hypothesis.between_imus and problem.others:
        gradient, information = score_of_own(problem.others, hypothesis, shape, times[0], times[1])
        b, v = b + gradient, v + information
    return Cells(hypothesis, shape, *times, b, v)


def of_other_imus(problem: Problem) -> tuple[Cells, ...]:
    """What may be wrong with every other IMU than the estimate's."""
    tried = [(one, shape) for one in HYPOTHESES if one.min_between_imus for shape in one.shapes]
    return tuple(_of_another(problem, other, *one) for other in problem.others for one in tried)


def _of_another(problem: Problem, one: Differences, hypothesis: Hypothesis, shape: str) -> Cells:
    """An error of another IMU, that begins and ends within blocks of its differences."""
    onset = np.linspace(one.t[0], one.t[-1], min(num.ONSETS_PER_BLOCK * len(one.t), num.KEYFRAMES))
    end, width = np.full(len(onset), np.inf), float(onset[1] - onset[0])
    if shape in ENDING:
        cuts = onset[:: -(-len(onset) // num.SCAN_STRETCHES)]
        onset, end = _pairs(cuts)
        lasts, width = end - onset >= num.PULSE_MIN_S["imu"], float(np.diff(cuts).max())
        onset, end = onset[lasts], end[lasts]
    weight = _weight(problem, onset, end, width)
    scores = one.score(hypothesis, shape, onset, end)
    return Cells(hypothesis, shape, onset, end, weight, *scores, imu=one.instance)


def _weight(problem: Problem, onset: Array, end: Array, width: float) -> Array:
    """(T,) prior probability of cells of a width, s: onsets alike, durations alike in their logarithm."""
    first, last = times_of_change(problem.t)
    span = max(last - first, num.CHANGE_MIN_S)
    share = np.full(len(onset), min(width / span, 1.0))
    ends = np.isfinite(end)
    lasted = np.where(ends, np.maximum(end - onset, num.CHANGE_MIN_S), 1.0)
    durations = max(float(np.log(span / num.CHANGE_MIN_S)), 1.0)
    return np.asarray(np.where(ends, share * np.minimum(width / lasted / durations, 1.0), share))


def _pairs(values: npt.NDArray[Any]) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Every two of ascending values."""
    first, last = np.triu_indices(len(values), 1)
    return values[first], values[last]


def _refined(problem: Problem, one: Trial, grid: Scan) -> Trial:
    """The trial on a grid that is finer about its peak, in some rounds."""
    if (one.hypothesis.name, one.shape) in _AT_EVERY_KEYFRAME or len(grid.cuts) < 2:
        return one
    first, last = times_of_change(problem.t)
    step = 0.5 * float(np.diff(grid.cuts).max())
    on_jump = one.onset[one.best] not in grid.cuts
    reach = 0.5 * float(np.median(np.diff(problem.t))) if on_jump else step
    for _ in range(num.REFINEMENTS):
        begin, final = float(one.onset[one.best]), float(one.end[one.best])
        shift, width = reach * np.linspace(-1.0, 1.0, num.REFINED_POINTS), 2.0 * reach / (num.REFINED_POINTS - 1)
        onset, end = begin + shift, np.full(num.REFINED_POINTS, np.inf)
        near = np.abs(one.onset - begin) <= reach
        if np.isfinite(final):
            onset, end = (x.ravel() for x in np.meshgrid(begin + shift, final + shift))
            near &= np.abs(one.end - final) <= reach
        right = (onset >= first) & (onset <= last) & (end > onset + num.PULSE_MIN_S[one.hypothesis.device])
        right &= ~np.isfinite(end) | (end <= last)
        if not right.any():
            return one
        scored = at_times(problem, one.hypothesis, one.shape, onset[right], end[right], width)
        if scored is None:
            return one
        fine = scored.weighed(problem)
        one = joined([kept(one, ~near), fine]) if (~near).any() else fine
        reach = 1.5 * width
    return one


def detectable(problem: Problem) -> dict[str, float]:
    """Hypothesis → the smallest that would have been accused in 95 % of flights like this, in the middle of it.

    Of an IMU's bias a step, of an aiding sensor what `num.CREEPS` says; in the kind's unit.
    """
    smallest = {}
    t = problem.t
    hours = float(t[-1] - t[0]) / 3600.0
    first, last = times_of_change(t)
    count = len(t) - 1
    middle = slice(count // 4, max(count // 4 + 1, 3 * count // 4))
    cell = float(np.median(np.diff(t))) / max(last - first, num.CHANGE_MIN_S)
    _, d = problem.solution.disturbances
    for (name, shape), block in _AT_EVERY_KEYFRAME.items():
        hypothesis = hypothesis_of(name)
        if shape != "step" or not hypothesis.has_aiding(problem):
            continue
        known = np.maximum(np.diagonal(d[middle, block, block], axis1=1, axis2=2).min(axis=1), 1e-300)
        sizes = least_found(known, hypothesis, shape, hours, cell)
        smallest[name] = float(np.median(sizes))
    for name, lasts in num.CREEPS.items():
        hypothesis, onset = hypothesis_of(name), 0.5 * (t[:1] + t[-1:] - lasts)
        scores = score(problem, hypothesis, "creep", onset, onset + lasts) if onset[0] >= first else None
        if scores is not None:
            known = np.linalg.eigvalsh(scores[1][0])[:1]
            rate = least_found(np.maximum(known, 1e-300), hypothesis, "creep", hours, cell, lasts)
            smallest[name] = lasts * float(rate[0])
    return smallest
