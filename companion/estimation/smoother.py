"""The smoother: Gauss-Newton over all keyframes at once, and one explanation after the other for what does not fit.

Each pass takes the nominal states, makes them linear, solves for all errors at once and moves the states; in between
the densities are learned. Then everything that may be wrong competes for what the witnesses do not agree on, and the
estimate is made anew with what explains most, until nothing pays for itself.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.estimation.choice import PROMISING, WORTH, Choice, cost, explained, gain_beside, promising, unrest
from companion.estimation.competition import choose, detectable
from companion.estimation.constant_errors import constant_errors, of_first_half
from companion.estimation.iteration import SETTLED, Start, estimate, in_noise, likelihood, resuming, start_of
from companion.estimation.learned_noise import believing, lasting, noise_limits, scatter
from companion.estimation.linearisation import Linear
from companion.estimation.measurements import UNITS
from companion.estimation.model import (
    ACCEL_BIAS,
    CONSTANT_STATES,
    GYRO_BIAS,
    BestEstimate,
    Correlation,
    Explained,
    Residuals,
    States,
)
from companion.estimation.retiming import Limits, retimed
from companion.estimation.setup import Setup, guesses, set_up
from companion.estimation.system import measurement_residual, solve
from companion.estimation.unrest import Unrest, louder, restless, with_unrest
from companion.estimation.weighing import bursts
from companion.model import STANDARD_GRAVITY, DataError, Flight, NoEstimateError

_MOST_EXPLAINED = 6
_LOUDER = 4  # times that the noise of a restless time is corrected


def smooth(
    flight: Flight,
    imu: str | None = None,
    *,
    gravity: float = STANDARD_GRAVITY,
    guess: States | None = None,
    span: tuple[float, float] | None = None,
    untrusted: Sequence[tuple[float, float]] = (),
    before: BestEstimate | None = None,
) -> BestEstimate:
    """The best estimate of a flight's trajectory from one IMU and every witness but the autopilot's own estimate.

    imu: the message, as for `Flight.imu`. guess: where to begin, in place of the autopilot's attitude and the GPS; the
    result does not depend on it. span: boot times (s) to which the estimate is confined.
    untrusted: stretches in which the IMU's readings are none: stuck, frozen, at the end of the range.
    before: the estimate of some seconds ago, of a flight of which this one is more: half the passes are left.

    Raises DataError without such an IMU, and NoEstimateError where it cannot carry an estimate.
    """
    with boundary(flight.imu(imu).source):
        setup = set_up(flight, imu, gravity, span, untrusted)
        begin = guesses(setup, flight) if guess is None else (guess,)
        starts = (start_of(setup, one) for one in begin)
        return explain(setup, starts if before is None else resuming(starts, setup, before))


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


def explain(setup: Setup, starts: Iterable[Start]) -> BestEstimate:
    """The estimate with everything explained that has to be: one after the other, each time what explains most.

    What is not explained was learned as noise, and hides in it. So an explanation that promises something is weighed
    again with the noise that is learned beside it, from where the iteration began: an unexplained fault may have led it
    to another heading.

    starts: where the iteration may begin: at the first, and where the IMU does not fit then, at that which fits best.
    """
    accepted: list[Choice] = []
    unrest: list[Explained] = []
    nearly: tuple[str, ...] = ()
    shown = scatter(setup)
    start, settled, linear = _begun(setup, starts, shown)
    while len(accepted) + len(unrest) < _MOST_EXPLAINED:
        further = _explained_further(setup, start, settled, linear, accepted, shown)
        if further is None:
            break
        if further.choice.gain < WORTH:
            nearly = promising(further.choice)
            break
        if (larger := restless(linear, further.choice.gain)) is not None:
            setup, settled, linear, larger = _calmed(setup, replace(settled, states=start.states), accepted, larger)
            unrest.append(larger.explained(further.choice))
            continue
        accepted.append(further.choice)
        setup, settled, linear = further.setup, further.settled, further.linear
    best = _result(setup, settled, linear, _seconded(linear, accepted), shown)
    return replace(
        best, promising=nearly, explained=tuple(sorted((*best.explained, *unrest), key=lambda one: one.onset))
    )


def _begun(setup: Setup, starts: Iterable[Start], shown: tuple[float, float]) -> tuple[Start, Start, Linear]:
    """Where the iteration begins, and where it settles with nothing explained."""
    tried: list[tuple[Start, Start, Linear]] = []
    for start in starts:
        tried.append((start, *estimate(setup, start)))
        if not tried[-1][1].noise.contradicts(shown):
            break
    return max(tried, key=lambda one: likelihood(*one[1:]))


def _calmed(setup: Setup, start: Start, accepted: Sequence[Choice], one: Unrest) -> tuple[Setup, Start, Linear, Unrest]:
    """The estimate with a time in which the IMU scatters more, and by how much it does beside the noise of the rest."""
    more, times = one, 1.0
    for _ in range(_LOUDER):
        setup, times = with_unrest(setup, more), times * more.times
        settled, linear = estimate(setup, start, accepted)
        more = replace(one, times=louder(linear, one))
        if more.times == 1.0:
            break
    return setup, settled, linear, replace(one, times=times)


def _seconded(linear: Linear, accepted: Sequence[Choice]) -> list[Choice]:
    """What was accepted, and of each of the gyro's whether it would promise something without the compass.

    About the vertical gyro and compass may be the only two: which of them is wrong, neither says.
    """
    problem = linear.problem
    others = tuple(one for one in problem.measurements if one.name != "compass")
    gyros = [one for one in accepted if one.kind.name.startswith("gyro")]
    if not gyros or len(others) == len(problem.measurements):
        return list(accepted)
    without = solve(len(problem.t), problem.motion, others, linear.prior)
    judged, after = [], 0
    for one in reversed(accepted):
        seconded = one not in gyros or gain_beside(one, problem, without, linear.prior, after) > PROMISING
        judged.append(replace(one, seconded=seconded))
        signature = one.of(problem)
        after += 0 if signature is None else signature.unknowns
    return judged[::-1]


@dataclass(frozen=True, slots=True, eq=False)
class Tried:
    """A choice with what it gains in the noise that is learned beside it, and the estimate with it."""

    choice: Choice
    setup: Setup
    settled: Start
    linear: Linear

    @property
    def name(self) -> tuple[str, str]:
        """Kind and shape."""
        return self.choice.kind.name, self.choice.shape

    @property
    def worth(self) -> float:
        """Twice the logarithm of its likelihood, less what it pays, but for a constant."""
        linear = self.linear
        return likelihood(self.settled, linear) - cost(self.choice, linear.problem, linear.solution, linear.prior)


def _explained_further(
    setup: Setup, start: Start, settled: Start, linear: Linear, accepted: Sequence[Choice], shown: tuple[float, float]
) -> Tried | None:
    """What explains most, and the estimate with it; None where nothing promises anything.

    A fault that lasts for a good part of the flight is learned as noise of the IMU: its own may then promise nothing
    any more, and of another witness' it is the IMU that seems to follow the other. So where it goes on to need far more
    noise than it shows, what would explain most if it were believed is tried, and taken if that ends it.
    shown: by which its readings scatter (`scatter`).
    """
    begin = replace(settled, states=start.states)
    first = best_of(setup, begin, accepted, choose(linear.problem, linear.solution))
    first = _off_for_long(setup, start, begin, accepted, first, (settled, linear)) or first
    doubted = any(one.kind.side == "imu" for one in accepted)
    if doubted or not (settled if first is None else first.settled).noise.contradicts(shown):
        return first
    limits = believing(noise_limits(setup), shown)
    choices = _chosen_within(setup, start, accepted, limits)
    if not choices or (first is not None and choices[0].kind.side == "imu"):
        return first
    second = best_of(setup, begin, accepted, choices, limits)
    return first if second is None or second.settled.noise.contradicts(shown) else second


def _off_for_long(
    setup: Setup,
    start: Start,
    begin: Start,
    accepted: Sequence[Choice],
    first: Tried | None,
    without: tuple[Start, Linear],
) -> Tried | None:
    """What explains most if a witness that seems all noise is in order for most of the flight; None if it is noise.

    An error that lasts for a third of a flight is learned as noise. Where its readings do not scatter so, what would
    explain it if the noise were less is tried, and taken if that ends it.
    first: what explains most with the noise that was learned; without: the estimate with nothing further explained.
    """
    settled, linear = without if first is None else (first.settled, first.linear)
    limited = lasting(setup, settled.scale, linear)
    if not limited:
        return None
    limits = noise_limits(setup) | limited
    second = best_of(setup, begin, accepted, _chosen_within(setup, start, accepted, limits), limits)
    if second is None or limited.keys() & lasting(second.setup, second.settled.scale, second.linear).keys():
        return None
    return second


def _chosen_within(setup: Setup, start: Start, accepted: Sequence[Choice], limits: Limits) -> tuple[Choice, ...]:
    """What explains most where the noise is within limits, as if what they are of were believed.

    That estimate is let go here, before another is made: of a long flight one more is more than all else.
    """
    _, believed = estimate(setup, start, accepted, limits, white=True)
    return choose(believed.problem, believed.solution)


def best_of(
    setup: Setup, start: Start, accepted: Sequence[Choice], choices: Sequence[Choice], limits: Limits | None = None
) -> Tried | None:
    """That of some choices, the first of them the best at first order, which explains most; None for none.

    Between others than those of which the first order says too little, a whole estimate decides only where they differ
    by more than the noise has settled to.
    """
    tried = [one for choice in choices if (one := _tried(setup, start, accepted, choice, limits)) is not None]
    if len(tried) < 2:
        return tried[0] if tried else None
    first, worth = tried[0], {one.name: one.worth for one in tried}
    intervals, clearly = len(first.linear.variance), 1.0 + SETTLED
    told = [
        one
        for one in tried
        if one is first
        or one.choice.kind.retimes
        or in_noise(abs(worth[one.name] - worth[first.name]), intervals) > clearly
    ]
    best = max(told, key=lambda one: worth[one.name])
    less = {one.name: worth[best.name] - worth[one.name] for one in told if one is not best}
    choice = best.choice
    if best is not first:  # the others are as far from the first as it is
        gain = next(gain for kind, shape, gain in choice.others if (kind, shape) == first.name)
        choice = choice.with_others(choice.gain - gain - less[first.name])
    return replace(best, choice=choice.beside(less))


def _tried(
    setup: Setup, start: Start, accepted: Sequence[Choice], choice: Choice, limits: Limits | None = None
) -> Tried | None:
    """None for what cannot be. limits: of the densities of the IMU, as the choice was made with."""
    possible = retimed(setup, start, accepted, choice, limits)
    if possible is None:
        return None
    setup, moved = possible.setup, possible.choice
    as_learned = possible.estimated if limits is None else None
    again, linear = as_learned or estimate(setup, start, [*accepted, moved])
    beside = gain_beside(moved, linear.problem, linear.solution, linear.prior)
    gain = max(choice.gain, beside) / unrest(moved, linear.problem, linear.solution)
    final = (
        moved.in_noise(choice.gain / gain)
        if moved is choice
        else replace(moved, gain=gain).with_others(gain - choice.gain)
    )
    return Tried(final, setup, again, linear)


def _result(
    setup: Setup, settled: Start, linear: Linear, accepted: Sequence[Choice], shown: tuple[float, float]
) -> BestEstimate:
    states = settled.states
    covariance = linear.solution.covariances()
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    if not (variance > 0).all():
        raise np.linalg.LinAlgError("variances are lost in rounding")
    sigma = np.sqrt(variance)
    of_constants = np.diagonal(linear.solution.constants_covariance)[:CONSTANT_STATES]
    residuals = {
        one.name: Residuals(one.t, measurement_residual(one, linear.solution), one.sigma, one.weight, UNITS[one.name])
        for one in linear.measurements
    }
    heading = "compass" if "compass" in residuals else "GPS and acceleration"
    if "gps_velocity" not in residuals and "compass" not in residuals:
        heading = "first guess"
    parts, together = explained(linear.problem, linear.solution, accepted)
    return BestEstimate(
        imu=setup.imu,
        index=setup.index,
        t=setup.t,
        states=states,
        covariance=covariance[:, :9, :9].copy(),
        correlation=Correlation(linear.solution.factor, linear.solution.border, linear.solution.constants_covariance),
        gyro_bias_sigma=sigma[:, GYRO_BIAS],
        accel_bias_sigma=sigma[:, ACCEL_BIAS],
        constants_sigma=np.sqrt(np.maximum(of_constants, 0.0)),
        errors=constant_errors(states, linear.solution),
        first_half=of_first_half(linear),
        noise=settled.noise,
        lasting=(
            linear.noise.gyro_noise / settled.noise.gyro_noise,
            linear.noise.accel_noise / settled.noise.accel_noise,
        ),
        scatter=shown,
        measurement_scale=dict(settled.scale),
        residuals=residuals,
        gravity=setup.gravity,
        origin=setup.origin,
        explained=parts,
        explained_covariance=together,
        detectable=detectable(linear.problem, linear.solution),
        bursts=bursts(linear.solution),
        heading_from=heading,
        notes=setup.notes,
    )
