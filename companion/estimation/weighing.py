"""Hypotheses weighed beside each other: each where its estimate is, all at one noise.

Docs: mathematics.md, one log evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from companion.constants import num, priors
from companion.estimation.candidate import Candidate, beside
from companion.estimation.evidence import Trial
from companion.estimation.iteration import Adaptation, Start, estimate_with, likelihood, preintegrated, whole_misfit
from companion.estimation.linearisation import linearise
from companion.estimation.model import ATTITUDE, CONSTANT_STATES, POSITION, VELOCITY, States
from companion.estimation.search import trials
from companion.estimation.setup import Setup
from companion.estimation.system import Problem
from companion.model import Array
from companion.strapdown import quaternion

_When = tuple[str, str, int | None, float, float]
"""What a candidate is (hypothesis, shape, IMU), and from when to when, s."""


class Weighing:
    """Estimates with a candidate each, and all hypotheses at the noise of the one that leaves least.

    A hypothesis is weighed where that estimate is, by what is linear there. One that has an estimate of its own is as
    likely as it fits there: where the heading is another with it, a straight line leads to nothing that is true. So it
    is with nothing more: it fits where the estimate has settled without a candidate, unless that may be far off.
    nothing: that estimate, and the sizes (m,) of what is accepted in it.
    """

    def __init__(
        self,
        setup: Setup,
        accepted: Sequence[Candidate],
        usual: list[Candidate],
        nothing: tuple[Start, Array] | None = None,
    ) -> None:
        self._setup, self._accepted, self._nothing = setup, accepted, nothing
        self._tried, self._failed = list[Adaptation](), set[_When]()  # that which leaves least first
        self._impossible = set[tuple[str, str]]()  # hypothesis and shape, of the estimate's own IMU or an aiding sensor
        self._linearly = self.weighed = usual  # the likeliest first
        self._trials = tuple[Trial, ...]()  # where the first of them is
        self._left = np.inf  # the misfit without a cause, where the first of them is or where it has settled so
        self.linearisations = 0

    def add(self, candidate: Candidate, begin: Start) -> bool:
        """Weigh all anew, with an estimate that has a candidate. Returns False where there is none."""
        if _when(candidate) in self._failed:
            return False
        one = estimate_with(self._setup, begin, self._accepted, candidate)
        if one is None:
            self._failed.add(_when(candidate))
            return False
        self.linearisations += one.settled.linearisations
        if self._tried and likelihood(one.settled, one.linear) <= likelihood(
            self._tried[0].settled, self._tried[0].linear
        ):
            self._tried.append(one)
        else:
            self._tried.insert(0, one)
            self._weigh_linearly(one)
        self.weighed = self._possible(sorted(map(self._where_it_is, self._linearly), key=lambda one: -one.log_odds))
        return True

    def rule_out(self, candidate: Candidate) -> None:
        """Weigh a hypothesis that cannot be no more: it is nobody's rival, in none of its shapes but those that can."""
        one = candidate.hypothesis
        possible = {other.candidate.shape for other in self._tried if other.candidate.hypothesis == one}
        self._impossible |= {(one.name, shape) for shape in one.shapes if shape not in possible}
        self.weighed = self._possible(self.weighed)

    def with_cause(self, candidate: Candidate) -> Adaptation | None:
        """The estimate that has a candidate, if there is one."""
        return next((one for one in self._tried if one.candidate.name == candidate.name), None)

    def surely_likeliest(self, others: Sequence[Candidate], usual: States) -> bool:
        """Whether what has an estimate is surely likelier than others that have none, and what is linear tells it.

        usual: the states without any cause.
        """
        odds = {one.name: one.log_odds for one in reversed(self.weighed)}
        own = max(odds.get(one.candidate.name, num.LOG_ZERO) for one in self._tried) - priors.ACCUSED_ODDS
        return self.near(usual) and all(own > odds.get(other.name, num.LOG_ZERO) for other in others)

    def near(self, usual: States) -> bool:
        """Whether attitudes are so near to others in every estimate that what is linear there tells of all of them."""
        return all(_turned(one.settled.states, usual) < num.LINEAR_TURN for one in self._tried)

    def _weigh_linearly(self, least: Adaptation) -> None:
        """Every hypothesis in the place of the candidate, at its states and noise."""
        problem = self._as_rough(_without_the_last(self._setup, least, self._accepted))
        there = whole_misfit(problem)
        self._left = min(there, self._with_nothing())
        self._trials = trials(problem)
        weighed = [Candidate.of_trial(one) for one in self._trials]
        more = 0.5 * (there - self._left)  # of another IMU's fault the estimate is the same as with nothing
        self._linearly = [one if one.imu is not None else replace(one, log_odds=one.log_odds - more) for one in weighed]

    def _with_nothing(self) -> float:
        """The misfit without a cause where the estimate has settled so, at the noise of that which leaves least."""
        if self._nothing is None:
            return np.inf
        settled, sizes = self._nothing
        return whole_misfit(self._as_rough(_linear_at(self._setup, settled, self._tried[0], self._accepted, sizes)))

    def _trial_of(self, candidate: Candidate) -> Trial:
        return next(one for one in self._trials if _name(one) == candidate.name)

    def _possible(self, weighed: list[Candidate]) -> list[Candidate]:
        return [one for one in weighed if one.imu is not None or one.name[:2] not in self._impossible]

    def _as_rough(self, problem: Problem) -> Problem:
        return as_rough(problem, self._tried[0].linear, self._tried[0].candidate)

    def _where_it_is(self, linearly: Candidate) -> Candidate:
        """A candidate weighed where it has its estimate, if it has one, at the noise of that which leaves least."""
        own = self.with_cause(linearly)
        if own is None or own.candidate.taken:
            return linearly
        is_first = own is self._tried[0]
        if own.candidate.hypothesis.turns:
            turned = self._where_it_turns(own)
            return linearly if is_first and linearly.log_odds > turned.log_odds else turned
        return linearly if is_first else self._where_it_fits(own)

    def _where_it_fits(self, own: Adaptation) -> Candidate:
        """By what is linear there."""
        accepted = [*self._accepted, own.candidate]
        there = self._as_rough(_linear_at(self._setup, own.settled, self._tried[0], accepted, _sizes(own)))
        problem = without(self._setup, there, accepted, len(self._accepted))
        alone = trials(problem, (own.candidate.hypothesis,))
        refined = next(Candidate.of_trial(one) for one in alone if _name(one) == own.candidate.name)
        return replace(refined, log_odds=refined.log_odds - 0.5 * (whole_misfit(problem) - self._left))

    def _where_it_turns(self, own: Adaptation) -> Candidate:
        """Of one that turns field or compass: by what its estimate leaves, its size and times known as well as there.

        The evidence of a size u that is known to Σ and was to σ² is half of what the misfit loses by it, priors
        included, and half of log |Σ/σ²|; rate and times are those of the trial.
        """
        accepted = [*self._accepted, own.candidate]
        there = self._as_rough(_linear_at(self._setup, own.settled, self._tried[0], accepted, _sizes(own)))
        known = slice(len(there.solution.c) - own.candidate.unknowns(there), None)
        _, spread = np.linalg.slogdet(there.solution.constants_covariance[known, known])
        known_better = 0.5 * float(spread) - float(np.log(there.prior.constants_sigma[known]).sum())
        times = _of_times(self._trial_of(own.candidate))
        log_odds = 0.5 * (self._left - whole_misfit(there)) + known_better + times
        return replace(own.candidate, log_odds=log_odds)


