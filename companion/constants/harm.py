"""Harmful sizes: from which on an error matters."""

from math import radians

from companion.model import STANDARD_GRAVITY

# IMUs beside one another
LIVELY = {"gyro": 0.2, "accel": 1.5}  # rad/s, m/s² rms of an axis from which on its scale shows, not its noise

# Evidence and the scan over hypotheses
NUISANCE = 0.2  # 1σ of nuisances, as part of the harmful size: at that size both are equally likely
CREEP_M = 15.0  # against a healthy GPS, the only other height: 3 σ of it

# The autopilot's estimator
# rad, m/s, m: the least deviation. A GPS is off by 13 m in 5 % of all heights (GPS SPS Performance Standard, 2020)
AP_ERROR = {"tilt": radians(2.0), "heading": radians(8.0), "velocity": 1.0, "height": 10.0}
AP_ERROR_SIGMA = {"tilt": radians(10.0), "heading": radians(40.0), "velocity": 5.0, "position": 30.0, "height": 50.0}
# what may be off → the SI size from which on it is no use to have looked
UNDETECTABLE = {
    "gyro_bias": 0.1, "accel_bias": 3.0, "tilt": radians(20.0), "heading": radians(45.0), "position": 50.0,
    "gps": 100.0, "compass": radians(90.0),
}  # fmt: skip
AP_BIAS = {"gyro": 3e-3, "accel": 0.1}  # rad/s, m/s²: of a real, calibrated part
MOUNTING_RAD = radians(2.0)

# Rest, biases and mounting
# Three IMUs were off by 0.4 rad/s, 2.0, 1.1 m/s²; of the compass as of one that a magnet comes near in flight
# One accelerometer read 20 % too little; a range that is set wrongly is a factor of 2
CONSTANT_FAULT_SIGMA = {"gyro": 0.2, "accel": 2.0, "compass": 30.0, "scale": 0.3}  # rad/s, m/s², µT, none
MOUNTING_MIN_RAD = radians(1.0)  # below, it is not reported
ATTITUDE_LAG_S = 0.005
LEVER_ARM_M = 0.05
FLOWN_M = 2.0  # a flight is higher than this

# Aiding sensors and jumps
DECLINATION_RAD = radians(4.0)  # more than what iron leaves of a calibrated compass (healthy.MAGNETIC_HEADING_RAD)
GPS_DELAY_M = 1.0  # a setting by which the position lags so far: what a healthy receiver is off by
ANTENNA_M = 0.3  # from where it is set to be
FROZEN_MPS = 1.0  # by GPS: a gyro that reads a turn at rest is off itself
FIX_JUMP_M = 10.0  # beyond what velocities say: far more than what two fixes of a healthy receiver differ by
GPS_OUTAGE_S = 5.0  # an accelerometer that is off by 0.1 m/s² has moved a dead-reckoned position by 1.25 m then
# m, m/s: with more, or fewer satellites, EKF3 does not begin with a GPS (ArduPilot AP_NavEKF3_VehicleStatus.cpp)
GPS_POOR = {"horizontal_sigma": 5.0, "vertical_sigma": 7.5, "speed_sigma": 1.0}
GPS_SATELLITES = 6
JAMMING = 80.0  # of 255 (PX4 User Guide, Log Analysis using Flight Review: above it is too much interference)

# Before take-off
WARMING_S = 240.0  # of flight, in which a gyro goes on warming as it does
COMPASS_HEADING_RAD = radians(
    20.0
)  # from the estimator's: ArduPilot refuses to arm (AP_AHRS.cpp, attitudes_consistent)

# Axes
AXES_MISFIT = 0.2  # g plus rad/s, from which on a far better rotation is enough
AXES_MIN_MISFIT = 0.04  # below it a bias explains it as well

# Clipped, frozen and stuck readings
CLIPPED_MOMENT_S = 0.05  # a shorter clipping is a shock, which no sensor is accused of
CLIPPED_S = 0.15  # in all, and it is none
# rad/s, 1.5 g in m/s²: nothing is so even there by chance
TOP_LEVEL = {"gyro": 1.0, "accel": 1.5 * STANDARD_GRAVITY}
MOVED_RAD = radians(1.0)  # at rest readings may repeat for ever: only a vehicle that moves shows a sensor that does not

# Measurements and keyframes
CLOCK_MOVED_S = 0.05  # a warning,
CLOCK_SPOILT_S = 0.1  # an error
LOW_RATE_HZ = 40.0  # RAW_IMU is low-passed at 20 Hz: below twice that, motion aliases into the samples
USELESS_RATE_HZ = 10.0

# Noise and vibration
VIBRATION_HIGH = 15.0  # m/s²
VIBRATION_LIMIT = 30.0  # m/s²: ArduPilot's documentation calls 30 the end of what is acceptable
VIBRATION_SAMPLED = 5.0  # m/s² that has come through the filter and the rate of a stream

# Phases and loss of control
OVERTURNED_RAD = radians(60.0)  # from level, of what flies by thrust alone; of every vehicle, from the desired attitude
TUMBLING_RPS = 10.0
OVERTURNED_S = 0.3  # PX4's FD_FAIL_R_TTRI: a failure of the attitude lasts as long
ALOFT_RPS = 0.05  # rms over a second, for a vehicle without a position
