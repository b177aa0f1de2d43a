"""The ranges to which an autopilot's drivers set the parts of an IMU, by the type of a part in its device id.

Sources: ArduPilot `AP_InertialSensor_*.cpp`; PX4 v1.16 `drivers/drv_sensor.h`, `drivers/imu/`.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from companion.model import STANDARD_GRAVITY
from companion.telemetry.samples import Ranges

_USUAL = (2000.0, 16.0)
_UNKNOWN = (None, None)
_RANGES: Mapping[str, Mapping[int | None, Ranges]] = {
    "ARDUPILOTMEGA": {
        None: _USUAL,  # of any other part
        0x2A: _UNKNOWN,  # SITL
        0x2B: (2000.0, 24.0),  # BMI088
        0x2E: (2000.0, 30.0),  # ICM20649
        0x30: (4000.0, 8.0),  # ICM20601
        0x31: (None, 40.0),  # ADIS1647x: 125, 500 or 2000 deg/s, by its model
        0x32: _UNKNOWN,  # external
        0x33: (2000.0, 32.0),  # ICM40609
        0x3B: (4000.0, 32.0),  # ICM45686
        0x3C: _UNKNOWN,  # SCHA63T
        0x3D: (4000.0, 32.0),  # IIM42653
    },
    "PX4": {
        # MPU6000, MPU9250, ICM42688P, ICM20948, ICM42605, MPU6500, ICM20602, ICM20608G, ICM20689
        **dict.fromkeys((0x21, 0x24, 0x26, 0x28, 0x29, 0x36, 0x38, 0x3A, 0x3C), _USUAL),
        0x25: (4000.0, 30.0),  # ICM20649
        0x41: (None, 16.0),  # BMI055, its accelerometer
        0x42: (2000.0, None),  # and its gyro
        0x66: (2000.0, None),  # BMI088, its gyro
        0x6A: (None, 24.0),  # and its accelerometer
    },
}
"""Autopilot → type (bits 16-23 of a device id) → deg/s and g; None where a driver has several, or it is not known."""


def part_ranges(autopilot: str, gyro_id: int | None, accel_id: int | None) -> Ranges:
    """rad/s and m/s², by the device ids of a gyro and an accelerometer; None where one is not known."""
    table = _RANGES.get(autopilot, {})
    (degrees, _), (_, g) = (
        table.get(part >> 16 & 0xFF, table.get(None, _UNKNOWN)) if part else _UNKNOWN for part in (gyro_id, accel_id)
    )
    return None if degrees is None else float(np.radians(degrees)), None if g is None else g * STANDARD_GRAVITY
