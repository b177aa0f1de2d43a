"""The solution with constants, its covariances and the weight of further unknowns against a dense least squares."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from companion.estimation.model import ATTITUDE, STATES, Correlation
from companion.estimation.system import (
    Measurement,
    Motion,
    Prior,
    Solution,
    measurement_variance,
    motion_residual,
    motion_residual_covariance,
    solve,
)
from companion.model import Array

COUNT, CONSTANTS = 7, 4


@dataclass(frozen=True, slots=True, eq=False)
class Dense:
    """All factors of a problem as one: residual = r - J (x, c), whitened."""

    jacobian: Array
    residual: Array


@pytest.fixture(scope="module")
def problem() -> tuple[Motion, tuple[Measurement, ...], Prior]:
    rng = np.random.default_rng(1)
    steps = COUNT - 1
    root = np.tril(rng.normal(size=(steps, STATES, STATES)), -1) * 0.2 + 2.0 * np.eye(STATES)
    motion = Motion(
        residual=rng.normal(size=(steps, STATES)),
        transition=np.eye(STATES) + 0.2 * rng.normal(size=(steps, STATES, STATES)),
        constants=rng.normal(size=(steps, STATES, CONSTANTS)),
        weight=root @ root.swapaxes(-1, -2),
    )
    keyframe = np.array([0, 2, 3, 5], dtype=np.intp)
    measurement = Measurement(
        "aiding sensor",
        np.arange(4.0),
        keyframe,
        rng.normal(size=(4, 3)),
        rng.normal(size=(4, 3, STATES)),
        rng.normal(size=(4, 3, CONSTANTS)),
        rng.uniform(0.3, 2.0, (4, 3)),
        np.array([1.0, 0.3, 1.0, 1.0]),
    )
    prior = Prior(
        rng.normal(size=STATES), rng.uniform(1, 3, STATES), rng.normal(size=CONSTANTS), np.full(CONSTANTS, 2.0)
    )
    return motion, (measurement,), prior


def dense(motion: Motion, measurements: tuple[Measurement, ...], prior: Prior) -> Dense:
    """The same factors, written out."""
    width = COUNT * STATES + len(prior.constants_sigma)
    constants = slice(COUNT * STATES, width)
    rows, values = [], []
    for k in range(COUNT - 1):
        root = np.linalg.cholesky(motion.weight[k]).T
        row = np.zeros((STATES, width))
        row[:, k * STATES : (k + 1) * STATES] = -motion.transition[k]
        row[:, (k + 1) * STATES : (k + 2) * STATES] = np.eye(STATES)
        row[:, constants] = -motion.constants[k]
        rows.append(root @ row)
        values.append(root @ motion.residual[k])
    for one in measurements:
        for i, k in enumerate(one.keyframe):
            root = np.diag(np.sqrt(one.information[i]))
            row = np.zeros((one.residual.shape[1], width))
            row[:, k * STATES : (k + 1) * STATES] = one.states[i]
            row[:, constants] = one.constants[i]
            rows.append(root @ row)
            values.append(root @ one.residual[i])
    first, last = np.zeros((STATES, width)), np.zeros((len(prior.constants_sigma), width))
    first[:, :STATES] = np.diag(1 / prior.sigma)
    last[:, constants] = np.diag(1 / prior.constants_sigma)
    rows += [first, last]
    values += [prior.residual / prior.sigma, prior.constants_residual / prior.constants_sigma]
    return Dense(np.concatenate(rows), np.concatenate(values))


@pytest.fixture(scope="module")
def solution(problem: tuple[Motion, tuple[Measurement, ...], Prior]) -> Solution:
    return solve(COUNT, *problem)


def test_the_solution_is_that_of_dense_least_squares(
    problem: tuple[Motion, tuple[Measurement, ...], Prior], solution: Solution
) -> None:
    whole = dense(*problem)
    expected, *_ = np.linalg.lstsq(whole.jacobian, whole.residual)
    np.testing.assert_allclose(solution.x.ravel(), expected[:-CONSTANTS], atol=1e-9)
    np.testing.assert_allclose(solution.c, expected[-CONSTANTS:], atol=1e-9)


def test_the_covariances_are_those_of_the_dense_inverse(
    problem: tuple[Motion, tuple[Measurement, ...], Prior], solution: Solution
) -> None:
    motion, (one,), _ = problem
    whole = dense(*problem)
    inverse = np.linalg.inv(whole.jacobian.T @ whole.jacobian)
    own = solution.covariances()
    for k in range(COUNT):
        here = slice(k * STATES, (k + 1) * STATES)
        np.testing.assert_allclose(own[k], inverse[here, here], atol=1e-9)
    np.testing.assert_allclose(solution.constants_covariance, inverse[-CONSTANTS:, -CONSTANTS:], atol=1e-9)

    since, rows = 2, ATTITUDE
    known = Correlation(solution.factor, solution.border, solution.constants_covariance)
    changed = known.change_sigma(own[:, rows, rows], rows, since)
    for k in range(COUNT):
        one_from_other = np.zeros((3, len(inverse)))
        one_from_other[:, k * STATES : k * STATES + 3] += np.eye(3)
        one_from_other[:, since * STATES : since * STATES + 3] -= np.eye(3)
        expected = np.diagonal(one_from_other @ inverse @ one_from_other.T)
        np.testing.assert_allclose(changed[k], np.sqrt(np.maximum(expected, 0.0)), atol=1e-6)

    weights = np.random.default_rng(3).normal(size=(COUNT, 2))
    row = np.zeros((1, len(inverse)))
    row[0, : COUNT * STATES].reshape(COUNT, STATES)[:, :2] = weights
    assert known.variance_of_sum(weights) == pytest.approx(float((row @ inverse @ row.T).item()))

    of_motion = motion_residual_covariance(motion, solution, solution.factor.inverse_blocks(), slice(None))
    step, constants = 3, slice(COUNT * STATES, None)
    row = np.zeros((STATES, len(inverse)))
    row[:, step * STATES : (step + 1) * STATES] = motion.transition[step]
    row[:, (step + 1) * STATES : (step + 2) * STATES] = -np.eye(STATES)
    row[:, constants] = motion.constants[step]
    np.testing.assert_allclose(of_motion[step], row @ inverse @ row.T, atol=1e-8)

    row = np.zeros((3, len(inverse)))
    row[:, one.keyframe[1] * STATES : (one.keyframe[1] + 1) * STATES] = one.states[1]
    row[:, constants] = one.constants[1]
    np.testing.assert_allclose(measurement_variance(one, solution)[1], np.diagonal(row @ inverse @ row.T), atol=1e-8)


def test_what_is_left_of_the_motion_is_what_the_solution_leaves(
    problem: tuple[Motion, tuple[Measurement, ...], Prior], solution: Solution
) -> None:
    motion, _, _ = problem
    exact = replace(motion, residual=motion.residual - motion_residual(motion, solution))
    np.testing.assert_allclose(motion_residual(exact, solution), 0.0, atol=1e-12)
