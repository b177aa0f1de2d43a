"""What would have been called."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from companion.estimation import kind_of
from companion.estimation.choice import WORTH, comes_and_goes, gain_beside, price, unrest
from companion.estimation.competition import detectable, rivals
from companion.estimation.iteration import estimate, start_of
from companion.estimation.learned_noise import believing, noise_limits, scatter
from companion.estimation.model import VELOCITY
from companion.estimation.setup import first_guess, set_up
from companion.estimation.weighing import candidate
from companion.model import STANDARD_GRAVITY
from tests.estimation.sensed import sensed, with_imu


@pytest.mark.parametrize("known", [(4e5, 4e5, 4e5), (3e6, 2e5, 5e5), (2e5, 9e5, 3e6)])
def test_a_step_of_the_size_that_is_told_is_called_on_any_axis(known: tuple[float, float, float]) -> None:
    """known: information of each axis, (rad/s)⁻²; an axis that is known worse than another decides."""
    kind, t = kind_of("gyro_bias"), np.arange(21.0)
    information = np.tile(np.diag(known), (20, 1, 1))
    disturbances = np.zeros((20, 15)), np.zeros((20, 15, 15))
    disturbances[1][:, 9:12, 9:12] = information
    problem: Any = SimpleNamespace(t=t, witness=lambda _: None, told_often=lambda _: None)
    solution: Any = SimpleNamespace(disturbances=disturbances)
    size = detectable(problem, solution)["gyro_bias"]
    gains = []
    for step in size * np.eye(3):
        found = candidate(kind, "step", problem, (t[1:], np.full(20, np.inf)), information @ step, information)
        gains.append(found.gain.max() - price(kind, "step"))
    assert min(gains) == pytest.approx(WORTH, rel=0.02)


@pytest.mark.parametrize("imu", ["gyro_bias", "accel_bias"])
def test_an_imu_that_errs_for_a_while_is_far_more_seldom_than_a_field_flown_past(imu: str) -> None:
    odds = price(kind_of(imu), "pulse") - price(kind_of("compass_field"), "creep")
    assert odds > 2.0 * np.log(100.0)
    assert price(kind_of(imu), "step") < price(kind_of("compass_field"), "creep"), "what stays is no rarer"


def test_what_a_choice_gains_is_read_at_its_own_unknowns() -> None:
    """Of three that were accepted, with 2, 3 and 1 unknowns, the second."""
    problem: Any = None
    choice: Any = SimpleNamespace(
        of=lambda _: SimpleNamespace(unknowns=3), taken=0.0, kind=kind_of("gyro_bias"), shape="step"
    )
    c, sigma, prior = np.array([9.0, 9.0, 0.02, 0.0, -0.01, 9.0]), 1e-3, 0.03
    solution: Any = SimpleNamespace(c=c, constants_covariance=np.diag(np.full(6, sigma**2)))
    beside: Any = SimpleNamespace(constants_sigma=np.full(6, prior))
    expected = (0.02**2 + 0.01**2) / sigma**2 - 6.0 * np.log(prior / sigma) - price(choice.kind, "step")
    assert gain_beside(choice, problem, solution, beside, after=1) == pytest.approx(expected)


@pytest.mark.parametrize("rough", [True, False])
def test_a_fault_that_has_only_begun_is_weighed_at_the_noise_in_which_it_lies(rough: bool) -> None:
    """A step half a second before the end explains what scatters since; that a launch shakes shows just before it."""
    t = np.arange(0.0, 10.01, 0.2)
    e, d = np.ones((50, 15)), np.tile(np.eye(15), (50, 1, 1))
    e[(t[1:] > 8.0) & (t[1:] < 9.5), VELOCITY] = 6.0 if rough else 1.0
    problem: Any = SimpleNamespace(t=t)
    solution: Any = SimpleNamespace(disturbances=(e, d))
    choice: Any = SimpleNamespace(kind=kind_of("accel_bias"), onset=9.5, end=np.inf)
    more = unrest(choice, problem, solution)
    assert more > 3.0 if rough else more == pytest.approx(1.0)


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_an_imu_that_errs_for_a_moment_has_no_bias_that_comes_and_goes(sensor: str) -> None:
    """For 1.5 s of half a minute: it is a shock, which accuses nobody, or something that lasts for 5 s and more."""
    flight, _ = sensed(30.0, "circle", rate=50.0)
    imu = flight.imu()
    readings = getattr(imu, sensor).copy()
    middle = imu.t[0] + 15.0
    readings[(imu.t > middle) & (imu.t < middle + 1.5)] += {"gyro": 0.03, "accel": 0.5}[sensor]
    flight = with_imu(flight, replace(imu, **{sensor: readings}))
    setup = set_up(flight, None, STANDARD_GRAVITY, None, ())
    limits = believing(noise_limits(setup), scatter(setup))
    _, linear = estimate(setup, start_of(setup, first_guess(setup, flight)), limits=limits, white=True)
    promising = rivals(linear.problem, linear.solution)
    assert promising[0].gain > 30.0
    assert all(one.end - one.onset >= 5.0 for one in promising if comes_and_goes(one.kind, one.shape))
