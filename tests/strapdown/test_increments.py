"""One interval: an eight-segment JPL integrator as oracle, the cubic between unequal samples, bad input."""

from __future__ import annotations

import numpy as np
import pytest

from companion.model import Array, DataError, ImuTrack, SettingsError
from companion.strapdown import (
    METHODS,
    MIDDLES,
    dead_reckon,
    dense_attitude,
    increments,
    motions,
    quaternion,
)

RNG = np.random.default_rng(1)


def random_track(n: int = 40) -> ImuTrack:
    t = np.cumsum(RNG.uniform(0.005, 0.02, n))
    return ImuTrack(t, RNG.normal(0, 2, (n, 3)), RNG.normal(0, 5, (n, 3)))


def integrate_quaternion(w_begin: Array, w_end: Array, q_begin: Array, dt: float) -> dict[float, Array]:
    """The integrator of docs/mathematics.md, in its own convention: JPL, scalar last, eight segments, unnormalised."""

    def derivative(q: Array, w: Array) -> Array:
        x, y, z = w
        compose_omega = np.array([[0, -z, y, -x], [z, 0, -x, -y], [-y, x, 0, -z], [x, y, z, 0]])
        return np.asarray(-0.5 * compose_omega @ q)

    count = 8
    h = dt / count
    q, handed_out = q_begin, {}
    for i in range(count):
        k1 = derivative(q, w_begin + i / count * (w_end - w_begin))
        middle = w_begin + 0.5 * (2 * i + 1) / count * (w_end - w_begin)
        k2 = derivative(q + 0.5 * k1 * h, middle)
        k3 = derivative(q + 0.5 * k2 * h, middle)
        k4 = derivative(q + k3 * h, w_begin + (i + 1) / count * (w_end - w_begin))
        q = q + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        handed_out[(i + 1) / count] = q
    return handed_out


def test_seed_001_in_its_own_convention() -> None:
    imu = random_track()
    attitude = quaternion.normalize(RNG.normal(size=(len(imu), 4)))
    fractions = np.array([1 / 8, 1 / 4, 1 / 2, 1.0])
    ours = dense_attitude(imu, attitude, fractions, middle="linear", segments=8)
    whole = quaternion.multiply(attitude[:-1], increments(imu, middle="linear", segments=8).dq)
    for i in range(len(imu) - 1):
        scalar_last = np.roll(attitude[i], -1)  # JPL's
        seed = integrate_quaternion(imu.gyro[i], imu.gyro[i + 1], scalar_last, imu.t[i + 1] - imu.t[i])
        theirs = np.roll([seed[u] for u in fractions], 1, axis=1)
        np.testing.assert_allclose(ours[i], quaternion.normalize(theirs), atol=1e-14)
        np.testing.assert_allclose(abs(whole[i] @ quaternion.normalize(theirs[-1])), 1.0, atol=1e-14)


@pytest.mark.parametrize("middle", MIDDLES)
@pytest.mark.parametrize("segments", [1, 3])
def test_dense_attitude_ends_at_the_next_sample(middle: str, segments: int) -> None:
    motion = motions.coning(np.linspace(0, 2, 101))
    path = dead_reckon(motion.imu, motion.start, middle=middle, segments=segments).q_ned_frd
    dense = dense_attitude(motion.imu, path, np.array([0.0, 1.0]), middle=middle, segments=segments)
    np.testing.assert_allclose(dense[:, 0], path[:-1], atol=1e-14)
    np.testing.assert_allclose(dense[:, 1], path[1:], atol=1e-14)


