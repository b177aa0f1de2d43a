"""Everything that may be wrong competes for what the witnesses do not agree on: which explanation pays most?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.estimation.explanations import KINDS, Kind, Problem, Signature, kind_of
from companion.estimation.model import (
    ACCEL_BIAS,
    ATTITUDE,
    CONSTANT_STATES,
    GYRO_BIAS,
    STATES,
    VELOCITY,
    Explained,
)
from companion.estimation.scan import Scan, scan
from companion.estimation.shapes import ENDING, SLOPED, at_work
from companion.estimation.system import Prior, Solution
from companion.estimation.weighing import Candidate, joined, jumps, pushes, weigh, weigh_shocks
from companion.model import Array

_ONSETS = 24
_ONSET_PRICE = 2.0 * float(np.log(_ONSETS))
_END_PRICE = 2.0 * float(np.log(4))  # whether it lasts for 8, 16, 32 or 64 s
_LEAST_S = {"imu": 5.0, "gps": 0.5, "compass": 2.0, "barometer": 2.0}  # what lasts for less is a shock, or a step
_SHARPEST_S = 0.05  # 1σ of an onset, at best
_MARGIN_S, _MARGIN = 3.0, 0.1  # s, and of the flight
WORTH = 30.0  # twice the logarithm of the likelihood ratio, from which on an explanation is accepted
_PROMISING = 10.0  # and from which on it is weighed again
_SHOCKS = {
    ("gyro_bias", "step"): GYRO_BIAS, ("accel_bias", "step"): ACCEL_BIAS,
    ("gyro_shock", "shock"): ATTITUDE, ("accel_shock", "shock"): VELOCITY,
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """An explanation that was accepted."""

    kind: Kind
    shape: str
    onset: float
    end: float  # s, of a pulse; infinite for what stays
    onset_sigma: float
    axis: int  # the one component that changes; -1 for all
    gain: float
    others: tuple[tuple[str, str, float], ...]

    def in_noise(self, times: float) -> Choice:
        """The same where the variance of the noise is so many times what it was chosen at."""
        others = tuple((kind, shape, gain / times) for kind, shape, gain in self.others)
        return replace(self, gain=self.gain / times, others=others)

    def of(self, problem: Problem) -> Signature | None:
        """The signature of what changes."""
        whole = self.kind.signature(problem)
        if whole is None or self.axis < 0:
            return whole
        part = slice(self.axis, self.axis + 1)
        return Signature(
            None if whole.motion is None else whole.motion[..., part],
            {name: values[..., part] for name, values in whole.measurements.items()},
        )


def choose(problem: Problem, solution: Solution) -> Choice | None:
    """The best further explanation; None where none promises to pay for itself."""
    grid = scan(problem, solution, _ONSETS + 1)
    found: list[Candidate] = []
    for seldom in (False, True):  # what comes and goes has two times to be tried: only where no single one explains
        found += [
            one
            for kind in KINDS
            for shape in kind.shapes
            if _comes_and_goes(kind, shape) == seldom
            and (one := _weighed(problem, solution, grid, kind, shape)) is not None
        ]
        found.sort(key=_net, reverse=True)
        if found and _net(found[0]) >= WORTH:
            break
    if not found or _net(found[0]) < _PROMISING - _ONSET_PRICE:
        return None
    refined = ((_refined(problem, solution, one, grid), one) for one in found[:4])
    (best, coarse), *fine = sorted(refined, key=lambda both: _net(both[0]), reverse=True)
    if _net(best) < _PROMISING:
        return None
    others = tuple((o.kind.name, o.shape, _net(o)) for o in [*(one for one, _ in fine), *found[4:]])
    i = best.best
    return Choice(
        kind=best.kind,
        shape=best.shape,
        onset=float(best.onset[i]),
        end=float(best.end[i]),
        onset_sigma=max(joined([best, coarse]).onset_sigma, _SHARPEST_S),
        axis=int(best.axis[i]),
        gain=_net(best),
        others=others,
    )


def _net(one: Candidate) -> float:
    """Twice the logarithm of the likelihood ratio at the best times, what choosing those costs paid."""
    return float(one.gain.max()) - _price(one.kind, one.shape)


def _price(kind: Kind, shape: str) -> float:
    return _ONSET_PRICE + (_END_PRICE if shape in ENDING else 0.0) + kind.rarity


def promising(choice: Choice) -> tuple[str, ...]:
    """The kinds of a choice that was not accepted and of its rivals that promise as much; a moment's shock is none."""
    others = (kind for kind, _, gain in choice.others if gain >= _PROMISING)
    return tuple(dict.fromkeys(kind for kind in (choice.kind.name, *others) if not kind.endswith("_shock")))


def gain_beside(choice: Choice, problem: Problem, solution: Solution, prior: Prior) -> float:
    """What a choice gains in a solution whose last unknowns are its sizes, at the noise learned beside it."""
    signature = choice.of(problem)
    if signature is None:
        return 0.0
    last = slice(len(solution.c) - signature.unknowns, None)
    size, known = solution.c[last], np.linalg.inv(solution.constants_covariance[last, last])
    paid = float(np.linalg.slogdet(known)[1] + 2.0 * np.log(prior.constants_sigma[last]).sum())
    return float(size @ known @ size) - paid - _price(choice.kind, choice.shape)


