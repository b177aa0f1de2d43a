"""Gauss-Newton over all keyframes at once, while the noise is learned.

Each pass takes the nominal states, makes them linear, solves for all errors at once and moves the states; in between
the densities are learned.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.estimation.choice import Choice
from companion.estimation.learned_noise import START, coloured, learn, noise_limits, outlier_weights
from companion.estimation.linearisation import CarriedImu, Linear, carry_imu, linearise
from companion.estimation.model import ATTITUDE, CONSTANT_STATES, ProcessNoise, States
from companion.estimation.setup import Setup
from companion.model import Array, DataError

_PASSES = 14
_LEARN_FROM = 1  # the pass after which densities are learned
_WEIGHTS_FROM = 4  # the pass after which outliers weigh less, whether or not densities have settled
_WEIGHTED = 3  # passes with such weights, at least
_NEAR, _SETTLED = 0.15, 0.05  # changes of the logarithm of a density
_STILL = 1e-3  # rad
_ALTERNATES = 0.8  # of the step before, and back: from there on Gauss-Newton goes to and fro
_SHORTEST = 0.2  # of a step
_FAR = (4e-3, 0.1)  # rad/s, m/s²: a bias further off than this changes the path by more than its first order


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
    path = carried(setup, states, start.path)
    linear = linearise(setup, path, states, noise, scale, weights, accepted)
    step = Step()
    for count in range(_PASSES):
        if count >= _WEIGHTS_FROM:  # the steps before are towards what is still being learned
            step = step.then(_in_priors(linear))
        states = step.taken(states, linear)
        moved, largest = float(np.abs(linear.solution.x[:, ATTITUDE]).max()), np.inf
        if count >= _LEARN_FROM:
            noise, scale, change = learn(linear, noise, scale, limits, change, setup.spectral_noise)
            largest = max(map(abs, change.values()))
            if weighted or accepted or largest < _NEAR or count >= _WEIGHTS_FROM:
                weights = outlier_weights(linear)
                weighted += 1
        if (weighted >= _WEIGHTED and largest < _SETTLED and moved < _STILL) or count == _PASSES - 1:
            break
        del linear  # before the next is made: of a long flight two are more than all else
        path = carried(setup, states, path)
        linear = linearise(setup, path, states, noise, scale, weights, accepted)
    grown = dict.fromkeys(coloured(linear), 1.0) if white else coloured(linear)
    wide = replace(noise, gyro_noise=noise.gyro_noise * grown["gyro"], accel_noise=noise.accel_noise * grown["accel"])
    del linear
    path = carried(setup, states, path)
    step = Step()  # of another problem: nothing is undone
    for last in (False, True):
        linear = linearise(setup, path, states, wide, scale, weights, accepted, grown)
        step = step.then(_in_priors(linear))
        states = step.taken(states, linear)
        if float(np.abs(linear.solution.x[:, ATTITUDE]).max()) < _STILL:
            break
        if not last:
            del linear
    if not np.isfinite(states.q_ned_frd).all():
        raise DataError(f"{setup.imu.source}: the estimate of the trajectory does not settle; the readings do not fit")
    return Start(states, noise, scale, path), linear


def likelihood(settled: Start, linear: Linear) -> float:
    """Twice the logarithm of the likelihood at the noise that was learned, but for a constant: what fits needs less."""
    noise, scale = settled.noise, settled.scale
    of_imu = -6.0 * len(linear.variance) * float(np.log(noise.gyro_noise) + np.log(noise.accel_noise))
    return of_imu - 2.0 * sum(m.residual.size * float(np.log(scale[m.name])) for m in linear.measurements)


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


def carried(setup: Setup, states: States, before: CarriedImu | None) -> CarriedImu:
    """The IMU carried with the biases of the states; as it was before, where it was and they differ by little."""
    bias = np.median(states.gyro_bias, axis=0), np.median(states.accel_bias, axis=0)
    if before is not None and all(np.abs(b - c).max() < far for b, c, far in zip(bias, before.bias, _FAR, strict=True)):
        return before
    return carry_imu(setup, bias)
