"""Everything that may be wrong competes for what the witnesses do not agree on: which explanation pays most?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.estimation.choice import (
    ONSET_PRICE,
    ONSETS,
    PROMISING,
    SHARPEST_S,
    WORTH,
    Choice,
    comes_and_goes,
    price,
)
from companion.estimation.explanations import KINDS, Kind, Problem, kind_of
from companion.estimation.model import (
    ACCEL_BIAS,
    ATTITUDE,
    GYRO_BIAS,
    VELOCITY,
)
from companion.estimation.scan import Scan, scan
from companion.estimation.system import Solution
from companion.estimation.weighing import Candidate, joined, jumps, pushes, weigh, weigh_shocks
from companion.model import Array

_LEAST_S = {"imu": 5.0, "gps": 0.5, "compass": 2.0, "barometer": 2.0}  # what lasts for less is a shock, or a step
_MARGIN_S, _MARGIN = 3.0, 0.1  # s, and of the flight
_REFINED = 4  # of the best, whose times are sought further
_UNTOLD = 0.3  # of what explains most
_NEARLY = 0.9  # the same of another side, beside which the first order does not tell which of them it is
CREEPS = {"gps_position": 30.0, "compass_field": 10.0}
"""Kind of a witness → s in which it goes off evenly, for what would have been called of it."""
_SHOCKS = {
    ("gyro_bias", "step"): GYRO_BIAS, ("accel_bias", "step"): ACCEL_BIAS,
    ("gyro_shock", "shock"): ATTITUDE, ("accel_shock", "shock"): VELOCITY,
}  # fmt: skip


def choose(problem: Problem, solution: Solution) -> tuple[Choice, ...]:
    """The best further explanation, none where none promises to pay for itself; and those that may be better yet.

    One of a kind that is linear in small sizes alone: its first order says less of it than it explains. And one of
    another side that explains nearly as much: of an error that is learned as noise the first order says little.
    """
    best, *others = rivals(problem, solution) or (None,)
    if best is None or best.gain < PROMISING:
        return ()
    least = max(_UNTOLD * best.gain, WORTH)
    untold = [] if best.kind.retimes else [one for one in others if one.kind.retimes and one.gain > least]
    near = [one for one in others if one.kind.side != best.kind.side and one.gain > max(_NEARLY * best.gain, WORTH)]
    return (best, *untold[:1], *(one for one in near[:1] if one not in untold[:1]))


def rivals(problem: Problem, solution: Solution) -> tuple[Choice, ...]:
    """The explanations that promise most, best first; none where none promises anything."""
    grid = scan(problem, solution, ONSETS + 1)
    weighed = (_weighed(problem, solution, grid, kind, shape) for kind in KINDS for shape in kind.shapes)
    candidates = sorted((one for one in weighed if one is not None), key=_net, reverse=True)
    if not candidates or _net(candidates[0]) < PROMISING - ONSET_PRICE:
        return ()
    refined = ((_refined(problem, solution, one, grid), one) for one in candidates[:_REFINED])
    fine = sorted(refined, key=lambda both: _net(both[0]), reverse=True)
    ranked = [*(one for one, _ in fine), *candidates[_REFINED:]]
    return tuple(_chosen(one, coarse, ranked) for one, coarse in fine)


def _chosen(one: Candidate, coarse: Candidate, ranked: Sequence[Candidate]) -> Choice:
    i, others = one.best, tuple((o.kind.name, o.shape, _net(o)) for o in ranked if o is not one)
    return Choice(
        kind=one.kind,
        shape=one.shape,
        onset=float(one.onset[i]),
        end=float(one.end[i]),
        onset_sigma=max(joined([one, coarse]).onset_sigma, SHARPEST_S),
        axis=int(one.axis[i]),
        gain=_net(one),
        others=others,
    )


def _net(one: Candidate) -> float:
    """Twice the logarithm of the likelihood ratio at the best times, what choosing those costs paid."""
    return float(one.gain.max()) - price(one.kind, one.shape)


def _weighed(problem: Problem, solution: Solution, grid: Scan, kind: Kind, shape: str) -> Candidate | None:
    """A kind and shape at the onsets of the grid, and where its witnesses step."""
    if not kind.has_witness(problem):
        return None
    if (kind.name, shape) in _SHOCKS:
        return weigh_shocks(problem, solution, kind, shape, _SHOCKS[kind.name, shape])
    first, last = times_of_change(problem.t)
    inside = np.flatnonzero((grid.cuts >= first) & (grid.cuts <= last))
    if shape == "creep":
        return grid.weighed(kind, shape, *_pairs(inside))
    if comes_and_goes(kind, shape):
        begin, end = _pairs(inside)
        lasts = grid.cuts[end] - grid.cuts[begin] >= _LEAST_S[kind.side]
        return grid.weighed(kind, shape, begin[lasts], end[lasts])
    if shape == "ramp" or kind.side == "imu":
        return grid.weighed(kind, shape, inside)
    sudden = np.sort(pushes(problem, solution) if kind.summed else jumps(problem, solution, kind))
    if shape == "pulse":
        begin, end = _pairs(sudden)
        between = weigh(problem, solution, kind, shape, begin, end) if len(begin) else None
        # what is priced as two moments, or is linear in small sizes alone, is tried between sudden changes only
        tried = between, None if kind.summed or kind.retimes else grid.weighed(kind, shape, *_pairs(inside))
    else:
        once = weigh(problem, solution, kind, shape, sudden) if len(sudden) else None
        tried = grid.weighed(kind, shape, inside), once
    candidates = [one for one in tried if one is not None]
    return joined(candidates) if candidates else None


def times_of_change(t: Array) -> tuple[float, float]:
    """From when to when something may be seen to change, of keyframes at t (K,), s.

    What is wrong from the first seconds on is a constant: nothing before it can be compared, and whatever the model
    lacks looks like it.
    """
    begin, end = float(t[0]), float(t[-1])
    margin = min(_MARGIN_S, _MARGIN * (end - begin))
    return begin + margin, end - margin


def _pairs(values: npt.NDArray[Any]) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Every two of ascending values."""
    first, last = np.triu_indices(len(values), 1)
    return values[first], values[last]


