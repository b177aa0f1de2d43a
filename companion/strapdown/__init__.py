"""Strapdown integration: IMU tracks in, trajectories out. Arrays throughout; imports tracks and NumPy alone."""

from companion.strapdown import motions, quaternion
from companion.strapdown._methods import METHODS
from companion.strapdown._signal import MIDDLES
from companion.strapdown._window_sums import skew
from companion.strapdown.covariance import MOVED, Propagation, Sums, error_sums, joined, propagate
from companion.strapdown.dead_reckon import SAME_TIME, Preintegration, dead_reckon, preintegrate
from companion.strapdown.dead_reckoner import DeadReckoner
from companion.strapdown.gravity import normal_gravity
from companion.strapdown.imu_model import ImuModel, Sensor, correct, simulate
from companion.strapdown.increments import Increments, dense_attitude, increments
from companion.strapdown.motions import Motion
