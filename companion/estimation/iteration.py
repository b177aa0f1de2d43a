"""Gauss-Newton over all keyframes at once, while the noise is learned.

Each pass takes the nominal states, makes them linear, solves for all errors at once and moves the states; in between
the densities are learned.

Where the readings contradict each other the problem is far from linear, and a whole step may lead anywhere. So the
misfit where it ends is compared with that where it begins, and a step that leads uphill is shortened to where a
parabola through both and the slope at its beginning is least (J. Nocedal, S. J. Wright 2006, Numerical Optimization,
§3.5). Where it leads uphill however short, there is nothing lower to be had. On a link the iteration may begin with
what was estimated a moment ago, carried on to what has arrived since.

Also here: readings that come late by much, which are put at the times that they speak of, not corrected by a slope:
where a vehicle was a second ago is no straight line from where it is. So of a kind that moves readings in time the
size is taken out of the readings, which go to other keyframes, and what is left asked for again, until that is little:
where the readings would speak of what has not happened yet, it is not the time that is off.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from itertools import count as counter

import numpy as np

from companion.constants import num
from companion.estimation.aiding_sensors import SLOW
from companion.estimation.candidate import Candidate
from companion.estimation.hypotheses import hypothesis_of
from companion.estimation.learned_noise import (
    FIRST_NOISE,
    Change,
    coloured,
    learn,
    noise_limits,
    outlier_weights,
    shocks,
)
from companion.estimation.linearisation import PreintegratedImu, linearise, preintegrate_imu
from companion.estimation.model import CONSTANT_STATES, BestEstimate, ProcessNoise, Rival, States, corrected
from companion.estimation.setup import Setup
from companion.estimation.shapes import SLOPED, activation
from companion.estimation.system import Prior, Problem, misfit, squares
from companion.model import Array, interpolated, nearest
from companion.strapdown import preintegrate


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """Where an iteration stands."""

    states: States
    sizes: Array  # (m,) of what is accepted


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """The way to the solution of a linear problem."""

    begin: Point
    x: Array  # (K, 15) error of the states
    c: Array  # (C + m,) error of the constants, and the sizes of what is accepted
    weight: Array  # (K-1, 15, 15) of the motion
    information: tuple[Array, ...]  # of every aiding sensor, (M, d)
    misfit: float  # at its beginning
    gain: float  # by how much less it is at its end, were the problem linear

    @classmethod
    def of(cls, linear: Problem, sizes: Array) -> Step:
        """From the states of a linear problem, where what is accepted has these sizes (m,).

        Raises numpy.linalg.LinAlgError where the problem has no finite solution.
        """
        solution = linear.solution
        if not (np.isfinite(solution.x).all() and np.isfinite(solution.c).all()):
            raise np.linalg.LinAlgError("a step of the iteration is not finite")
        information = tuple(one.information for one in linear.measurements)
        begin = _misfit(linear, sizes, linear.motion.weight, information)
        end = whole_misfit(linear)
        point = Point(linear.states, sizes)
        return cls(point, solution.x, solution.c, linear.motion.weight, information, begin, begin - end)

    def at(self, share: float) -> Point:
        """After a share of it."""
        sizes = self.begin.sizes
        states = self.begin.states.moved(share * self.x, share * self.c)
        return Point(states, sizes + share * (self.c[CONSTANT_STATES:] - sizes))

    def misfit_at(self, point: Point, linear: Problem) -> float:
        """The misfit at a point, about which a problem was made linear, with the weights of this one."""
        return _misfit(linear, point.sizes, self.weight, self.information)

    def taken(self, linearised: Callable[[Point], Problem]) -> tuple[Point, Problem, bool]:
        """Where it leads, the linear problem there, and whether the misfit is higher there, however short the step.

        A whole step that leads uphill is corrected before it is shortened: an error of the IMU turns with the attitudes
        that change with it, so that the valley is curved, and the next step from there leads down again (second-order
        correction, Nocedal and Wright, §15.6). linearised: makes the problem about a point. Raises
        numpy.linalg.LinAlgError where the misfit is no number there, however short the step.
        """
        share, left = 1.0, num.SHORTENED_TIMES
        while True:
            point = self.at(share)
            linear = linearised(point)
            higher = self.misfit_at(point, linear) - self.misfit
            uphill = not higher <= num.CONVERGED_MISFIT  # NaN is higher than anything
            if uphill and share == 1.0 and (corrected := self._corrected(point, linear, linearised)) is not None:
                return *corrected, False
            if not (uphill and left):
                if not np.isfinite(higher):
                    raise np.linalg.LinAlgError("the misfit is not finite")
                return point, linear, uphill
            del linear  # before the next is made, as large
            least = np.nan_to_num(self.gain * share**2 / (higher + 2.0 * self.gain * share))
            share, left = float(np.clip(least, num.SHORTENED_MIN * share, num.SHORTENED_MAX * share)), left - 1

    def _corrected(
        self, point: Point, linear: Problem, linearised: Callable[[Point], Problem]
    ) -> tuple[Point, Problem] | None:
        """Where the next whole step from a point leads, if the misfit is not higher there than at the beginning."""
        with contextlib.suppress(np.linalg.LinAlgError):
            further = Step.of(linear, point.sizes).at(1.0)
            there = linearised(further)
            if self.misfit_at(further, there) <= self.misfit + num.CONVERGED_MISFIT:
                return further, there
        return None


def _misfit(linear: Problem, sizes: Array, weight: Array, information: Sequence[Array]) -> float:
    """That of the states about which a problem was made linear, and of sizes (m,), with the weights of a problem."""
    known = slice(CONSTANT_STATES, None)
    measured = (
        (one.residual - one.constants[..., known] @ sizes, own)
        for one, own in zip(linear.measurements, information, strict=True)
    )
    motion, prior = linear.motion, linear.prior
    constants = prior.constants_residual.copy()
    constants[known] -= sizes
    return squares(motion.residual + motion.constants[..., known] @ sizes, weight, measured) + _of_prior(
        prior, prior.residual, constants
    )


def whole_misfit(linear: Problem) -> float:
    """The sum of the squares of all that the solution leaves, each divided by its σ, and of the priors."""
    solution, prior = linear.solution, linear.prior
    return misfit(linear) + _of_prior(prior, prior.residual - solution.x[0], prior.constants_residual - solution.c)


def _of_prior(prior: Prior, states: Array, constants: Array) -> float:
    return float(((states / prior.sigma) ** 2).sum() + ((constants / prior.constants_sigma) ** 2).sum())


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """Where an iteration begins."""

    states: States
    noise: ProcessNoise
    scale: Mapping[str, float]
    slow: Mapping[str, float]  # aiding sensor → 1σ of its slow error
    path: PreintegratedImu | None = None  # as it was last
    near: bool = False  # to where it ends: what the first pass leaves tells of the noise already
    gain: float = 0.0  # by how much a further step would have lessened the misfit, where an iteration has ended here
    complete: bool = False  # whether noise and states had settled there, before the passes were used up
    linearisations: int = 0  # since it began


def start_of(setup: Setup, guess: States) -> Start:
    """Where nothing is learned yet: every σ wide."""
    scale = {r.name: 1.0 if r.name.startswith("rest") else 3.0 for r in setup.readings}
    return Start(guess, FIRST_NOISE, scale, {name: SLOW[name][0] for name in setup.slow})


def estimate(
    setup: Setup,
    start: Start,
    accepted: Sequence[Candidate] = (),
    limits: Mapping[str, tuple[float, float]] | None = None,
    *,
    white: bool = False,
    polish: float = num.CONVERGED_MISFIT,
    passes: int = num.SMOOTHER_PASSES,
) -> tuple[Start, Problem]:
    """The iteration with what is accepted: where it settles, and the linear problem there.

    limits: of the densities of the IMU, in place of what may be learned. white: what is left over is taken for white
    noise, however long it lasts: as it is not where something unexplained is in it. polish: with the noise as learned
    at last it goes on until no more than this is to gain; infinite: for the noise alone. passes: at most, before that.
    """
    noise, scale, slow, change = start.noise, dict(start.scale), dict(start.slow), dict[str, Change]()
    weights, weighted, roughly = dict[str, Array](), 0, num.BIAS_LINEAR_LEARNING
    limits, path = _limits(setup, start, accepted, limits), preintegrated(setup, start.states, start.path, roughly)
    wide, shaken, made = noise, np.ones_like(setup.relative_noise), counter()

    def about(point: Point) -> Problem:
        next(made)
        rougher = replace(setup, relative_noise=setup.relative_noise * shaken)
        return linearise(rougher, path, point.states, wide, scale, weights, slow, accepted, sizes=point.sizes)

    def moved(step: Step) -> tuple[Point, Problem, bool]:
        """Where a step leads; the misfits along it are compared with the IMU carried as before."""
        nonlocal path
        point, linear, uphill = step.taken(about)
        before, path = path, preintegrated(setup, point.states, path, roughly)
        if path is not before:
            del linear
            linear = about(point)
        return point, linear, uphill

    uphill, linear = False, about(Point(start.states, np.zeros(0)))
    point = Point(start.states, np.zeros(len(linear.prior.constants_sigma) - CONSTANT_STATES))
    for count in range(passes):
        step, largest = Step.of(linear, point.sizes), np.inf
        if count >= num.LEARN_FROM_PASS or start.near:
            noise, scale, slow, change = learn(linear, setup, noise, scale, slow, limits, change)
            wide, largest = noise, max(abs(one.size) for one in change.values())
            if weighted or accepted or start.near or largest < num.DENSITY_NEAR or count >= num.WEIGHTS_FROM_PASS:
                weights, shaken = outlier_weights(linear), np.minimum(shaken * shocks(linear), num.SHAKEN_MAX)
                weighted += 1
        there = uphill or step.gain < num.LEARNING_MISFIT  # as near as it comes
        complete = weighted >= num.WEIGHTED_PASSES and largest < num.DENSITY_SETTLED and there
        if complete or count == passes - 1:
            break
        del linear  # before the next is made: of a long flight two are more than all else
        point, linear, uphill = moved(step)
    wide, roughly = noise if white else noise.louder(**coloured(linear)), 1.0
    for _ in range(num.FINAL_PASSES if np.isfinite(polish) else 0):
        del linear
        point, linear, _ = moved(step)
        step = Step.of(linear, point.sizes)
        if step.gain < polish:
            break
    return Start(step.at(1.0).states, noise, scale, slow, path, False, step.gain, complete, next(made)), linear


def _limits(
    setup: Setup, start: Start, accepted: Sequence[Candidate], given: Mapping[str, tuple[float, float]] | None
) -> Mapping[str, tuple[float, float]]:
    """What may be learned: a cause takes from what was learned as the gyro's walk before, and adds nothing to it."""
    walk = {"gyro_walk": (FIRST_NOISE.gyro_walk, start.noise.gyro_walk)} if accepted else {}
    return {**walk, **(given or noise_limits(setup))}


