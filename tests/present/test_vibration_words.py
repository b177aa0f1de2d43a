"""Vibration in words: good, fair, bad by the limits that ArduPilot's documentation gives."""

from __future__ import annotations

import numpy as np
import pytest

from companion.model import Flight, Series, Vehicle
from companion.present.noise import vibration_words

AXES = ("x_mps2", "y_mps2", "z_mps2")


@pytest.mark.parametrize(("peak", "grade"), [(12.0, "good"), (25.0, "fair"), (45.0, "bad")])
def test_the_worst_axis_decides(peak: float, grade: str) -> None:
    values = np.tile([1.0, 2.0, 5.0], (9, 1))
    values[4, 1] = peak
    shaken = Series(np.arange(9.0), values, AXES, "VIBRATION")
    flight = Flight(Vehicle(1, 1, "ARDUPILOTMEGA", "QUADROTOR"), 1, 0.0, 9.0, series={"vibration": shaken})
    assert vibration_words(flight) == f"5 m/s² typical, {peak:.0f} peak: {grade} (limit 30)"


def test_what_is_not_told_has_no_words() -> None:
    assert vibration_words(Flight(Vehicle(1, 1, "PX4", "QUADROTOR"), 1, 0.0, 9.0)) == ""
