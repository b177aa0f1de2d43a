"""Tolerances: what healthy parts, sensors, vehicles and estimators show. Without a source: engineering judgement."""

from math import pi, radians, sqrt

# Axes
AXIS_FOLLOWED = 0.7  # of a reading that motion explains: correct axes 0.8 and more, mirrored and exchanged ones less
AXES_MISFIT = 0.015  # g plus rad/s, of a good sensor
TRIM_RAD = radians(12.0)  # AHRS_TRIM reaches ±10°; more is another orientation

# Clipped, frozen and stuck readings
CLIPPED_MPS = 0.04  # 1σ of a clipped reading: a quarter of 16 g for 1 ms; autopilots count at 1 kHz or more
MIN_DENSITY = {"gyro": 1e-6, "accel": 1e-4}  # rad/s/√Hz, m/s²/√Hz: no sensor is quieter, but a simulated one
FROZEN_S = 0.5  # an IMU whose noise always shows does not read the same for so long
STUCK_S = 1.0  # an axis that reads the same for so long

# IMUs beside one another
DIFF_MIN_NOISE = {"gyro": 1e-4, "accel": 1e-3}  # rad/s, m/s²: 1σ of a block at least, the resolution of the messages
DIFF_MIN_WALK = {"gyro": 4e-5, "accel": 8e-4}  # per √s, at least: twice what the simulator's perfect parts show

# Measurements and keyframes
FIELD_ANOMALY = 0.04  # 1σ of local anomalies and of a compass calibration's scale, as part of the field
BIAS_SIGMA = (0.02, 0.08)  # rad/s, m/s², 1σ at the first keyframe: what real parts show (config/imu/README.md)
UNHEARD_MOTION = (2.0, 30.0, 100.0)  # rad, m/s, m per s: what may happen while the IMU is not heard
GYRO_WALK_SPREAD = 3.0  # factor, 1σ, by which the walks of gyros differ over ten real flights (docs/accuracy.md)
BIAS_RENEWED_S = 60.0  # unheard for so long, an IMU may have been recalibrated or have cooled: its bias is as at first
GPS_LATENCY_S = 0.1  # of an ordinary receiver: keyframes stand where its fixes were taken, as far as that is known
FIELD_MEAN_S = 0.1  # of a field either way, at most
MAX_MEDIAN_G = 10.0  # what turns hard for a while does not do so for half of a flight
UNEVEN_PERIOD = 0.2  # of a period,
UNEVEN_S = 0.004  # or s

# Noise and vibration
IMU_NOISE = ((5e-5, 0.5), (1e-3, 5.0))  # rad/s/√Hz, m/s²/√Hz: least and most of gyro and accelerometer
GYRO_SHARE = 0.5  # of what a gyro shows above 3 Hz: the rest is the vehicle, which its controller keeps turning
ALIASED = 0.25  # 1σ of a slow error, as part of the scatter of readings that are sampled too slowly for it
SCALE_SHOWS_RPS = 0.2  # below which a gyro's scale hardly shows
NOISE_OVER_DATA_SHEET = 10.0  # times, that vibration explains
TOO_QUIET = 0.02  # times the data sheet's noise

