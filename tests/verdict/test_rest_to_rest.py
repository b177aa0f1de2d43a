"""An accelerometer that reads another gravity after a flight than before it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import companion as c
from companion.comparison import GENERIC
from companion.model import Flight
from companion.verdict import assess
from companion.verdict.rest_to_rest import changed_at_rest
from tests.flights import with_imu
from tests.recordings import BUNDLED

BEGIN = 120.0
"""s: in the flight, which lasts from 76 to 156 s."""


@pytest.fixture(scope="module")
def indoors() -> Flight:
    """A flight between two rests without a GPS."""
    return replace(c.open_log(BUNDLED / "copter-demo-100hz.tlog")[0], gps=())


def off_by(flight: Flight, x: float, z: float) -> Flight:
    imu = flight.imu()
    return with_imu(flight, accel=imu.accel + (imu.t >= BEGIN)[:, None] * np.array([x, 0.0, z]))


def test_gravity_alone_names_what_changed_in_flight(indoors: Flight) -> None:
    found = assess(off_by(indoors, 0.0, -0.5), GENERIC).verdict
    assert found.status == "imu_suspect"
    assert "reads 10.31 m/s² at rest after the flight, and read 9.81" in found.summary
    assert found.cause is not None
    assert (found.cause.kind, found.cause.sensor) == ("accel_bias", "accel")
    assert found.cause.size == pytest.approx(0.5, abs=0.02)
    assert found.probability["imu"] > 0.95


@pytest.mark.parametrize(("x", "z"), [(0.0, 0.0), (0.0, -0.12), (0.4, 0.0)])
def test_what_parts_in_order_do_or_gravity_does_not_tell_is_not_named(indoors: Flight, x: float, z: float) -> None:
    """Level, an error of 0.4 m/s² to the side makes gravity 0.01 m/s² longer."""
    assert not [*changed_at_rest(off_by(indoors, x, z), None, ())]


def test_a_vehicle_that_lies_otherwise_after_the_flight_reads_its_usual_biases_otherwise(indoors: Flight) -> None:
    """0.2 m/s² on z, upright and upside down: 0.4 m/s² between the two."""
    imu = indoors.imu()
    over = np.where((imu.t >= 156.5)[:, None], [1.0, -1.0, -1.0], 1.0)
    lying = with_imu(indoors, accel=imu.accel * over + [0.0, 0.0, 0.2], gyro=imu.gyro * over)
    assert not [f for f in changed_at_rest(lying, None, ()) if f.severity == "error"]


def test_with_a_gps_the_best_estimate_says_when_it_began() -> None:
    flight = off_by(c.open_log(BUNDLED / "copter-demo-100hz.tlog")[0], 0.0, -0.5)
    cause = assess(flight, GENERIC).verdict.cause
    assert cause is not None
    assert cause.onset_s == pytest.approx(BEGIN, abs=1.0)
