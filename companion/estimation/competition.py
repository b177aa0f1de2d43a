"""Everything that may be wrong competes for what the witnesses do not agree on: which explanation pays most?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.estimation.explanations import (
    KINDS,
    Candidate,
    Kind,
    Problem,
    Signature,
    jumps,
    kind_of,
    pushes,
    weigh,
    weigh_shocks,
)
from companion.estimation.model import (
    ACCEL_BIAS,
    ATTITUDE,
    CONSTANT_STATES,
    GYRO_BIAS,
    STATES,
    VELOCITY,
    Explained,
)
from companion.estimation.shapes import SLOPED, at_work
from companion.estimation.system import (
    Prior,
    Solution,
)
from companion.model import Array

_ONSETS = 24
_ONSET_PRICE = 2.0 * float(np.log(_ONSETS))
_CREEPS_S = np.array([8.0, 16.0, 32.0, 64.0])  # how long what creeps may creep
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
    begin, end = problem.t[0], problem.t[-1]
    margin = min(3.0, 0.1 * (end - begin))
    coarse = np.linspace(begin + margin, end - margin, _ONSETS)
    found: list[Candidate] = []
    for seldom in (False, True):  # what comes and goes has two times to be tried: only where no single one explains
        found += [
            one
            for kind in KINDS
            for shape in kind.shapes
            if _comes_and_goes(kind, shape) == seldom
            and (one := _weighed(problem, solution, kind, shape, coarse)) is not None
        ]
        found.sort(key=lambda one: -float(one.gain.max()))
        if found and found[0].gain.max() >= WORTH:
            break
    if not found or found[0].gain.max() < _PROMISING:
        return None
    fine = sorted(
        (_refined(problem, solution, one, coarse) for one in found[:4]), key=lambda one: -float(one.gain.max())
    )
    first = fine[0]
    gain = float(first.gain.max()) - _ONSET_PRICE
    if gain < _PROMISING:
        return None
    others = tuple((o.kind.name, o.shape, float(o.gain.max()) - _ONSET_PRICE) for o in [*fine[1:], *found[4:]])
    return _chosen(first, gain, others)


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
    return float(size @ known @ size) - paid - _ONSET_PRICE


def _chosen(first: Candidate, gain: float, others: tuple[tuple[str, str, float], ...]) -> Choice:
    likely = np.exp(0.5 * (first.gain - first.gain.max()))
    likely /= likely.sum()
    spread = float(np.sqrt(likely @ (first.onset - float(likely @ first.onset)) ** 2))
    i = first.best
    return Choice(
        kind=first.kind,
        shape=first.shape,
        onset=float(first.onset[i]),
        end=float(first.end[i]),
        onset_sigma=max(spread, 0.05),
        axis=int(first.axis[i]),
        gain=gain,
        others=others,
    )


def _comes_and_goes(kind: Kind, shape: str) -> bool:
    """Whether it is an error of the IMU, which does not show in a single reading, that ends again."""
    return shape == "pulse" and kind.side == "imu"


def _weighed(problem: Problem, solution: Solution, kind: Kind, shape: str, coarse: Array) -> Candidate | None:
    if kind.needs and problem.witness(kind.needs) is None:
        return None
    if (kind.name, shape) in _SHOCKS:
        return weigh_shocks(problem, solution, kind, shape, _SHOCKS[kind.name, shape])
    onset, end = _tried(problem, solution, kind, shape, coarse)
    return weigh(problem, solution, kind, shape, onset, end) if len(onset) else None


def _tried(problem: Problem, solution: Solution, kind: Kind, shape: str, coarse: Array) -> tuple[Array, Array | None]:
    """Onsets (T,) s, and ends (T,) of what ends, that are tried first."""
    if _comes_and_goes(kind, shape):
        sudden = coarse[::2]
    else:
        sudden = np.sort(pushes(problem, solution) if kind.summed else jumps(problem, solution, kind))
    if shape == "pulse":
        first, last = (x.ravel() for x in np.meshgrid(sudden, sudden, indexing="ij"))
        return first[last > first], last[last > first]
    if shape == "creep":
        first, lasted = (x.ravel() for x in np.meshgrid(coarse, _CREEPS_S, indexing="ij"))
        inside = first + lasted < problem.t[-1]
        return first[inside], (first + lasted)[inside]
    return (np.unique(np.concatenate([coarse, sudden])) if shape == "step" and kind.side != "imu" else coarse), None


def _refined(problem: Problem, solution: Solution, one: Candidate, coarse: Array) -> Candidate:
    """The candidate at onsets around its best."""
    t = problem.t
    near = float(one.onset[one.best])
    if _comes_and_goes(one.kind, one.shape) or (one.kind.summed and one.shape == "pulse"):
        reach = 0.5 if one.kind.summed else 2.0 * float(coarse[1] - coarse[0])
        for _ in range(3):
            one = _moved(problem, solution, one, reach)
            reach *= 0.3
        return one
    if one.shape in ("pulse", "shock"):
        return one
    if one.shape == "creep":  # the beginning and the end by turns
        stop = float(one.end[one.best])
        shift = np.linspace(-1.0, 1.0, 15)
        begin, final = (x.ravel() for x in np.meshgrid(near + 3.0 * shift, stop + 0.6 * (stop - near) * shift))
        again = weigh(problem, solution, one.kind, one.shape, begin, np.maximum(final, begin + 1.0))
        return one if again is None else again
    at = int(np.argmin(np.abs(coarse - near)))
    reach = 1.0 if abs(coarse[at] - near) > 1e-9 else float(coarse[1] - coarse[0])
    onset = np.unique(np.clip(np.concatenate([[near], near + np.linspace(-reach, reach, 21)]), t[0], t[-1]))
    again = weigh(problem, solution, one.kind, one.shape, onset)
    return one if again is None or again.gain.max() < one.gain.max() - 10.0 else again


def _moved(problem: Problem, solution: Solution, one: Candidate, reach: float) -> Candidate:
    """A pulse with beginning and end moved by up to `reach` s, whichever pair pays most."""
    shift = reach * np.linspace(-1.0, 1.0, 7)
    begin, final = (x.ravel() for x in np.meshgrid(one.onset[one.best] + shift, one.end[one.best] + shift))
    right = (begin > problem.t[0]) & (final < problem.t[-1]) & (final > begin + 0.5)
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
        if shape != "step" or (kind.needs and problem.witness(kind.needs) is None):
            continue
        known = np.maximum(np.diagonal(d[middle, block, block], axis1=1, axis2=2).min(axis=1), 1e-300)
        paid = np.log1p(known * kind.prior**2) + 2.0 * np.log(3.0) + _ONSET_PRICE
        found[name] = max(float(np.median(np.sqrt((WORTH + paid) / known))), kind.least)
    return found