def _name(one: Trial) -> tuple[str, str, int | None]:
    return one.hypothesis.name, one.shape, one.imu


def _of_times(one: Trial) -> float:
    """What its rate and its times add to the evidence of its size: less than nothing, for they are not known."""
    return one.log_odds - float(one.log_bayes.max())


def _turned(one: States, other: States) -> float:
    """The largest angle between attitudes of two estimates, rad."""
    turn = quaternion.log(quaternion.multiply(one.q_ned_frd, quaternion.conjugate(other.q_ned_frd)))
    return float(np.linalg.norm(turn, axis=1).max())


def _when(one: Candidate) -> _When:
    return (*one.name, one.onset, one.end)


def _without_the_last(setup: Setup, adaptation: Adaptation, accepted: Sequence[Candidate]) -> Problem:
    """The problem of a cause without it, at its states and noise; with the readings where they were before it."""
    candidate = adaptation.candidate
    if not (candidate.taken or candidate.hypothesis.turns):
        return without(setup, adaptation.linear, [*accepted, candidate], len(accepted))
    sizes = _sizes(adaptation)
    before = sizes[: len(sizes) - candidate.unknowns(adaptation.linear)]
    return _linear_at(setup, adaptation.settled, adaptation, accepted, before)


def _sizes(adaptation: Adaptation) -> Array:
    """(m,) of all that is accepted, and of its candidate."""
    return adaptation.linear.solution.c[CONSTANT_STATES:]