def likelihood(settled: Start, linear: Problem) -> float:
    """Twice the logarithm of the likelihood at the noise that was learned, but for a constant: what fits needs less."""
    noise, scale = settled.noise, settled.scale
    of_imu = -num.LIKELIHOOD_3 * len(linear.variance) * float(np.log(noise.gyro_noise) + np.log(noise.accel_noise))
    return of_imu - 2.0 * sum(m.residual.size * float(np.log(scale[m.name])) for m in linear.measurements)


def in_noise(more: float, intervals: int) -> float:
    """How many times less noise of both sensors makes so many intervals likelier by `more`, as `likelihood` has it."""
    return float(np.exp(more / (2.0 * num.LIKELIHOOD_3 * intervals)))


def preintegrated(
    setup: Setup, states: States, before: PreintegratedImu | None, tolerance: float = 1.0
) -> PreintegratedImu:
    """The IMU preintegrated with the biases of the states; as it was before, where they differ from those by little.

    tolerance: multiple of `num.BIAS_LINEAR` by which a bias may differ, until the IMU is preintegrated anew.
    """
    bias = np.median(states.gyro_bias, axis=0), np.median(states.accel_bias, axis=0)
    if before is not None:
        apart = (np.abs(one - other).max() for one, other in zip(bias, before.bias, strict=True))
        if all(one < tolerance * far for one, far in zip(apart, num.BIAS_LINEAR, strict=True)):
            return before
    return preintegrate_imu(setup, bias)


