"""What a simulated autopilot says of its state: its estimator's flags and test ratios, vibration, landed or not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.simulate.true_flight import Flown

Steps = npt.NDArray[np.int64]
Fields = Mapping[str, npt.NDArray[Any] | int]

_ALIGNED = 0b11_0011_1111  # ESTIMATOR_STATUS_FLAGS: attitude, velocity, position and height are known
_RATIO = 0.05  # of an innovation to what it may be, in an estimator that is well
_LOCAL_NED, _ON_GROUND, _IN_AIR = 1, 1, 2  # MAV_FRAME, MAV_LANDED_STATE
_ALOFT_M = 0.1
_COVARIANCE = 21  # elements; the first is NaN where it is not known


_RATIOS = {
    "EKF_STATUS_REPORT": ("velocity_variance", "pos_horiz_variance", "pos_vert_variance", "compass_variance"),
    "ESTIMATOR_STATUS": ("vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio"),
}
_AXES = ("vibration_x", "vibration_y", "vibration_z")

STATUS = frozenset({*_RATIOS, "VIBRATION", "EXTENDED_SYS_STATE", "ODOMETRY"})
"""Messages about the autopilot's state."""


def status_fields(name: str, flown: Flown, index: Steps, boot_us: Steps) -> Fields:
    """The fields of a message about the state at loop steps (N,), at times (N,) µs after boot."""
    if name == "EXTENDED_SYS_STATE":
        return {"landed_state": np.where(-flown.truth.position[index, 2] > _ALOFT_M, _IN_AIR, _ON_GROUND)}
    stamp: Fields = {} if name == "EKF_STATUS_REPORT" else {"time_usec": boot_us}
    if name == "VIBRATION":
        return {**stamp, **dict.fromkeys(_AXES, 1)}
    if name == "ODOMETRY":
        return {**stamp, **_odometry(flown, index)}
    return {**stamp, **dict.fromkeys(_RATIOS[name], np.full(len(index), _RATIO)), "flags": _ALIGNED}


def _odometry(flown: Flown, index: Steps) -> Fields:
    """As PX4's: both frames are local NED."""
    unknown = np.full((len(index), _COVARIANCE), np.nan)
    names = ("x", "y", "z", "vx", "vy", "vz", "rollspeed", "pitchspeed", "yawspeed")
    columns = np.hstack([flown.position[index], flown.velocity[index], flown.rates[index]]).T
    known = dict(zip(names, columns, strict=True)) | {"q": flown.q_ned_frd[index]}
    frames = {"frame_id": _LOCAL_NED, "child_frame_id": _LOCAL_NED}
    return {**known, **frames, "pose_covariance": unknown, "velocity_covariance": unknown}
