"""A click into the picture goes to the instant that lies there."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.view import ReplayChoice
from companion.view.scene.cameras import Pose, picked
from tests.view.circles import make_flight, recompute

DISPLAY = recompute(make_flight(), ReplayChoice())


@given(st.integers(0, len(DISPLAY.replay.t) - 1), st.booleans())
def test_a_ray_through_a_path_is_where_the_vehicle_was(at: int, imu: bool) -> None:
    eye = np.array([-150.0, 60.0, -120.0])
    path = DISPLAY.replay.position_imu if imu else DISPLAY.replay.position_ref
    found = picked(DISPLAY, eye, 3.0 * (path[at] - eye))
    assert found is not None
    there = np.concatenate([DISPLAY.replay.position_ref, DISPLAY.replay.position_imu])
    i = int(np.searchsorted(DISPLAY.replay.t, found))
    hit = there[[i, i + len(DISPLAY.replay.t)]] - eye
    ray = (path[at] - eye) / np.linalg.norm(path[at] - eye)
    aside = np.linalg.norm(np.cross(hit, ray), axis=1) / np.linalg.norm(hit, axis=1)
    assert aside.min() < 1e-6


def test_beside_the_paths_and_behind_the_camera_there_is_nothing() -> None:
    eye = np.array([-150.0, 60.0, -120.0])
    there = DISPLAY.replay.position_ref[0]
    assert picked(DISPLAY, eye, eye - there) is None
    assert picked(DISPLAY, eye, np.array([0.0, 0.0, -1.0])) is None
    assert picked(DISPLAY, eye, np.zeros(3)) is None


@pytest.mark.parametrize("seed", range(3))
def test_the_way_back_from_a_browsers_world_undoes_the_way_there(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = rng.normal(size=4)
    pose = Pose(q / np.linalg.norm(q), rng.normal(size=3))
    point = rng.normal(size=3)
    np.testing.assert_allclose(pose.back(pose.apply(point)), point, atol=1e-12)
