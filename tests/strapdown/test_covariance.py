"""Error growth: every Jacobian by numerical differences, a plain 15-state recursion, and simulated sensors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import chdtri

from companion.model import STANDARD_GRAVITY, Array, ImuTrack, NavState, Trajectory
from companion.strapdown import (
    ImuModel,
    Propagation,
    Sensor,
    dead_reckon,
    error_sums,
    joined,
    motions,
    preintegrate,
    propagate,
    quaternion,
    simulate,
)
from companion.strapdown.motions import Motion

pytestmark = pytest.mark.slow

RNG = np.random.default_rng(9)


def windows(motion: Motion, start: list[int], end: list[int]) -> Propagation:
    k = np.array(start)
    return propagate(motion.imu, preintegrate(motion.imu), k, end, motion.q_ned_frd[k], motion.velocity[k])


def error(truth: NavState, estimate: NavState) -> Array:
    """Truth minus estimate (9,): rotation vector in NED, velocity, position."""
    turn = quaternion.log(quaternion.multiply(truth.q_ned_frd, quaternion.conjugate(estimate.q_ned_frd)))
    return np.concatenate((turn, truth.velocity - estimate.velocity, truth.position - estimate.position))


MOTION = motions.coning(np.cumsum(RNG.uniform(0.6, 1.4, 1_001)) / 400)
K, E = 100, 900
WINDOW = windows(MOTION, [K], [E])


def state_at(k: int) -> NavState:
    return NavState(MOTION.t[k], MOTION.q_ned_frd[k], MOTION.velocity[k], MOTION.position[k])


def end_state(trajectory: Trajectory, row: int) -> NavState:
    return NavState(trajectory.t[row], trajectory.q_ned_frd[row], trajectory.velocity[row], trajectory.position[row])


def reach_end(imu: ImuTrack, start: NavState, gravity: float = STANDARD_GRAVITY) -> NavState:
    return end_state(dead_reckon(imu, start, gravity=gravity), E - K)


def assert_close(found: Array, numerical: Array, rtol: float = 2e-4) -> None:
    assert np.abs(found - numerical).max() <= rtol * np.abs(numerical).max()


def central(perturbed: Callable[[Array], NavState], size: int, step: float) -> Array:
    plain = reach_end(MOTION.imu, state_at(K))
    columns = [
        (error(perturbed(step * unit), plain) - error(perturbed(-step * unit), plain)) / (2 * step)
        for unit in np.eye(size)
    ]
    return np.stack(columns, axis=1)


def test_start_errors() -> None:
    def perturbed(x: Array) -> NavState:
        s = state_at(K)
        turned = quaternion.multiply(quaternion.exp(x[:3]), s.q_ned_frd)
        return reach_end(MOTION.imu, NavState(s.t, turned, s.velocity + x[3:6], s.position + x[6:]))

    assert_close(WINDOW.transition[0, :9, :9], central(perturbed, 9, 1e-5), 1e-6)


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_bias_errors(sensor: str) -> None:
    """b is true minus used: the truth is what the readings less b integrate to."""

    def perturbed(b: Array) -> NavState:
        return reach_end(replace(MOTION.imu, **{sensor: getattr(MOTION.imu, sensor) - b}), state_at(K))

    columns = slice(9, 12) if sensor == "gyro" else slice(12, 15)
    assert_close(WINDOW.transition[0, :9, columns], central(perturbed, 3, 1e-4))


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_scale_and_misalignment_errors(sensor: str) -> None:
    def perturbed(x: Array) -> NavState:
        reading = getattr(MOTION.imu, sensor)
        return reach_end(replace(MOTION.imu, **{sensor: reading - reading @ x.reshape(3, 3).T}), state_at(K))

    found = WINDOW.gyro_matrix if sensor == "gyro" else WINDOW.accel_matrix
    assert_close(found[0].reshape(9, 9), central(perturbed, 9, 1e-5))


def test_time_offset() -> None:
    """An IMU whose times lag by d reads at t what was true at t - d."""
    columns = []
    for d in (1e-4, -1e-4):
        late = motions.coning(MOTION.t - d)
        estimate = reach_end(replace(MOTION.imu, gyro=late.gyro, accel=late.accel), state_at(K))
        columns.append(error(state_at(E), estimate) / d)
    assert_close(WINDOW.time_offset[0], (columns[0] + columns[1]) / 2)


@pytest.mark.parametrize("gravity", [STANDARD_GRAVITY, 9.78])
def test_at_rest_times_that_are_off_change_nothing_whatever_the_gravity(gravity: float) -> None:
    t = np.linspace(0.0, 10.0, 101)
    imu = ImuTrack(t, np.zeros((101, 3)), np.tile([0.0, 0.0, -gravity], (101, 1)))
    still = propagate(imu, preintegrate(imu), [0], [100], quaternion.IDENTITY[None], np.zeros((1, 3)), gravity=gravity)
    np.testing.assert_allclose(still.time_offset, 0.0, atol=1e-12)


def test_gravity_error() -> None:
    def perturbed(g: Array) -> NavState:
        return reach_end(MOTION.imu, state_at(K), gravity=STANDARD_GRAVITY + g[0])

    assert_close(WINDOW.gravity[0][:, None], central(perturbed, 1, 1e-3), 1e-9)


def recursion(motion: Motion, gyro_noise: float, accel_noise: float, gyro_walk: float, accel_walk: float) -> Array:
    """A plain discrete 15-state recursion P <- F P Fᵀ + Q over all samples, starting from zero."""
    p = np.zeros((15, 15))
    for k in range(len(motion.t) - 1):
        h = motion.t[k + 1] - motion.t[k]
        middle = quaternion.slerp(motion.q_ned_frd[k], motion.q_ned_frd[k + 1], 0.5)
        c = quaternion.to_matrix(middle)
        x, y, z = c @ (motion.accel[k] + motion.accel[k + 1]) / 2
        skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        a = np.zeros((15, 15))
        a[0:3, 9:12] = -c
        a[3:6, 0:3] = -skew
        a[3:6, 12:15] = -c
        a[6:9, 3:6] = np.eye(3)
        f = np.eye(15) + h * a + h * h / 2 * a @ a
        densities = np.repeat([gyro_noise, accel_noise, 0.0, gyro_walk, accel_walk], 3)
        p = f @ p @ f.T + np.diag(densities**2) * h
    return p


@pytest.mark.parametrize("cause", ["gyro_noise", "accel_noise", "gyro_walk", "accel_walk"])
def test_plain_recursion_agrees(cause: str) -> None:
    """Within what the recursion's own steps of first order in the noise leave: a part in T / h."""
    motion = motions.coning(np.linspace(0, 4, 1601))
    found = windows(motion, [0], [1600]).noise[cause][0]
    density = {"gyro_noise": 0.0, "accel_noise": 0.0, "gyro_walk": 0.0, "accel_walk": 0.0, cause: 1.0}
    expected = recursion(motion, **density)
    scale = np.sqrt(np.diag(expected).reshape(5, 3).max(axis=1).repeat(3))
    scale[scale == 0] = 1.0
    np.testing.assert_allclose(found / np.outer(scale, scale), expected / np.outer(scale, scale), atol=3e-3)


