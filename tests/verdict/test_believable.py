"""An accelerometer that is off by more than gravity reads so: no vehicle hides that by leaning."""

from __future__ import annotations

import numpy as np
import pytest

from companion.verdict import Cause, Finding, Verdict, believable
from tests.flights import flown, with_imu

FLIGHT = flown()
MIDDLE = FLIGHT.start + 0.5 * FLIGHT.duration


def accused(size: float, end: float | None = None) -> Verdict:
    imu = FLIGHT.imu().instance
    cause = Cause(
        "accel_bias", "imu", MIDDLE, end, sensor="accel", axis="x", size=size, sigma=0.1, unit="m/s²", imu=imu
    )
    finding = Finding("accel_bias", "imu", "error", MIDDLE, MIDDLE + 9.0, "accelerometer x", "", cause=cause)
    return Verdict("imu_suspect", "Suspect the IMU: accelerometer x.", (finding,), cause)


@pytest.mark.parametrize("size", [0.5, 3.0, 9.0])
def test_less_than_gravity_may_be_hidden_by_leaning(size: float) -> None:
    assert believable(accused(size), FLIGHT) == accused(size)


def test_more_than_gravity_is_not_believed_of_an_imu_that_does_not_read_it() -> None:
    said = believable(accused(25.0), FLIGHT)
    assert said.status == "insufficient_data"
    assert "it is not known yet which of them is wrong" in said.summary
    assert not said.findings
    imu = FLIGHT.imu()
    off = np.where(imu.t[:, None] > MIDDLE, [25.0, 0.0, 0.0], 0.0)
    assert believable(accused(25.0), with_imu(FLIGHT, accel=imu.accel + off)) == accused(25.0)


def test_what_is_over_is_believed_of_an_imu_that_read_it_while_it_lasted() -> None:
    imu, end = FLIGHT.imu(), MIDDLE + 3.0
    off = np.where(((imu.t > MIDDLE) & (imu.t <= end))[:, None], [25.0, 0.0, 0.0], 0.0)
    said = accused(25.0, end)
    assert believable(said, with_imu(FLIGHT, accel=imu.accel + off)) == said
    assert believable(said, FLIGHT).status == "insufficient_data"
