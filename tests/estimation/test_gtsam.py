"""GTSAM as an oracle of the smoother: the same factors, another solver (Dellaert and Kaess 2017)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from companion.estimation.iteration import start_of
from companion.estimation.learned_noise import FIRST_NOISE
from companion.estimation.linearisation import linearise, preintegrate_imu
from companion.estimation.setup import first_guess, set_up
from companion.estimation.system import Problem
from companion.model import STANDARD_GRAVITY
from tests.estimation.sensed import sensed

gtsam = pytest.importorskip("gtsam", reason="gtsam is not installed: pip install gtsam")
pytestmark = pytest.mark.slow

CONSTANTS = 10**6  # GTSAM's key of the flight's constants


def problem() -> Problem:
    flight, _ = sensed(20.0, "circle", rate=50.0)
    setup = set_up(flight, None, STANDARD_GRAVITY, None)
    states = first_guess(setup, flight)
    path = preintegrate_imu(setup, (np.zeros(3), np.zeros(3)))
    scale = {one.name: 1.0 for one in setup.readings}
    return linearise(setup, path, states, FIRST_NOISE, scale, {}, start_of(setup, states).slow)


def in_gtsam(linear: Problem) -> Any:
    """The factors of a linear problem, each whitened."""
    graph, unit = gtsam.GaussianFactorGraph(), gtsam.noiseModel.Unit.Create
    motion, prior = linear.motion, linear.prior
    for k in range(len(motion.residual)):
        root = np.linalg.cholesky(motion.weight[k]).T
        graph.add(gtsam.JacobianFactor(
            k, -root @ motion.transition[k], k + 1, root, CONSTANTS, -root @ motion.constants[k],
            root @ motion.residual[k], unit(len(root)),
        ))  # fmt: skip
    for one in linear.measurements:
        for m, k in enumerate(one.keyframe):
            root = np.sqrt(one.information[m])[:, None]
            graph.add(gtsam.JacobianFactor(
                int(k), root * one.states[m], CONSTANTS, root * one.constants[m], root[:, 0] * one.residual[m],
                unit(len(root)),
            ))  # fmt: skip
    for key, residual, sigma in (
        (0, prior.residual, prior.sigma), (CONSTANTS, prior.constants_residual, prior.constants_sigma),
    ):  # fmt: skip
        graph.add(gtsam.JacobianFactor(key, np.diag(1.0 / sigma), residual / sigma, unit(len(sigma))))
    return graph


def test_states_and_covariances_are_those_of_gtsam() -> None:
    linear = problem()
    graph = in_gtsam(linear)
    solved = graph.optimize()
    covariance = linear.solution.covariances()
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    theirs = np.array([solved.at(k) for k in range(len(linear.solution.x))])
    assert np.abs((theirs - linear.solution.x) / sigma).max() < 0.01
    constants_sigma = np.sqrt(np.diag(linear.solution.constants_covariance))
    assert np.abs((solved.at(CONSTANTS) - linear.solution.c) / constants_sigma).max() < 0.01

    values = gtsam.Values()
    for k in range(len(linear.solution.x)):
        values.insert(k, np.zeros(linear.solution.x.shape[1]))
    values.insert(CONSTANTS, np.zeros(len(linear.solution.c)))
    marginals = gtsam.Marginals(graph, values)
    for k in (0, len(covariance) // 2, len(covariance) - 1):
        root = np.sqrt(np.diag(marginals.marginalCovariance(k)))
        np.testing.assert_allclose(sigma[k], root, rtol=0.01)
    np.testing.assert_allclose(constants_sigma, np.sqrt(np.diag(marginals.marginalCovariance(CONSTANTS))), rtol=0.01)
