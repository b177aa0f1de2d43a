"""Quaternion laws over random inputs, and scipy's Rotation as an independent oracle."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from companion.model import Array, DataError
from companion.strapdown import quaternion as quat

VECTORS = arrays(np.float64, 3, elements=st.floats(-3.0, 3.0))
UNIT = (
    arrays(np.float64, 4, elements=st.floats(-1.0, 1.0)).filter(lambda q: np.linalg.norm(q) > 0.1).map(quat.normalize)
)
RNG = np.random.default_rng(20240917)
MANY = quat.normalize(RNG.normal(size=(500, 4)))


def same_rotation(a: Array, b: Array, atol: float = 1e-12) -> bool:
    return bool((np.abs(np.einsum("...i,...i", a, b)) > 1 - atol).all())


def scipy(q: Array) -> Rotation:
    return Rotation.from_quat(np.roll(q, -1, axis=-1))


@given(UNIT, UNIT, UNIT)
def test_product_is_associative(a: Array, b: Array, c: Array) -> None:
    left, right = quat.multiply(quat.multiply(a, b), c), quat.multiply(a, quat.multiply(b, c))
    np.testing.assert_allclose(left, right, atol=1e-14)


@given(UNIT)
def test_identity_and_inverse(q: Array) -> None:
    np.testing.assert_allclose(quat.multiply(q, quat.IDENTITY), q)
    np.testing.assert_allclose(quat.multiply(quat.IDENTITY, q), q)
    np.testing.assert_allclose(quat.multiply(q, quat.conjugate(q)), quat.IDENTITY, atol=1e-15)


@given(UNIT, UNIT, VECTORS)
def test_product_rotates_in_turn(a: Array, b: Array, v: Array) -> None:
    np.testing.assert_allclose(quat.rotate(quat.multiply(a, b), v), quat.rotate(a, quat.rotate(b, v)), atol=1e-13)


@given(UNIT, VECTORS)
def test_rotation_keeps_length_and_agrees_with_its_matrix(q: Array, v: Array) -> None:
    turned = quat.rotate(q, v)
    assert np.linalg.norm(turned) == pytest.approx(np.linalg.norm(v), abs=1e-13)
    np.testing.assert_allclose(quat.to_matrix(q) @ v, turned, atol=1e-13)


@given(UNIT)
def test_matrix_round_trip(q: Array) -> None:
    assert same_rotation(quat.from_matrix(quat.to_matrix(q)), q)


@given(VECTORS.filter(lambda v: np.linalg.norm(v) < np.pi - 1e-6))
def test_log_undoes_exp(vector: Array) -> None:
    np.testing.assert_allclose(quat.log(quat.exp(vector)), vector, atol=1e-9)


@given(UNIT)
def test_exp_undoes_log_and_log_is_the_shorter_way(q: Array) -> None:
    vector = quat.log(q)
    assert np.linalg.norm(vector) <= np.pi + 1e-12
    assert same_rotation(quat.exp(vector), q)
    if abs(q[0]) > 1e-6:  # at half a turn both ways are equally short
        np.testing.assert_allclose(quat.log(-q), vector, atol=1e-9)


@given(UNIT, UNIT)
def test_slerp_ends_where_it_should_and_is_of_unit_length(a: Array, b: Array) -> None:
    between = quat.slerp(a, b, np.array([0.0, 0.3, 1.0]))
    np.testing.assert_allclose(np.linalg.norm(between, axis=-1), 1.0, atol=1e-14)
    assert same_rotation(between[0], a)
    assert same_rotation(between[2], b)


def test_slerp_turns_at_constant_rate() -> None:
    at = np.linspace(0, 1, 11)
    path = quat.slerp(MANY[0], MANY[1], at)
    steps = np.linalg.norm(quat.log(quat.multiply(quat.conjugate(path[:-1]), path[1:])), axis=1)
    np.testing.assert_allclose(steps, steps[0], rtol=1e-12)


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_euler_round_trip(roll: float, pitch: float, yaw: float) -> None:
    np.testing.assert_allclose(quat.to_euler(quat.from_euler(roll, pitch, yaw)), (roll, pitch, yaw), atol=1e-9)


def test_scipy_agrees() -> None:
    a, b, v = MANY[:250], MANY[250:], RNG.normal(size=(250, 3))
    assert same_rotation(quat.multiply(a, b), np.roll((scipy(a) * scipy(b)).as_quat(), 1, axis=-1))
    np.testing.assert_allclose(quat.rotate(a, v), scipy(a).apply(v), atol=1e-13)
    np.testing.assert_allclose(quat.to_matrix(a), scipy(a).as_matrix(), atol=1e-14)
    np.testing.assert_allclose(quat.log(a), scipy(a).as_rotvec(), atol=1e-12)
    assert same_rotation(quat.exp(v), np.roll(Rotation.from_rotvec(v).as_quat(), 1, axis=-1))
    np.testing.assert_allclose(quat.to_euler(a)[:, ::-1], scipy(a).as_euler("ZYX"), atol=1e-9)
    assert same_rotation(quat.from_matrix(scipy(a).as_matrix()), a)


def test_half_turns_survive_the_matrix() -> None:
    turns = np.eye(4)
    assert same_rotation(quat.from_matrix(quat.to_matrix(turns)), turns)


def test_continuous_sign_keeps_rotations_and_removes_jumps() -> None:
    path = quat.exp(np.linspace(0, 20, 400)[:, None] * np.array([0.6, -0.2, 0.77]))
    shuffled = path * RNG.choice([-1.0, 1.0], size=(400, 1))
    smooth = quat.continuous_sign(shuffled)
    assert same_rotation(smooth, path)
    assert (np.einsum("ij,ij->i", smooth[1:], smooth[:-1]) > 0).all()
    np.testing.assert_array_equal(smooth[0], shuffled[0])
    assert quat.continuous_sign(np.empty((0, 4))).shape == (0, 4)


def test_small_angles_keep_their_digits() -> None:
    for size in (1e-9, 1e-5, 1e-3):
        small = size * np.array([1.0, -2.0, 0.3])
        np.testing.assert_allclose(quat.log(quat.exp(small)), small, rtol=1e-12)
    np.testing.assert_array_equal(quat.log(quat.exp(np.zeros(3))), np.zeros(3))


@pytest.mark.parametrize("bad", [np.zeros(4), np.full(4, np.nan), np.full(4, np.inf)])
def test_no_direction_is_an_error(bad: Array) -> None:
    with pytest.raises(DataError, match="length zero"):
        quat.normalize(bad)
