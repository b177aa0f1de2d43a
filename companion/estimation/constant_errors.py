"""What the best estimate says of an IMU's errors that last through the flight: biases, scale and misalignment."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from companion.estimation.model import ACCEL_BIAS, CONSTANTS, GYRO_BIAS, ConstantErrors, States
from companion.estimation.system import Motion, Problem

_BIASES = slice(GYRO_BIAS.start, ACCEL_BIAS.stop)
_MATRICES = np.r_[CONSTANTS["gyro_matrix"][0], CONSTANTS["accel_matrix"][0]]


def constant_errors(states: States, problem: Problem) -> ConstantErrors:
    """The errors that last, about which the problem was made linear and solved."""
    count, solution, prior = len(problem.t), problem.solution, problem.prior
    every = np.zeros((*solution.x.shape, 6))
    every[:, _BIASES] = np.eye(6) / count
    by_constants = -solution.border[:, _BIASES].mean(axis=0)  # what the mean changes by with them
    along = by_constants @ solution.constants_covariance
    covariance = np.empty((24, 24))
    covariance[:6, :6] = solution.factor.solve(every)[:, _BIASES].mean(axis=0) + along @ by_constants.T
    covariance[:6, 6:] = along[:, _MATRICES]
    covariance[6:, :6] = covariance[:6, 6:].T
    covariance[6:, 6:] = solution.constants_covariance[np.ix_(_MATRICES, _MATRICES)]
    biases = states.gyro_bias.mean(axis=0), states.accel_bias.mean(axis=0)
    believed = np.concatenate((prior.sigma[_BIASES], prior.constants_sigma[_MATRICES]))
    return ConstantErrors(np.concatenate([*biases, states.constants[_MATRICES]]), covariance, believed)


def of_first_half(problem: Problem) -> tuple[float, ConstantErrors]:
    """A time in the middle of the flight, s, and the errors by what every aiding sensor reads until then.

    The densities and what is explained are those of the whole flight.
    """
    middle = float(0.5 * (problem.t[0] + problem.t[-1]))
    count = int(np.searchsorted(problem.t, middle, side="right"))
    motion = Motion(*(getattr(problem.motion, part.name)[: count - 1] for part in fields(Motion)))
    measurements = []
    for one in problem.measurements:
        until = int(np.searchsorted(one.keyframe, count))
        rows = ("t", "keyframe", "residual", "states", "constants", "sigma", "weight")
        measurements.append(replace(one, **{name: getattr(one, name)[:until] for name in rows}))
    part = ("q_ned_frd", "velocity", "position", "gyro_bias", "accel_bias", "slow")
    states = replace(problem.states, **{name: getattr(problem.states, name)[:count] for name in part})
    begun = replace(problem, t=problem.t[:count], motion=motion, measurements=tuple(measurements), states=states)
    return middle, constant_errors(states.moved(begun.solution.x, begun.solution.c), begun)


def allowing(errors: ConstantErrors, gyro_scale: float, accel_scale: float) -> ConstantErrors:
    """The same where the scales may be off by more (1σ) than the smoother believes.

    The difference is taken out of what it believed beforehand, which leaves what the flight says as it is.
    """
    possible = errors.possible.copy()
    diagonals = possible[6:].reshape(2, 9)[:, ::4]  # of both matrices, after six biases
    diagonals[:] = np.maximum(diagonals, [[gyro_scale], [accel_scale]])
    wider = possible > errors.possible
    information = 1.0 / errors.possible[wider] ** 2 - 1.0 / possible[wider] ** 2
    covariance = errors.covariance
    gain = covariance[:, wider] @ np.linalg.inv(np.diag(1.0 / information) - covariance[np.ix_(wider, wider)])
    return ConstantErrors(errors.values + gain @ errors.values[wider], covariance + gain @ covariance[wider], possible)
