"""Which of several causes the verdict is about."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from companion.analysis.finding import Cause, Finding, Side
from companion.analysis.verdict import decide


def cause(kind: str, side: Side, onset: float, sigma: float | None, sensor: str) -> Finding:
    about = Cause(kind, side, onset, onset_sigma_s=sigma, sensor=sensor)
    return Finding(kind, side, "error", onset, 100.0, f"{kind} seen", "do this", f"{kind} seen", about)


VAGUE = cause("accel_scale", "imu", 66.6, 3.6, "accel")


@pytest.mark.parametrize(
    ("other", "first"),
    [
        (cause("accel_bias", "imu", 68.9, 0.2, "accel"), "accel_bias"),
        (cause("stuck_axis", "imu", 68.9, None, "accel"), "stuck_axis"),
        (cause("accel_bias", "imu", 68.9, 5.0, "accel"), "accel_scale"),
        (cause("accel_bias", "imu", 80.0, 0.2, "accel"), "accel_scale"),
        (cause("gyro_bias", "imu", 68.9, 0.2, "gyro"), "accel_scale"),
        (cause("heading_off", "autopilot", 68.9, None, ""), "accel_scale"),
    ],
)
def test_of_one_sensors_causes_that_may_have_begun_together_the_surest_time_counts(other: Finding, first: str) -> None:
    judged: Any = SimpleNamespace(start=range(5), excluded={})
    expected: Any = SimpleNamespace(inside={"attitude": 0.5})
    verdict = decide(judged, expected, (VAGUE, other), None)
    assert verdict.status == "imu_suspect"
    assert verdict.summary == f"Suspect the IMU: {first} seen."
    assert verdict.cause is not None
    assert verdict.cause.kind == first
