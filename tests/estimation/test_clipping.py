"""What clipped readings take: of the IMU that they were counted of, when they were counted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.estimation import smooth
from companion.estimation.gaps import lost_by_clipping
from companion.model import Flight, Series
from tests.estimation.sensed import sensed

FLIGHT = sensed(60.0, rate=50.0)[0]


def counted(flight: Flight, column: str, each: float) -> Flight:
    """Readings clipped from 30 to 35 s, so many a second."""
    t = np.arange(0.0, 61.0)
    clips = np.clip(t - 30.0, 0.0, 5.0) * each
    series = Series(t, clips[:, None], (column,), "VIBRATION")
    return replace(flight, series={"vibration": series})


def test_only_the_imu_and_the_time_that_were_counted() -> None:
    t = np.arange(0.0, 60.0, 0.5)
    lost = lost_by_clipping(counted(FLIGHT, "clips_0", 100.0), FLIGHT.imu(), t, 0.1)
    assert lost[(t[:-1] >= 30.0) & (t[1:] <= 35.0)] == pytest.approx(2.0 / (0.1 * np.sqrt(0.5)))
    assert not lost[t[1:] < 30.0].any()
    assert np.isfinite(lost_by_clipping(FLIGHT, FLIGHT.imu(), t, 0.0)).all(), "a simulated sensor has no noise"
    assert lost_by_clipping(counted(FLIGHT, "clips_x", 100.0), FLIGHT.imu(), t, 0.1) == pytest.approx(lost)
    assert not lost_by_clipping(counted(FLIGHT, "clips_1", 100.0), FLIGHT.imu(), t, 0.1).any()


def test_an_accelerometer_that_clips_is_not_accused_of_a_fault_meanwhile() -> None:
    imu = FLIGHT.imu()
    off = np.where((imu.t > 30.0) & (imu.t < 35.0), -3.0, 0.0)[:, None] * np.array([0.0, 0.0, 1.0])
    wrong = replace(FLIGHT, imus={imu.source: replace(imu, accel=imu.accel + off)})
    assert any(one.kind.startswith("accel") for one in smooth(wrong).explained)
    clipped = smooth(counted(wrong, "clips_0", 200.0))
    assert not any(one.kind.startswith("accel") for one in clipped.explained)
