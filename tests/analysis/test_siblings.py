"""Several IMUs of one flight, and the odd one out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import companion as c
from companion.analysis import GENERIC, ReferenceFigures, Sibling, compare, odd_one_out, siblings
from companion.strapdown import motions
from tests.flights import flight_of, seconds
from tests.recordings import recording


def side_by_side(flight: c.Flight) -> tuple[Sibling, ...]:
    return siblings(flight, lambda name: compare(flight, imu=name), lambda _: GENERIC, ReferenceFigures())


def test_the_imu_with_the_bias_is_the_odd_one() -> None:
    flight = flight_of(motions.coning(seconds(60, 100), angle=0.2, frequency=0.2))
    good = flight.imu()
    bad = replace(good, gyro=good.gyro + np.array([0.05, 0, 0]), source="SCALED_IMU2", instance=1)
    found = side_by_side(replace(flight, imus={"RAW_IMU": good, "SCALED_IMU2": bad}))
    odd = odd_one_out(found)
    assert odd
    assert "SCALED_IMU2" in odd.advice
    (few,) = (replace(s, drift=replace(s.drift, windows=4)) for s in found[1:])
    assert odd_one_out((found[0], few)) is None, "a share of four windows says little"
    assert odd_one_out(found[:1]) is None, "one IMU alone is never odd"
    assert odd_one_out((found[1], replace(found[1], imu="SCALED_IMU3", instance=2))) is None, "nor are two bad ones"


def test_the_failed_imu_of_a_recording_is_the_odd_one() -> None:
    flight = c.open_log(recording("sitl/copter-imu1-fail-100hz.tlog"))[0]
    odd = odd_one_out(side_by_side(flight))
    assert odd
    assert odd.advice.startswith("The autopilot and SCALED_IMU2 agree: it is RAW_IMU that is wrong.")


def test_two_messages_of_one_imu_are_one() -> None:
    flight = c.open_log(recording("sitl/copter-hover-nodrift-100hz.tlog"))[0]
    found = side_by_side(flight)
    assert {s.imu: s.instance for s in found}["RAW_IMU"] == {s.imu: s.instance for s in found}["HIGHRES_IMU"] == 0
    assert odd_one_out(found) is None
    assert [s.drift.horizon_s for s in found] == pytest.approx([5.0] * len(found))
