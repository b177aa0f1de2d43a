"""An explanation that was chosen: what it changes in the problem, what it gains, and what it turns out to be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.estimation.explanations import ENDING, SLOPED, Kind, Problem, Signature, at_work
from companion.estimation.model import ATTITUDE, CONSTANT_STATES, VELOCITY, Explained
from companion.estimation.system import Prior, Solution
from companion.model import Array

SHARPEST_S = 0.05  # 1σ of an onset, at best
ONSETS = 24
ONSET_PRICE = 2.0 * float(np.log(ONSETS))
_END_PRICE = 2.0 * float(np.log(4))  # whether it lasts for 8, 16, 32 or 64 s
_PASSING = 2.0 * float(np.log(1000))  # an IMU's bias that comes and goes, beside a field that a vehicle flies past
WORTH = 20.0  # twice the logarithm of the likelihood ratio, from which on an explanation is accepted
_ABOUT_S = 2.0  # before a fault, where it shows that the fault lies in a rough stretch
PROMISING = 10.0  # and from which on it is weighed again


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
    seconded: bool = True  # of a gyro: whether anything but the compass speaks against it
    taken: float = 0.0  # of its size, what the readings have been corrected by: the rest is small, and linear

    def in_noise(self, times: float) -> Choice:
        """The same where the variance of the noise is so many times what it was chosen at."""
        others = tuple((kind, shape, gain / times) for kind, shape, gain in self.others)
        return replace(self, gain=self.gain / times, others=others)

    def with_others(self, nearer: float) -> Choice:
        """The same where all others gain so much more."""
        return replace(self, others=tuple((kind, shape, gain + nearer) for kind, shape, gain in self.others))

    def beside(self, tried: Mapping[tuple[str, str], float]) -> Choice:
        """The same where it is known of some others, kind and shape, by how much less they are worth."""
        others = tuple(
            (k, shape, self.gain - tried.get((k, shape), self.gain - gain)) for k, shape, gain in self.others
        )
        return replace(self, others=others)

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


def comes_and_goes(kind: Kind, shape: str) -> bool:
    """Whether it is an error of the IMU, which does not show in a single reading, that ends again."""
    return shape == "pulse" and kind.side == "imu"


def price(kind: Kind, shape: str) -> float:
    """What choosing its times costs, and how seldom it is, as twice the logarithm of a likelihood."""
    passing = _PASSING if comes_and_goes(kind, shape) else 0.0
    return ONSET_PRICE + (_END_PRICE if shape in ENDING else 0.0) + kind.rarity + passing


def promising(choice: Choice) -> tuple[str, ...]:
    """The kinds of a choice that was not accepted and of its rivals that promise as much; a moment's shock is none."""
    others = (kind for kind, _, gain in choice.others if gain >= PROMISING)
    return tuple(dict.fromkeys(kind for kind in (choice.kind.name, *others) if not kind.endswith("_shock")))


def gain_beside(choice: Choice, problem: Problem, solution: Solution, prior: Prior, after: int = 0) -> float:
    """What a choice gains in a solution in which its sizes are unknowns, at the noise learned beside it.

    after: how many unknowns of later choices follow them.
    """
    signature = choice.of(problem)
    if signature is None:
        return 0.0
    own = slice(len(solution.c) - after - signature.unknowns, len(solution.c) - after)
    size, known = solution.c[own] + choice.taken, np.linalg.inv(solution.constants_covariance[own, own])
    return float(size @ known @ size) - _paid(solution, prior, own) - price(choice.kind, choice.shape)


def cost(choice: Choice, problem: Problem, solution: Solution, prior: Prior) -> float:
    """What a choice whose sizes are the last unknowns of a solution pays, as twice the logarithm of a likelihood."""
    signature = choice.of(problem)
    paid = 0.0 if signature is None else _paid(solution, prior, slice(-signature.unknowns, None))
    return paid + price(choice.kind, choice.shape)


def _paid(solution: Solution, prior: Prior, own: slice) -> float:
    """Occam's factor: sizes that could have been anything."""
    known = -float(np.linalg.slogdet(solution.constants_covariance[own, own])[1])
    return known + 2.0 * float(np.log(prior.constants_sigma[own]).sum())


def unrest(choice: Choice, problem: Problem, solution: Solution) -> float:
    """How many times more the IMU scatters about a fault of it than in the whole flight; at least 1.

    Of a solution that has the fault in it. Noise was learned where the flight is typical: where it is rougher, as by
    vibration, a launch or a touch of the ground, chance does as much as so much less evidence. The moments before the
    fault belong to it: one that has only begun explains what scatters since, but not what scattered before.
    """
    if choice.kind.side != "imu":
        return 1.0
    block = ATTITUDE if choice.kind.name.startswith("gyro") else VELOCITY
    e, d = solution.disturbances
    own = np.diagonal(d, axis1=1, axis2=2)[:, block]
    unlikely = (e[:, block] ** 2 / np.where(own > 0.0, own, np.inf)).sum(axis=1)
    within = (problem.t[1:] > choice.onset - _ABOUT_S) & (problem.t[:-1] < choice.end)
    return max(1.0, float(unlikely[within].mean() / max(unlikely.mean(), 1e-300))) if within.any() else 1.0


def with_choice(problem: Problem, prior: Prior, choice: Choice) -> tuple[Problem, Prior]:
    """The problem with the sizes of an explanation as further unknowns."""
    signature = choice.of(problem)
    if signature is None:
        return problem, prior
    onset, end = np.array([choice.onset]), np.array([choice.end])
    motion, measurements, m = problem.motion, list(problem.measurements), signature.unknowns
    column = np.zeros((*motion.residual.shape, m))
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
            constants_residual=np.concatenate((prior.constants_residual, np.full(m, -choice.taken))),
            constants_sigma=np.concatenate((prior.constants_sigma, np.full(m, choice.kind.prior / lasted))),
        ),
    )


def explained(problem: Problem, solution: Solution, accepted: Sequence[Choice]) -> tuple[tuple[Explained, ...], Array]:
    """What was accepted, with its size as the solution has it, in order of time; and the covariance of all sizes."""
    out, at, columns = [], CONSTANT_STATES, list[int]()
    for choice in accepted:
        signature = choice.of(problem)
        if signature is None:
            continue
        m = signature.unknowns
        whole = choice.kind.signature(problem)
        width = m if choice.axis < 0 or whole is None else whole.unknowns
        place = slice(None) if choice.axis < 0 else slice(choice.axis, choice.axis + 1)
        own = np.full(width, -1)
        own[place] = np.arange(at, at + m)
        size = np.zeros(width)
        size[place] = solution.c[at : at + m] + choice.taken
        out.append((choice, size, slice(len(columns), len(columns) + width)))
        columns += own.tolist()
        at += m
    known = np.array(columns, dtype=np.intp)
    covariance = solution.constants_covariance[np.ix_(known, known)] * np.outer(known >= 0, known >= 0)
    sigma = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    parts = (
        Explained(
            kind=choice.kind.name,
            shape=choice.shape,
            onset=choice.onset,
            onset_sigma=choice.onset_sigma,
            end=choice.end,
            size=size,
            sigma=sigma[place],
            gain=choice.gain,
            others=choice.others,
            seconded=choice.seconded,
            place=place,
        )
        for choice, size, place in out
    )
    return tuple(sorted(parts, key=lambda one: one.onset)), covariance
