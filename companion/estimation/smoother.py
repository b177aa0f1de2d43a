"""The smoother: Gauss-Newton over all keyframes at once, and one cause after the other for what does not fit.

Each pass takes the nominal states, makes them linear, solves for all errors at once and moves the states; in between
the noise densities are learned. Then all hypotheses are weighed for what the sensors do not agree on, and the estimate
is made anew with the likeliest, until none is likelier than not. Docs: mathematics.md, one log evidence.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.constants import harm, healthy, num, priors
from companion.estimation.candidate import Candidate, beside
from companion.estimation.evidence import Trial
from companion.estimation.identifiability import confusion_matrix
from companion.estimation.iteration import Adaptation, Start, estimate, likelihood, resuming, start_of
from companion.estimation.learned_noise import FIRST_NOISE, doubted_limits, spectral
from companion.estimation.model import CONSTANT_STATES, BestEstimate, Rival, States
from companion.estimation.result import best_estimate, is_field_of_the_place
from companion.estimation.search import trials
from companion.estimation.setup import Setup, guesses, set_up
from companion.estimation.system import Problem
from companion.estimation.weighing import Weighing, as_rough, without
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
    enough: Callable[[BestEstimate], bool] | None = None,
) -> BestEstimate:
    """The best estimate of a flight's trajectory from one IMU and every aiding sensor but the autopilot's own estimate.

    imu: the message, as for `Flight.imu`. guess: where to begin, in place of the autopilot's attitude and the GPS; the
    result does not depend on it. span: boot times (s) to which the estimate is confined.
    untrusted: spans (s, boot clock) in which the IMU's readings are invalid: stuck, frozen, at the end of the range.
    before: the estimate of some seconds ago, of a flight of which this one is more: half the passes are left.
    confusion: whether to find out what faults would be called, and from which size on they are told from their rivals.
    enough: asked about the estimate with the first cause alone; it ends with that one where it says so.

    Raises DataError without such an IMU, and NoEstimateError where it cannot carry an estimate.
    """
    with boundary(flight.imu(imu).source):
        setup = set_up(flight, imu, gravity, span, untrusted, effort.keyframes)
        begin = guesses(setup, flight) if guess is None else (guess,)
        guessed = (start_of(setup, one) for one in begin)
        starts = guessed if before is None else resuming(guessed, setup, before)
        return explain(setup, starts, confusion=confusion, effort=effort, enough=enough)


@contextlib.contextmanager
def boundary(imu: str) -> Iterator[None]:
    """Within it whatever keeps a trajectory from being estimated with this IMU ends as NoEstimateError."""
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # absurd readings: no step that is not finite is taken
            yield
    except NoEstimateError:
        raise
    except (DataError, np.linalg.LinAlgError) as error:
        why = error if isinstance(error, DataError) else "the equations of the estimate have no solution"
        raise NoEstimateError(
            imu,
            f"its readings do not determine a trajectory ({why})",
            "Look at them with `companion info`; try another IMU: --imu.",
        ) from error


def explain(
    setup: Setup,
    starts: Iterable[Start],
    *,
    confusion: bool = False,
    effort: Effort = Effort(),
    enough: Callable[[BestEstimate], bool] | None = None,
) -> BestEstimate:
    """The estimate with every cause that the readings ask for: one after the other, each time the likeliest.

    starts: where the iteration may begin: at the first, and where the IMU does not fit then, at that which fits best.
    """
    accepted: list[Candidate] = []
    rivals: list[tuple[Rival, ...]] = []
    as_weighed = set[int]()  # causes whose rivals are not weighed again beside all others
    start, settled, linear = _begun(setup, starts)
    spent = settled.linearisations
    if (sigma := _bias_sigma(settled.states)) is not None:
        setup = replace(setup, bias_sigma=sigma)
        settled, linear = estimate(setup, replace(settled, near=True))
        spent += settled.linearisations

    def explained() -> tuple[BestEstimate, Problem]:
        last, solved, most = settled, linear, list(rivals)
        moves = not last.complete and last.gain >= num.LEARNING_MISFIT  # each was tried for some passes alone
        again = range(len(accepted) - 1)  # of the last the rivals are by this very estimate
        if moves and any(one.imu is None for one in accepted) and spent < effort.most_linearisations:
            last, solved = estimate(setup, last, accepted)
            again = range(len(accepted))
        if len(accepted) > 1:
            for i in set(again) - as_weighed:
                most[i] = _rivals(setup, solved, accepted, i, most[i]) or most[i]
        best = best_estimate(setup, last, solved, accepted, most)
        return replace(best, linearisations=spent), solved

    made: tuple[BestEstimate, Problem] | None = None  # with what is accepted so far
    further: tuple[Rival, ...] = ()
    while len(accepted) < effort.most_causes:
        if spent >= effort.most_linearisations:  # what has not been tried is likely or not all the same
            further = _by_fault(Candidate.of_trial(one).rival for one in trials(linear))
            break
        adaptation = next_adaptation(setup, start, settled, linear, accepted, effort.most_linearisations - spent)
        if isinstance(adaptation, Adaptation):
            if not adaptation.is_linear:
                as_weighed.add(len(accepted))
            accepted.append(adaptation.candidate)
            rivals.append(adaptation.rivals)
            setup, settled, linear = adaptation.setup, adaptation.settled, adaptation.linear
            spent, made = spent + adaptation.linearisations, None
        else:
            further = adaptation
            break
        if enough and len(accepted) == 1 < effort.most_causes and enough((made := explained())[0]):
            break
    best, solved = made or explained()
    matrix = confusion_matrix(solved) if confusion else None
    return replace(best, further=further, confusion=matrix, linearisations=spent)


def _begun(setup: Setup, starts: Iterable[Start]) -> tuple[Start, Start, Problem]:
    """Where the iteration begins, and where it settles with nothing explained."""
    tried: list[tuple[Start, Start, Problem]] = []
    for start in starts:
        tried.append((start, *estimate(setup, start)))
        if not tried[-1][1].noise.contradicts(spectral(setup)):
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
    astray = not is_field_of_the_place(setup, settled.states)
    anew = astray or settled.noise.contradicts(spectral(setup))
    begin = replace(settled, states=start.states) if anew else replace(settled, near=True)
    if astray:  # its gyro had to follow: that is no walk
        begin = replace(begin, noise=replace(settled.noise, gyro_walk=FIRST_NOISE.gyro_walk))
    usual = trials(linear)
    candidates = {one.name: (one, begin) for one in _candidates(usual)}
    in_order = not any(one.hypothesis.device == "imu" for one in accepted)
    spent = 0
    if astray:  # nothing is as it seems there, but where it began
        first, believed = estimate(setup, begin, accepted, white=True, polish=np.inf, passes=1)
        spent += first.linearisations
        candidates = {one.name: (one, begin) for one in _candidates(trials(believed))}
    for limits in doubted_limits(setup, linear, settled.noise, settled.scale, imu_in_order=in_order):
        quieter, believed = estimate(
            setup, begin, accepted, limits, white=True, polish=num.LEARNING_MISFIT, passes=num.TRIAL_PASSES
        )
        spent += quieter.linearisations
        seen = replace(quieter, states=begin.states, near=begin.near)
        for one in _candidates(trials(believed)):
            candidates[one.name] = one, seen if one.hypothesis.time_shifts else begin
    nothing = None if anew else (settled, linear.solution.c[CONSTANT_STATES:])
    weighing = Weighing(setup, accepted, [Candidate.of_trial(one) for one in usual], nothing)
    _try_out(weighing, candidates.values(), settled.states, most - spent)
    while best := next(iter(weighing.weighed), None):
        if best.log_odds < (priors.ACCEPT_FAULT if best.fault > priors.PROBABLY_HARMFUL else priors.ACCEPT_NUISANCE):
            break
        rivals = tuple(one.rival for one in weighing.weighed)
        if best.imu is not None:  # nothing of the estimate changes
            return Adaptation(
                best, setup, settled, beside(linear, best), rivals, linearisations=spent + weighing.linearisations
            )
        if (own := weighing.with_cause(best)) is not None:
            candidate = replace(own.candidate, log_odds=best.log_odds, fault=best.fault)
            is_linear, used = weighing.near(own.settled.states), spent + weighing.linearisations
            return replace(own, rivals=rivals, is_linear=is_linear, candidate=candidate, linearisations=used)
        if not weighing.add(best, begin):
            weighing.rule_out(best)
    return _by_fault(one.rival for one in weighing.weighed)


def _by_fault(rivals: Iterable[Rival]) -> tuple[Rival, ...]:
    """The likeliest fault first."""
    return tuple(sorted(rivals, key=lambda one: -one.fault_log_odds))


def _try_out(weighing: Weighing, candidates: Iterable[tuple[Candidate, Start]], usual: States, most: float) -> None:
    """Estimates with a candidate each, the likeliest first, until one is surely likelier than all others."""
    left = sorted(candidates, key=lambda one: one[0].log_odds)
    while left and weighing.linearisations < most:
        if weighing.add(*left.pop()) and weighing.surely_likeliest([one for one, _ in left], usual):
            break


def _candidates(weighed: Sequence[Trial]) -> Iterable[Candidate]:
    """The likeliest hypothesis of the IMU and of an aiding sensor, where they may be worth an estimate of their own."""
    chosen: dict[bool, Candidate] = {}
    for one in weighed:
        if one.worth_trying and one.imu is None:  # of another IMU nothing changes in the estimate
            chosen.setdefault(one.hypothesis.device == "imu", Candidate.of_trial(one))
    return chosen.values()


def _rivals(
    setup: Setup, linear: Problem, accepted: Sequence[Candidate], one: int, possible: Sequence[Rival]
) -> tuple[Rival, ...]:
    """Every hypothesis in the place of one that was accepted, beside all others; empty where it is far from linear.

    possible: of what can be, as it was weighed when that was accepted.
    """
    if accepted[one].taken or accepted[one].hypothesis.turns:
        return ()
    problem = as_rough(without(setup, linear, accepted, one), linear, accepted[one])
    again, kinds = (Candidate.of_trial(other).rival for other in trials(problem)), {_who(rival) for rival in possible}
    return tuple(rival for rival in again if _who(rival) in kinds)


def _who(rival: Rival) -> tuple[str, int | None]:
    return rival.kind, rival.imu
