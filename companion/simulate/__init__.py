"""A vehicle with known truth: flies a closed form, measures it through the IMU model, speaks MAVLink. Deterministic."""

from companion.simulate.aiding_sensors import GPS_SIGMA, HOME, Witnesses, pressure, witness
from companion.simulate.circuit import square
from companion.simulate.faults import Faults
from companion.simulate.run import serve, write_flight
from companion.simulate.true_flight import LOOP_US, MOTIONS, TYPICAL, Flown, fly, low_pass
from companion.simulate.vehicle import PARAMETERS, SimulatedVehicle

__all__ = [
    "GPS_SIGMA",
    "HOME",
    "LOOP_US",
    "MOTIONS",
    "PARAMETERS",
    "TYPICAL",
    "Faults",
    "Flown",
    "SimulatedVehicle",
    "Witnesses",
    "fly",
    "low_pass",
    "pressure",
    "serve",
    "square",
    "witness",
    "write_flight",
]
