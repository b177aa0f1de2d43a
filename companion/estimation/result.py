"""What an estimate says: where the vehicle was and how well that is known, what was wrong, and how large it was.

Also here: an IMU's errors that last through the flight, which are biases, scale and misalignment.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from functools import partial, reduce

import numpy as np
import numpy.typing as npt

from companion.constants import num
from companion.estimation.candidate import Candidate
from companion.estimation.differences import Differences
from companion.estimation.iteration import Start
from companion.estimation.learned_noise import spectral
from companion.estimation.model import (
    ACCEL_BIAS,
    CONSTANT_STATES,
    CONSTANTS,
    GYRO_BIAS,
    BestEstimate,
    ConstantErrors,
    Correlation,
    Explained,
    Residuals,
    Rival,
    States,
)
from companion.estimation.search import detectable
from companion.estimation.setup import Setup
from companion.estimation.shapes import SLOPED
from companion.estimation.system import Motion, Problem, measurement_residual
from companion.estimation.turning import jacobian
from companion.model import Array

_BIASES = slice(GYRO_BIAS.start, ACCEL_BIAS.stop)
_MATRICES = np.r_[CONSTANTS["gyro_matrix"][0], CONSTANTS["accel_matrix"][0]]


def best_estimate(
    setup: Setup, settled: Start, linear: Problem, accepted: Sequence[Candidate], rivals: Sequence[tuple[Rival, ...]]
) -> BestEstimate:
    """Where an iteration with what is accepted has settled, and how well it is known."""
    states, own, louder = settled.states, settled.noise, linear.noise
    covariance = linear.solution.covariances()
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    if not (variance > 0).all():
        raise np.linalg.LinAlgError("variances are lost in rounding")
    sigma = np.sqrt(variance)
    of_constants = np.diagonal(linear.solution.constants_covariance)[:CONSTANT_STATES]
    residuals = {
        one.name: Residuals(one.t, measurement_residual(one, linear.solution), one.sigma, one.weight, one.unit)
        for one in linear.measurements
    }
    heading = "compass" if "compass" in residuals else "GPS and acceleration"
    if "gps_velocity" not in residuals and "compass" not in residuals:
        heading = "first guess"
    parts, together = explained(linear, accepted, rivals, setup.others)
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
        errors=constant_errors(states, linear),
        first_half=of_first_half(linear),
        noise=own,
        correlated=(louder.gyro_noise / own.gyro_noise, louder.accel_noise / own.accel_noise),
        spectral=spectral(setup),
        measurement_scale=dict(settled.scale),
        slow_sigma=dict(settled.slow),
        residuals=residuals,
        gravity=setup.gravity,
        origin=setup.origin,
        explained=parts,
        explained_covariance=together,
        detectable=detectable(linear),
        heading_from=heading,
        notes=setup.notes,
        converged=settled.gain < num.UNSETTLED_MISFIT and is_field_of_the_place(setup, states),
    )


def is_field_of_the_place(setup: Setup, states: States) -> bool:
    """Whether the Earth's field of an estimate may be that of the place.

    On one heading iron may stand for all of it that is level: where gyro and compass contradict each other, that fits
    both, and the heading is any.
    """
    place, _ = CONSTANTS["earth_field"]
    apart = (states.constants[place] - setup.constants[place]) / setup.constants_sigma[place]
    return float(np.linalg.norm(apart)) < num.FIELD_SIGMAS


def explained(
    problem: Problem,
    accepted: Sequence[Candidate],
    rivals: Sequence[tuple[Rival, ...]],
    differences: Sequence[Differences],
) -> tuple[tuple[Explained, ...], Array]:
    """What was accepted, with its size as the solution has it, in order of time; and the covariance of all sizes.

    differences: of the other IMUs, before anything was taken out: of their errors they tell the size.
    """
    solution, at, columns = problem.solution, CONSTANT_STATES, list[int]()
    out = list[tuple[Candidate, tuple[Rival, ...], Array, slice]]()
    bent = list[tuple[slice, Array]]()  # sizes of what does not lead straight, by which that which does changes
    for candidate, others in zip(accepted, rivals, strict=True):
        if candidate.imu is not None or (whole := candidate.hypothesis.signature(problem)) is None:
            continue
        own = np.full(whole.unknowns, -1)  # where its components stand in the solution: -1 for what does not change
        changed = own if candidate.axis < 0 else own[candidate.axis : candidate.axis + 1]
        changed[:] = at + np.arange(len(changed))
        at += len(changed)
        size = np.where(own >= 0, solution.c[own] + candidate.taken, 0.0)
        place = slice(len(columns), len(columns) + len(own))
        if candidate.hypothesis.turns_field and candidate.shape in SLOPED:  # as what leads straight to where it ends
            straight = partial(_straight, candidate, problem)
            bent.append((place, jacobian(straight, complex(*size))[0]))
            size = straight(complex(*size)).view(np.float64)
        out.append((candidate, others, size, place))
        columns += own.tolist()
    known = np.array(columns, dtype=np.intp)
    covariance = solution.constants_covariance[np.ix_(known, known)] * np.outer(known >= 0, known >= 0)
    for place, by_size in bent:
        covariance[place] = by_size @ covariance[place]
        covariance[:, place] = covariance[:, place] @ by_size.T
    sigma = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    parts = [one.explained(size, sigma[place], others, place) for one, others, size, place in out]
    parts += _of_others(accepted, rivals, differences)
    return tuple(sorted(parts, key=lambda one: one.onset)), covariance


def _straight(candidate: Candidate, problem: Problem, size: complex) -> npt.NDArray[np.complex128]:
    """(1,) µT/s, north + i east, by which a field that turns evenly would have to grow along a line."""
    t, level = problem.t[-1:], complex(*problem.states.constant("earth_field")[:2])
    lasted = max(min(candidate.end, float(t[0])) - candidate.onset, num.CHANGE_MIN_S)
    return np.asarray(candidate.change_of_field(t, level, size) / lasted)


def _of_others(
    accepted: Sequence[Candidate], rivals: Sequence[tuple[Rival, ...]], differences: Sequence[Differences]
) -> Iterator[Explained]:
    """Errors of other IMUs than the estimate's, by what these read more than it, its own errors free."""
    own = [one for one in accepted if one.imu is None and one.hypothesis.device == "imu"]
    for whole in differences:
        other = reduce(Differences.beside, own, whole)
        mine = [i for i, one in enumerate(accepted) if one.imu == other.instance]
        for i, (size, sigma) in zip(mine, other.sizes([accepted[i] for i in mine]), strict=True):
            yield accepted[i].explained(size, sigma, rivals[i])


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
