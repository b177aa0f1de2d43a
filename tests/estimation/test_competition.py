"""What would have been called."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from companion.estimation import competition, kind_of
from companion.estimation.choice import WORTH, Choice, comes_and_goes, cost, gain_beside, price, unrest
from companion.estimation.competition import choose, detectable, rivals
from companion.estimation.iteration import estimate, start_of
from companion.estimation.learned_noise import believing, noise_limits, scatter
from companion.estimation.model import VELOCITY
from companion.estimation.setup import first_guess, set_up
from companion.estimation.smoother import Tried, best_of
from companion.estimation.weighing import candidate
from companion.model import STANDARD_GRAVITY, Flight
from tests.estimation.sensed import sensed, with_imu
from tests.flights import moved_north


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
    paid = 6.0 * np.log(prior / sigma) + price(choice.kind, "step")
    assert cost(choice, problem, solution, beside) == pytest.approx(paid)


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


def chosen(kind: str, gain: float, *others: tuple[str, str, float]) -> Choice:
    return Choice(kind_of(kind), kind_of(kind).shapes[0], 15.1, np.inf, 0.1, -1, gain, others)


@pytest.mark.parametrize(
    ("rival", "tried"),
    [
        (("compass_turn", 95.0), ["accel_bias", "compass_turn"]),
        (("compass_turn", 85.0), ["accel_bias"]),
        (("gyro_bias", 99.0), ["accel_bias"]),
        (("gps_latency", 50.0), ["accel_bias", "gps_latency"]),
        (("gps_latency", 95.0), ["accel_bias", "gps_latency"]),
    ],
)
def test_whom_the_first_order_does_not_tell_apart_is_tried(
    rival: tuple[str, float], tried: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another side, or what is linear in small sizes alone; of the same side it accuses nobody else."""
    monkeypatch.setattr(competition, "rivals", lambda *_: (chosen("accel_bias", 100.0), chosen(*rival)))
    problem: Any = None
    solution: Any = None
    assert [one.kind.name for one in choose(problem, solution)] == tried


def best(flight: Flight, ranked: tuple[str, str], apart: float) -> Tried:
    """That of two, of which the first explains so much more at first order."""
    setup = set_up(flight, None, STANDARD_GRAVITY, None)
    (first, more), (second, less) = zip(ranked, (500.0, 500.0 - apart), strict=True)
    shapes = {kind: kind_of(kind).shapes[0] for kind in ranked}
    choices = chosen(first, more, (second, shapes[second], less)), chosen(second, less, (first, shapes[first], more))
    found = best_of(setup, start_of(setup, first_guess(setup, flight)), [], choices)
    assert found is not None
    return found


@pytest.mark.parametrize("ranked", [("accel_bias", "compass_turn"), ("compass_turn", "accel_bias")])
def test_the_whole_estimate_decides_between_two_sides(ranked: tuple[str, str]) -> None:
    """An error that is learned as noise hardly differs at first order from what another witness may have done."""
    flight, _ = sensed(30.0, rate=50.0)
    imu = flight.imu()
    off = np.where(imu.t > 15.1, 2.0, 0.0)[:, None] * [1.0, 0.0, 0.0]
    found = best(with_imu(flight, replace(imu, accel=imu.accel + off)), ranked, 10.0)
    assert found.choice.kind.name == "accel_bias"
    assert found.choice.gain > 500.0
    ((kind, _, gain),) = found.choice.others
    assert kind == "compass_turn"
    assert gain < found.choice.gain - 300.0


@pytest.mark.parametrize("ranked", [("gps_motion", "accel_shock"), ("accel_shock", "gps_motion")])
def test_between_what_explains_the_same_the_first_order_decides(ranked: tuple[str, str]) -> None:
    """A GPS that begins to move, and a push that nobody felt: of whole estimates the noise differs by chance."""
    flight, _ = sensed(30.0, rate=50.0)
    (gps,) = flight.gps
    moved = moved_north(gps, 2.0 * np.maximum(gps.t - 15.1, 0.0))
    told = replace(moved, velocity=gps.velocity + 2.0 * (gps.t > 15.1)[:, None] * [1.0, 0.0, 0.0])
    found = best(replace(flight, gps=(told,)), ranked, 10.0)
    assert found.choice.kind.name == ranked[0]
    ((kind, _, gain),) = found.choice.others
    assert kind == ranked[1]
    assert gain == pytest.approx(0.98 * found.choice.gain), "as at first order"
