"""The smoother: Gauss-Newton over all keyframes at once, and one explanation after the other for what does not fit.

Each pass takes the nominal states, makes them linear, solves for all errors at once and moves the states; in between
the densities are learned. Then everything that may be wrong competes for what the witnesses do not agree on, and the
estimate is made anew with what explains most, until nothing pays for itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.estimation.competition import (
    WORTH,
    Choice,
    choose,
    detectable,
    explained,
    gain_beside,
    promising,
    unrest,
)
from companion.estimation.learned_noise import START, believing, coloured, learn, noise_limits, outlier_weights, scatter
from companion.estimation.linearisation import CarriedImu, Linear, carry_imu, linearise
from companion.estimation.measurements import UNITS
from companion.estimation.model import (
    ACCEL_BIAS,
    ATTITUDE,
    CONSTANT_STATES,
    GYRO_BIAS,
    BestEstimate,
    Correlation,
    ProcessNoise,
    Residuals,
    States,
)
from companion.estimation.setup import Setup, first_guess, set_up
from companion.estimation.system import (
    measurement_residual,
)
from companion.estimation.weighing import bursts
from companion.model import STANDARD_GRAVITY, Array, DataError, Flight

_PASSES = 14
_LEARN_FROM = 1  # the pass after which densities are learned
_WEIGHTS_FROM = 4  # the pass after which outliers weigh less, whether or not densities have settled
_WEIGHTED = 3  # passes with such weights, at least
_NEAR, _SETTLED = 0.15, 0.05  # changes of the logarithm of a density
_STILL = 1e-3  # rad
_ALTERNATES = 0.8  # of the step before, and back: from there on Gauss-Newton goes to and fro
_SHORTEST = 0.2  # of a step
_FAR = (4e-3, 0.1)  # rad/s, m/s²: a bias further off than this changes the path by more than its first order
_MOST_EXPLAINED = 6


def smooth(
    flight: Flight,
    imu: str | None = None,
    *,
    gravity: float = STANDARD_GRAVITY,
    guess: States | None = None,
    span: tuple[float, float] | None = None,
    untrusted: Sequence[tuple[float, float]] = (),
) -> BestEstimate:
    """The best estimate of a flight's trajectory from one IMU and every witness but the autopilot's own estimate.

    imu: the message, as for `Flight.imu`. guess: where to begin, in place of the autopilot's attitude and the GPS; the
    result does not depend on it. span: boot times (s) to which the estimate is confined.
    untrusted: stretches in which the IMU's readings are none: stuck, frozen, at the end of the range.

    Raises DataError where the IMU cannot carry an estimate.
    """
    setup = set_up(flight, imu, gravity, span, untrusted)
    start = start_of(setup, guess or first_guess(setup, flight))
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # absurd readings: what is not finite is refused below
            return explain(setup, start)
    except np.linalg.LinAlgError as error:
        raise DataError(
            f"{setup.imu.source}: no estimate of the trajectory can be made of these readings ({error}). "
            "Look at them with `companion info`; try another IMU: --imu."
        ) from error


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """Where an iteration begins."""

    states: States
    noise: ProcessNoise
    scale: Mapping[str, float]
    path: CarriedImu | None = None  # the IMU as it was carried last


def start_of(setup: Setup, guess: States) -> Start:
    """Where nothing is learned yet: every σ wide."""
    return Start(guess, START, {r.name: 1.0 if r.name.startswith("rest") else 3.0 for r in setup.readings})


def explain(setup: Setup, start: Start) -> BestEstimate:
    """The estimate with everything explained that has to be: one after the other, each time what explains most.

    What is not explained was learned as noise, and hides in it. So an explanation that promises something is weighed
    again with the noise that is learned beside it, from where the iteration began: an unexplained fault may have led it
    to another heading.
    """
    accepted: list[Choice] = []
    nearly: tuple[str, ...] = ()
    settled, linear = estimate(setup, start)
    shown = scatter(setup)
    while len(accepted) < _MOST_EXPLAINED:
        found = _explained_further(setup, start, settled, linear, accepted, shown)
        if found is None:
            break
        choice, again, result = found
        if choice.gain < WORTH:
            nearly = promising(choice)
            break
        accepted.append(choice)
        settled, linear = again, result
    return replace(_result(setup, settled, linear, accepted, shown), promising=nearly)


def _explained_further(
    setup: Setup, start: Start, settled: Start, linear: Linear, accepted: Sequence[Choice], shown: tuple[float, float]
) -> tuple[Choice, Start, Linear] | None:
    """What explains most, and the estimate with it; None where nothing promises anything.

    A fault of another witness that lasts for a good part of the flight is learned as noise of the IMU: it is then the
    IMU that seems to follow the other. So where it goes on to need far more noise than it shows, what would explain
    most if it were believed is tried, and taken if that ends it.
    shown: by which its readings scatter (`scatter`).
    """
    begin = replace(settled, states=start.states)
    choice = choose(linear.problem, linear.solution)
    first = None if choice is None else _tried(setup, begin, accepted, choice)
    doubted = any(one.kind.side == "imu" for one in accepted)
    if doubted or not (settled if first is None else first[1]).noise.contradicts(shown):
        return first
    limits = believing(noise_limits(setup), shown)
    _, believed = estimate(setup, start, accepted, limits, white=True)
    choice = choose(believed.problem, believed.solution)
    if choice is None or choice.kind.side == "imu":
        return first
    second = _tried(setup, begin, accepted, choice)
    return first if second[1].noise.contradicts(shown) else second


def _tried(setup: Setup, start: Start, accepted: Sequence[Choice], choice: Choice) -> tuple[Choice, Start, Linear]:
    """A choice with what it gains in the noise that is learned beside it, and the estimate with it."""
    again, linear = estimate(setup, start, [*accepted, choice])
    beside = gain_beside(choice, linear.problem, linear.solution, linear.prior)
    gain = max(choice.gain, beside) / unrest(choice, linear.problem, linear.solution)
    return choice.in_noise(choice.gain / gain), again, linear


def estimate(
    setup: Setup,
    start: Start,
    accepted: Sequence[Choice] = (),
    limits: Mapping[str, tuple[float, float]] | None = None,
    *,
    white: bool = False,
) -> tuple[Start, Linear]:
    """The iteration with what is accepted: where it settles, and the linear problem there.

    limits: of the densities of the IMU, in place of what may be learned. white: what is left over is taken for white
    noise, however long it lasts: as it is not where something unexplained is in it.
    """
    states, noise, scale = start.states, start.noise, dict(start.scale)
    weights: dict[str, Array] = {}
    limits = limits or noise_limits(setup)
    change: dict[str, float] = {}
    weighted = 0
    path = _carried(setup, states, start.path)
    linear = linearise(setup, path, states, noise, scale, weights, accepted)
    step = Step()
    for count in range(_PASSES):
        if count >= _WEIGHTS_FROM:  # the steps before are towards what is still being learned
            step = step.then(_in_priors(linear))
        states = step.taken(states, linear)
        path = _carried(setup, states, path)
        moved, largest = float(np.abs(linear.solution.x[:, ATTITUDE]).max()), np.inf
        if count >= _LEARN_FROM:
            noise, scale, change = learn(linear, noise, scale, limits, change)
            largest = max(map(abs, change.values()))
            if weighted or accepted or largest < _NEAR or count >= _WEIGHTS_FROM:
                weights = outlier_weights(linear)
                weighted += 1
        if (weighted >= _WEIGHTED and largest < _SETTLED and moved < _STILL) or count == _PASSES - 1:
            break
        del linear  # before the next is made: of a long flight two are more than all else
        linear = linearise(setup, path, states, noise, scale, weights, accepted)
    grown = dict.fromkeys(coloured(linear), 1.0) if white else coloured(linear)
    wide = replace(noise, gyro_noise=noise.gyro_noise * grown["gyro"], accel_noise=noise.accel_noise * grown["accel"])
    step = Step()  # of another problem: nothing is undone
    for _ in range(2):
        del linear
        linear = linearise(setup, path, states, wide, scale, weights, accepted, grown)
        step = step.then(_in_priors(linear))
        states = step.taken(states, linear)
        if float(np.abs(linear.solution.x[:, ATTITUDE]).max()) < _STILL:
            break
    if not np.isfinite(states.q_ned_frd).all():
        raise DataError(f"{setup.imu.source}: the estimate of the trajectory does not settle; the readings do not fit")
    return Start(states, noise, scale, path), linear


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """A step of Gauss-Newton, and the share of it that is taken.

    Where the problem is far from linear, steps may go to and fro about the solution, and grow. A step that undoes the
    one before is then shortened to where a straight line between the two has its zero (Irons, Tuck 1969, "A version of
    the Aitken accelerator for computer iteration").
    """

    whole: Array | None = None  # as it would be at full length, in units of what is believed beforehand
    share: float = 1.0

    def then(self, whole: Array) -> Step:
        """The next one, from where this one led."""
        before = self.whole
        if before is None or whole @ before >= -_ALTERNATES * (before @ before):
            return Step(whole)
        change = whole - before
        share = -self.share * float(before @ change) / float(change @ change)
        return Step(whole, float(np.clip(share, _SHORTEST, 1.0)))

    def taken(self, states: States, linear: Linear) -> States:
        """The states after its share of what the linear problem asks for."""
        return states.moved(self.share * linear.solution.x, self.share * linear.solution.c)


def _in_priors(linear: Linear) -> Array:
    """The step that the linear problem asks for, of states and constants, in units of what is believed beforehand."""
    states, constants = linear.solution.x / linear.prior.sigma, linear.solution.c / linear.prior.constants_sigma
    return np.concatenate((states.ravel(), constants[:CONSTANT_STATES]))


def _carried(setup: Setup, states: States, before: CarriedImu | None) -> CarriedImu:
    """The IMU carried with the biases of the states; as it was before where they differ by little."""
    bias = np.median(states.gyro_bias, axis=0), np.median(states.accel_bias, axis=0)
    if before is not None and all(np.abs(b - c).max() < far for b, c, far in zip(bias, before.bias, _FAR, strict=True)):
        return before
    return carry_imu(setup, bias)


def _result(
    setup: Setup, settled: Start, linear: Linear, accepted: Sequence[Choice], shown: tuple[float, float]
) -> BestEstimate:
    states = settled.states
    covariance = linear.solution.covariances()
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    if not (variance > 0).all():
        raise np.linalg.LinAlgError("variances are lost in rounding")
    sigma = np.sqrt(variance)
    residuals = {
        one.name: Residuals(one.t, measurement_residual(one, linear.solution), one.sigma, one.weight, UNITS[one.name])
        for one in linear.measurements
    }
    heading = "compass" if "compass" in residuals else "GPS and acceleration"
    if "gps_velocity" not in residuals and "compass" not in residuals:
        heading = "first guess"
    return BestEstimate(
        imu=setup.imu,
        index=setup.index,
        t=setup.t,
        states=states,
        covariance=covariance[:, :9, :9].copy(),
        correlation=Correlation(linear.solution.factor, linear.solution.border, linear.solution.constants_covariance),
        gyro_bias_sigma=sigma[:, GYRO_BIAS],
        accel_bias_sigma=sigma[:, ACCEL_BIAS],
        constants_sigma=np.sqrt(np.maximum(np.diagonal(linear.solution.constants_covariance), 0.0)),
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
        explained=explained(linear.problem, linear.solution, accepted),
        detectable=detectable(linear.problem, linear.solution),
        bursts=bursts(linear.solution),
        heading_from=heading,
        notes=setup.notes,
    )
