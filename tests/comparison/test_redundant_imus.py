"""Every IMU through the same windows, and two of one vehicle against each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import companion as c
from companion.comparison import GENERIC, RedundantImu, ReferenceSpec, compare, each_imu
from companion.strapdown import motions
from tests.flights import flight_of, seconds
from tests.recordings import recording


def side_by_side(flight: c.Flight) -> tuple[RedundantImu, ...]:
    return each_imu(flight, lambda name: compare(flight, imu=name), lambda _: GENERIC, ReferenceSpec())


def test_the_imu_with_the_bias_is_outside_its_bound() -> None:
    flight = flight_of(motions.coning(seconds(60, 100), angle=0.2, frequency=0.2))
    good = flight.imu()
    bad = replace(good, gyro=good.gyro + np.array([0.05, 0, 0]), source="SCALED_IMU2", instance=1)
    found = side_by_side(replace(flight, imus={"RAW_IMU": good, "SCALED_IMU2": bad}))
    assert [(s.imu, s.instance) for s in found] == [("RAW_IMU", 0), ("SCALED_IMU2", 1)]
    inside = [min(s.inside.values()) for s in found]
    assert inside[0] > 0.9
    assert inside[1] < 0.1


def test_two_messages_of_one_imu_are_one() -> None:
    flight = c.open_log(recording("sitl/copter-hover-nodrift-100hz.tlog"))[0]
    found = side_by_side(flight)
    assert {s.imu: s.instance for s in found}["RAW_IMU"] == {s.imu: s.instance for s in found}["HIGHRES_IMU"] == 0
    assert [s.drift.horizon_s for s in found] == pytest.approx([5.0] * len(found))
