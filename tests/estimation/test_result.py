"""An IMU's lasting errors, against the dense problem."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.estimation import hypothesis_of, smooth
from companion.estimation.candidate import Candidate, with_candidate
from companion.estimation.iteration import estimate, start_of
from companion.estimation.model import ACCEL_BIAS, CONSTANT_STATES, CONSTANTS, GYRO_BIAS
from companion.estimation.result import allowing, constant_errors, explained, of_first_half
from companion.estimation.setup import first_guess, set_up
from companion.estimation.system import Problem
from companion.model import STANDARD_GRAVITY, Array
from tests.estimation.sensed import BIASES, sensed, with_imu

MATRICES = np.r_[CONSTANTS["gyro_matrix"][0], CONSTANTS["accel_matrix"][0]]


@pytest.fixture(scope="module")
def linear() -> Problem:
    flight, _ = sensed(16.0, "circle", rate=50.0)
    setup = set_up(flight, None, STANDARD_GRAVITY, None)
    return estimate(setup, start_of(setup, first_guess(setup, flight)))[1]


def dense(one: Problem) -> tuple[Array, int]:
    """The covariance of all states and constants, by inverting all information at once."""
    (count, states), width = one.solution.x.shape, len(one.solution.c)
    information = np.zeros((count * states + width,) * 2)

    def add(jacobian: Array, weight: Array) -> None:
        information[:] += jacobian.T @ weight @ jacobian

    rows = np.zeros((states, len(information)))
    rows[:, :states] = np.eye(states)
    add(rows, np.diag(one.prior.sigma**-2.0))
    rows = np.zeros((width, len(information)))
    rows[:, count * states :] = np.eye(width)
    add(rows, np.diag(one.prior.constants_sigma**-2.0))
    for k in range(count - 1):
        rows = np.zeros((states, len(information)))
        rows[:, k * states : (k + 1) * states] = one.motion.transition[k]
        rows[:, (k + 1) * states : (k + 2) * states] = -np.eye(states)
        rows[:, count * states :] = one.motion.constants[k]
        add(rows, one.motion.weight[k])
    for told in one.measurements:
        for i, k in enumerate(told.keyframe):
            rows = np.zeros((told.residual.shape[1], len(information)))
            rows[:, k * states : (k + 1) * states] = told.states[i]
            rows[:, count * states :] = told.constants[i]
            add(rows, np.diag(told.information[i]))
    scale = np.sqrt(np.diag(information))
    return np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale), count


def test_the_mean_bias_goes_with_the_matrices_as_in_the_dense_problem(linear: Problem) -> None:
    (covariance, count), states = dense(linear), linear.solution.x.shape[1]
    pick = np.zeros((24, len(covariance)))
    for k in range(count):
        own = k * states + np.r_[GYRO_BIAS, ACCEL_BIAS]
        pick[np.arange(6), own] = 1.0 / count
    pick[6 + np.arange(18), count * states + MATRICES] = 1.0
    found = constant_errors(linear.states, linear)
    sigma = np.sqrt(np.diag(found.covariance))
    expected = pick @ covariance @ pick.T
    np.testing.assert_allclose(found.covariance / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-4)
    np.testing.assert_allclose(found.values[:3], linear.states.gyro_bias.mean(axis=0))


def test_wider_scales_are_as_if_they_had_been_believed_in_before(linear: Problem) -> None:
    prior = linear.prior
    sigma = prior.constants_sigma.copy()
    sigma[MATRICES[[0, 4, 8]]], sigma[MATRICES[[9, 13, 17]]] = 0.02, 0.01
    wide = replace(linear, prior=replace(prior, constants_sigma=sigma))
    expected = constant_errors(linear.states.moved(wide.solution.x, wide.solution.c), wide)
    once = constant_errors(linear.states.moved(linear.solution.x, linear.solution.c), linear)
    found = allowing(once, 0.02, 0.01)
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-4, atol=1e-12)
    np.testing.assert_allclose(found.values, expected.values, rtol=1e-4, atol=1e-7)
    np.testing.assert_allclose(found.possible[6:15].reshape(3, 3).diagonal(), 0.02)
    narrower = allowing(once, 1e-4, 1e-4)
    np.testing.assert_allclose(narrower.covariance, once.covariance)


def test_the_first_half_has_not_heard_the_second(linear: Problem) -> None:
    """As the whole chain without what is told after the middle; all of it tells more."""
    middle, found = of_first_half(linear)
    assert middle == pytest.approx(0.5 * (linear.t[0] + linear.t[-1]))
    told = tuple(
        replace(one, weight=np.where(linear.t[one.keyframe] <= middle, one.weight, 1e-12))
        for one in linear.measurements
    )
    deaf = replace(linear, measurements=told)
    whole = constant_errors(linear.states.moved(deaf.solution.x, deaf.solution.c), deaf)
    np.testing.assert_allclose(found.values[6:], whole.values[6:], rtol=1e-3, atol=1e-7)
    np.testing.assert_allclose(found.covariance[6:, 6:], whole.covariance[6:, 6:], rtol=1e-3, atol=1e-10)
    every = constant_errors(linear.states, linear)
    assert (np.diag(every.covariance) <= np.diag(found.covariance) * (1 + 1e-9)).all()


@pytest.mark.parametrize("size", [0.0, 3.0])
def test_a_bias_that_no_part_in_order_has_is_not_held_to_what_parts_in_order_have(size: float) -> None:
    """Else the rest of it would be a lean that the other sensors contradict."""
    flight, _ = sensed(40.0, "square", rate=50.0)
    imu = flight.imu()
    best = smooth(with_imu(flight, replace(imu, accel=imu.accel + np.array([size, 0.0, 0.0]))))
    off = best.states.accel_bias.mean(axis=0) - BIASES[1] - [size, 0.0, 0.0]
    assert (np.abs(off) < 3.0 * best.accel_bias_sigma.max(axis=0)).all()
    assert best.explained == ()
    assert (best.errors.possible[3:6] > 1.0).tolist() == [size > 0.0, False, False]


@pytest.mark.parametrize("axis", [-1, 1])
def test_a_field_that_turns_along_an_arc_is_known_across_its_end(linear: Problem, axis: int) -> None:
    """It is told as what leads straight there, and its σ is of that: after a quarter turn of east it is north's."""
    one = Candidate(hypothesis_of("compass_field"), "creep", 4.0, 10.0, 0.1, axis, 0.0, 0.0)
    problem = with_candidate(linear, one)
    found = problem.solution.c.copy()
    found[CONSTANT_STATES:] = 0.0
    found[-1] = 0.5 * np.pi * problem.states.constant("earth_field")[0] / 6.0

    def told(c: Array) -> tuple[Array, Array, Array]:
        other = replace(problem)
        vars(other)["solution"] = replace(problem.solution, c=c)
        (whole,), covariance = explained(other, [one], [()], ())
        return whole.size, whole.sigma, covariance

    step = 1e-4 * np.eye(len(found))[CONSTANT_STATES:]
    by_size = np.stack([(told(found + by)[0] - told(found - by)[0]) / 2e-4 for by in step], axis=1)
    known = problem.solution.constants_covariance[CONSTANT_STATES:, CONSTANT_STATES:]
    _, sigma, covariance = told(found)
    np.testing.assert_allclose(covariance, by_size @ known @ by_size.T, rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(sigma, np.sqrt(np.diagonal(covariance)))
    if axis == 1:
        assert sigma[0] > 5.0 * sigma[1]
