"""Strapdown integration: IMU tracks in, trajectories out. Arrays throughout; imports tracks and NumPy alone."""

from companion.strapdown import motions, quaternion
from companion.strapdown.covariance import MOVED, Propagation, Sums, error_sums, joined, left_jacobian, propagate, skew
from companion.strapdown.dead_reckon import (
    SAME_TIME,
    DeadReckoner,
    Preintegration,
    bend,
    dead_reckon,
    normal_gravity,
    preintegrate,
    sample_at,
)
from companion.strapdown.imu_model import ImuModel, Sensor, correct, simulate
from companion.strapdown.increments import METHODS, MIDDLES, Increments, dense_attitude, increments
from companion.strapdown.motions import Motion
