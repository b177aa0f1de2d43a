"""Flights with known truth, made from closed-form motions."""

from __future__ import annotations

from typing import Any

import numpy as np

from companion.strapdown import Motion
from companion.tracks import AttitudeTrack, Flight, ImuTrack, PositionTrack, Vehicle

VEHICLE = Vehicle(1, 1, "ARDUPILOTMEGA", "QUADROTOR")


def flight_of(motion: Motion, *, every: int = 1, **changes: Any) -> Flight:
    """An ideal IMU at the motion's times, and an autopilot that knows the truth at every `every`-th of them."""
    parts: dict[str, Any] = {
        "vehicle": VEHICLE,
        "boot": 1,
        "start": float(motion.t[0]),
        "duration": float(motion.t[-1] - motion.t[0]),
        "imus": {"RAW_IMU": ImuTrack(motion.t, motion.gyro, motion.accel, source="RAW_IMU")},
        "attitude": AttitudeTrack(motion.t[::every], motion.q_ned_frd[::every], motion.gyro[::every], "ATTITUDE"),
        "position": PositionTrack(
            motion.t[::every], motion.position[::every], motion.velocity[::every], "LOCAL_POSITION_NED"
        ),
    }
    return Flight(**(parts | changes))


def seconds(duration: float, rate_hz: float, start: float = 10.0) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Sample times."""
    return start + np.arange(round(duration * rate_hz) + 1) / rate_hz
