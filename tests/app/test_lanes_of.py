"""By which IMU the lanes of an estimator are judged."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.app.examination import lanes_of
from companion.app.settings import Settings
from companion.model import EstimatorLane, ImuTrack, rows
from tests.flights import LIVELY, flown

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("every", "source"), [(1, "SCALED_IMU2"), (25, "RAW_IMU")], ids=["fast", "at 2 Hz"])
def test_an_imu_that_is_too_slow_carries_no_estimate_though_the_other_is_at_fault(every: int, source: str) -> None:
    flight = flown()
    imu = flight.imu()
    late = (imu.t > 35.0)[:, None] * [0.0, 1.0, 0.0]
    first: ImuTrack = replace(imu, accel=imu.accel + late)
    second = rows(replace(imu, source="SCALED_IMU2", instance=1), slice(None, None, every))
    t, q = imu.t[::5], LIVELY.q_ned_frd[::5]
    lanes = tuple(
        EstimatorLane(t, q, LIVELY.velocity[::5], LIVELY.position[::5], f"EKF2 instance {i}", i, f"instance {i}", i)
        for i in (0, 1)
    )
    _, best = lanes_of(replace(flight, imus={"RAW_IMU": first, "SCALED_IMU2": second}, lanes=lanes), Settings())
    assert best.imu.source == source
