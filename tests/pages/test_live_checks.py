"""The checks before take-off on a link: while the vehicle stands disarmed, and no longer."""

from __future__ import annotations

import pytest

from companion.model import Flight
from companion.pages.live import checks_on_the_ground
from companion.simulate import SimulatedVehicle, fly
from companion.telemetry import Stream
from tests.simulated import bursts

STREAMS = {"RAW_IMU": 50.0, "ATTITUDE": 20.0, "LOCAL_POSITION_NED": 10.0}


def heard(motion: str, seconds: float) -> Flight:
    """What a link carried in the first seconds of a vehicle."""
    stream = Stream()
    vehicle = SimulatedVehicle(fly(seconds + 5.0, motion=motion), streams=STREAMS)
    for t, data in bursts(vehicle, seconds):
        stream.push(data, 1.7e9 + t)
    return stream.flights()[0]


def test_a_vehicle_that_stands_disarmed_is_checked() -> None:
    result = checks_on_the_ground(heard("rest", 12.0))
    assert result is not None
    assert result.outcome == "go"
    assert result.motors_off, "its heartbeats say so, though nothing has changed"


@pytest.mark.parametrize("motion", ["circle", "square"])
def test_one_that_flies_is_not(motion: str) -> None:
    assert checks_on_the_ground(heard(motion, 12.0)) is None
