"""Steps of Gauss-Newton lead downhill, as far as they say near their beginning; late readings go where they belong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from companion.constants import healthy, num
from companion.constants.priors import ACCUSED
from companion.estimation import hypothesis_of, iteration, probabilities, smooth
from companion.estimation.candidate import Candidate
from companion.estimation.iteration import (
    Point,
    Step,
    estimate,
    in_noise,
    likelihood,
    preintegrated,
    start_of,
    time_shifted,
)
from companion.estimation.learned_noise import FIRST_NOISE
from companion.estimation.linearisation import PreintegratedImu, linearise, preintegrate_imu
from companion.estimation.readings import Readings
from companion.estimation.search import trials
from companion.estimation.setup import Setup, first_guess, set_up
from companion.estimation.system import Problem
from companion.model import STANDARD_GRAVITY, Array, Flight
from companion.strapdown import Motion, motions, quaternion
from tests.estimation.sensed import LATENCY, PATHS, errors, gps_of, sensed, with_imu

NOTHING = np.zeros(0)


@cache
def contradicted(yaw_rate: float) -> tuple[Point, Callable[[Point], Problem]]:
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

    def about(point: Point) -> Problem:
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

    def about(point: Point) -> Problem:
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

    def linearised(*args: Any, **named: Any) -> Problem:
        passes.append(args[1])
        return linearise(*args, **named)

    def noted(step: Step, about: Callable[[Point], Problem]) -> tuple[Point, Problem, bool]:
        begin = len(passes) - 1  # where the problem was made linear about its beginning
        there = taken(step, about)
        steps.append(slice(begin, len(passes)))
        return there

    monkeypatch.setattr(iteration, "linearise", linearised)
    monkeypatch.setattr(Step, "taken", noted)
    estimate(setup, start_of(setup, first_guess(setup, flight)))
    assert all(len(set(map(id, passes[step]))) == 1 for step in steps)
    assert len(set(map(id, passes))) > 1, "it was never carried anew"


@pytest.mark.parametrize(("bias", "polish", "anew"), [(0.01, np.inf, 0), (0.01, 1e-3, 1), (0.04, np.inf, 1)])
def test_the_imu_is_carried_anew_for_a_far_bias_and_at_last_for_any(
    bias: float, polish: float, anew: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While the noise is learned the first order of 10 mrad/s is near enough; for the path it is not."""
    flight, _ = sensed(20.0, "circle", rate=50.0, biases=(np.array([bias, 0.0, 0.0]), np.zeros(3)))
    setup = set_up(flight, None, STANDARD_GRAVITY, None)
    passes = list[tuple[Array, Array]]()

    def noted(setup: Setup, bias: tuple[Array, Array]) -> PreintegratedImu:
        passes.append(bias)
        return preintegrate_imu(setup, bias)

    monkeypatch.setattr(iteration, "preintegrate_imu", noted)
    settled, _ = estimate(setup, start_of(setup, first_guess(setup, flight)), polish=polish)
    assert len(passes) >= 1 + anew if anew else len(passes) == 1
    off = np.median(settled.states.gyro_bias, axis=0) - passes[-1][0]
    assert np.abs(off).max() < (4e-3 if np.isfinite(polish) else 0.02)


def test_where_no_step_leads_down_the_iteration_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """A turn by 60° along a line leads off the circle, and lower than there is nowhere."""
    flight, _ = sensed(40.0, "square", rate=25.0, fixes_hz=5.0)
    (compass,) = flight.compasses
    begin, end = 20.1, 28.0
    turned = quaternion.rotate(quaternion.exp(np.array([0.0, 0.0, np.radians(60.0)])), compass.field)
    field = np.where(((compass.t > begin) & (compass.t < end))[:, None], turned, compass.field)
    setup = set_up(replace(flight, compasses=(replace(compass, field=field),)), None, STANDARD_GRAVITY, None)
    along_a_line = replace(hypothesis_of("compass_turn"), turns_compass=False)
    choice = Candidate(along_a_line, "pulse", begin, end, 0.1, -1, 0.0, 0.0)
    passes, uphill = list[Step](), list[bool]()
    taken = Step.taken

    def noted(step: Step, about: Callable[[Point], Problem]) -> tuple[Point, Problem, bool]:
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


