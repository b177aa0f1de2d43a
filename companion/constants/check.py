"""How readings and estimates are checked: windows, fewest samples, margins, quantiles."""

from math import comb, log, radians

# The autopilot's estimator
OVERSHOOT = 2.0  # times what misled it: a height that is off by more has another cause
PARTED = 2.0  # times the 95 % bound of the NEES: what all windows share reaches so far in one flight of a million
NEAR_S = 5.0  # a fault and an estimator's deviation so close in time may be one event: onsets are blurred
SUDDEN_S = 1.0  # one that begins with a step of
SUDDEN = 0.5  # so much of itself need not last longer
DEVIATION_ONSET = 0.25  # of a deviation's peak, from where it rose
DEAD_RECKONED_S = 10.0  # for so long an IMU tells a velocity and a position
RATE_LAG_RPS = 0.1  # of turn, and
RATE_LAG_CHANGES = 10  # changes that tell of a lag
RATE_LAG_S = 0.1
WELL_KNOWN = 0.5  # of what a healthy estimator may be off by: an estimate known so well is judged as it is
KNOWN_BETTER = 0.5  # of the σ of a heading: that of its change, where the change is known far better
HEARTBEAT_S = 1.0  # in which a vehicle reports once whether it is armed, and that it is there
BEFORE_S = 2.0  # messages of the vehicle about a finding: a glitch is reported
AFTER_S = 15.0  # once the estimator has noticed
MAX_QUOTED = 2

# Evidence and the scan over hypotheses
STRIKING_SCATTER = 2.0  # times the usual scatter: readings that are rougher are not calm

# Aiding sensors and jumps
AGREES_PERCENTILE = 95.0  # of what the autopilot is off an aiding sensor by: says how far the two agree
REPEATS_BLOCK = 20  # readings;
REPEATS_MIN_BLOCKS = 10  # outside of such stretches that tell how often one is repeated
REPEATS_SELDOM = 0.5  # above it one repetition makes the next likelier, and chance is not told by their share
FROZEN_STEPS = 10.0  # of the coarsest sensor, that a reading has to have changed by
SYNTHETIC_FIELD = 1e-6  # of a field: a length that is the same to this, of three components that are not, is synthetic
FIX_MIN_INTERVAL_S = 0.05
FIX_JUMPS_MIN = 4  # fixes, and jumps in a group
FIX_JUMPS_GROUPED_S = 5.0
YAW_STEP_RATE_HZ = 20.0  # below it a turn between two samples looks like a step of the heading
YAW_STEP_S = 0.2  # windows in which a heading step is searched for
GROUPED_S = 1.0  # jumps, and shocks, closer than this are one finding
SETTING_KEYFRAMES = 20  # from which on a setting is compared with the flight
SETTING_PERCENTILES = (10.0, 90.0)  # of a heading error, that may differ by twice what an estimator is off by
SETTING_SWIFT = 90.0  # percentile of the speed
FIX_3D = 3  # GPS_FIX_TYPE
# EKF_STATUS_FLAGS and nav_filter_status (GPS glitching, dead reckoning), ESTIMATOR_STATUS_FLAGS (GPS glitch)
GPS_DOUBTED = {
    "EKF_STATUS_REPORT": 1 << 15, "XKF4": 1 << 14 | 1 << 18, "NKF4": 1 << 14, "ESTIMATOR_STATUS": 1 << 10,
    "estimator_status": 1 << 10,
}  # fmt: skip
JAMMED = 2  # jamming_state and spoofing_state: 0 unknown, 1 none, 2 mitigated or indicated, 3 detected or multiple

# Axes
AXES_WINDOW_S = 0.5  # over which turns and forces are averaged
AXES_MIN_WINDOWS = 10  # of those with motion, for units
AXES_MIN_SAMPLES = 4  # of such a mean: fewer tell of no motion between them
UNIT_FACTOR_LOG = log(1.5)  # within such a factor of the usual one,
UNIT_FACTOR_SHARE = 0.8  # in such a share of the windows
UNIT_AXIS_SHARE = 0.05  # of the squares about the axis with most: about others there is too little
UNIT_REST = 0.1  # of the squares of what is read, that the motion may leave
UNIT_MIN_FACTOR = 2.0  # or a half: what is less off is no unit
UNIT_TOLERANCE = 0.03  # by which a factor of units may be missed
ORIENTATION_READINGS = (30, 200)  # of a compass, at least and at most, that tell its orientation
ORIENTATION_EXACT_RAD = radians(1.0)  # from one of the list, within which it is that
ORIENTATION_BETTER = 0.5  # of the misfit of any other orientation, that the right one leaves