def resuming(starts: Iterable[Start], setup: Setup, before: BestEstimate) -> Iterable[Start]:
    """Where the iteration may begin: at an estimate whose flight goes on, which fitted so far; else where it would."""
    others = iter(starts)
    first = next(others)
    resumed = _resumed(setup, first, before)
    return chain((first,), others) if resumed is None else (resumed,)


def _resumed(setup: Setup, first: Start, before: BestEstimate) -> Start | None:
    """A start with attitudes, biases, constants and noise of an estimate; velocities and positions follow in one step.

    None where that estimate is of another IMU or another time, or had to explain something of an IMU: without it the
    states would be elsewhere.
    """
    track, t = setup.imu, before.t
    seen = np.flatnonzero((t >= track.t[0]) & (t <= track.t[-1]))
    bent = any(hypothesis_of(one.kind).device == "imu" for one in before.explained)
    if before.imu.source != track.source or not len(seen) or bent or before.contradicted:
        return None
    k = seen[np.clip(np.searchsorted(t[seen], setup.t, side="right") - 1, 0, len(seen) - 1)]
    own, still = before.states, np.zeros((len(k), 3))
    path = preintegrate(corrected(track, before))
    q, _, _ = path.carry(nearest(track.t, t[k]), setup.index, own.q_ned_frd[k], still, still)
    gaps = np.append(0, np.cumsum(setup.broken))
    carried = gaps <= gaps[np.searchsorted(setup.t, t[seen[-1]], side="right") - 1]  # without one since its end
    q = np.where(carried[:, None], q, first.states.q_ned_frd)
    gyro, accel = (interpolated(setup.t, t, bias) for bias in (own.gyro_bias, own.accel_bias))
    states = replace(first.states, q_ned_frd=q, gyro_bias=gyro, accel_bias=accel, constants=own.constants)
    slow = {name: before.slow_sigma.get(name, sigma) for name, sigma in first.slow.items()}
    return Start(states, before.noise, {**first.scale, **before.measurement_scale}, slow, near=True)


