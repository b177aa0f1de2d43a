"""Steps of Gauss-Newton: they lead downhill, as far as they say near their beginning, and further in no case."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from companion.constants import num
from companion.estimation import iteration
from companion.estimation.candidate import Candidate
from companion.estimation.hypotheses import hypothesis_of
from companion.estimation.iteration import Point, Step, estimate, in_noise, likelihood, preintegrated, start_of
from companion.estimation.learned_noise import FIRST_NOISE
from companion.estimation.linearisation import Linear, PreintegratedImu, linearise, preintegrate_imu
from companion.estimation.setup import Setup, first_guess, set_up
from companion.model import STANDARD_GRAVITY, Array
from companion.strapdown import quaternion
from tests.estimation.sensed import sensed, with_imu

NOTHING = np.zeros(0)


@cache
def contradicted(yaw_rate: float) -> tuple[Point, Callable[[Point], Linear]]:
    """Where to begin, and the problem of a flight whose IMU contradicts all others from its middle on.

    yaw_rate: rad/s that its gyro reads too much. The noise is one in which all are believed.
    """
    flight, _ = sensed(40.0, "square", rate=50.0)
    imu = flight.imu()
    late = (imu.t > 20.0)[:, None]
    accel, gyro = imu.accel + late * [1.5, -1.0, 0.5], imu.gyro + late * [0.0, 0.0, yaw_rate]
    wrong = with_imu(flight, replace(imu, accel=accel, gyro=gyro))
    setup = set_up(wrong, None, STANDARD_GRAVITY, None)
    noise = replace(FIRST_NOISE, gyro_noise=5e-4, accel_noise=5e-3)
    scale = {one.name: 1.0 for one in setup.readings}
    guess = first_guess(setup, flight)
    path, slow = preintegrated(setup, guess, None), start_of(setup, guess).slow

    def about(point: Point) -> Linear:
        return linearise(setup, path, point.states, noise, scale, {}, slow, sizes=point.sizes)

    return Point(guess, NOTHING), about


def test_no_step_leads_uphill() -> None:
    point, about = contradicted(0.2)
    linear, shortened = about(point), 0
    for _ in range(8):
        step = Step.of(linear, point.sizes)
        point, linear, uphill = step.taken(about)
        assert not uphill
        shortened += not np.array_equal(point.states.position, step.at(1.0).states.position)
        assert step.misfit_at(point, linear) < step.misfit + num.CONVERGED_MISFIT
    assert shortened, "the problem is too easy to show anything"


def test_the_misfit_falls_at_first_as_the_step_says() -> None:
    """Its slope along a step is minus twice the gain of a linear problem: else a derivative is wrong."""
    point, about = contradicted(0.02)
    for _ in range(2):
        point, _, _ = Step.of(about(point), point.sizes).taken(about)
    step = Step.of(about(point), point.sizes)
    share = 1e-4
    there, back = (step.misfit_at(at, about(at)) for at in (step.at(share), step.at(-share)))
    assert (there - back) / (2.0 * share) == pytest.approx(-2.0 * step.gain, rel=1e-3)


def test_a_step_that_leads_down_is_taken_whole() -> None:
    flight, _ = sensed(20.0, "circle", rate=50.0)
    setup = set_up(flight, None, STANDARD_GRAVITY, None)
    scale, slow = {one.name: 3.0 for one in setup.readings}, start_of(setup, first_guess(setup, flight)).slow

    def about(point: Point) -> Linear:
        return linearise(setup, preintegrated(setup, point.states, None), point.states, FIRST_NOISE, scale, {}, slow)

    step = Step.of(about(Point(first_guess(setup, flight), NOTHING)), NOTHING)
    point, _, uphill = step.taken(about)
    assert not uphill
    np.testing.assert_array_equal(point.states.velocity, step.at(1.0).states.velocity)


def test_the_misfits_along_a_step_are_of_one_pass_over_the_imu(monkeypatch: pytest.MonkeyPatch) -> None:
    """Carried anew with another bias the IMU says something else: what a step has gained could not be told."""
    flight, _ = sensed(20.0, "circle", rate=50.0)
    imu = flight.imu()
    setup = set_up(with_imu(flight, replace(imu, gyro=imu.gyro + 0.05)), None, STANDARD_GRAVITY, None)
    passes, steps = list[PreintegratedImu](), list[slice]()
    taken = Step.taken

    def linearised(*args: Any, **named: Any) -> Linear:
        passes.append(args[1])
        return linearise(*args, **named)

    def noted(step: Step, about: Callable[[Point], Linear]) -> tuple[Point, Linear, bool]:
        begin = len(passes) - 1  # where the problem was made linear about its beginning
        there = taken(step, about)
        steps.append(slice(begin, len(passes)))
        return there

    monkeypatch.setattr(iteration, "linearise", linearised)
    monkeypatch.setattr(Step, "taken", noted)
    estimate(setup, start_of(setup, first_guess(setup, flight)))
    assert all(len(set(map(id, passes[step]))) == 1 for step in steps)
    assert len(set(map(id, passes))) > 1, "it was never carried anew"


@pytest.mark.parametrize(("bias", "polished", "anew"), [(0.01, False, 0), (0.01, True, 1), (0.04, False, 1)])
def test_the_imu_is_carried_anew_for_a_far_bias_and_at_last_for_any(
    bias: float, polished: bool, anew: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While the noise is learned the first order of 10 mrad/s is near enough; for the path it is not."""
    flight, _ = sensed(20.0, "circle", rate=50.0, biases=(np.array([bias, 0.0, 0.0]), np.zeros(3)))
    setup = set_up(flight, None, STANDARD_GRAVITY, None)
    passes = list[tuple[Array, Array]]()

    def noted(setup: Setup, bias: tuple[Array, Array]) -> PreintegratedImu:
        passes.append(bias)
        return preintegrate_imu(setup, bias)

    monkeypatch.setattr(iteration, "preintegrate_imu", noted)
    settled, _ = estimate(setup, start_of(setup, first_guess(setup, flight)), polished=polished)
    assert len(passes) >= 1 + anew if anew else len(passes) == 1
    off = np.median(settled.states.gyro_bias, axis=0) - passes[-1][0]
    assert np.abs(off).max() < (4e-3 if polished else 0.02)


