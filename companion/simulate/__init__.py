"""A vehicle with known truth: flies a closed form, measures it through the IMU model, speaks MAVLink. Deterministic."""

from companion.simulate.circuit import square
from companion.simulate.faults import Faults
from companion.simulate.flown import LOOP_US, MOTIONS, TYPICAL, Flown, fly, low_pass
from companion.simulate.run import serve, write_flight
from companion.simulate.vehicle import PARAMETERS, SimulatedVehicle
from companion.simulate.witnesses import GPS_SIGMA, HOME, Witnesses, pressure, witness

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