def test_covariances_are_symmetric_and_causes_add_up() -> None:
    found = windows(MOTION, [0, 100], [500, 1000])
    start = np.diag(RNG.uniform(0, 1, 15))
    densities = {"gyro_noise": 1e-3, "accel_noise": 1e-2, "gyro_walk": 1e-4, "accel_walk": 1e-3}
    parts = [density**2 * found.noise[cause] for cause, density in densities.items()]
    parts.append(found.covariance(start=start))
    np.testing.assert_allclose(sum(parts), found.covariance(start=start, **densities))
    for part in parts:
        np.testing.assert_allclose(part, part.swapaxes(1, 2), atol=1e-15)
        assert (np.linalg.eigvalsh(part) > -1e-12 * np.abs(part).max()).all()


@pytest.mark.parametrize(
    ("starts", "ends"),
    [([0, 10, 500, 7], [1000, 10, 503, 400]), ([40, 10, 40, 40, 10, 40], [700, 10, 40, 55, 900, 700])],
    ids=["apart", "some begin together"],
)
def test_windows_of_any_length_do_not_disturb_one_another(starts: list[int], ends: list[int]) -> None:
    together = windows(MOTION, starts, ends)
    for w, (k, e) in enumerate(zip(starts, ends, strict=True)):
        alone = windows(MOTION, [k], [e])
        np.testing.assert_allclose(together.transition[w], alone.transition[0], atol=1e-12)
        np.testing.assert_allclose(together.gyro_matrix[w], alone.gyro_matrix[0], atol=1e-12)
        for cause, covariance in together.noise.items():
            np.testing.assert_allclose(covariance[w], alone.noise[cause][0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(together.transition[1], np.eye(15), atol=1e-15)
    assert together.duration[1] == 0


def test_windows_are_joined_of_pieces() -> None:
    imu, path = MOTION.imu, preintegrate(MOTION.imu)
    knots = np.array([0, 40, 41, 300, 700, 1000])
    pieces = error_sums(imu, path, knots[:-1], knots[1:])
    first, last = np.array([0, 1, 4, 2]), np.array([5, 2, 5, 4])
    made, whole = joined(pieces, first, last), error_sums(imu, path, knots[first], knots[last])
    np.testing.assert_allclose(made.transition, whole.transition, atol=1e-12)
    np.testing.assert_allclose(made.gyro_matrix, whole.gyro_matrix, atol=1e-12)
    np.testing.assert_allclose(made.accel_matrix, whole.accel_matrix, atol=1e-12)
    for cause, covariance in whole.noise.items():
        np.testing.assert_allclose(made.noise[cause], covariance, rtol=1e-9, atol=1e-12)
    assert len(joined(pieces, first[:0], last[:0]).transition) == 0


def test_the_world_may_be_turned() -> None:
    """Yawing the whole flight yaws the errors with it: the result does not depend on where north is."""
    turn = quaternion.from_euler(0.0, 0.0, 1.0)
    path, k = preintegrate(MOTION.imu), np.array([K])
    q, v = quaternion.multiply(turn, MOTION.q_ned_frd[k]), quaternion.rotate(turn, MOTION.velocity[k])
    turned = propagate(MOTION.imu, path, k, np.array([E]), q, v)
    c = np.kron(np.eye(3), quaternion.to_matrix(turn))
    np.testing.assert_allclose(turned.transition[0, :9, 9:], c @ WINDOW.transition[0, :9, 9:], atol=1e-10)
    np.testing.assert_allclose(turned.time_offset[0], c @ WINDOW.time_offset[0], atol=1e-10)


@pytest.mark.parametrize("middle", ["linear", "cubic"])
def test_simulated_sensors_drift_as_predicted(middle: str) -> None:
    """300 simulated sensors over 60 s: the mean NEES lies inside the 99 % bounds of chi-square at 1, 10 and 60 s."""
    rate, runs = 100, 300
    motion = motions.circle(np.arange(60 * rate + 1) / rate, heave=2.0)
    figures = {"gyro_noise": 2e-3, "accel_noise": 2e-2, "gyro_walk": 2e-4, "accel_walk": 2e-3}
    bias = [3e-3, 3e-2]
    rng = np.random.default_rng(11)
    ends = [rate, 10 * rate, 60 * rate]
    errors = np.empty((3, runs, 9))
    exact = dead_reckon(motion.imu, motion.start, middle=middle)  # leaves the integrator's own error out
    for run in range(runs):
        own = [rng.normal(0, sigma, 3) for sigma in bias]
        model = ImuModel(
            Sensor(noise_density=figures["gyro_noise"], bias_walk=figures["gyro_walk"], bias=own[0]),
            Sensor(noise_density=figures["accel_noise"], bias_walk=figures["accel_walk"], bias=own[1]),
        )
        estimate = dead_reckon(simulate(motion.imu, model, rng), motion.start, middle=middle)
        for i, end in enumerate(ends):
            errors[i, run] = error(end_state(exact, end), end_state(estimate, end))
    start = np.diag(np.repeat([0.0, 0.0, 0.0, *bias], 3) ** 2)
    predicted = windows(motion, [0, 0, 0], ends).covariance(start=start, **figures)
    low, high = (float(chdtri(9 * runs, 1 - tail)) / runs for tail in (0.005, 0.995))
    for i in range(3):
        x = errors[i]
        nees = np.einsum("ri,ij,rj->r", x, np.linalg.inv(predicted[i, :9, :9]), x)
        assert low < nees.mean() < high, (
            f"{ends[i] / rate:g} s: mean NEES {nees.mean():.2f} not in {low:.2f}..{high:.2f}"
        )


def test_what_does_not_fit_is_named() -> None:
    path, q, v = preintegrate(MOTION.imu), MOTION.q_ned_frd[:2], MOTION.velocity[:2]
    with pytest.raises(ValueError, match="same shape"):
        propagate(MOTION.imu, path, [0, 1], [5], q, v)
    with pytest.raises(ValueError, match="must have shapes"):
        propagate(MOTION.imu, path, [0, 1], [5, 6], q[:1], v)
    with pytest.raises(ValueError, match="end no earlier"):
        propagate(MOTION.imu, path, [0, 9], [5, 6], q, v)
    with pytest.raises(ValueError, match="lie in the track"):
        propagate(MOTION.imu, path, [0, 1], [5, 6000], q, v)
