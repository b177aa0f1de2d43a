"""The smoother: Gauss-Newton over all keyframes at once, and one cause after the other for what does not fit.

Each pass takes the nominal states, makes them linear, solves for all errors at once and moves the states; in between
the noise densities are learned. Then all hypotheses are weighed for what the sensors do not agree on, and the estimate
is made anew with the likeliest, until none is likelier than not. Docs: mathematics.md, one log evidence.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.constants import harm, healthy, num, priors
from companion.estimation.candidate import Candidate, beside
from companion.estimation.evidence import Trial
from companion.estimation.identifiability import confusion_matrix
from companion.estimation.iteration import (
    Adaptation,
    Start,
    estimate,
    estimate_with,
    likelihood,
    preintegrated,
    resuming,
    start_of,
)
from companion.estimation.learned_noise import doubted_limits, scatter
from companion.estimation.linearisation import linearise
from companion.estimation.model import ATTITUDE, CONSTANT_STATES, VELOCITY, BestEstimate, Rival, States
from companion.estimation.result import best_estimate
from companion.estimation.search import trials
from companion.estimation.setup import Setup, guesses, set_up
from companion.estimation.system import Problem
from companion.model import STANDARD_GRAVITY, Array, DataError, Flight, NoEstimateError


@dataclass(frozen=True, slots=True)
class Effort:
    """How much an estimate may take."""

    keyframes: int = num.KEYFRAMES  # about so many, in proportion to which all of it takes time
    most_causes: int = num.MAX_EXPLAINED  # that are explained: each takes as long as the estimate itself
    most_linearisations: float = num.MOST_LINEARISATIONS  # after which no further cause is sought
    looks_again: float = np.inf  # linearisations of it, after which nothing is sought in the readings by it


def smooth(
    flight: Flight,
    imu: str | None = None,
    *,
    gravity: float = STANDARD_GRAVITY,
    guess: States | None = None,
    span: tuple[float, float] | None = None,
    untrusted: Sequence[tuple[float, float]] = (),
    before: BestEstimate | None = None,
    confusion: bool = False,
    effort: Effort = Effort(),
) -> BestEstimate:
    """The best estimate of a flight's trajectory from one IMU and every aiding sensor but the autopilot's own estimate.

    imu: the message, as for `Flight.imu`. guess: where to begin, in place of the autopilot's attitude and the GPS; the
    result does not depend on it. span: boot times (s) to which the estimate is confined.
    untrusted: spans (s, boot clock) in which the IMU's readings are invalid: stuck, frozen, at the end of the range.
    before: the estimate of some seconds ago, of a flight of which this one is more: half the passes are left.
    confusion: whether to find out what faults would be called, and from which size on they are told from their rivals.

    Raises DataError without such an IMU, and NoEstimateError where it cannot carry an estimate.
    """
    with boundary(flight.imu(imu).source):
        setup = set_up(flight, imu, gravity, span, untrusted, effort.keyframes)
        begin = guesses(setup, flight) if guess is None else (guess,)
        guessed = (start_of(setup, one) for one in begin)
        starts = guessed if before is None else resuming(guessed, setup, before)
        return explain(setup, starts, confusion=confusion, effort=effort)


@contextlib.contextmanager
def boundary(imu: str) -> Iterator[None]:
    """Within it whatever keeps a trajectory from being estimated with this IMU ends as NoEstimateError."""
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # absurd readings: no step that is not finite is taken
            yield
    except NoEstimateError:
        raise
    except (DataError, np.linalg.LinAlgError) as error:
        raise NoEstimateError(
            imu,
            f"its readings do not determine a trajectory ({error})",
            "Look at them with `companion info`; try another IMU: --imu.",
        ) from error


def explain(
    setup: Setup, starts: Iterable[Start], *, confusion: bool = False, effort: Effort = Effort()
) -> BestEstimate:
    """The estimate with every cause that the readings ask for: one after the other, each time the likeliest.

    starts: where the iteration may begin: at the first, and where the IMU does not fit then, at that which fits best.
    """
    accepted: list[Candidate] = []
    rivals: list[tuple[Rival, ...]] = []
    start, settled, linear = _begun(setup, starts)
    spent = settled.linearisations
    if (sigma := _bias_sigma(settled.states)) is not None:
        setup = replace(setup, bias_sigma=sigma)
        settled, linear = estimate(setup, replace(settled, near=True))
        spent += settled.linearisations
    further: tuple[Rival, ...] = ()
    while len(accepted) < effort.most_causes:
        if spent >= effort.most_linearisations:  # what has not been tried is likely or not all the same
            further = _by_fault(Candidate.of_trial(one).rival for one in trials(linear))
            break
        adaptation = next_adaptation(setup, start, settled, linear, accepted, effort.most_linearisations - spent)
        if isinstance(adaptation, Adaptation):
            accepted.append(adaptation.candidate)
            rivals.append(adaptation.rivals)
            setup, settled, linear = adaptation.setup, adaptation.settled, adaptation.linear
            spent += adaptation.linearisations
        else:
            further = adaptation
            break
    moves = not settled.complete and settled.gain >= num.LEARNING_MISFIT  # each was tried for some passes alone
    weighed = len(accepted) - 1  # of the last the rivals are by this very estimate
    if moves and any(one.imu is None for one in accepted) and spent < effort.most_linearisations:
        settled, linear = estimate(setup, settled, accepted)
        weighed = len(accepted)
    if len(accepted) > 1:
        rivals[:weighed] = [_rivals(setup, linear, accepted, i) or rivals[i] for i in range(weighed)]
    matrix = confusion_matrix(linear) if confusion else None
    best = best_estimate(setup, settled, linear, accepted, rivals)
    return replace(best, further=further, confusion=matrix, linearisations=spent)


def _begun(setup: Setup, starts: Iterable[Start]) -> tuple[Start, Start, Problem]:
    """Where the iteration begins, and where it settles with nothing explained."""
    tried: list[tuple[Start, Start, Problem]] = []
    for start in starts:
        tried.append((start, *estimate(setup, start)))
        if not tried[-1][1].noise.contradicts(scatter(setup)):
            break
    return max(tried, key=lambda one: likelihood(*one[1:]))


def _bias_sigma(states: States) -> Array | None:
    """(6,) 1σ of the biases at the beginning where some are pulled further than those of parts in order; else None.

    Of few IMUs, which are faulty, a bias is off by more from the first second on. Believed to be in order, such a one
    would leave the rest of it to other sensors.
    """
    usual = np.repeat(healthy.BIAS_SIGMA, 3)
    faulty = np.hypot(usual, np.repeat([harm.CONSTANT_FAULT_SIGMA[sensor] for sensor in ("gyro", "accel")], 3))
    bias = np.concatenate((states.gyro_bias[0], states.accel_bias[0]))
    odds = np.log(priors.FAULTY_IMU / (1.0 - priors.FAULTY_IMU) * usual / faulty)
    unusual = odds + 0.5 * bias**2 * (usual**-2.0 - faulty**-2.0) > 0.0
    return np.where(unusual, faulty, usual) if unusual.any() else None


_When = tuple[str, str, int | None, float, float]
"""What a candidate is (hypothesis, shape, IMU), and from when to when, s."""


def next_adaptation(
    setup: Setup,
    start: Start,
    settled: Start,
    linear: Problem,
    accepted: Sequence[Candidate],
    most: float = np.inf,
) -> Adaptation | tuple[Rival, ...]:
    """The likeliest further cause with its rivals; the likeliest faults first where none is likelier than not.

    A fault that is not in the model is learned as noise, in which all hypotheses look alike. So each candidate gets an
    estimate with the noise that is learned beside it, and all are weighed at the noise of the one that leaves least.
    It begins where the estimate has settled; where the IMU does not fit, that may be far off, and it begins anew. What
    moves readings in time is linear in small sizes alone: it begins at the noise at which it was seen, for where the
    IMU is held for noise the states follow late readings.
    most: linearisations, after which no other candidate is tried.
    """
    anew = settled.noise.contradicts(scatter(setup))
    begin = replace(settled, states=start.states) if anew else replace(settled, near=True)
    usual = trials(linear)
    candidates = {one.name: (one, begin) for one in _candidates(usual)}
    in_order = not any(one.hypothesis.device == "imu" for one in accepted)
    spent = 0
    for limits in doubted_limits(setup, linear, settled.noise, settled.scale, imu_in_order=in_order):
        quieter, believed = estimate(
            setup, begin, accepted, limits, white=True, polish=num.LEARNING_MISFIT, passes=num.TRIAL_PASSES
        )
        spent += quieter.linearisations
        seen = replace(quieter, states=begin.states, near=begin.near)
        for one in _candidates(trials(believed)):
            candidates[one.name] = one, seen if one.hypothesis.time_shifts else begin
    tried, weighed, failed = _tried(setup, accepted, candidates.values(), most - spent)
    weighed = weighed or [Candidate.of_trial(one) for one in usual]
    spent += sum(one.settled.linearisations for one in tried)
    rivals = tuple(one.rival for one in weighed)
    impossible = set[str]()
    for best in (one for one in weighed if one.hypothesis.name not in impossible):
        if best.log_odds < (priors.ACCEPT_FAULT if best.fault > priors.PROBABLY_HARMFUL else priors.ACCEPT_NUISANCE):
            break
        if best.imu is not None:  # nothing of the estimate changes
            return Adaptation(best, setup, settled, beside(linear, best), rivals, spent)
        own = next((one for one in tried if one.candidate.name == best.name), None)
        if own is None and _when(best) not in failed:
            own = estimate_with(setup, begin, accepted, best)
        if own is not None:
            candidate = replace(own.candidate, log_odds=best.log_odds, fault=best.fault)
            return replace(own, rivals=rivals, candidate=candidate, linearisations=spent)
        impossible.add(best.hypothesis.name)
    return _by_fault(rivals)


def _by_fault(rivals: Iterable[Rival]) -> tuple[Rival, ...]:
    """The likeliest fault first."""
    return tuple(sorted(rivals, key=lambda one: -one.fault_log_odds))


def _tried(
    setup: Setup, accepted: Sequence[Candidate], candidates: Iterable[tuple[Candidate, Start]], most: float
) -> tuple[list[Adaptation], list[Candidate], set[_When]]:
    """The estimates with a candidate each, that which leaves least first, and all hypotheses at its noise.

    And which could not be.

    The likeliest is tried first: where it is surely likelier than each of the others at its own noise, that is all.
    """
    tried, weighed, failed = list[Adaptation](), list[Candidate](), set[_When]()
    left = sorted(candidates, key=lambda one: one[0].log_odds)
    while left and sum(one.settled.linearisations for one in tried) < most:
        candidate, begin = left.pop()
        if (one := estimate_with(setup, begin, accepted, candidate)) is None:
            failed.add(_when(candidate))
            continue
        if tried and likelihood(one.settled, one.linear) <= likelihood(tried[0].settled, tried[0].linear):
            tried.append(one)
            continue
        tried.insert(0, one)
        weighed = _weighed(setup, one, accepted)
        odds = {other.name: other.log_odds for other in reversed(weighed)}
        own = odds.get(one.candidate.name, num.LOG_ZERO) - priors.ACCUSED_ODDS
        if all(own > odds.get(other.name, num.LOG_ZERO) for other, _ in left):
            break
    return tried, weighed, failed


def _when(one: Candidate) -> _When:
    return (*one.name, one.onset, one.end)


def _weighed(setup: Setup, adaptation: Adaptation, accepted: Sequence[Candidate]) -> list[Candidate]:
    """Every hypothesis in the place of the candidate, at its noise, the likeliest first."""
    rougher = local_noise(adaptation.linear, adaptation.candidate)
    problem = replace(_without_the_last(setup, adaptation, accepted), rougher=rougher)
    weighed = [Candidate.of_trial(one) for one in trials(problem)]
    if adaptation.candidate.taken:
        weighed = [_as_moved(one, adaptation) if one.name == adaptation.candidate.name else one for one in weighed]
        weighed.sort(key=lambda one: -one.log_odds)
    return weighed


def _candidates(weighed: Sequence[Trial]) -> Iterable[Candidate]:
    """The likeliest hypothesis of the IMU and of an aiding sensor, where they may be worth an estimate of their own."""
    chosen: dict[bool, Candidate] = {}
    for one in weighed:
        if one.worth_trying and one.imu is None:  # of another IMU nothing changes in the estimate
            chosen.setdefault(one.hypothesis.device == "imu", Candidate.of_trial(one))
    return chosen.values()


def _without_the_last(setup: Setup, adaptation: Adaptation, accepted: Sequence[Candidate]) -> Problem:
    """The problem of a cause without it, at its states and noise; with the readings where they were before it."""
    if not adaptation.candidate.taken:
        return without(setup, adaptation.linear, [*accepted, adaptation.candidate], len(accepted))
    settled = adaptation.settled
    path = preintegrated(setup, settled.states, settled.path)
    return linearise(setup, path, settled.states, adaptation.linear.noise, settled.scale, {}, settled.slow, accepted)


def _as_moved(candidate: Candidate, adaptation: Adaptation) -> Candidate:
    """A hypothesis that is linear in small sizes alone, with the evidence that it has where it moved the readings.

    Its size is known to 1σ there: the statistic is the square of size over σ, at the rate and times of the first order.
    """
    solution, moved = adaptation.linear.solution, adaptation.candidate
    variance = float(solution.constants_covariance[-1, -1])
    size = float(solution.c[-1]) + moved.taken
    moved_odds = 0.5 * (size**2 / variance + np.log(variance / candidate.hypothesis.prior**2))
    return replace(
        candidate, log_odds=max(candidate.log_odds, moved.log_odds, moved_odds), fault=max(candidate.fault, moved.fault)
    )


def without(setup: Setup, problem: Problem, accepted: Sequence[Candidate], one: int) -> Problem:
    """The problem without one of the hypotheses that it has, at the same states and noise."""
    prior = problem.prior
    widths = [0 if (s := candidate.of(problem)) is None else s.unknowns for candidate in accepted]
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


def _rivals(setup: Setup, linear: Problem, accepted: Sequence[Candidate], one: int) -> tuple[Rival, ...]:
    """Every hypothesis in the place of one that was accepted, beside all others; empty where readings were moved."""
    if accepted[one].taken:
        return ()
    problem = replace(without(setup, linear, accepted, one), rougher=local_noise(linear, accepted[one]))
    return tuple(Candidate.of_trial(other).rival for other in trials(problem))


def local_noise(linear: Problem, candidate: Candidate) -> dict[str, float]:
    """Times by which gyro and accelerometer scatter more about a cause than in the whole flight: variances, 1 or more.

    Of an estimate that has the cause in it. Noise is learned where the flight is typical: where it is rougher, as by
    vibration, a launch or a touch of the ground, chance does as much. The moments before a cause belong to it: one that
    has only begun explains what scatters since, but not what scattered before.
    """
    e, d = linear.solution.disturbances
    t, own = linear.t, np.diagonal(d, axis1=1, axis2=2)
    within = (t[1:] > candidate.onset - num.ROUGH_STRETCH_S) & (t[:-1] < candidate.end)

    def ratio(block: slice) -> float:
        unlikely = (e[:, block] ** 2 / np.where(own[:, block] > 0.0, own[:, block], np.inf)).sum(axis=1)
        return max(1.0, float(unlikely[within].mean() / max(unlikely.mean(), 1e-300))) if within.any() else 1.0

    return {"gyro": ratio(ATTITUDE), "accel": ratio(VELOCITY)}