def test_cubic_is_exact_for_cubic_signals_between_unequal_samples() -> None:
    """About one fixed axis the angle is the integral of the rate, which Simpson's rule has exactly for a cubic."""
    t = np.cumsum(RNG.uniform(0.01, 0.05, 30))
    rate, integral = np.poly1d([0.3, -1.0, 0.5, 0.2]), np.poly1d([0.3, -1.0, 0.5, 0.2]).integ()
    gyro = np.zeros((30, 3))
    gyro[:, 2] = rate(t)
    accel = np.zeros((30, 3))
    accel[:, 2] = rate(t)
    cubic = increments(ImuTrack(t, gyro, accel))
    np.testing.assert_allclose(cubic.dv[:, 2], np.diff(integral(t)), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(quaternion.log(cubic.dq)[:, 2], np.diff(integral(t)), atol=1e-8)  # RK4's own h⁵
    linear = increments(ImuTrack(t, gyro, accel), middle="linear")
    assert np.abs(linear.dv[:, 2] - np.diff(integral(t))).max() > 1e-6


@pytest.mark.parametrize(("samples", "shape"), [(2, "line"), (3, "parabola")])
def test_too_few_samples_for_the_cubic_use_what_there_is_and_say_so(samples: int, shape: str) -> None:
    track = random_track(samples)
    found = increments(track)
    assert len(found.dt) == samples - 1
    assert shape in found.notes[0]
    assert str(samples) in found.notes[0]
    if samples == 2:
        np.testing.assert_allclose(found.dv, increments(track, middle="linear").dv, rtol=1e-13)
    assert increments(track, middle="linear").notes == ()
    assert increments(track, method="euler").notes == ()


def test_three_samples_give_the_parabola() -> None:
    t = np.array([0.0, 0.1, 0.25])
    accel = np.stack((t**2, 1 - t, 3 * t**2 - t), axis=1)
    found = increments(ImuTrack(t, np.zeros((3, 3)), accel))
    integral = np.stack((t**3 / 3, t - t**2 / 2, t**3 - t**2 / 2), axis=1)
    np.testing.assert_allclose(found.dv, np.diff(integral, axis=0), rtol=1e-13)


def test_one_sample_has_no_interval() -> None:
    found = increments(random_track(1))
    assert found.dq.shape == (0, 4)
    assert found.notes == ()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("middle", MIDDLES)
def test_increments_are_unit_rotations_of_at_most_half_a_turn(method: str, middle: str) -> None:
    dq = increments(random_track(), method=method, middle=middle, segments=2).dq
    np.testing.assert_allclose(np.linalg.norm(dq, axis=1), 1.0, atol=1e-14)
    assert (dq[:, 0] >= 0).all()


def test_seed_002_euler_and_midpoint_by_hand() -> None:
    t = np.array([0.0, 0.1])
    gyro, accel = np.array([[0.1, 0.2, 0.3], [0.3, 0.0, -0.1]]), np.array([[1.0, 2.0, -9.0], [0.5, 1.0, -10.0]])
    imu = ImuTrack(t, gyro, accel)
    euler = increments(imu, method="euler")
    np.testing.assert_allclose(euler.dq[0], quaternion.normalize(np.append(1.0, 0.05 * gyro[0])))
    np.testing.assert_allclose(euler.dv[0], 0.1 * accel[0])
    np.testing.assert_allclose(euler.dp[0], 0.005 * accel[0])
    midpoint = increments(imu, method="midpoint")
    dq = quaternion.normalize(np.append(1.0, 0.05 * (gyro[0] + gyro[1]) / 2))
    a = (accel[0] + quaternion.rotate(dq, accel[1])) / 2
    np.testing.assert_allclose(midpoint.dq[0], dq)
    np.testing.assert_allclose(midpoint.dv[0], 0.1 * a)
    np.testing.assert_allclose(midpoint.dp[0], 0.005 * a)


def test_steps_of_more_than_half_a_turn_are_finite_and_reported() -> None:
    t = np.arange(5.0)
    fast = increments(ImuTrack(t, np.full((5, 3), 4.0), np.ones((5, 3))))
    assert np.isfinite(fast.dq).all()
    np.testing.assert_allclose(np.linalg.norm(fast.dq, axis=1), 1.0)
    backwards = increments(ImuTrack(t, np.full((5, 3), 2.6), np.ones((5, 3))))  # 4.5 rad, beyond half a turn
    assert (backwards.dq[:, 0] >= 0).all()
    assert "4 of 4 intervals turn by more than π" in fast.notes[0]
    askew = increments(ImuTrack(t, np.full((5, 3), 1.85), np.ones((5, 3))))  # 3.204 rad, about no axis of the body
    assert "4 of 4 intervals turn by more than π" in askew.notes[0]
    assert increments(ImuTrack(t, np.full((5, 3), 1.8), np.ones((5, 3)))).notes == ()  # 3.118 rad


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "rk5"}, f"unknown method 'rk5': choose one of {', '.join(METHODS)}"),
        ({"middle": "spline"}, "unknown middle 'spline': choose one of linear, cubic"),
        ({"segments": 0}, "segments must be 1 or more"),
    ],
)
def test_unknown_settings_name_the_choices(options: dict[str, str], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        increments(random_track(), **options)  # type: ignore[arg-type]


def test_bad_input_is_named() -> None:
    empty = ImuTrack(np.empty(0), np.empty((0, 3)), np.empty((0, 3)))
    with pytest.raises(DataError, match="no samples"):
        increments(empty)
    track, q = random_track(5), np.tile(quaternion.IDENTITY, (5, 1))
    with pytest.raises(ValueError, match=r"fractions must lie in 0\.\.1"):
        dense_attitude(track, q, np.array([0.5, 1.5]))
    with pytest.raises(ValueError, match="one per sample"):
        dense_attitude(track, q[:3], np.array([0.5]))
    with pytest.raises(SettingsError, match="segments must be 1 or more"):
        dense_attitude(track, q, np.array([0.5]), segments=0)


def test_beside_a_gap_or_a_burst_the_line_is_taken_and_it_is_said() -> None:
    """Two samples 10 µs apart would multiply the noise of the readings by hundreds in the cubic next to them."""
    t = np.sort(np.concatenate((np.arange(100) * 0.02, [0.5 + 1e-5])))
    t[60:] += 2.0
    noise = RNG.normal(0, 1, (101, 3))
    track = ImuTrack(t, 0 * noise, noise)
    cubic, linear = increments(track), increments(track, middle="linear")
    assert "more than 30 times as long as a neighbour: 3 of 100 intervals" in cubic.notes[0]
    marked = np.nonzero(np.diff(t) > 1)[0][0]
    np.testing.assert_array_equal(cubic.dv[marked], linear.dv[marked])
    assert np.abs(cubic.dv / cubic.dt[:, None]).max() < 5
    assert linear.notes == ()
