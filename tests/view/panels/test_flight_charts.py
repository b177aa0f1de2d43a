"""What the charts of a flight show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from companion.view import ReplayChoice
from companion.view.panels.drawings import reading_drawings
from companion.view.state.trajectory import display_trajectory
from tests.view.circles import dead_reckon, make_flight


def test_readings_and_what_they_were_before_correction_are_in_the_same_units() -> None:
    flight = make_flight()
    imu = flight.imu("RAW_IMU")
    turning = replace(imu, gyro=imu.gyro + np.radians([10.0, -20.0, 30.0]))
    corrected = replace(turning, gyro=turning.gyro - np.radians([1.0, 1.0, 1.0]), accel=imu.accel + 0.5)
    display = display_trajectory(dead_reckon(flight, ReplayChoice()), corrected)
    gyro, accel = reading_drawings(display, replace(flight, imus={"RAW_IMU": turning}))
    assert (gyro.unit, accel.unit) == ("deg/s", "m/s²")
    shown = [[(line.dash is None, float(np.median(line.values).round(6))) for line in d.lines] for d in (gyro, accel)]
    assert shown[0] == [(True, 9.0), (True, -21.0), (True, 29.0), (False, 10.0), (False, -20.0), (False, 30.0)]
    assert shown[1] == [(True, 0.5), (True, 0.5), (True, -9.30665), (False, 0.0), (False, 0.0), (False, -9.80665)]
