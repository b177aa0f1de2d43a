"""Data sets of a linear problem: noise as it states it, and faults of size one, at known times.

A data set is what all factors read: the residuals of the motion and of every sensor, those of the priors, and what
other IMUs read more. The solution, and every score, is linear in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.constants import num
from companion.estimation.block_tridiagonal import roots
from companion.estimation.differences import Differences
from companion.estimation.evidence import least_found
from companion.estimation.explanations import KINDS, Kind, Problem
from companion.estimation.search import detectable, times_of_change
from companion.estimation.shapes import activation
from companion.estimation.system import Prior, Solution
from companion.estimation.weighing import score
from companion.model import Array


@dataclass(frozen=True, slots=True, eq=False)
class DataSets:
    """N data sets."""

    motion: Array  # (K-1, n, N)
    measured: tuple[Array, ...]  # of every sensor (M, d, N)
    prior: tuple[Array, Array]  # (n, N) and (C, N), times their information
    apart: tuple[Mapping[str, Array], ...]  # of every other IMU, by sensor (B, 3, N)

    def __len__(self) -> int:
        return int(self.motion.shape[-1])

    @classmethod
    def joined(cls, parts: Sequence[DataSets]) -> DataSets:
        """One after the other."""

        def together(values: Sequence[Array]) -> Array:
            return np.concatenate(values, axis=-1)

        first = parts[0]
        return cls(
            together([one.motion for one in parts]),
            tuple(together(each) for each in zip(*(one.measured for one in parts), strict=True)),
            (together([one.prior[0] for one in parts]), together([one.prior[1] for one in parts])),
            tuple(
                {name: together([one.apart[i][name] for one in parts]) for name in own}
                for i, own in enumerate(first.apart)
            ),
        )

    def solved(self, problem: Problem, solution: Solution) -> tuple[Problem, Solution]:
        """A problem that reads these, and its solution."""
        x, c = solution.redrawn(self.motion, list(zip(problem.measurements, self.measured, strict=True)), self.prior)
        motion = replace(problem.motion, residual=self.motion)
        read = zip(problem.measurements, self.measured, strict=True)
        apart = zip(problem.others, self.apart, strict=True)
        shown = replace(
            problem,
            motion=motion,
            measurements=tuple(replace(one, residual=own) for one, own in read),
            others=tuple(replace(one, value=own) for one, own in apart),
        )
        return shown, replace(solution, motion=motion, x=x, c=c)


@dataclass(frozen=True, slots=True, eq=False)
class Fault:
    """A kind of fault of size one at several times."""

    kind: Kind
    shape: str
    lasts: float  # s, that it grows for; 0 for a step
    onset: Array  # (O,) s
    end: Array  # (O,)
    direction: Array  # (m,), of a creep per second
    size: float  # that is detectable

    def alone(self, problem: Problem) -> DataSets:
        """Nothing but itself, at each of its times."""
        signature = self.kind.signature(problem)
        assert signature is not None
        sets = len(self.onset)

        def column(columns: Array, shape: str, start: Array, stop: Array) -> Array:
            share = activation(shape, self.onset, self.end, start, stop).T
            return (columns @ self.direction)[..., None] * share[:, None, :]

        motion = np.zeros((*problem.motion.transition.shape[:2], sets))
        if signature.motion is not None:
            motion = -column(signature.motion, self.shape, problem.t[:-1], problem.t[1:])
        measured = [np.zeros((*one.residual.shape, sets)) for one in problem.measurements]
        for i, one in enumerate(problem.measurements):
            if one.name in signature.measurements:
                shape = self.kind.shape_at(one.name, self.shape)
                measured[i] = column(signature.measurements[one.name], shape, one.t, one.t)
        states, constants = problem.motion.constants.shape[1:]
        nothing = np.zeros((states, sets)), np.zeros((constants, sets))
        return DataSets(motion, tuple(measured), nothing, tuple(self._apart(one) for one in problem.others))

    def _apart(self, other: Differences) -> dict[str, Array]:
        """(B, 3, O) by sensor: what another IMU reads more than the one with the fault."""
        apart = {name: np.zeros((len(other.t), 3, len(self.onset))) for name in other.value}
        if self.kind.side == "imu":
            columns = other.columns(self.kind.sensor, self.kind.error, self.shape, self.onset, self.end)
            apart[self.kind.sensor] = -columns.transpose(2, 0, 1) * self.direction[:, None]
        return apart


def injected(
    problem: Problem, solution: Solution, kinds: Sequence[Kind] = KINDS
) -> tuple[tuple[Fault, ...], tuple[str, ...]]:
    """Kinds as faults along the axis that the flight tells least of, and those that it cannot show; no nuisances.

    In the middle of the flight. Of an IMU a step, of an aiding sensor what `num.CREEPS` says, else a step.
    """
    faults, not_shown, known = list[Fault](), list[str](), detectable(problem, solution)
    t, (first, last) = problem.t, times_of_change(problem.t)
    cell, hours = float(np.median(np.diff(t))) / (last - first), float(t[-1] - t[0]) / 3600.0
    for kind in (one for one in kinds if not one.nuisance):
        lasts = num.CREEPS.get(kind.name, 0.0)
        shape = "creep" if lasts else "step"
        possible = t[(t >= first) & (t <= last - lasts)]
        if not len(possible):
            continue
        middle = t[0] + np.linspace(*num.INJECTED_MIDDLE, num.INJECTED_ONSETS) * (t[-1] - t[0]) - 0.5 * lasts
        onset = possible[np.minimum(np.searchsorted(possible, middle), len(possible) - 1)]
        end = onset + (lasts or np.inf)
        scores = score(problem, solution, kind, shape, onset, end)
        if scores is None:
            continue
        direction, information = _least_known(kind, np.median(scores[1], axis=0))
        grown = lasts or 1.0
        size = grown * float(least_found(np.array([information]), kind, shape, hours, cell, grown)[0])
        size = known.get(kind.name, max(size, kind.harmful(shape)))
        if size > min(kind.most, num.INJECTED_SIGMAS * kind.prior):
            not_shown.append(kind.name)
        else:
            faults.append(Fault(kind, shape, lasts, onset, end, direction / grown, size))
    return tuple(faults), tuple(not_shown)


def _least_known(kind: Kind, v: Array) -> tuple[Array, float]:
    """The direction (m,) of which information V (m, m) tells least, and how much: of an IMU one of its axes."""
    if kind.side != "imu":
        values, vectors = np.linalg.eigh(v)
        return vectors[:, 0], float(max(values[0], 0.0))
    own = np.diagonal(v)
    axis = int(np.argmin(np.where(own > num.UNSEEN_INFORMATION * own.max(), own, np.inf)))
    return np.eye(len(v))[axis], float(own[axis])


def noise(problem: Problem, prior: Prior, rng: np.random.Generator, count: int) -> DataSets:
    """Nothing but the noise that the problem states."""
    weight = problem.motion.weight
    motion = roots(weight).swapaxes(-1, -2) @ rng.standard_normal((*weight.shape[:2], count))
    measured = tuple(
        rng.standard_normal((*one.residual.shape, count)) / np.sqrt(np.maximum(one.information, 1e-300))[..., None]
        for one in problem.measurements
    )
    believed = (prior.sigma, prior.constants_sigma)
    of_states, of_constants = (rng.standard_normal((len(own), count)) / own[:, None] for own in believed)
    apart = ({name: _drawn(rng, own, count) for name, own in one.weight.items()} for one in problem.others)
    return DataSets(motion, measured, (of_states, of_constants), tuple(apart))


def _drawn(rng: np.random.Generator, weight: Array, count: int) -> Array:
    """(B, 3, N) differences with an inverse covariance (3, B, B); nothing of what is free."""
    values, vectors = np.linalg.eigh(0.5 * (weight + weight.swapaxes(-1, -2)))
    known = values > num.UNSEEN_INFORMATION * values[:, -1:]
    root = np.where(known, 1.0 / np.sqrt(np.where(known, values, 1.0)), 0.0)
    return np.asarray((vectors @ (root[..., None] * rng.standard_normal((*root.shape, count)))).swapaxes(0, 1))
