"""What faults would be called: laws of the data sets that are drawn, and of the sizes that follow from them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from companion.constants.priors import ACCUSED
from companion.estimation import HYPOTHESES, hypothesis_of, identifiability
from companion.estimation.candidate import Candidate
from companion.estimation.evidence import probabilities
from companion.estimation.identifiability import Experiment, Fault, confusion_matrix, injected, noise, solved
from companion.estimation.iteration import estimate, start_of
from companion.estimation.scan import score
from companion.estimation.search import trials
from companion.estimation.setup import first_guess, set_up
from companion.estimation.system import Prior, Problem
from companion.model import STANDARD_GRAVITY
from tests.estimation.sensed import sensed

pytestmark = pytest.mark.slow

NAMED = tuple(hypothesis_of(name) for name in ("gyro_bias", "gps_position"))
SIDES = {"nobody", "perhaps harmless", "cannot tell", *(kind.name for kind in HYPOTHESES)}


@pytest.fixture(scope="module")
def linear() -> Problem:
    """The linear problem of a healthy flight, where its estimate settles."""
    flight, _ = sensed(60.0, "circle", rate=50.0)
    setup = set_up(flight, None, STANDARD_GRAVITY, None)
    return estimate(setup, start_of(setup, first_guess(setup, flight)))[1]


@pytest.fixture(scope="module")
def experiment(linear: Problem) -> Experiment:
    return Experiment.of(linear, 20, seed=1)


def faults(linear: Problem) -> tuple[Fault, ...]:
    heard = tuple(replace(one, t=linear.t[one.keyframe]) for one in linear.measurements)
    return injected(replace(linear, measurements=heard))[0]


def test_every_kind_is_injected_or_said_not_to_show(linear: Problem, experiment: Experiment) -> None:
    possible = {kind.name for kind in HYPOTHESES if not kind.nuisance and kind.of(linear) is not None}
    assert {fault.hypothesis.name for fault in experiment.faults} | set(experiment.not_shown) == possible


@pytest.mark.parametrize("kind", ["gyro_bias", "accel_scale", "gps_position", "gps_motion", "compass_field"])
def test_the_score_of_a_fault_alone_is_its_information_times_its_size(linear: Problem, kind: str) -> None:
    """An analytic truth: b = Sᵀ W S u, and the size that it leads to is u, at each of its times."""
    (fault,) = (one for one in faults(linear) if one.hypothesis.name == kind)
    problem = solved(linear, [fault.alone(linear)])
    found = score(problem, fault.hypothesis, fault.shape, fault.onset, fault.end)
    assert found is not None
    b, v = found
    for i in range(len(fault.onset)):
        expected = v[i] @ fault.direction
        np.testing.assert_allclose(b[i, :, i], expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())


def test_noise_alone_scatters_every_score_by_its_information(linear: Problem) -> None:
    """A law: b ~ N(0, V). Of 500 data sets, the mean square is right to three of its standard errors in most cases."""
    problem = solved(linear, [noise(linear, np.random.default_rng(3), 500)])
    ratios = []
    for kind in HYPOTHESES:
        for shape in kind.shapes:
            found = score(problem, kind, shape, np.array([25.3]), np.array([38.1]))
            assert found is not None
            own = np.diagonal(found[1][0])
            ratios += ((found[0][0] ** 2).mean(axis=1)[own > 0] / own[own > 0]).tolist()
    assert np.abs(np.array(ratios) - 1.0).max() < 0.3
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.05)


def test_an_undetected_fault_moves_the_estimate_as_it_does_when_the_readings_are_wrong(
    linear: Problem, experiment: Experiment
) -> None:
    """The external reliability against an oracle: the problem with the fault in its readings, solved anew."""
    (fault,) = (one for one in experiment.faults if one.hypothesis.name == "gps_position")
    moved = experiment.moved[experiment.faults.index(fault)]
    alone, prior = fault.alone(experiment.problem), linear.prior
    motion = replace(linear.motion, residual=alone.motion.residual[..., 0])
    read = tuple(
        replace(m, residual=own.residual[..., 0])
        for m, own in zip(linear.measurements, alone.measurements, strict=True)
    )
    nothing = Prior(
        np.zeros_like(prior.sigma), prior.sigma, np.zeros_like(prior.constants_sigma), prior.constants_sigma
    )
    anew = replace(linear, motion=motion, measurements=read, prior=nothing).solution
    position = np.linalg.norm(anew.x[:, 6:9], axis=1).max()
    assert 0.8 * moved[3] < position <= moved[3] * (1.0 + 1e-9)  # the largest of five times
    assert 1.0 < moved[3] < 1.5  # nothing but GPS tells of a position; its motion carries the error on past the ends


def test_what_is_identifiable_is_detectable_and_told_in_95_of_100_fresh_draws(linear: Problem) -> None:
    matrix = confusion_matrix(linear, draws=200, hypotheses=NAMED)
    assert [row.kind for row in matrix.rows] == [kind.name for kind in NAMED]
    fresh = Experiment.of(linear, 200, seed=1, hypotheses=NAMED)
    for i, row in enumerate(matrix.rows):
        assert set(row.called) <= SIDES
        assert sum(row.called.values()) == pytest.approx(1.0)
        if row.identifiable is None:
            continue
        assert row.identifiable >= row.detectable >= hypothesis_of(row.kind).harmful(row.shape)
        told = fresh.judged(i, row.identifiable).accused
        assert 0.92 <= told <= (1.0 if row.identifiable == row.detectable else 0.985), row


@pytest.mark.parametrize(("told_from", "found"), [(0.55, True), (1.0, False)])
def test_no_fault_is_identifiable_that_no_sensor_has(told_from: float, found: bool) -> None:
    """A gyro's scale of 100 %, where one of 60 % is the largest that there is."""
    nothing = np.zeros(0)
    fault: Any = Fault(hypothesis_of("gyro_scale"), "step", 0.0, nothing, nothing, np.eye(3)[0], 0.5)
    experiment: Any = SimpleNamespace(
        faults=(fault,), cells=(), judged=lambda _, size, __: SimpleNamespace(accused=float(size >= told_from))
    )
    near: Any = SimpleNamespace(accused=0.5, counts=())
    least = identifiability._identifiable(experiment, 0, near)
    assert (least is not None) is found
    assert least is None or least == pytest.approx(told_from, rel=0.02)