def test_a_step_along_a_curved_valley_is_corrected_before_it_is_shortened(monkeypatch: pytest.MonkeyPatch) -> None:
    """A scale turns with the attitudes that change with it: whole steps lead uphill, and shortened ones creep."""
    monkeypatch.setitem(PATHS, "turning", partial(motions.circle, radius=0.3, speed=0.6))
    flight, _ = sensed(60.0, "turning", seed=1, noise=(5e-5, 5e-3))
    imu = flight.imu()
    scaled = with_imu(
        flight, replace(imu, gyro=np.where((imu.t > 30.0)[:, None], imu.gyro * [1.0, 1.0, 1.1], imu.gyro))
    )
    setup = set_up(scaled, None, STANDARD_GRAVITY, None)
    settled, _ = estimate(setup, start_of(setup, first_guess(setup, scaled)))
    choice = Candidate(hypothesis_of("gyro_scale"), "step", 30.0, np.inf, 0.1, -1, 0.0, 0.0)
    settled, linear = estimate(setup, replace(settled, near=True), [choice], passes=num.TRIAL_PASSES)
    assert settled.gain < num.LEARNING_MISFIT  # it was thousands
    assert linear.solution.c[-1] == pytest.approx(0.1, abs=0.001)


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


ONSET = 20.0


def late_by(flight: Flight, truth: Motion, seconds: float) -> Flight:
    """The fixes from the onset on are so much older."""
    (gps,) = flight.gps
    older = gps_of(truth, np.random.default_rng(8), latency=LATENCY + seconds, rate=2.5)
    after = gps.t >= ONSET
    columns = {
        name: np.where(
            after[:, None] if getattr(gps, name).ndim > 1 else after, getattr(older, name), getattr(gps, name)
        )
        for name in ("latitude", "longitude", "height", "velocity")
    }
    return replace(flight, gps=(replace(gps, **columns),))


@pytest.mark.parametrize("seconds", [0.4, 1.0])
@pytest.mark.slow
def test_fixes_that_come_late_are_put_where_the_vehicle_was(seconds: float) -> None:
    flight, truth = sensed(45.0, seed=3)
    found = smooth(late_by(flight, truth, seconds))
    (late,) = found.explained
    assert (late.kind, late.shape) == ("gps_latency", "step")
    assert late.size[0] == pytest.approx(seconds, abs=max(4.0 * float(late.sigma[0]), 0.02))
    own = next(one for one in late.rivals if (one.kind, one.shape) == (late.kind, late.shape))
    of_size = 0.5 * (late.size[0] / late.sigma[0]) ** 2
    assert own.log_odds > 0.5 * of_size  # of all of it, not of what the last pass left
    row, hours = hypothesis_of("gps_latency"), (found.t[-1] - found.t[0]) / num.HOUR_S
    assert own.log_odds < of_size - np.log(row.prior / late.sigma[0]) + np.log(row.rate_of("step") * hours)
    assert late.onset == pytest.approx(ONSET, abs=max(3.0 * late.onset_sigma, 0.5))
    assert np.linalg.norm(errors(found, truth)[:, 6:8], axis=1).max() < 1.0  # at 1 s and 6 m/s it was 6 m


@pytest.mark.slow
def test_no_fix_tells_of_what_has_not_happened_yet() -> None:
    """What looks like fixes from the future, as slow errors of a velocity do, is not the time."""
    flight, truth = sensed(45.0, seed=3)
    found = smooth(late_by(flight, truth, -0.6))
    assert "gps_latency" not in {one.kind for one in found.explained}
    rivals = [*found.further, *(rival for one in found.explained for rival in one.rivals)]
    assert "gps_latency" not in {one.kind for one in rivals}, "what cannot be is nobody's rival"


