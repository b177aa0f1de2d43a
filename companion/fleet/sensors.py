"""Which sensors a flight flew with, as its parameters and texts name them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from companion.tracks import Flight, StatusText

_SERIAL = re.compile(r"\b([0-9A-F]{8} [0-9A-F]{8} [0-9A-F]{8})\b")
"""ArduPilot's banner gives the processor's unique id so (AP_HAL_ChibiOS/Util.cpp, get_system_id)."""


def sensor_ids(flight: Flight, sensor: str) -> dict[str, int]:
    """IMU message → the autopilot's id of its "gyro" or "accel", where the parameters are in the log.

    ArduPilot: INS_GYR_ID, INS_GYR2_ID, ...; INS_ACC_ID, ...; PX4: CAL_GYRO0_ID, ..., CAL_ACC0_ID, .... The id holds bus,
    address and type of the part (AP_InertialSensor, DevTypes): two boards of a kind have the same.
    """
    found: dict[str, int] = {}
    for name, track in flight.imus.items():
        identity = next((flight.parameters[p] for p in _names(sensor, track.instance) if p in flight.parameters), 0.0)
        if identity:
            found[name] = int(identity)
    return found


def board_of(texts: Iterable[StatusText], parameters: Mapping[str, float]) -> str | None:
    """The flight controller's serial number: what its banner says, else BRD_SERIAL_NUM; None when neither is known."""
    for said in texts:
        if match := _SERIAL.search(said.text):
            return match[1]
    number = parameters.get("BRD_SERIAL_NUM", 0.0)
    return str(int(number)) if number else None


def _names(sensor: str, instance: int) -> tuple[str, ...]:
    ardupilot = {"gyro": "INS_GYR", "accel": "INS_ACC"}[sensor]
    px4 = {"gyro": "CAL_GYRO", "accel": "CAL_ACC"}[sensor]
    number = "" if instance == 0 else str(instance + 1)
    return f"{ardupilot}{number}_ID", f"{px4}{instance}_ID"