@dataclass(frozen=True, slots=True, eq=False)
class Adaptation:
    """A hypothesis with the estimate that has it, and every hypothesis in its place at the same noise."""

    candidate: Candidate
    setup: Setup
    settled: Start
    linear: Problem
    rivals: tuple[Rival, ...] = ()
    is_linear: bool = True  # whether all estimates that it was chosen among are so near that what is linear there tells
    linearisations: int = 0  # of all estimates that it was chosen among


def estimate_with(setup: Setup, start: Start, accepted: Sequence[Candidate], candidate: Candidate) -> Adaptation | None:
    """The estimate with one more hypothesis; None for what cannot be."""
    if candidate.hypothesis.time_shifts:
        possible = time_shifted(setup, start, accepted, candidate)
    else:
        possible = _with(setup, start, accepted, candidate)
    if possible is None:
        return None
    c = possible.linear.solution.c
    size = c[len(c) - possible.candidate.unknowns(possible.linear) :]
    too_large = candidate.shape not in SLOPED and (np.abs(size) > candidate.hypothesis.max_plausible).any()
    return None if too_large else possible


def _with(setup: Setup, start: Start, accepted: Sequence[Candidate], candidate: Candidate) -> Adaptation:
    settled = estimate(setup, start, [*accepted, candidate], polish=num.LEARNING_MISFIT, passes=num.TRIAL_PASSES)
    return Adaptation(candidate, setup, *settled)


def time_shifted(setup: Setup, start: Start, accepted: Sequence[Candidate], candidate: Candidate) -> Adaptation | None:
    """The estimate with the readings where a candidate puts them that moves readings in time.

    With the readings as they are where its size does not settle; None where readings would speak of what has not
    happened yet.
    """
    linearly, moved, made = replace(candidate, taken=0.0), _moved(setup, candidate), 0
    if _is_yet_to_come(candidate, start.states):
        return None
    for _ in range(num.LATENCY_ROUNDS):
        settled, linear = estimate(moved, start, [*accepted, candidate])
        made += settled.linearisations
        further = float(linear.solution.c[-1])
        if abs(further) < num.LATENCY_CONVERGED_S:
            return Adaptation(candidate, moved, replace(settled, linearisations=made), linear)
        candidate = replace(candidate, taken=candidate.taken + further)
        if _is_yet_to_come(candidate, settled.states):
            return None
        moved = _moved(setup, candidate)
    return _after(made, _with(setup, start, accepted, linearly))


def _is_yet_to_come(candidate: Candidate, states: States) -> bool:
    """Whether readings would speak of what has not happened when they come."""
    return candidate.taken < -float(states.constant("gps_latency")[0])


def _after(made: int, one: Adaptation) -> Adaptation:
    """The same after so many linearisations of others."""
    return replace(one, settled=replace(one.settled, linearisations=one.settled.linearisations + made))


def _moved(setup: Setup, candidate: Candidate) -> Setup:
    """The readings at the times that they speak of, while the candidate is at work."""
    onset, end = np.array([candidate.onset]), np.array([candidate.end])
    readings = tuple(
        one.later(candidate.taken * activation(candidate.shape, onset, end, one.t, one.t)[0], setup.t)
        if one.name in candidate.hypothesis.time_shifts
        else one
        for one in setup.readings
    )
    return replace(setup, readings=readings)
