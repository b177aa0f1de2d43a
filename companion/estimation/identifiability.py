"""How often a fault of a certain size is told from its rivals in a flight, and what it does while it is not found.

Data sets are drawn with the noise that the linear problem states and a fault in them, r ~ N(S u, R), and weighed as the
search does. All scores are linear in r, so one solution for the noise and one for each fault of size one serve every
size. The minimal identifiable bias is the size whose device is accused in 95 % of the data sets (Teunissen 2018;
Zaminpardaz & Teunissen 2019). What an undetected fault does to the states, dx = (J' W J)⁻¹ J' W S u, is the
external reliability (W. Baarda 1968).

Also here: data sets of a linear problem: noise as it states it, and faults of size one, at known times.

A data set is what all factors read: the residuals of the motion and of every sensor, those of the priors, and what
other IMUs read more; N of them are a problem whose residuals have an axis more. The solution, and every score, is
linear in it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from companion.constants import num, priors
from companion.estimation.differences import Differences
from companion.estimation.evidence import Trial, least_found, probabilities_of_each
from companion.estimation.hypotheses import HYPOTHESES, Hypothesis
from companion.estimation.model import ATTITUDE, POSITION, VELOCITY, ConfusionMatrix, Identifiability
from companion.estimation.scan import scan, score
from companion.estimation.search import Cells, at_times, detectable, of_other_imus, on_cuts, times_of_change
from companion.estimation.shapes import ENDING, activation
from companion.estimation.system import Problem
from companion.model import Array


def solved(problem: Problem, parts: Sequence[Problem]) -> Problem:
    """The data sets of some parts, one after the other, with their solution."""

    def together(values: Iterable[Array]) -> Array:
        return np.concatenate(list(values), axis=-1)

    believed = together(one.prior.residual for one in parts), together(one.prior.constants_residual for one in parts)
    whole = problem.with_residuals(
        together(one.motion.residual for one in parts),
        [together(one.residual for one in each) for each in zip(*(part.measurements for part in parts), strict=True)],
        believed,
        [{name: together(one.value[name] for one in each) for name in each[0].value}
         for each in zip(*(part.others for part in parts), strict=True)],
    )  # fmt: skip
    vars(whole)["solution"] = problem.solution.redrawn(whole)  # in place of one that is made anew
    return whole


@dataclass(frozen=True, slots=True, eq=False)
class Fault:
    """A kind of fault of size one at several times."""

    hypothesis: Hypothesis
    shape: str
    lasts: float  # s, that it grows for; 0 for a step
    onset: Array  # (O,) s
    end: Array  # (O,)
    direction: Array  # (m,), of a creep per second
    size: float  # that is detectable

    def alone(self, problem: Problem) -> Problem:
        """Data sets of nothing but itself, at each of its times."""
        signature = self.hypothesis.signature(problem)
        assert signature is not None
        sets = len(self.onset)

        def column(columns: Array | None, measured: str, start: Array, stop: Array, of: Array) -> Array:
            if columns is None:
                return np.zeros((*of.shape, sets))
            share = activation(self.hypothesis.shape_at(measured, self.shape), self.onset, self.end, start, stop).T
            return (columns @ self.direction)[..., None] * share[:, None, :]

        read, prior = signature.measurements, problem.prior
        return problem.with_residuals(
            -column(signature.motion, "", problem.t[:-1], problem.t[1:], problem.motion.residual),
            [column(read.get(one.name), one.name, one.t, one.t, one.residual) for one in problem.measurements],
            (np.zeros((len(prior.sigma), sets)), np.zeros((len(prior.constants_sigma), sets))),
            [self._apart(one) for one in problem.others],
        )

    def _apart(self, other: Differences) -> dict[str, Array]:
        """(B, 3, O) by sensor: what another IMU reads more than the one with the fault."""
        apart = {name: np.zeros((len(other.t), 3, len(self.onset))) for name in other.value}
        if self.hypothesis.device == "imu":
            columns = other.columns(self.hypothesis, self.shape, self.onset, self.end)
            apart[self.hypothesis.sensor] = -columns.transpose(2, 0, 1) * self.direction[:, None]
        return apart


def injected(
    problem: Problem, hypotheses: Sequence[Hypothesis] = HYPOTHESES
) -> tuple[tuple[Fault, ...], tuple[str, ...]]:
    """Kinds as faults along the axis that the flight tells least of, and those that it cannot show; no nuisances.

    In the middle of the flight. Of an IMU a step, of an aiding sensor what `num.CREEPS` says, else a step.
    """
    faults, not_shown, known = list[Fault](), list[str](), detectable(problem)
    t, (first, last) = problem.t, times_of_change(problem.t)
    cell, hours = float(np.median(np.diff(t))) / (last - first), float(t[-1] - t[0]) / 3600.0
    for hypothesis in (one for one in hypotheses if not one.nuisance):
        lasts = num.CREEPS.get(hypothesis.name, 0.0)
        shape = "creep" if lasts else "step"
        possible = t[(t >= first) & (t <= last - lasts)]
        if not len(possible):
            continue
        middle = t[0] + np.linspace(*num.INJECTED_MIDDLE, num.INJECTED_ONSETS) * (t[-1] - t[0]) - 0.5 * lasts
        onset = possible[np.minimum(np.searchsorted(possible, middle), len(possible) - 1)]
        end = onset + (lasts or np.inf)
        scores = score(problem, hypothesis, shape, onset, end)
        if scores is None:
            continue
        direction, information = _least_known(hypothesis, np.median(scores[1], axis=0))
        grown = lasts or 1.0
        size = grown * float(least_found(np.array([information]), hypothesis, shape, hours, cell, grown)[0])
        size = known.get(hypothesis.name, max(size, hypothesis.harmful(shape)))
        if size > _largest(hypothesis):
            not_shown.append(hypothesis.name)
        else:
            faults.append(Fault(hypothesis, shape, lasts, onset, end, direction / grown, size))
    return tuple(faults), tuple(not_shown)


def _largest(hypothesis: Hypothesis) -> float:
    """The largest fault of a kind that there is, in its unit."""
    return float(min(hypothesis.max_plausible, num.INJECTED_SIGMAS * hypothesis.prior))


def _least_known(hypothesis: Hypothesis, v: Array) -> tuple[Array, float]:
    """The direction (m,) of which information V (m, m) tells least, and how much: of an IMU one of its axes."""
    if hypothesis.device != "imu":
        values, vectors = np.linalg.eigh(v)
        return vectors[:, 0], float(max(values[0], 0.0))
    own = np.diagonal(v)
    axis = int(np.argmin(np.where(own > num.UNSEEN_INFORMATION * own.max(), own, np.inf)))
    return np.eye(len(v))[axis], float(own[axis])


def noise(problem: Problem, rng: np.random.Generator, count: int) -> Problem:
    """Data sets of nothing but the noise that the problem states."""
    drawn, prior = problem.drawn(rng, count), problem.prior
    believed = (rng.standard_normal((len(own), count)) * own[:, None] for own in (prior.sigma, prior.constants_sigma))
    apart = [{name: _drawn(rng, own, count) for name, own in one.weight.items()} for one in problem.others]
    measured = [one.residual for one in drawn.measurements]
    return problem.with_residuals(drawn.motion.residual, measured, tuple(believed), apart)


def _drawn(rng: np.random.Generator, weight: Array, count: int) -> Array:
    """(B, 3, N) differences with an inverse covariance (3, B, B); nothing of what is free."""
    values, vectors = np.linalg.eigh(0.5 * (weight + weight.swapaxes(-1, -2)))
    known = values > num.UNSEEN_INFORMATION * values[:, -1:]
    root = np.where(known, 1.0 / np.sqrt(np.where(known, values, 1.0)), 0.0)
    return np.asarray((vectors @ (root[..., None] * rng.standard_normal((*root.shape, count)))).swapaxes(0, 1))


_IN_DOUBT, _CANNOT_TELL, _NOBODY = "perhaps harmless", "cannot tell", "nobody"


def confusion_matrix(
    problem: Problem, *, draws: int = num.DATA_SETS, seed: int = 0, hypotheses: Sequence[Hypothesis] = HYPOTHESES
) -> ConfusionMatrix:
    """What each kind of fault is called where it is as large as what is detectable, and from which size on it is told.

    draws: data sets of each kind. hypotheses: of the faults; their
    rivals are all.
    """
    experiment = Experiment.of(problem, draws, seed, hypotheses)
    rows = []
    for i, fault in enumerate(experiment.faults):
        judged = experiment.judged(i, fault.size)
        off = (fault.size * experiment.moved[i]).tolist()
        least = _identifiable(experiment, i, judged)
        what = fault.hypothesis.name, fault.shape, fault.lasts, fault.size
        rows.append(Identifiability(*what, least, judged.called, *off))
    return ConfusionMatrix(tuple(rows), experiment.not_shown, draws)


def _identifiable(experiment: Experiment, fault: int, near: Judgement) -> float | None:
    """The size from which on a fault is told from its rivals, None where there is none so large.

    near: what it is called where it is detectable.
    """
    least = experiment.faults[fault].size
    times = min(num.IDENTIFIABLE_MOST, _largest(experiment.faults[fault].hypothesis) / least)
    if near.accused >= num.IDENTIFIABLE_SHARE[0]:
        return least
    cells = [one.at(some) for one, some in zip(experiment.cells, near.counts, strict=True) if some.any()]
    if experiment.judged(fault, times * least, cells).accused < num.IDENTIFIABLE_SHARE[0]:
        return None
    low, high = 0.0, float(np.log(times))
    for _ in range(num.IDENTIFIABLE_HALVINGS):
        middle = 0.5 * (low + high)
        accused = experiment.judged(fault, least * np.exp(middle), cells).accused
        low, high = (low, middle) if accused >= num.IDENTIFIABLE_SHARE[0] else (middle, high)
        if num.IDENTIFIABLE_SHARE[0] <= accused <= num.IDENTIFIABLE_SHARE[1]:
            break
    return float(least * np.exp(high))


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """What data sets are called."""

    called: Mapping[str, float]  # kind, "cannot tell", "nobody" → share
    accused: float  # share in which the device of the fault is accused
    counts: Sequence[npt.NDArray[np.bool_]]  # of every hypothesis (T,): the times that count in any data set


@dataclass(frozen=True, slots=True, eq=False)
class Experiment:
    """Scores of noise and of faults of size one, of every hypothesis: added up they are those of any size."""

    problem: Problem
    faults: tuple[Fault, ...]
    not_shown: tuple[str, ...]
    cells: tuple[Cells, ...]  # with D data sets of noise, and after them those of each fault at O times
    moved: Array  # (faults, 4) by how much tilt, heading, velocity and position move at most, SI
    draws: int  # D

    @classmethod
    def of(cls, problem: Problem, draws: int, seed: int, hypotheses: Sequence[Hypothesis] = HYPOTHESES) -> Experiment:
        """The same of a linear problem."""
        # as the scan has them
        heard = tuple(replace(one, t=problem.t[one.keyframe]) for one in problem.measurements)
        problem = replace(problem, measurements=heard)
        faults, not_shown = injected(problem, hypotheses)
        together = max(1, int(num.DATA_SETS_SIZE / problem.solution.x.size))
        chunks, moved = [], list[Array]()
        for shown in _solved(problem, faults, draws, seed, together):
            chunks.append(_cells(shown, faults))
            moved.append(_off(shown.solution.x))
        each = zip(*chunks, strict=True)
        cells = [replace(parts[0], b=np.concatenate([one.b for one in parts], axis=-1)) for parts in each]
        off = np.concatenate(moved)[draws:].reshape(len(faults), num.INJECTED_ONSETS, 4).max(axis=1)
        return cls(problem, faults, not_shown, tuple(cells), off, draws)

    def judged(self, fault: int, size: float, cells: Sequence[Cells] | None = None) -> Judgement:
        """What a fault of some size is called; cells: those that are weighed, in place of all."""
        hypothesis, times = self.faults[fault].hypothesis, len(self.faults[fault].onset)
        each = np.arange(self.draws)
        of_fault = self.draws + fault * times + each % times
        weighed = [
            one.weighed(self.problem, one.b[..., each] + size * one.b[..., of_fault])
            for one in (self.cells if cells is None else cells)
        ]
        odds = np.array([one.log_odds_of_each for one in weighed])
        counts = [_counts(one, odds.max(axis=0)) for one in weighed]
        both = zip(weighed, counts, strict=True)
        harm = np.array([one.fault_of_each if some.any() else np.zeros(self.draws) for one, some in both])
        hypotheses = [one.hypothesis for one in weighed]
        shares = probabilities_of_each(hypotheses, odds, harm)
        either = probabilities_of_each(hypotheses, odds, np.ones_like(harm))
        called = Counter(_called(hypotheses, odds + np.log(np.maximum(harm, 1e-300)), shares, either))
        accused = float((shares[hypothesis.device] >= priors.ACCUSED).mean())
        return Judgement({name: count / self.draws for name, count in called.most_common()}, accused, counts)


def _counts(one: Trial, best: Array) -> npt.NDArray[np.bool_]:
    """(T,) whether the times of a hypothesis count beside the best log odds of any (D,), or beside nothing."""
    return np.asarray((one.cells.max(axis=1) > np.maximum(best, 0.0) - num.RIVAL_LOG_ODDS).any(axis=1))


def _called(
    hypotheses: Sequence[Hypothesis], fault_odds: Array, shares: Mapping[str, Array], either: Mapping[str, Array]
) -> list[str]:
    """What each data set is called, from the log odds (H, D) of faults by hypothesis and the probability by device.

    either: the probability by device, whether or not it is harmful.
    """
    names = []
    for i in range(fault_odds.shape[1]):
        by_device, of_any = ({device: float(share[i]) for device, share in one.items()} for one in (shares, either))
        device, likely = max(by_device.items(), key=lambda pair: pair[1])
        if likely >= priors.ACCUSED and device != _NOBODY:
            own = [h for h, one in enumerate(hypotheses) if one.device == device]
            names.append(hypotheses[max(own, key=lambda h: fault_odds[h, i])].name)
        elif likely >= priors.ACCUSED:
            names.append(_NOBODY)
        else:
            known = max(share for device, share in of_any.items() if device != _NOBODY) >= priors.ACCUSED
            names.append(_IN_DOUBT if known else _CANNOT_TELL)
    return names


def _solved(problem: Problem, faults: Sequence[Fault], draws: int, seed: int, together: int) -> Iterator[Problem]:
    """The problem with data sets of noise and with those of each fault, so many at a time."""
    rng = np.random.default_rng(seed)
    waiting: list[Problem] = []
    parts = [min(together, draws - first) for first in range(0, draws, together)]
    for one in (*(noise(problem, rng, count) for count in parts), *(fault.alone(problem) for fault in faults)):
        if waiting and sum(w.motion.residual.shape[-1] for w in (*waiting, one)) > together:
            yield solved(problem, waiting)
            waiting = []
        waiting.append(one)
    yield solved(problem, waiting)


def _cells(problem: Problem, faults: Sequence[Fault]) -> list[Cells]:
    """Every hypothesis on the grid of the search and at the times of the faults, always in the same order."""
    grid = scan(problem, num.SCAN_STRETCHES)
    width = float(np.diff(grid.cuts).max()) * num.INJECTED_CELL
    parts: list[Cells | None] = []
    for hypothesis in HYPOTHESES:
        for shape in hypothesis.shapes:
            parts.append(on_cuts(problem, grid, hypothesis, shape))
            parts.append(_exact(problem, hypothesis, shape, faults, width))
    return [*(one for one in parts if one is not None), *of_other_imus(problem)]


def _exact(problem: Problem, hypothesis: Hypothesis, shape: str, faults: Sequence[Fault], width: float) -> Cells | None:
    """A hypothesis at the very times of faults; None of what is tried at every keyframe, and of what tells nothing."""
    at_every_keyframe = hypothesis.device == "imu" and hypothesis.error != "scale" and shape in ("step", "shock")
    if at_every_keyframe or not hypothesis.has_aiding(problem):
        return None
    ends = shape in ENDING
    times = {(a, b if ends else np.inf) for f in faults for a, b in zip(f.onset.tolist(), f.end.tolist(), strict=True)}
    onset, end = np.array(sorted(one for one in times if np.isfinite(one[1]) == ends)).reshape(-1, 2).T
    return at_times(problem, hypothesis, shape, onset, end, width)


def _off(x: Array) -> Array:
    """(N, 4) tilt, heading, velocity and position at most, of errors (K, n, N)."""
    attitude = x[:, ATTITUDE]
    parts = (attitude[:, :2], attitude[:, 2:], x[:, VELOCITY], x[:, POSITION])
    return np.array([np.linalg.norm(part, axis=1).max(axis=0) for part in parts]).T
