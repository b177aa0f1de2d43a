"""Strapdown integration: IMU tracks in, trajectories out. The seeds, as arrays; imports tracks and NumPy alone."""

from companion.strapdown import motions, quaternion
from companion.strapdown._signal import MIDDLES
from companion.strapdown.gravity import normal_gravity
from companion.strapdown.increments import METHODS, Increments, attitude_at, dense_attitude, increments
from companion.strapdown.motions import Motion
from companion.strapdown.reckon import Preintegration, preintegrate, reckon
from companion.strapdown.reckoner import Reckoner

__all__ = [
    "METHODS",
    "MIDDLES",
    "Increments",
    "Motion",
    "Preintegration",
    "Reckoner",
    "attitude_at",
    "dense_attitude",
    "increments",
    "motions",
    "normal_gravity",
    "preintegrate",
    "quaternion",
    "reckon",
]