def test_a_late_reading_goes_to_the_keyframe_that_it_speaks_of() -> None:
    t = 0.2 * np.arange(20.0)
    arrived = t + healthy.GPS_LATENCY_S
    one = Readings(
        "gps_position", arrived, np.arange(20), np.column_stack([t, -t]), np.ones((20, 2)), np.zeros(20, np.intp),
        latency_s=healthy.GPS_LATENCY_S,
    )  # fmt: skip
    late = one.later(np.where(arrived >= 2.0, 0.6, 0.0), t)
    assert (np.diff(late.keyframe) > 0).all()  # each once
    np.testing.assert_allclose(late.t - late.late - healthy.GPS_LATENCY_S, t[late.keyframe])
    np.testing.assert_allclose(late.value[:, 0], late.t - healthy.GPS_LATENCY_S)  # what was read goes with it
    back = late.later(np.where(late.t >= 2.0, -0.6, 0.0), t)
    np.testing.assert_allclose(back.t - healthy.GPS_LATENCY_S, t[back.keyframe])
    assert back.late == pytest.approx(0.0)
    assert len(one.later(np.full(20, 1.0), t).t) == 15  # what speaks of the time before the first is left out


@pytest.mark.parametrize("faulty", ["gps_latency", "accel_scale"])
@pytest.mark.slow
def test_the_whole_estimate_decides_between_what_is_linear_and_what_is_not(faulty: str) -> None:
    """At first order an accelerometer that reads too little may explain more of a late GPS than its latency does."""
    flight, truth = sensed(45.0, seed=3)
    if faulty == "gps_latency":
        flight = late_by(flight, truth, 1.0)
    else:
        imu = flight.imu()
        flight = with_imu(flight, replace(imu, accel=imu.accel * np.where(imu.t >= ONSET, 0.9, 1.0)[:, None]))
    found = smooth(flight).explained
    assert found[0].kind == faulty
    if faulty == "gps_latency":
        assert found[0].size[0] == pytest.approx(1.0, abs=0.05)
    assert probabilities(found[0].rivals)[hypothesis_of(faulty).device] > ACCUSED


@pytest.mark.slow
def test_what_is_told_to_be_late_is_asked_again_until_little_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    made = list[int]()

    def counted(*args: Any, **options: Any) -> Problem:
        made.append(1)
        return linearise(*args, **options)

    monkeypatch.setattr(iteration, "linearise", counted)
    flight, truth = sensed(45.0, seed=3)
    setup = set_up(late_by(flight, truth, 1.0), None, STANDARD_GRAVITY, None)
    start = start_of(setup, first_guess(setup, flight))
    row = hypothesis_of("gps_latency")
    possible = time_shifted(setup, start, [], Candidate(row, "step", ONSET, np.inf, 0.1, -1, 300.0, 1.0, taken=0.7))
    assert possible is not None
    moved, found = possible.setup, possible.candidate
    assert found.taken == pytest.approx(1.0, abs=0.05)
    assert next(one for one in moved.readings if one.name == "barometer").late == 0.0
    assert possible.settled.linearisations == len(made), "of all estimates on the way"


@pytest.mark.parametrize("seconds", [0.5, 1.0, 1.7])
@pytest.mark.slow
def test_by_how_much_fixes_are_late_shows_at_first_sight(seconds: float) -> None:
    """Where an estimate that knows nothing of it follows the IMU, as it is in order."""
    flight, truth = sensed(45.0, seed=3)
    setup = set_up(late_by(flight, truth, seconds), None, STANDARD_GRAVITY, None)
    in_order = {"gyro_noise": (1e-4, 1e-3), "accel_noise": (1e-3, 1e-2)}
    start = start_of(setup, first_guess(setup, flight))
    _, believed = estimate(setup, start, limits=in_order, white=True, passes=num.TRIAL_PASSES)
    first = Candidate.of_trial(trials(believed)[0])
    assert first.name == ("gps_latency", "step", None)
    assert first.taken == pytest.approx(seconds, rel=0.25)
    assert first.onset == pytest.approx(ONSET, abs=0.5)