def _linear_at(
    setup: Setup, settled: Start, noise_of: Adaptation, accepted: Sequence[Candidate], sizes: Array
) -> Problem:
    """The problem about the states of an estimate, at the noise of another; its weights too, where none was moved."""
    least = noise_of.linear
    weights = {} if noise_of.candidate.taken else {one.name: one.weight for one in least.measurements}
    return linearise(
        replace(setup, relative_noise=least.relative_noise), preintegrated(setup, settled.states, settled.path),
        settled.states, least.noise, noise_of.settled.scale, weights, noise_of.settled.slow, accepted, sizes=sizes,
    )  # fmt: skip


def without(setup: Setup, problem: Problem, accepted: Sequence[Candidate], one: int) -> Problem:
    """The problem without one of the hypotheses that it has, at the same states and noise."""
    prior = problem.prior
    widths = [candidate.unknowns(problem) for candidate in accepted]
    first = CONSTANT_STATES + sum(widths[:one])
    keep = np.delete(np.arange(len(prior.constants_sigma)), np.arange(first, first + widths[one]))
    motion = replace(problem.motion, constants=problem.motion.constants[..., keep])
    measurements = tuple(replace(m, constants=m.constants[..., keep]) for m in problem.measurements)
    prior = replace(
        prior, constants_residual=prior.constants_residual[keep], constants_sigma=prior.constants_sigma[keep]
    )
    left = replace(problem, motion=motion, measurements=measurements, prior=prior, others=setup.others)
    for candidate in (*accepted[:one], *accepted[one + 1 :]):
        left = beside(left, candidate)
    return left


def as_rough(problem: Problem, linear: Problem, candidate: Candidate) -> Problem:
    """The problem with as much process noise about a cause as that scatters there, more than in the whole flight.

    linear: of an estimate that has the cause in it. Noise is learned where the flight is typical: where it is rougher,
    as by vibration, a launch or a touch of the ground, chance does as much. The moments before a cause belong to it:
    one that has only begun explains what scatters since, but not what scattered before.
    """
    e, d = linear.solution.disturbances
    t, own = linear.t, np.diagonal(d, axis1=1, axis2=2)
    within = (t[1:] > candidate.onset - num.ROUGH_STRETCH_S) & (t[:-1] < candidate.end)
    if not within.any():
        return problem
    weight = problem.motion.weight.copy()
    for block, moved in ((ATTITUDE, ATTITUDE), (VELOCITY, slice(VELOCITY.start, POSITION.stop))):
        unlikely = (e[:, block] ** 2 / np.where(own[:, block] > 0.0, own[:, block], np.inf)).sum(axis=1)
        rougher = max(1.0, float(np.sqrt(unlikely[within].mean() / max(unlikely.mean(), 1e-300))))
        weight[within, moved] /= rougher
        weight[within, :, moved] /= rougher
    return replace(problem, motion=replace(problem.motion, weight=weight))