def _refined(problem: Problem, solution: Solution, one: Candidate, grid: Scan) -> Candidate:
    """The candidate at onsets around its best."""
    t, near, step = problem.t, float(one.onset[one.best]), float(np.diff(grid.cuts).max())
    from_pushes = bool(one.kind.summed) and one.shape == "pulse"
    if one.shape == "creep" or from_pushes or (one.shape == "pulse" and near in grid.cuts):
        for part in (1.0, 0.3, 0.09):
            one = _moved(problem, solution, one, part * (0.5 if from_pushes else step))
        return one
    if one.shape in ("pulse", "shock"):
        return one
    reach = step if near in grid.cuts else 1.0
    onset = np.unique(np.clip(np.concatenate([[near], near + np.linspace(-reach, reach, 21)]), t[0], t[-1]))
    again = weigh(problem, solution, one.kind, one.shape, onset)
    return one if again is None or again.gain.max() < one.gain.max() - 10.0 else again


def _moved(problem: Problem, solution: Solution, one: Candidate, reach: float) -> Candidate:
    """A pulse with beginning and end moved by up to `reach` s, whichever pair pays most."""
    shift = reach * np.linspace(-1.0, 1.0, 7)
    begin, final = (x.ravel() for x in np.meshgrid(one.onset[one.best] + shift, one.end[one.best] + shift))
    right = (begin > problem.t[0]) & (final < problem.t[-1]) & (final > begin + _LEAST_S[one.kind.side])
    if not right.any():
        return one
    again = weigh(problem, solution, one.kind, one.shape, begin[right], final[right])
    return one if again is None or again.gain.max() < one.gain.max() else again


def detectable(problem: Problem, solution: Solution) -> dict[str, float]:
    """Kind → the smallest that would have been called of it in the middle of the flight, in the kind's unit.

    Of an IMU's bias a step, of a witness what `CREEPS` says.
    """
    smallest = {}
    count = len(problem.t) - 1
    middle = slice(count // 4, max(count // 4 + 1, 3 * count // 4))
    _, d = solution.disturbances
    for (name, shape), block in _SHOCKS.items():
        kind = kind_of(name)
        if shape != "step" or not kind.has_witness(problem):
            continue
        known = np.maximum(np.diagonal(d[middle, block, block], axis1=1, axis2=2).min(axis=1), 1e-300)
        sizes = np.sqrt(_asked(kind, shape, known * kind.prior**2, 3) / known)
        smallest[name] = max(float(np.median(sizes)), kind.least)
    for name, lasts in CREEPS.items():
        kind, onset = kind_of(name), 0.5 * (problem.t[:1] + problem.t[-1:] - lasts)
        if onset[0] < times_of_change(problem.t)[0]:
            continue
        one = weigh(problem, solution, kind, "creep", onset, onset + lasts)
        if one is not None:
            variance = lasts**2 * float(np.diagonal(one.covariance[0]).max())
            asked = _asked(kind, "creep", kind.prior**2 / variance, one.size.shape[1])
            smallest[name] = max(float(np.sqrt(asked * variance)), kind.least_of("creep"))
    return smallest


def _asked(kind: Kind, shape: str, known: Any, unknowns: int) -> Any:
    """What a size of one of some components has to gain at first, to be worth its price.

    known: by how much better it is known than beforehand, a ratio of variances.
    """
    return WORTH + np.log1p(known) + 2.0 * np.log(unknowns) + price(kind, shape)
