"""The truth is true: each closed-form motion obeys the strapdown equations, checked by fine differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from companion.model import STANDARD_GRAVITY, Array
from companion.simulate import square
from companion.strapdown import motions, quaternion
from companion.strapdown.motions import Motion

MOTIONS = [square, motions.coning, motions.circle, motions.spin, motions.free_fall, motions.rest]


@pytest.mark.parametrize("motion", MOTIONS)
def test_motion_obeys_the_strapdown_equations(motion: Callable[[Array], Motion]) -> None:
    h = 1e-4
    t = np.linspace(0.3, 9.7, 60)
    now, before, after = motion(t), motion(t - h), motion(t + h)
    rate = quaternion.log(quaternion.multiply(quaternion.conjugate(before.q_ned_frd), after.q_ned_frd)) / (2 * h)
    np.testing.assert_allclose(rate, now.gyro, atol=1e-5)
    np.testing.assert_allclose((after.position - before.position) / (2 * h), now.velocity, atol=1e-5)
    acceleration = quaternion.rotate(now.q_ned_frd, now.accel) + np.array([0.0, 0.0, STANDARD_GRAVITY])
    np.testing.assert_allclose((after.velocity - before.velocity) / (2 * h), acceleration, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(now.q_ned_frd, axis=1), 1.0, atol=1e-14)


def test_rest_reads_minus_g_and_free_fall_reads_nothing() -> None:
    t = np.array([0.0, 1.0])
    np.testing.assert_allclose(motions.rest(t).accel, [[0, 0, -STANDARD_GRAVITY]] * 2)
    np.testing.assert_array_equal(motions.free_fall(t).accel, np.zeros((2, 3)))


def test_a_motion_is_a_track_a_start_and_attitudes_without_jumps() -> None:
    motion = motions.circle(np.linspace(0, 30, 301))
    assert len(motion.imu) == 301
    np.testing.assert_array_equal(motion.start.position, motion.position[0])
    q = motion.q_ned_frd
    assert (np.einsum("ij,ij->i", q[1:], q[:-1]) > 0).all()
