"""Whether something has just begun, by the last seconds of a flight alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.comparison import compare, newest_stands_out
from companion.model import Flight
from companion.strapdown import motions
from tests.flights import flown, seconds, turned, with_imu

END = 30.0


@pytest.fixture(scope="module")
def flight() -> Flight:
    """20 s of it, until END."""
    return flown(motions.coning(seconds(20, 100), angle=0.2, frequency=0.3, amplitude=(3.0, 2.0, 1.0)))


def test_a_flight_that_goes_on_as_before_does_not_stand_out(flight: Flight) -> None:
    assert not newest_stands_out(compare(flight))
    biased = with_imu(flight, gyro=flight.imu().gyro + [0.02, 0.0, 0.0])
    assert not newest_stands_out(compare(biased)), "what was so before is nothing new"


@pytest.mark.parametrize(("begun", "seen"), [(END - 2.0, True), (END - 10.0, False)], ids=["just now", "long ago"])
def test_a_sensor_that_has_just_gone_wrong_stands_out(flight: Flight, begun: float, seen: bool) -> None:
    imu = flight.imu()
    on = (imu.t >= begun)[:, None]
    assert newest_stands_out(compare(with_imu(flight, gyro=imu.gyro + on * [0.02, 0.0, 0.0]))) is seen
    assert newest_stands_out(compare(with_imu(flight, accel=imu.accel + on * [0.5, 0.0, 0.0]))) is seen


@pytest.mark.parametrize(("begun", "seen"), [(END - 1.0, True), (END - 10.0, False)], ids=["just now", "long ago"])
def test_an_estimate_that_has_just_stepped_stands_out(flight: Flight, begun: float, seen: bool) -> None:
    position, attitude = flight.position, flight.require_attitude()
    assert position is not None
    moved = position.position + (position.t >= begun)[:, None] * [10.0, 0.0, 0.0]
    turn = np.radians(15.0) * (attitude.t >= begun)[:, None] * np.array([0.0, 0.0, 1.0])
    assert newest_stands_out(compare(replace(flight, position=replace(position, position=moved)))) is seen
    assert newest_stands_out(compare(turned(flight, turn))) is seen


@pytest.mark.parametrize(
    ("begun", "seen"), [(END - 0.5, False), (END - 1.3, True), (END - 8.0, False)], ids=["too short", "just", "long"]
)
def test_an_axis_that_has_just_stopped_stands_out(begun: float, seen: bool) -> None:
    still = flown(motions.coning(seconds(20, 100), angle=0.002, frequency=0.3))  # so that nothing parts
    imu = still.imu()
    gyro = imu.gyro + 1e-4 * np.random.default_rng(0).normal(size=imu.gyro.shape)
    after = imu.t >= begun
    gyro[after, 0] = gyro[np.argmax(after), 0]
    assert newest_stands_out(compare(with_imu(still, gyro=gyro))) is seen