def unrest(choice: Choice, problem: Problem, solution: Solution) -> float:
    """How many times more the IMU scatters while a fault of it is at work than in the whole flight; at least 1.

    Of a solution that has the fault in it. Noise was learned where the flight is typical: where it is rougher, as by
    vibration or a touch of the ground, chance does as much as so much less evidence.
    """
    if choice.kind.side != "imu":
        return 1.0
    block = ATTITUDE if choice.kind.name.startswith("gyro") else VELOCITY
    e, d = solution.disturbances
    own = np.diagonal(d, axis1=1, axis2=2)[:, block]
    unlikely = (e[:, block] ** 2 / np.where(own > 0.0, own, np.inf)).sum(axis=1)
    within = (problem.t[1:] > choice.onset) & (problem.t[:-1] < choice.end)
    return max(1.0, float(unlikely[within].mean() / max(unlikely.mean(), 1e-300))) if within.any() else 1.0


def _comes_and_goes(kind: Kind, shape: str) -> bool:
    """Whether it is an error of the IMU, which does not show in a single reading, that ends again."""
    return shape == "pulse" and kind.side == "imu"


def _weighed(problem: Problem, solution: Solution, grid: Scan, kind: Kind, shape: str) -> Candidate | None:
    """A kind and shape at the onsets of the grid, and where its witnesses step."""
    if not kind.has_witness(problem):
        return None
    if (kind.name, shape) in _SHOCKS:
        return weigh_shocks(problem, solution, kind, shape, _SHOCKS[kind.name, shape])
    first, last = times_of_change(problem.t)
    inside = np.flatnonzero((grid.cuts >= first) & (grid.cuts <= last))
    if shape == "creep" or _comes_and_goes(kind, shape):
        return grid.weighed(kind, shape, *_pairs(inside))
    if shape == "ramp" or kind.side == "imu":
        return grid.weighed(kind, shape, inside)
    sudden = np.sort(pushes(problem, solution) if kind.summed else jumps(problem, solution, kind))
    if shape == "pulse":
        begin, end = _pairs(sudden)
        return weigh(problem, solution, kind, shape, begin, end) if len(begin) else None
    tried = grid.weighed(kind, shape, inside), weigh(problem, solution, kind, shape, sudden) if len(sudden) else None
    found = [one for one in tried if one is not None]
    return joined(found) if found else None


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
    if one.shape == "creep" or from_pushes or _comes_and_goes(one.kind, one.shape):
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


def with_choice(problem: Problem, prior: Prior, choice: Choice) -> tuple[Problem, Prior]:
    """The problem with the sizes of an explanation as further unknowns."""
    signature = choice.of(problem)
    if signature is None:
        return problem, prior
    onset, end = np.array([choice.onset]), np.array([choice.end])
    motion, measurements, m = problem.motion, list(problem.measurements), signature.unknowns
    column = np.zeros((len(problem.t) - 1, STATES, m))
    if signature.motion is not None:
        column = signature.motion * at_work(choice.shape, onset, end, problem.t[:-1], problem.t[1:])[0][:, None, None]
    motion = replace(motion, constants=np.concatenate((motion.constants, column), axis=2))
    for i, one in enumerate(measurements):
        own = np.zeros((*one.residual.shape, m))
        if one.name in signature.measurements:
            shape = choice.kind.shape_at(one.name, choice.shape)
            own = signature.measurements[one.name] * at_work(shape, onset, end, one.t, one.t)[0][:, None, None]
        measurements[i] = replace(one, constants=np.concatenate((one.constants, own), axis=2))
    sloped = choice.shape in SLOPED
    lasted = max(min(float(problem.t[-1]), choice.end) - choice.onset, 1.0) if sloped else 1.0
    return (
        replace(problem, motion=motion, measurements=tuple(measurements)),
        replace(
            prior,
            constants_residual=np.concatenate((prior.constants_residual, np.zeros(m))),
            constants_sigma=np.concatenate((prior.constants_sigma, np.full(m, choice.kind.prior / lasted))),
        ),
    )


def explained(problem: Problem, solution: Solution, accepted: Sequence[Choice]) -> tuple[Explained, ...]:
    """What was accepted, with its size as the solution has it; in order of time."""
    out, at = [], CONSTANT_STATES
    sigma = np.sqrt(np.maximum(np.diagonal(solution.constants_covariance), 0.0))
    for choice in accepted:
        signature = choice.of(problem)
        if signature is None:
            continue
        m = signature.unknowns
        whole = choice.kind.signature(problem)
        width = m if choice.axis < 0 or whole is None else whole.unknowns
        size, own = np.zeros(width), np.zeros(width)
        place = slice(None) if choice.axis < 0 else slice(choice.axis, choice.axis + 1)
        size[place], own[place] = solution.c[at : at + m], sigma[at : at + m]
        out.append(
            Explained(
                kind=choice.kind.name,
                shape=choice.shape,
                onset=choice.onset,
                onset_sigma=choice.onset_sigma,
                end=choice.end,
                size=size,
                sigma=own,
                gain=choice.gain,
                others=choice.others,
            )
        )
        at += m
    return tuple(sorted(out, key=lambda one: one.onset))


def detectable(problem: Problem, solution: Solution) -> dict[str, float]:
    """Kind → the smallest step in the middle of the flight that would have been called, in the kind's unit."""
    found = {}
    count = len(problem.t) - 1
    middle = slice(count // 4, max(count // 4 + 1, 3 * count // 4))
    _, d = solution.disturbances
    for (name, shape), block in _SHOCKS.items():
        kind = kind_of(name)
        if shape != "step" or not kind.has_witness(problem):
            continue
        known = np.maximum(np.diagonal(d[middle, block, block], axis1=1, axis2=2).min(axis=1), 1e-300)
        paid = np.log1p(known * kind.prior**2) + 2.0 * np.log(3.0) + _ONSET_PRICE
        found[name] = max(float(np.median(np.sqrt((WORTH + paid) / known))), kind.least)
    return found
