"""Every derivative of the smoother against differences: of each measurement, and of the motion between keyframes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.aiding_sensors import SENSORS
from companion.estimation.candidate import Candidate
from companion.estimation.hypotheses import hypothesis_of
from companion.estimation.iteration import start_of
from companion.estimation.learned_noise import FIRST_NOISE
from companion.estimation.linearisation import PreintegratedImu, _kinematics, linearise, measure, preintegrate_imu
from companion.estimation.model import ATTITUDE, CONSTANT_STATES, CONSTANTS, STATES, States
from companion.estimation.readings import Kinematics
from companion.estimation.setup import Setup, first_guess, set_up
from companion.estimation.system import Measurement, Problem
from companion.model import STANDARD_GRAVITY, Array
from companion.strapdown import skew
from tests.estimation.sensed import BIASES, range_of, sensed

STEP = 1e-5


@pytest.fixture(scope="module")
def problem() -> tuple[Setup, PreintegratedImu, States]:
    """Nominal states that are off in everything, and constants that all count."""
    flight, truth = sensed(12.0, "circle", rate=50.0)
    flight = replace(flight, ranges=(range_of(truth, np.random.default_rng(1)),))
    setup = set_up(flight, None, STANDARD_GRAVITY, None)
    count, rng = len(setup.t), np.random.default_rng(0)
    every = np.arange(count, dtype=np.intp)
    for name in ("rest_velocity", "rest_rate", "calm"):
        zero = SENSORS[name].at(setup.t, every, np.zeros((count, 3)))
        setup = replace(setup, readings=(*setup.readings, zero))
    moved = rng.normal(size=(count, STATES)) * np.repeat([0.1, 1.0, 2.0, 2e-3, 0.02], 3)
    constants = np.zeros(CONSTANT_STATES)
    constants[CONSTANTS["lever_arm"][0]] = [0.3, -0.2, 0.1]
    constants[CONSTANTS["hard_iron"][0]] = [2.0, -1.0, 3.0]
    constants[CONSTANTS["soft_iron"][0]] = rng.normal(size=9) * 0.03
    constants[CONSTANTS["compass_latency"][0]] = 0.02
    constants[CONSTANTS["gps_latency"][0]] = 0.15
    guess = first_guess(setup, flight)
    states = guess.moved(np.concatenate((moved, np.zeros_like(guess.slow)), axis=1), constants)
    return setup, preintegrate_imu(setup, BIASES), states


def derivative(function: Callable[[States], Array], states: States, x: Array, c: Array) -> Array:
    """Central difference in the direction (x, c)."""
    return (function(states.moved(x, c)) - function(states.moved(-x, -c))) / 2.0


def test_every_aiding_sensor_has_a_case(problem: tuple[Setup, PreintegratedImu, States]) -> None:
    assert {one.name for one in problem[0].readings} == SENSORS.keys()


@pytest.mark.parametrize("name", SENSORS)
def test_a_measurement_is_linear_as_it_says(problem: tuple[Setup, PreintegratedImu, States], name: str) -> None:
    setup, path, states = problem
    one = next(reading for reading in setup.readings if reading.name == name)

    nominal = _kinematics(setup, path, states)

    def predicted(of: States, at: Kinematics | None = None) -> Array:
        return one.value - measure(one, at or _kinematics(setup, path, of), setup.slow).residual

    def held(of: States) -> Array:
        return predicted(of, replace(nominal, states=of))

    exact = measure(one, nominal, setup.slow)
    none = np.zeros(CONSTANT_STATES)
    for column in range(STATES + states.slow.shape[1]):
        # of what the IMU felt since a late fix, the tilt is left to the motion; that of a rangefinder to all others
        function = held if name.startswith("gps") and column < 2 else predicted
        if name == "rangefinder" and column in range(*ATTITUDE.indices(STATES)):
            continue
        x = np.zeros((len(setup.t), STATES + states.slow.shape[1]))
        x[:, column] = STEP
        found = derivative(function, states, x, none) / STEP
        np.testing.assert_allclose(found, exact.states[:, :, column], rtol=1e-5, atol=1e-5, err_msg=f"state {column}")
    still = np.zeros_like(x)
    for column in range(CONSTANT_STATES):
        c = np.zeros(CONSTANT_STATES)
        c[column] = STEP
        found = derivative(predicted, states, still, c) / STEP
        np.testing.assert_allclose(
            found, exact.constants[:, :, column], rtol=1e-5, atol=1e-5, err_msg=f"constant {column}"
        )


def test_how_fast_a_late_compass_turns_where_the_axis_of_the_turn_turns_too() -> None:
    """A body that cones: its rate is not the derivative of the rotation vector. Left out is the third power of that."""
    flight, _ = sensed(12.0, "coning", rate=100.0)
    setup = set_up(flight, None, STANDARD_GRAVITY, None)
    path, late = preintegrate_imu(setup, BIASES), CONSTANTS["compass_latency"][0]
    one = next(reading for reading in setup.readings if reading.name == "compass")
    guess, c = first_guess(setup, flight), np.zeros(CONSTANT_STATES)
    still = np.zeros((len(setup.t), STATES + guess.slow.shape[1]))
    c[late] = 0.05
    states = guess.moved(still, c)
    nominal = _kinematics(setup, path, states)

    def predicted(of: States) -> Array:
        return one.value - measure(one, replace(nominal, states=of), setup.slow).residual

    c[late] = STEP
    found = derivative(predicted, states, still, c) / STEP
    exact = measure(one, nominal, setup.slow).constants[:, :, late]
    np.testing.assert_allclose(found, exact[..., 0], atol=4e-3 * np.abs(exact).max())


def step_of(kind: str) -> Candidate:
    return Candidate(
        hypothesis_of(kind), "step", onset=6.0, end=np.inf, onset_sigma=0.1, axis=-1, log_odds=0.0, fault=0.0
    )


def right_jacobian(turn: Array) -> Array:
    """(N, 3, 3) of exp, by its series: exp(a + δ) = exp(a) exp(J_r δ)."""
    power, total = np.tile(np.eye(3), (len(turn), 1, 1)), np.zeros((len(turn), 3, 3))
    for n in range(1, 25):
        total += power
        power = power @ skew(-turn) / (n + 1)
    return total


@pytest.mark.parametrize(
    ("apart", "turned", "accepted", "sizes"),
    [
        pytest.param(0.0, 0.0, [], [], id="about the bias that the pass over the IMU took off"),
        pytest.param(1.0, 0.0, [], [], id="far from it"),
        pytest.param(1.0, 0.5, [], [], id="where the IMU contradicts the attitudes"),
        pytest.param(0.0, 0.0, [step_of("accel_bias")], [0.3, -0.2, 0.1], id="with an explanation"),
        pytest.param(0.0, 0.5, [step_of("gyro_bias")], [0.9, -0.6, 0.7], id="with a large one, contradicted"),
    ],
)
def test_the_motion_is_linear_as_it_says(
    apart: float, turned: float, accepted: list[Candidate], sizes: list[float]
) -> None:
    """Residual r + Φ x_k + G c - x_{k+1}, of a turn that is left times J_r; what is accepted has a size already."""
    flight, _ = sensed(12.0, "circle", rate=50.0)
    setup = set_up(flight, None, STANDARD_GRAVITY, None)
    path, count = preintegrate_imu(setup, BIASES), len(setup.t)
    guess = first_guess(setup, flight)
    constants = guess.constants.copy()
    constants[CONSTANTS["accel_matrix"][0]] = apart * 0.01
    states = replace(
        guess,
        gyro_bias=np.tile(BIASES[0] + apart * np.array([2e-3, -1e-3, 2e-3]), (count, 1)),
        accel_bias=np.tile(BIASES[1] + apart * np.array([0.1, 0.2, -0.1]), (count, 1)),
        constants=constants,
    )
    contradicting = np.zeros((count, STATES + states.slow.shape[1]))
    contradicting[:, ATTITUDE] = turned * np.random.default_rng(1).normal(size=(count, 3))
    states = states.moved(contradicting, np.zeros(CONSTANT_STATES))
    scale, slow = {one.name: 1.0 for one in setup.readings}, start_of(setup, guess).slow

    def made(of: States) -> Problem:
        return linearise(setup, path, of, FIRST_NOISE, scale, {}, slow, accepted, sizes=np.array(sizes))

    def left(of: States) -> Array:
        motion = made(of).motion
        return np.asarray(motion.residual + motion.constants[..., CONSTANT_STATES:] @ np.array(sizes))

    exact = made(states).motion
    frame = right_jacobian(left(states)[:, ATTITUDE])

    def changed(x: Array, c: Array, size: float) -> Array:
        out = derivative(left, states, x, c) / size
        out[:, ATTITUDE] = (frame @ out[:, ATTITUDE, None])[..., 0]
        return out

    size = np.repeat([1e-5, 1e-4, 1e-4, 1e-7, 1e-6], 3)
    none = np.zeros(CONSTANT_STATES)
    for column in range(STATES):
        x = np.zeros_like(contradicting)
        x[::2, column] = size[column]
        found = changed(x, none, size[column])
        expected = exact.transition[:, :, column] * (x[:-1, column] > 0)[:, None]
        expected[:, column] -= x[1:, column] > 0
        np.testing.assert_allclose(found, expected, rtol=2e-3, atol=2e-3, err_msg=f"state {column}")
    still = np.zeros_like(contradicting)
    for column in range(CONSTANT_STATES):
        c = np.zeros(CONSTANT_STATES)
        c[column] = 1e-5
        found = changed(still, c, 1e-5)
        np.testing.assert_allclose(
            found, exact.constants[:, :, column], rtol=2e-3, atol=2e-3, err_msg=f"constant {column}"
        )


FAR = {"compass_field": [4.0, -7.0], "compass_turn": [0.3, -0.2, 0.5]}


@pytest.mark.parametrize(
    "turned",
    [
        [("compass_field", "step")],
        [("compass_field", "ramp")],
        [("compass_field", "creep"), ("compass_field", "pulse")],
        [("compass_turn", "ramp")],
        [("compass_turn", "step"), ("compass_field", "ramp"), ("compass_turn", "pulse")],
    ],
)
def test_a_compass_that_has_turned_or_its_field_is_linear_as_it_says(
    problem: tuple[Setup, PreintegratedImu, States], turned: list[tuple[str, str]]
) -> None:
    """By far, evenly or at once: in attitudes, in all that is constant and in the sizes that were found so far."""
    setup, path, states = problem
    rows = [(hypothesis_of(kind), shape) for kind, shape in turned]
    accepted = [Candidate(row, shape, 3.0 + i, 8.0 + i, 0.1, -1, 0.0, 0.0) for i, (row, shape) in enumerate(rows)]
    sizes = np.concatenate([FAR[kind] for kind, _ in turned])
    scale, slow = {one.name: 1.0 for one in setup.readings}, start_of(setup, states).slow

    def made(of: States, sizes: Array = sizes) -> Measurement:
        problem = linearise(setup, path, of, FIRST_NOISE, scale, {}, slow, accepted, sizes=sizes)
        one = problem.measurement("compass")
        assert one is not None
        return one

    def predicted(of: States, sizes: Array = sizes) -> Array:
        one = made(of, sizes)
        return np.asarray(one.constants[..., CONSTANT_STATES:] @ sizes - one.residual)

    exact, still = made(states), np.zeros((len(setup.t), STATES + states.slow.shape[1]))
    for column in range(*ATTITUDE.indices(STATES)):
        x = still.copy()
        x[:, column] = STEP
        found = derivative(predicted, states, x, np.zeros(CONSTANT_STATES)) / STEP
        np.testing.assert_allclose(found, exact.states[..., column], rtol=1e-5, atol=1e-4)
    for column in range(CONSTANT_STATES):
        c = np.zeros(CONSTANT_STATES)
        c[column] = STEP
        found = derivative(predicted, states, still, c) / STEP
        np.testing.assert_allclose(found, exact.constants[..., column], rtol=1e-5, atol=1e-4)
    for i in range(len(sizes)):
        ways = (sizes + sign * STEP * (np.arange(len(sizes)) == i) for sign in (1.0, -1.0))
        above, below = (predicted(states, way) for way in ways)
        found = exact.constants[..., CONSTANT_STATES + i]
        np.testing.assert_allclose((above - below) / (2.0 * STEP), found, rtol=1e-5, atol=1e-4)


def test_where_the_imu_is_not_heard_no_fix_tells_its_latency(problem: tuple[Setup, PreintegratedImu, States]) -> None:
    """Between gaps a velocity is told by nothing: with a latency it would explain any noise of a height."""
    setup, path, states = problem
    broken = setup.t[1:] > 6.0
    deaf = replace(setup, broken=broken)
    for one in setup.readings:
        if not one.name.startswith("gps"):
            continue
        measured = measure(one, _kinematics(deaf, path, states), setup.slow)
        latency = measured.constants[:, :, CONSTANTS["gps_latency"][0]]
        after = np.append(broken, True)[one.keyframe]
        assert not latency[after].any()
        assert latency[~after].any()
