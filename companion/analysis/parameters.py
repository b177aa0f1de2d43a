"""The parameters of the vehicle that say how a sensor sits and how late it is: their names, and what would mend them.

ArduPilot: AP_AHRS (AHRS_ORIENTATION turns every IMU of the board, and its internal compasses), AP_Compass
(COMPASS_ORIENT, of external ones alone; AP_Compass_Backend.cpp, rotate_field). PX4: SENS_BOARD_ROT, and CAL_MAGn_ROT,
-1 for an internal compass (lib/sensor_calibration/Magnetometer.cpp). Both take a reading by it into the body.
"""

from __future__ import annotations

import numpy as np

from companion.constants import check
from companion.model import ORIENTATIONS, Array, Flight, orientation_name, orientation_number, orientations
from companion.strapdown import quaternion


def parameter(flight: Flight, *names: str) -> tuple[str, float] | None:
    """The first of these that the log has, and its value when it began; None where it has none."""
    return next(((name, flight.parameters[name]) for name in names if name in flight.parameters), None)


def board_orientation(flight: Flight) -> str:
    """What the orientation of the board is called; in general words at an autopilot that is not known."""
    return {"ARDUPILOTMEGA": "AHRS_ORIENTATION", "PX4": "SENS_BOARD_ROT"}.get(
        flight.vehicle.autopilot, "the orientation of the board"
    )


def compass_orientation(flight: Flight, instance: int) -> str:
    """The same of a compass."""
    number = "" if instance == 0 else str(instance + 1)
    return {"ARDUPILOTMEGA": f"COMPASS_ORIENT{number}", "PX4": f"CAL_MAG{instance}_ROT"}.get(
        flight.vehicle.autopilot, "the orientation of the compass"
    )


def is_internal(flight: Flight, instance: int) -> bool | None:
    """Whether a compass turns with the board; None where the log does not tell."""
    number = "" if instance == 0 else str(instance + 1)
    external = parameter(flight, f"COMPASS_EXTERN{number}", f"COMPASS_EXTERNAL{number}")
    if external is not None:
        return external[1] == 0.0
    rotation = parameter(flight, f"CAL_MAG{instance}_ROT")
    return None if rotation is None else rotation[1] < 0.0


def mended(flight: Flight, name: str, turn: Array, turned_by: str = "") -> str:
    """The value of an orientation by which its readings would be turned further by a rotation (4,), in words.

    turned_by: what its readings are turned by now, where that is another parameter. Where the log does not have what is
    set now, the turn itself; where that, or the value, is none of the list, the name alone.
    """
    now = flight.parameters.get(turned_by or name, np.nan)
    if not 0 <= now < len(ORIENTATIONS):
        further, apart = orientation_number(turn)
        listed = apart < check.ORIENTATION_EXACT_RAD
        return f"{name} (turned further by {orientation_name(further)})" if listed else name
    number, apart = orientation_number(quaternion.multiply(turn, orientations()[int(now)]))
    if apart > check.ORIENTATION_EXACT_RAD:
        return name
    now_set = "" if turned_by else f"; now {now:g}"
    return f"{name} to {number} ({orientation_name(number)}{now_set})"