def test_the_same_flight_has_the_same_matrix(linear: Problem) -> None:
    one, other = (confusion_matrix(linear, draws=10, hypotheses=NAMED) for _ in range(2))
    assert one == other


def test_the_draws_are_judged_as_the_search_would_judge_them(experiment: Experiment, linear: Problem) -> None:
    """An oracle: the search with all its refinement, on one data set, accuses as the matrix has it."""
    problem = experiment.problem
    (fault,) = (one for one in faults(linear) if one.hypothesis.name == "gyro_bias")
    drawn, alone = noise(problem, np.random.default_rng(9), 1), fault.alone(problem)
    motion = drawn.motion.residual[..., 0] + 0.8 * fault.size * alone.motion.residual[..., 0]
    read = tuple(
        replace(one, residual=own.residual[..., 0] + 0.8 * fault.size * other.residual[..., 0])
        for one, own, other in zip(problem.measurements, drawn.measurements, alone.measurements, strict=True)
    )
    prior = linear.prior
    believed = replace(
        prior,
        residual=drawn.prior.residual[:, 0],
        constants_residual=drawn.prior.constants_residual[:, 0],
    )
    moved = replace(problem, motion=replace(problem.motion, residual=motion), measurements=read, prior=believed)
    searched = probabilities([Candidate.of_trial(one).rival for one in trials(moved)])
    mine = Experiment.of(problem, 1, seed=9)
    told = mine.judged([one.hypothesis.name for one in mine.faults].index("gyro_bias"), 0.8 * fault.size).accused
    assert (searched["imu"] >= ACCUSED) == bool(told)