# Phases and loss of control
OUTPUT_FULL = 0.98  # of an output's range
AROUND_S = 1.0  # before control was lost and after, in which an output may have saturated
LEADS_TO_TUMBLING_RPS = 2.0  # what leads to a loss of control
CAUGHT_S = 2.0  # in control for so long, the vehicle has been caught
LOST_BEFORE_S = 3.0  # the vehicle is over, control may have been lost
DESIRED_FRESH_S = 0.5  # age of a desired attitude that still holds
LANDED_S = 1.0  # after the last motion, until which a vehicle may turn over,
CRASH_REPORTED_S = 10.0  # and a crash may be reported
WORTHLESS_S = 1.0  # evidence so shortly before control was lost, or a log ended, is worth nothing
ATTITUDE_VALID = 0b1  # ESTIMATOR_STATUS_FLAGS: attitude;
POSITION_VALID = 0b11000  # horizontal position, relative or absolute

# Rest, biases and mounting
LEVER_SIGMAS = 5.0  # standard errors from which on a lever arm is believed,
MOUNTING_SIGMAS = 3.0  # and a mounting
INSTALLED_MIN_WINDOWS = 5
INSTALLED_ROUNDS = 8
REST_BLOCK_S = 0.5  # a block is as long as both need
REST_BLOCK_SAMPLES = 5
REST_MIN_S = 3.0
REST_GRAVITY_SIGMA = 0.02  # m/s², 1σ of a length of gravity at rest: between two rests parts warm and settle
REST_QUIETEST = 5.0  # percentile of the blocks that is as quiet as this IMU gets
REST_CLUSTER_S = 0.25  # over which noise is averaged: filters make neighbouring samples alike

# Lanes of the estimator
SWITCH_JUDGED_S = 20.0  # after a change of lane, or until the next, over which both are compared

# The seconds around an incident
INCIDENT_BEFORE_S = 30.0
INCIDENT_AFTER_S = 5.0
NOT_FOLLOWED_RAD = radians(30.0)  # from the desired attitude: half of what counts as overturned
TAKING_OFF_S = 5.0  # after take-off: what tips over then was put together wrongly more often than not
AT_END_SHARE = 0.25  # of two seconds about the moment, that an output stands at an end of its range,
AT_END_USUAL = 0.05  # and of the time before

# Before take-off
PREFLIGHT_S = 60.0  # before arming or take-off, at most, that are looked at
WARMING_TOLD_S = 20.0  # that tell how a gyro warms: in less its slow noise looks like it
HIDING_STEPS = 0.3  # of quantisation: readings that scatter by less show no noise
# rad/s, m/s², rad between two: AP_Arming.cpp, Compass::consistent; PX4 COM_ARM_IMU_*, COM_ARM_MAG_ANG
PREARM_REPEATED_S = 35.0  # ArduPilot repeats its refusals every 30 s (AP_Arming.cpp)
PREARM_ARDUPILOT = {"gyro": radians(5.0), "accel": 0.75, "compass": radians(90.0)}
PREARM_THIRD_ACCEL = 3.0  # times as much from the third IMU on, which is as warm as it likes (ins_accels_consistent)
PREARM_GPS_SCALE = 100.0  # %, EK3_CHECK_SCALE: of what EKF3 asks of a GPS before it uses it
PREARM_PX4 = {"gyro": 0.25, "accel": 0.7, "compass": radians(60.0)}

# IMUs beside one another
MISSED_CONFIRMED = 0.5  # of what an axis missed, that another IMU has to have felt
MISSED_MIN = 3
MISSED_ALONG = 0.8  # part of a motion along the axis
MISSED_BEYOND_USUAL = 3.0  # times the usual
NOISIER_BLOCK_S = 2.0  # at least, and
NOISIER_BLOCK = 20  # samples: a scatter of 20 differences is known to 20 %
NOISIER_MIN_BLOCKS = 3
NOISIER_OTHERS = 10  # that tell what is usual
NOISIER_ORDER = 4  # of the differences: of a motion of 2 Hz at 100 Hz 0.03 % is left
NOISIER_GAIN = float(comb(2 * NOISIER_ORDER, NOISIER_ORDER))  # of the variance of white noise by them
NOISIER_MIN_SPREAD = 0.05  # of a logarithm: what scatters by less is known no better

