"""MAVLink messages → tracks: SI units, FRD and NED, one clock per flight. Knows no physics."""

from companion.telemetry.convert import IMU_MESSAGES
from companion.telemetry.flights import flights
from companion.telemetry.split import Bystander
from companion.telemetry.ulog import ulog_flight

__all__ = ["IMU_MESSAGES", "Bystander", "flights", "ulog_flight"]