def test_where_no_step_leads_down_the_iteration_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """A compass that turns by 60° is no small error: the steps lead off the circle, and lower than there is nowhere."""
    flight, _ = sensed(40.0, "square", rate=25.0, fixes_hz=5.0)
    (compass,) = flight.compasses
    begin, end = 20.1, 28.0
    turned = quaternion.rotate(quaternion.exp(np.array([0.0, 0.0, np.radians(60.0)])), compass.field)
    field = np.where(((compass.t > begin) & (compass.t < end))[:, None], turned, compass.field)
    setup = set_up(replace(flight, compasses=(replace(compass, field=field),)), None, STANDARD_GRAVITY, None)
    choice = Candidate(hypothesis_of("compass_turn"), "pulse", begin, end, 0.1, -1, 0.0, 0.0)
    passes, uphill = list[Step](), list[bool]()
    taken = Step.taken

    def noted(step: Step, about: Callable[[Point], Linear]) -> tuple[Point, Linear, bool]:
        there = taken(step, about)
        passes.append(step)
        uphill.append(there[2])
        return there

    start = start_of(setup, first_guess(setup, flight))
    settled, _ = estimate(setup, start)
    monkeypatch.setattr(Step, "taken", noted)
    estimate(setup, replace(settled, states=start.states), [choice])
    assert any(uphill), "the problem is too easy to show anything"
    assert len(passes) < 15


def test_what_is_likelier_by_noise_alone_is_a_factor_of_noise() -> None:
    """Both sensors at half the noise, and the other aiding sensors as they were."""
    linear: Any = SimpleNamespace(variance=np.ones((10, 15)), measurements=())

    def made_likely(part: float) -> float:
        noise = replace(FIRST_NOISE, gyro_noise=2e-3 * part, accel_noise=5e-2 * part)
        settled: Any = SimpleNamespace(noise=noise, scale={})
        return likelihood(settled, linear)

    more = made_likely(0.5) - made_likely(1.0)
    assert more == pytest.approx(2.0 * 10 * 2 * 3 * np.log(2.0)), "of ten intervals, two sensors, three axes"
    assert in_noise(more, 10) == pytest.approx(2.0)
