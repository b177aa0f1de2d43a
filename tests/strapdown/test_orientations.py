"""MAVLink's list of orientations."""

from __future__ import annotations

import re

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from companion.model import ORIENTATIONS, orientation_name, orientation_number, orientations
from companion.strapdown import quaternion

NAMES = {
    number: entry.name
    for number, entry in common.enums["MAV_SENSOR_ORIENTATION"].items()
    if re.search(r"ROLL|PITCH|YAW|NONE", entry.name)
}


def test_the_list_is_mavlinks() -> None:
    assert sorted(NAMES) == list(range(len(ORIENTATIONS)))
    for number, name in NAMES.items():
        by_axis = {axis: float(angle) for axis, angle in re.findall(r"(ROLL|PITCH|YAW)_(\d+)", name)}
        assert ORIENTATIONS[number] == tuple(by_axis.get(axis, 0.0) for axis in ("ROLL", "PITCH", "YAW"))


@pytest.mark.parametrize("number", range(len(ORIENTATIONS)))
def test_a_rotation_has_its_number(number: int) -> None:
    found, off = orientation_number(-orientations()[number])
    assert off == pytest.approx(0.0, abs=1e-6)
    assert found <= number
    assert np.allclose(np.abs(orientations()[found] @ orientations()[number]), 1.0)


def test_each_turns_about_the_axes_of_the_body_yaw_last() -> None:
    """A sensor that is mounted with its x to the right of the vehicle, yaw 90°, reads its x as the body's y."""
    x, z = np.eye(3)[[0, 2]]
    assert np.allclose(quaternion.rotate(orientations()[2], x), [0.0, 1.0, 0.0])
    assert np.allclose(quaternion.rotate(orientations()[8], z), [0.0, 0.0, -1.0])
    assert np.allclose(quaternion.rotate(orientations()[10], z), [0.0, 0.0, -1.0])
    assert np.allclose(quaternion.rotate(orientations()[10], x), [0.0, 1.0, 0.0])
    assert orientation_name(10) == "roll 180°, yaw 90°"
    assert orientation_name(0) == "none"
