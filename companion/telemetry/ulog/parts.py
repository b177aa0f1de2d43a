"""What PX4's driver makes of a sensor, known by the type in its device id: the range that it is set to.

Sources: PX4 v1.16 `drivers/drv_sensor.h` for the types, `drivers/imu/` for the ranges, which the drivers write into the
sensor when they start. A type whose driver has several, or that is not known here, has none.
"""

from __future__ import annotations

import numpy as np

from companion.model import STANDARD_GRAVITY

_PARTS: dict[int, tuple[str, float | None, float | None]] = {
    0x21: ("MPU6000", 2000.0, 16.0),
    0x24: ("MPU9250", 2000.0, 16.0),
    0x25: ("ICM20649", 4000.0, 30.0),
    0x26: ("ICM42688P", 2000.0, 16.0),
    0x28: ("ICM20948", 2000.0, 16.0),
    0x29: ("ICM42605", 2000.0, 16.0),
    0x36: ("MPU6500", 2000.0, 16.0),
    0x38: ("ICM20602", 2000.0, 16.0),
    0x3A: ("ICM20608G", 2000.0, 16.0),
    0x3C: ("ICM20689", 2000.0, 16.0),
    0x41: ("BMI055", None, 16.0),
    0x42: ("BMI055", 2000.0, None),
    0x66: ("BMI088", 2000.0, None),
    0x6A: ("BMI088", None, 24.0),
}
"""Type → part, range of the gyro in °/s and of the accelerometer in g."""


def _type(device_id: int) -> int:
    return device_id >> 16 & 0xFF  # uORB device::DeviceId: bus type and number, address, type


def gyro_range(device_id: int) -> float | None:
    """rad/s; None where it is not known."""
    _, degrees, _ = _PARTS.get(_type(device_id), ("", None, None))
    return None if degrees is None else float(np.radians(degrees))


def accel_range(device_id: int) -> float | None:
    """m/s²; None where it is not known."""
    _, _, g = _PARTS.get(_type(device_id), ("", None, None))
    return None if g is None else g * STANDARD_GRAVITY
