"""A gap in flight is lost data; a log that pauses while the vehicle is disarmed is whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from companion.cli.info import gap_line
from companion.model import Event, Flight, ImuTrack, Vehicle

T = np.concatenate([np.arange(0.0, 10.0, 0.02), np.arange(40.0, 60.0, 0.02), np.arange(61.5, 80.0, 0.02)])
STILL = np.zeros((len(T), 3))
FLIGHT = Flight(
    Vehicle(1, 1, "ARDUPILOTMEGA", "QUADROTOR"), boot=1, start=0.0, duration=80.0,
    imus={"RAW_IMU": ImuTrack(T, STILL, STILL, "RAW_IMU")},
    events=(Event(45.0, "armed", "armed"), Event(70.0, "disarmed", "disarmed")),
)  # fmt: skip


def test_a_pause_is_told_from_a_gap_in_flight() -> None:
    armed, disarmed = gap_line(FLIGHT).split("; ")
    assert armed == "1 gap while armed, the longest 1.52 s"
    assert disarmed == "1 gap while disarmed, where a log may pause, the longest 30.02 s"


def test_what_began_armed_was_armed_before() -> None:
    assert "disarmed" not in gap_line(replace(FLIGHT, events=(Event(70.0, "disarmed", "disarmed"),)))
    assert gap_line(replace(FLIGHT, events=())) == ""
