"""A vehicle with known truth: flies a closed form, measures it through the IMU model, speaks MAVLink. Deterministic."""

from companion.simulate.faults import Faults
from companion.simulate.flown import LOOP_US, MOTIONS, TYPICAL, Flown, fly
from companion.simulate.run import serve, write_flight
from companion.simulate.vehicle import SimulatedVehicle

__all__ = ["LOOP_US", "MOTIONS", "TYPICAL", "Faults", "Flown", "SimulatedVehicle", "fly", "serve", "write_flight"]