# Clipped, frozen and stuck readings
REPEATED_SELDOM = 0.25  # of the samples of a second: an IMU that never repeats itself
REPEATED_OFTEN = 0.1  # one that always does
FLAT_TOP = 0.003  # of the level, that neighbours on a clipped top differ by
TOP_EDGE = 0.03  # of the level, that is lower beside it
TOP_SCATTER = 1.5  # times what neighbours differ by: as far many samples of noise are apart
TOP_S = 0.02  # of a top at least, and in which, and one sample, it is reached and left
TOP_SAMPLES = 3
TOP_RATE_HZ = 20.0  # slower, a top between two samples is not seen to be flat
TOP_STEPS = 3.0  # of the readings, that an edge has to have: else noise makes one
TOP_OTHERS = 1000  # the strongest other readings, which tell how often neighbours are alike
MIN_SECONDS = 10  # to tell whether an IMU repeats itself
MANY_STEPS = 50.0  # of quantisation
STUCK_KNOWN = 0.9  # of the stretch, that is known
BESIDE = 0.8  # of the stretch, that another axis may stand still with it
TURN_PART = 0.14  # of a stretch, over which the attitude turns: a step is in less than a fifth of such spans
STUCK_SAMPLES = 20.0  # of a window at least, which is a second or more
MOTION_MEAN_S = 0.2  # means of another IMU's readings, whose noise is not the vehicle's motion
NOISE_RANGE = 6.0  # σ of the quietest windows: hardly ever more is between the largest and the smallest reading
SOME_STEPS = 10.0  # of quantisation
STUCK_MIN_SAMPLES = 2  # of another IMU
STEP_ROUNDING = 1.01  # for sums of floats are no whole steps
FLOAT32_BIT = 2.0**-22  # of a reading,
FLOAT32_BITS = 2.0**-20  # and its last two bits more
STUCK_CHANGE = 0.005  # of what another axis changes by from sample to sample, or this one when it does
STUCK_USUAL = 0.99
STUCK_SWING = 4.0  # times what is nothing, between readings of an axis that is not stuck all the time
STUCK_FAR = 20.0  # changes from sample to sample, as they are on average
STUCK_MISSED = 0.8  # quantile of what a gyro does not read of the attitude's turns: a step is in less than a fifth
STUCK_QUIETER = 0.1  # than its quietest seconds
STUCK_CALM = 0.25  # of what the other axes change by in half of the flight

# Drift, consistency and replay
SHORT_S = 2.0  # windows whose residuals tell of tilt and heading
MAX_LIVE_WINDOWS = 40_000  # of a horizon. At 1 s that is 11 h; then the oldest are forgotten, which bounds the memory
LIVE_NEWEST_S = 2.5
LIVE_MIN = 8  # before the newest
JUST_S = 0.6  # from when on an axis that stands still can be judged: later, it has been
LIVE_TIMES = 3.0  # times
LIVE_USUAL = 90.0  # of the windows before

# Measurements and keyframes
GAP_PERIODS = 8.0  # from which on an interval is a gap
ARMS_S = 0.5  # from the first sample until the arming that began the logging is logged
LAG_PARTS = 3  # of the flight, that have to agree
LAG_GRID_S = 0.04
LAG_TURN_S = 0.2
LAG_MOMENTS = 4000  # of a part that are looked at: an hour's third has 30,000
LAG_MAX_S = 1.0
LAG_MIN_RPS = 0.05  # rms: less does not tell a lag
LAG_SHARP = 0.1  # part of the power, and of what is left beside it, that the best lag may leave
LAG_ASIDE = 5  # shifts
LAG_OVERSAMPLED = 10  # of the grid for each sample

# Noise and vibration
LONG_REST_S = 120.0  # long enough for an Allan deviation to show more than white noise
SHORT_REST_S = 10.0  # that shows white noise
FILTERED_PERIODS = 5.0  # of a low-pass's corner: τ below are not white noise's, which loses 1.5 % of N there

# What is said
ANY_BIAS = 100.0  # times the size that such faults have: no sensor reads so much
STALE_S = 5.0  # from which age of its data on a live verdict is none of now any more: it is renewed every 3 s
