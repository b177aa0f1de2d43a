"""The lanes of a redundant estimator: each core or instance with its own attitude, velocity and position."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from companion.model.aiding import SensorInUse
from companion.model.checks import floats, times
from companion.model.tracks import Array, Sampled


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class EstimatorLane(Sampled):
    """One core of an EKF, one instance of EKF2, or DCM: what it estimated, whether or not the vehicle flew by it."""

    t: Array  # (N,) s, strictly increasing
    q_ned_frd: Array  # (N, 4) wxyz, in the body frame of the IMU tracks
    velocity: Array  # (N, 3) NED, m/s; NaN where it is not logged, or not valid
    position: Array  # (N, 3) NED, m; NaN alike. The zero is the estimator's own
    name: str  # "EKF3 core 0", "EKF2 instance 1", "DCM"
    core: int | None = None  # its number among those that may fly; None for a fallback, which has none
    source: str = ""  # XKQ[0], estimator_attitude_1, AHRS2, ...
    imu: int | None = None  # the IMU that it reads; None: unknown
    sensors: Mapping[str, SensorInUse] = field(default_factory=dict)  # "GPS", "compass", ... → the one that it uses

    def __post_init__(self) -> None:
        times(f"{self.source}.t", self.t)
        floats(f"{self.source}.q_ned_frd", self.q_ned_frd, (len(self.t), 4))
        for name in ("velocity", "position"):
            floats(f"{self.source}.{name}", getattr(self, name), (len(self.t), 3), finite=False)

    @property
    def has_position(self) -> bool:
        """Whether any position of it is known."""
        return bool(np.isfinite(self.position).any())
