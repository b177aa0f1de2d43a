"""Gauss-Newton over all keyframes at once, while the noise is learned.

Each pass takes the nominal states, makes them linear, solves for all errors at once and moves the states; in between
the densities are learned.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.estimation.choice import Choice
from companion.estimation.descent import LITTLE, Point, Step
from companion.estimation.learned_noise import START, coloured, learn, noise_limits, outlier_weights
from companion.estimation.linearisation import CarriedImu, Linear, carry_imu, linearise
from companion.estimation.model import CONSTANT_STATES, ProcessNoise, States
from companion.estimation.setup import Setup
from companion.model import Array, DataError

_PASSES = 20  # at most
_LEARN_FROM = 1  # the pass after which densities are learned
_WEIGHTS_FROM = 4  # the pass after which outliers weigh less, whether or not densities have settled
_WEIGHTED = 2  # passes with such weights, at least
_NEAR, _SETTLED = 0.15, 0.05  # changes of the logarithm of a density
_LEARNING = 0.1  # of the misfit, that may be left to gain while the noise still changes a little with every pass
_POLISHED = 4  # passes with the noise that lasts, at most
_FAR = (4e-3, 0.1)  # rad/s, m/s²: a bias further off than this changes the path by more than its first order


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """Where an iteration begins."""

    states: States
    noise: ProcessNoise
    scale: Mapping[str, float]
    path: CarriedImu | None = None  # the IMU as it was carried last
    near: bool = False  # to where it ends: what the first pass leaves tells of the noise already


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
    noise, scale = start.noise, dict(start.scale)
    weights: dict[str, Array] = {}
    limits = limits or noise_limits(setup)
    change: dict[str, float] = {}
    weighted = 0
    wide, grown = noise, dict[str, float]()
    path = carried(setup, start.states, start.path)

    def about(point: Point) -> Linear:
        nonlocal path
        path = carried(setup, point.states, path)
        return linearise(setup, path, point.states, wide, scale, weights, accepted, grown, sizes=point.sizes)

    linear = about(Point(start.states, np.zeros(0)))
    point = Point(start.states, np.zeros(len(linear.prior.constants_sigma) - CONSTANT_STATES))
    for count in range(_PASSES):
        step, largest = Step.of(linear, point.sizes), np.inf
        if count >= _LEARN_FROM or start.near:
            noise, scale, change = learn(linear, noise, scale, limits, change, setup.spectral_noise)
            wide, largest = noise, max(map(abs, change.values()))
            if weighted or accepted or largest < _NEAR or count >= _WEIGHTS_FROM:
                weights = outlier_weights(linear)
                weighted += 1
        if (weighted >= _WEIGHTED and largest < _SETTLED and step.gain < _LEARNING) or count == _PASSES - 1:
            break
        del linear  # before the next is made: of a long flight two are more than all else
        point, linear = step.taken(about)
        del step  # its weights are as large as the motion of the next
    grown = dict.fromkeys(coloured(linear), 1.0) if white else coloured(linear)
    wide = replace(noise, gyro_noise=noise.gyro_noise * grown["gyro"], accel_noise=noise.accel_noise * grown["accel"])
    for _ in range(_POLISHED):
        del linear
        point, linear = step.taken(about)  # noqa: F821  (ruff takes the break above for none)
        del step  # noqa: F821
        step = Step.of(linear, point.sizes)
        if step.gain < LITTLE:
            break
    states = step.at(1.0).states
    if not np.isfinite(states.q_ned_frd).all():
        raise DataError(f"{setup.imu.source}: the estimate of the trajectory does not settle; the readings do not fit")
    return Start(states, noise, scale, path), linear


def likelihood(settled: Start, linear: Linear) -> float:
    """Twice the logarithm of the likelihood at the noise that was learned, but for a constant: what fits needs less."""
    noise, scale = settled.noise, settled.scale
    of_imu = -6.0 * len(linear.variance) * float(np.log(noise.gyro_noise) + np.log(noise.accel_noise))
    return of_imu - 2.0 * sum(m.residual.size * float(np.log(scale[m.name])) for m in linear.measurements)


def carried(setup: Setup, states: States, before: CarriedImu | None) -> CarriedImu:
    """The IMU carried with the biases of the states; as it was before, where it was and they differ by little."""
    bias = np.median(states.gyro_bias, axis=0), np.median(states.accel_bias, axis=0)
    if before is not None and all(np.abs(b - c).max() < far for b, c, far in zip(bias, before.bias, _FAR, strict=True)):
        return before
    return carry_imu(setup, bias)
