"""The MAVLink messages that carry an IMU: the one table of their names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ImuMessage:
    """A message of an IMU, and of the magnetometer beside it."""

    instance: int  # which of the vehicle's IMUs; HIGHRES_IMU carries its own where it is another
    rank: int  # 0: preferred for integration
    clock: str  # "time_boot_ms": when it was sampled, on every autopilot; "time_usec": perhaps when it was sent
    numbered: bool = False  # one of SCALED_IMU, 2 and 3: an IMU by its number


IMU_MESSAGES: Mapping[str, ImuMessage] = {
    "RAW_IMU": ImuMessage(0, rank=1, clock="time_usec"),
    "SCALED_IMU": ImuMessage(0, rank=2, clock="time_boot_ms", numbered=True),
    "SCALED_IMU2": ImuMessage(1, rank=3, clock="time_boot_ms", numbered=True),
    "SCALED_IMU3": ImuMessage(2, rank=4, clock="time_boot_ms", numbered=True),
    "HIGHRES_IMU": ImuMessage(0, rank=0, clock="time_usec"),
}


def by_preference() -> list[str]:
    """The names, that of the message to integrate first; see `Flight.default_imu`."""
    return sorted(IMU_MESSAGES, key=lambda name: IMU_MESSAGES[name].rank)
