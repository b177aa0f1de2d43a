"""Imperfect flights: the sensors are, the estimate is not, and who is blamed for one is a false alarm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.accuracy.answer import Answer
from benchmarks.accuracy.imperfect import IMPERFECTIONS, Case, _result, judged, wandering
from companion.app.recording import read_recording
from companion.model import Flight
from companion.strapdown import quaternion
from tests.estimation.sensed import sensed
from tests.recordings import BUNDLED

pytestmark = pytest.mark.slow

DEMO = BUNDLED / "copter-demo-100hz.tlog"


@pytest.fixture(scope="module")
def demo() -> Flight:
    (flight,) = read_recording(DEMO).flights
    return flight


@pytest.mark.parametrize("name", IMPERFECTIONS)
def test_sensors_are_imperfect_and_the_recorded_estimate_stays(name: str) -> None:
    perfect, _ = sensed(30.0)
    made, again = (IMPERFECTIONS[name].change(perfect, np.random.default_rng(3)) for _ in range(2))
    assert made.attitude is perfect.attitude
    assert made.position is perfect.position
    imu = made.imu()
    assert np.array_equal(imu.gyro, again.imu().gyro), "the same seed, the same imperfection"
    assert (np.diff(imu.t) > 0).all()
    sensors = [(made.gps, perfect.gps), (made.compasses, perfect.compasses), (made.barometers, perfect.barometers)]
    changed = [any(a is not b for a, b in zip(*pair, strict=True)) for pair in sensors]
    assert any(changed) or not np.array_equal(imu.gyro, perfect.imu().gyro)


def test_what_wanders_has_its_size_and_its_time() -> None:
    t = np.arange(0.0, 20_000.0, 0.5)
    values = wandering(t, 2.0, 10.0, np.random.default_rng(0), 2)
    assert values.std() == pytest.approx(2.0, rel=0.1)
    after = (values[:-20] * values[20:]).mean() / (values**2).mean()
    assert after == pytest.approx(np.exp(-1.0), abs=0.05), "10 s later"


def test_who_is_blamed_for_nothing_is_blamed_falsely(demo: Flight) -> None:
    assert _result(Answer("none"), demo, demo) == "clear"
    assert _result(Answer("cannot_tell"), demo, demo) == "cannot tell"
    assert _result(Answer("imu"), demo, demo) == "false alarm"
    assert _result(Answer("autopilot", onset=100.0, end=120.0), demo, demo) == "false alarm"
    attitude = demo.require_attitude()
    late = np.outer(attitude.t > 110.0, np.radians([4.0, 0.0, 0.0]))
    off = replace(
        demo, attitude=replace(attitude, q_ned_frd=quaternion.multiply(quaternion.exp(late), attitude.q_ned_frd))
    )
    assert _result(Answer("autopilot", onset=100.0, end=120.0), off, demo) == "off indeed"
    assert _result(Answer("autopilot", onset=100.0, end=105.0), off, demo) == "false alarm"


def test_an_imu_that_warms_is_no_fault() -> None:
    rows = judged(Case(str(DEMO), "IMU warms", 1))
    assert [(row.rate, row.result) for row in rows] == [("full", "clear"), ("25 Hz", "clear")]