# Rest, biases and mounting
REST_LOUDER = 2.0  # times the quietest stretches, and still quiet
REST_CHANGE = (0.01, 0.15)  # rad/s, m/s² between keyframes: nothing at rest scatters by as much
REST_FORCE = 0.8  # of gravity, more or less: an accelerometer may be wrong
REST_TURN_RPS = 0.1  # about the vertical, as on a boat, which gravity does not show; about the other axes it would turn
REST_MPS = 0.5  # by GPS or estimator, or m above where it was armed, from which on a vehicle moves
REST_DRIFT_M = 1.0  # by the GPS velocity, that its position has to confirm
REST_DRIFT_CONFIRMED = 0.5  # part of it by which the position may say otherwise
REST_FORCE_SIGMAS = 12.0  # of a mean force by which neighbours differ where gravity turns: noise is correlated
MAGNETIC_HEADING_RAD = 0.05  # 1σ: what is left of hard and soft iron
UNKNOWN_HEADING_RAD = pi / sqrt(3.0)  # 1σ of any heading at all
UNDECLINED_HEADING_RAD = 0.2  # 1σ without the declination: most of the Earth is within 20°
WARMING_BIAS = (1.5e-3, 0.03)  # rad/s, m/s², within four minutes of flight
MOUNTING_RAD = 0.1  # 1σ
TIME_OFFSET_S = 0.05  # 1σ
LEVER_ARM_M = 0.3  # 1σ
LOCAL_GRAVITY = 0.05  # m/s²: gravity where the vehicle is, and steps of the readings
ATTITUDE_LAG_S = 0.02  # 1σ
GYRO_TIMES = 4.0  # times what calibration leaves: a gyro may be wrong as well
AP_HEADING_RAD = 0.1  # 1σ
USUAL_IRON = 15.0  # µT, 30 % of the field: what ArduPilot's CompassMot still calls acceptable of motor currents
USUAL_BIAS = {"gyro": 0.018, "accel": 0.2}  # SI: twice what 19 of 20 axes of 14 real vehicles stay below in flight
USUAL_SCALE = 0.03  # of any reading: the tolerance of an MPU-6000's gyro, whose scale no autopilot calibrates
AP_MIN_SIGMA = 1e-4  # rad, m/s: nobody is more certain
REST_CONTRAST = 3.0  # an armed vehicle that rests becomes this much louder when it flies
REST_SPREAD = (0.012, 0.2)  # rad/s, m/s²: a spread that no bench has; a boat at its moorings does
GROUND_M = 1.5  # the ground is within this of the lowest point

# The autopilot's estimator
AP_BIAS_MIN_SIGMA = {"gyro": 3e-4, "accel": 0.02}  # rad/s, m/s²
# quantity → s: what an estimator mends sooner by itself is no deviation
DEVIATION_S = {"tilt": 3.0, "heading": 6.0, "velocity": 3.0, "position": 3.0, "height": 5.0}
# m: of the spheres on which autopilots count degrees (ArduPilot's LOCATION_SCALING_FACTOR, PX4's geo.h)
SPHERES = (6_378_100.0, 6_371_000.0)
# 1σ of an estimator, by quantity: rad, m/s, m
AP_SIGMA = {"tilt": radians(0.7), "heading": radians(3.0), "velocity": 0.25, "position": 1.0, "height": 3.0}
ALIGNS_S = 10.0  # at rest, or in control in the air after tumbling

# Aiding sensors and jumps
EKF_UNFED_S = 2.0  # an estimator without anything new has hardly moved for so long
# tesla (HMC5883L: 4.35 mG), m (MS5611: 0.065 mbar, at sea level), m (1e-7° of latitude)
COARSEST_STEP = {"compass": 4.35e-7, "barometer": 0.55, "gps": 0.02}
GYRO_BIAS_RPS = 0.1  # of an even turn so much may be the gyro's bias
BAROMETER_DEGC = (-40.0, 85.0)  # for which barometers are made (MS5611, BMP280, BMP388, DPS310, LPS22 alike)
FASTEST_IMU_HZ = 32_000.0  # ICM-42688-P: the highest output rate of such parts
MAX_MPS2 = 60.0  # m/s²: of vehicles that these autopilots fly
GPS_DRIVER_DELAY_S = (0.08, 0.22)  # by the receiver, where none is set (ArduPilot, get_lag of AP_GPS_SBF and _UBLOX)
GPS_HEIGHT_WANDER_M = 1.5  # 1σ: how far the heights of a healthy GPS wander meanwhile
EKF_RECOVERS_S = 20.0  # after a sensor reads anew its estimator may still be converging

# Phases and loss of control
FLIP_S = 2.5  # what was caught sooner was a flip: ArduCopter gives up one that takes longer (mode_flip.cpp)
LYING_SCATTER = 0.2  # m/s² on every axis: what lies as still does not fall, though its attitude turns over
ATTITUDE_FOLLOWS_S = 2.0  # that a vehicle may take to follow another desired attitude
EKF_YOUNG_S = 60.0  # since boot: until then an estimator may still be finding its heading
HEADING_SETTLED_RAD = radians(2.0)  # at rest
REST_GYRO_BIAS_RPS = 0.02  # of a gyro at rest
HANDLED_RPS = 0.03  # less, and a vehicle is not being turned
