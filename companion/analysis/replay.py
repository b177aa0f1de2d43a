"""The flight twice on one time axis: as the autopilot had it and as the IMU alone would have it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from companion.tracks import Array

BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """Both trajectories at the same times, and the error between them.

    Without a position source the autopilot's position and velocity are zero throughout, the IMU's are
    held at zero too, and `has_position` is False: only the attitudes mean something.
    """

    t: Array  # (N,) s, boot clock
    q_imu: Array  # (N, 4) wxyz NED/FRD, the IMU's reckoning
    velocity_imu: Array  # (N, 3) NED m/s
    position_imu: Array  # (N, 3) NED m
    q_ref: Array  # (N, 4) the autopilot's
    velocity_ref: Array  # (N, 3)
    position_ref: Array  # (N, 3)
    attitude_error: Array  # (N, 3) rotation vector of q_ref ⊗ q_imu⁻¹ in NED, rad
    velocity_error: Array  # (N, 3) autopilot minus IMU, NED m/s
    position_error: Array  # (N, 3) autopilot minus IMU, NED m
    anchors: Array  # (A,) s, where the reckoning was (re)started from the autopilot's state
    has_position: bool
    reference_valid: BoolArray  # (N,) False where the autopilot's messages have a hole: its state is interpolated
