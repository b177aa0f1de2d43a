"""A simulated vehicle with known truth: a motion in closed form, the IMU model, MAVLink. Deterministic."""

from companion.simulate.true_flight import (
    GPS_SIGMA,
    HOME,
    LOOP_US,
    MOTIONS,
    TYPICAL,
    AidingReadings,
    Faults,
    Flown,
    aiding_readings,
    fly,
    low_pass,
    pressure,
    square,
)
from companion.simulate.vehicle import PARAMETERS, SimulatedVehicle, serve, write_flight
