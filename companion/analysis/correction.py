"""The constant errors of an IMU: what a calibration looks for, and what is taken from the readings afterwards."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Final

import numpy as np

from companion.model import Array, ImuTrack
from companion.strapdown import quaternion

PARTS: Final[Mapping[str, slice]] = {
    "gyro_bias": slice(0, 3),
    "accel_bias": slice(3, 6),
    "mounting": slice(6, 9),
    "time_offset": slice(9, 10),
    "gyro_scale": slice(10, 13),
    "accel_scale": slice(13, 16),
    "gyro_misalignment": slice(16, 22),
    "accel_misalignment": slice(22, 25),
    "lever_arm": slice(25, 28),
}
"""The attributes of a Correction, and their places when all are one vector."""

GYRO_MISALIGNED: Final = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))
ACCEL_MISALIGNED: Final = ((1, 0), (2, 0), (2, 1))
"""Row and column of each misalignment in its sensor's matrix. The accelerometer's is lower triangular: it defines the
IMU's axes, which `mounting` turns into the attitude's (Rehder et al. 2016, Extending kalibr)."""

_AXES = {3: ("x", "y", "z"), 1: ("",), 6: tuple("xyz"[i] + "xyz"[j] for i, j in GYRO_MISALIGNED)}
NAMES: Final = tuple(
    f"{part}_{axis}".rstrip("_")
    for part, place in PARTS.items()
    for axis in (
        tuple("xyz"[i] + "xyz"[j] for i, j in ACCEL_MISALIGNED)
        if part == "accel_misalignment"
        else _AXES[place.stop - place.start]
    )
)
"""One name for each figure, in the order of the vector."""


@dataclass(frozen=True, slots=True, eq=False)
class Correction:
    """What is taken from an IMU's readings: true = (1 + [mounting]x)(1 + E)(measured - bias), at t - time_offset.

    E is a sensor's matrix of scale (diagonal) and misalignment. With a lever arm r, what the IMU feels only because it
    is not at the body's origin is taken from the specific force: α x r + ω x (ω x r).
    """

    gyro_bias: Array = field(default_factory=lambda: np.zeros(3))  # rad/s
    accel_bias: Array = field(default_factory=lambda: np.zeros(3))  # m/s²
    mounting: Array = field(
        default_factory=lambda: np.zeros(3)
    )  # rad, small rotation of the IMU's axes into those of the attitude, FRD
    time_offset: float = 0.0  # s by which the IMU's times lag behind the autopilot's estimate
    gyro_scale: Array = field(default_factory=lambda: np.zeros(3))  # part of the reading that is missing
    accel_scale: Array = field(default_factory=lambda: np.zeros(3))
    gyro_misalignment: Array = field(default_factory=lambda: np.zeros(6))  # rad, in the order of GYRO_MISALIGNED
    accel_misalignment: Array = field(default_factory=lambda: np.zeros(3))  # rad, in the order of ACCEL_MISALIGNED
    lever_arm: Array = field(
        default_factory=lambda: np.zeros(3)
    )  # m, FRD, from the point whose position the autopilot reports to the IMU

    @classmethod
    def of(cls, values: Array) -> Correction:
        """From one vector (28,) in the order of PARTS."""
        parts = {name: values[place] for name, place in PARTS.items() if name != "time_offset"}
        return cls(**parts, time_offset=float(values[PARTS["time_offset"]][0]))

    @property
    def values(self) -> Array:
        """All as one vector (28,) in the order of PARTS."""
        return np.concatenate([np.atleast_1d(getattr(self, f.name)) for f in fields(self)])

    def apply(self, track: ImuTrack) -> ImuTrack:
        """The track freed of these errors; itself where there are none."""
        if not self.values.any():
            return track
        turn = np.eye(3) + np.cross(self.mounting, np.eye(3)).T
        gyro_matrix = _matrix(self.gyro_scale, self.gyro_misalignment, GYRO_MISALIGNED)
        accel_matrix = _matrix(self.accel_scale, self.accel_misalignment, ACCEL_MISALIGNED)
        gyro = (track.gyro - self.gyro_bias) @ (turn @ gyro_matrix).T
        accel = (track.accel - self.accel_bias) @ (turn @ accel_matrix).T
        if self.lever_arm.any() and len(track) > 1:
            # differences of the noisy rate are noisy, but telescope in the integral that they are made for
            angular = np.gradient(gyro, track.t, axis=0)
            swing = quaternion.cross(gyro, self.lever_arm)
            accel = accel - quaternion.cross(angular, self.lever_arm) - quaternion.cross(gyro, swing)
        return replace(track, t=track.t - self.time_offset, gyro=gyro, accel=accel)


NO_CORRECTION: Final = Correction()


def _matrix(scale: Array, misalignment: Array, places: tuple[tuple[int, int], ...]) -> Array:
    matrix = np.diag(1.0 + scale)
    rows, columns = zip(*places, strict=True)
    matrix[rows, columns] = misalignment
    return matrix
