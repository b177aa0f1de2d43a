"""Which sensors a flight flew with, as its parameters and texts name them."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from companion.model import Flight

_SERIAL = re.compile(r"\b([0-9A-F]{8} [0-9A-F]{8} [0-9A-F]{8})\b|^([0-9a-f]{32})$")
"""ArduPilot's banner gives the processor's unique id so (AP_HAL_ChibiOS/Util.cpp, get_system_id); its simulator's is
32 digits."""

_IDS = 2.0**32  # a device id has 32 bits: what is larger is damage


def sensor_ids(flight: Flight, sensor: str) -> dict[str, int]:
    """IMU message → the autopilot's id of its "gyro" or "accel", where the parameters are in the log.

    ArduPilot: INS_GYR_ID, INS_GYR2_ID, ..., INS_ACC_ID; PX4: CAL_GYRO0_ID, ..., CAL_ACC0_ID. The id holds the bus,
    address and type of the part (AP_InertialSensor, DevTypes): two boards of a kind have the same.
    """
    ids: dict[str, int] = {}
    for name, track in flight.imus.items():
        identity = next((flight.parameters[p] for p in _names(sensor, track.instance) if p in flight.parameters), 0.0)
        if identity and abs(identity) < _IDS:
            ids[name] = int(identity)
    return ids


def board_of(flights: Iterable[Flight]) -> str | None:
    """The serial number of a vehicle's flight controller: what its banner says in any of its flights (it comes once
    for a ground station), else BRD_SERIAL_NUM; None when neither is known.
    """
    number = 0.0
    for flight in flights:
        for said in flight.texts:
            if match := _SERIAL.search(said.text):
                return match[1] or match[2]
        number = flight.parameters.get("BRD_SERIAL_NUM", number)
    return str(int(number)) if number and abs(number) < _IDS else None


def temperatures(flight: Flight) -> dict[str, float]:
    """IMU message → its median temperature over the flight, °C, where the log has it."""
    medians: dict[str, float] = {}
    for name in flight.imus:
        if (series := flight.series.get(f"temperature:{name}")) is not None and len(series):
            known = series["temperature_degc"]
            known = known[np.isfinite(known)]
            if len(known):
                medians[name] = float(np.median(known))
    return medians


def _names(sensor: str, instance: int) -> tuple[str, ...]:
    ardupilot = {"gyro": "INS_GYR", "accel": "INS_ACC"}[sensor]
    px4 = {"gyro": "CAL_GYRO", "accel": "CAL_ACC"}[sensor]
    number = "" if instance == 0 else str(instance + 1)
    return f"{ardupilot}{number}_ID", f"{px4}{instance}_ID"
