"""Grids, iterations, windows, convergence, units."""

from math import log, pi

# Noise and vibration
FLICKER_VARIANCE = 2.0 * log(2.0) / pi  # Allan variance of bias instability B = 1: its root is 0.664
ALLAN_PER_DECADE = 10  # of averaging time τ
ALLAN_MAX_TAU = 0.25  # of the record: beyond, fewer than three independent differences remain
ALLAN_MIN_SAMPLES = 32
ALLAN_SIGMAS = 2.0  # standard errors above zero from which on a term is reported
ALLAN_PASSES = 4  # of reweighting
ALLAN_OCTAVES = 3.0  # of τ that count as one point: with it the 95 % intervals hold 95 % (test)
# Where learning begins: wide, some thirty times a data sheet, as vibration and aliasing make it. Walks are not learned:
# they are what warming parts show in flight (1.5 mrad/s, 0.03 m/s² in four minutes); free, they would swallow faults.
FIRST_PROCESS_NOISE = {"gyro_noise": 3e-3, "accel_noise": 5e-2, "gyro_walk": 1e-4, "accel_walk": 2e-3}
# Readings by which a density is believed to be what the spectrum shows, to a factor of two (1σ): a steady hover may
# show nothing of the gyro's noise, a band in motion more, and folded vibration less than what is integrated
DENSITY_PRIOR_READINGS = 1.0
TRUNCATED_S = 0.2  # for which the error of a truncated reading may stay the same
NOISE_STRETCHES = 12  # of the flight
TYPICAL_PERCENTILE = 65.0  # of the stretches: a third of a log may stand still, a third may hold a fault
RESTING_SHARE = 1.0 / 3.0  # of a log, from which on only what moves is learned of
MOVING_MIN_INTERVALS = 24  # or readings, that tell without what rests
CORRELATED_LAGS = 15  # of the autocorrelation of disturbances
FILTERED_NOISE = 3.0  # times what shows between samples or in spectra: a low-pass makes that less
AIDING_MAX_SCALE = 100.0  # of an aiding sensor's σ
AIDING_SCATTERS = 8.0  # times what its readings scatter by: beyond, it is no noise
SERIES_RATIO = 0.3  # of a step to the one before, either way, from which on the series is summed
SERIES_MAX_LOG = log(10.0)  # of a density in one pass, at most a factor of ten
SERIES_MAX_STEPS = 5.0  # times a plain step, at most: a ratio near 1 is seldom that of a series
RESTORED_OF_RATE = 0.4  # the highest frequency that is restored, whichever is less
RESTORED_OF_CORNER = 2.0
RESTORED_MIN_OF_CORNER = 0.5  # below it a low-pass removes hardly anything
RESTORED_ORDER = 8  # of the roll-off above
FILTER_LASTS = 4.0  # times 1 / corner, after which a sample's effect is over
FILTER_FREQUENCIES = 2048
VEHICLE_MOTION_S = 0.2  # moving mean that is taken for the vehicle's own motion, not vibration: 5 Hz
NOISE_BEYOND = 8.0  # times what spectra show: of a sensor with correct axes no more is learned
VEHICLE_MOTION_HZ = 3.0  # below it a vehicle flies, it does not vibrate
NOISE_MAX_HZ = 10.0  # well below the corner of ArduPilot's filters, 20 Hz by default
NOISE_MIN_BAND_HZ = 1.5  # a narrower band says nothing
NOISE_SEGMENT_S = 2.0  # short, so that a manoeuvre is in few of them
NOISE_MAX_SEGMENTS = 512  # as many as a median needs, spread evenly over the flight
NOISE_MIN_SEGMENTS = 4
NOISE_QUANTILE = 0.25  # over the frequencies: up to three quarters of them may hold vibration or motion
TWO_VALUES_SHARE = 0.85  # of the readings that two values have when noise is half a step
MOSTLY_ZERO_SHARE = 0.3
HIDDEN = 0.5  # steps of noise that quantisation hides
NOISE_BLOCKS = 8  # of time, for the standard error
FILTER_VISIBLE = 300.0  # a filter is fitted to 25 dB below its pass band: further down digital and analogue part ways
MEDIAN_EFFICIENCY = 0.48  # of an exponential variable, beside its mean: ln²2
MEAN_OF_INTERVAL = 0.7  # part of the sampling interval from which on a sample counts as its mean
HANN_BANDWIDTH = 1.5  # cells of a spectrum over which its window spreads a line (F. J. Harris 1978)
LINES_FROM = 0.25  # of the sampling rate: half of the band, below which a line may be the vehicle's own motion
ALIASED_CORNER = 0.4  # of a low-pass, as part of the sampling rate, from which on vibration is aliased
SCATTER_MIN_DIFFERENCES = 8
SHOCKS_SHARE = 0.02  # of readings, or intervals, in which the ground may be touched: they tell of no usual motion
SCATTER_S = 1.5  # either way, over which the noise is constant: vibration changes with throttle, in seconds
SCATTER_RANGE = (0.1, 30.0)  # times the median: bias walk and timing remain where nothing shakes
PSD_SEGMENT_S = 4.0  # a resolution of a quarter of a hertz
PSD_SAMPLES = (32, 4096)  # of a segment
PSD_BATCH = 128  # segments in memory, so that a day's log needs no more than a minute's
AVERAGED_S = 1.0  # over which vibration, noise and biases are averaged
# coefficients of 1, cos x, cos 2x, ...
SPECTRAL_WINDOWS = {"hann": (0.5, -0.5), "blackmanharris": (0.35875, -0.48829, 0.14128, -0.01168)}
PSD_PEAK = 4.0  # times the density around it, in power: 6 dB
PSD_AROUND_HZ = 6.0

# Axes
AXIS_SIGNAL_SIGMAS = 2.0  # times the noise, learned or by its spectrum, whichever is less
AXIS_MIN_INTERVALS = 30  # from which on axes are judged
AXIS_GAIN = 1.3  # times less noise without the suspected axes: what they spoil on the others comes on top
ONSET_SIGMAS = 2.0  # σ of an onset by which something began in flight: before, it may have been there from the start
DOUBTED_ONCE = 0.5  # at least, of a live fault that one verdict alone does not find again: they share most data
AXIS_SPAN_S = 100.0  # of which the worst stretch counts: a wrong axis is wrong all the time
AXIS_TRIAL_PASSES = 6  # that tell the ways apart: a contradiction is far from convergence then
AXIS_KEYFRAMES = 120  # in which a contradiction that lasts all the time shows as well as in more
ORIENTATION_HALF_RAD = pi / 8.0  # half of the least angle between two of the autopilots' orientations, 45°
AXIS_CLEARLY_BETTER = 2.0  # times less noise, in every interval and on every axis: not by chance

# Iteration and linear algebra
DIAGONAL_LOADING = (0.0, 1e-12, 1e-11, 1e-10)  # of the unit diagonal, tried in turn until it can be factorised
SHORT_CHAIN_BLOCKS = 16  # which LAPACK inverts one by one sooner than a loop over their rows all together
CACHED_BLOCKS = 512  # that stay in the processor's cache
ONSET_SIGMA_S = 0.05  # 1σ of an onset, at best
CONVERGED_MISFIT = 1e-3  # no state moves by more than three hundredths of its σ
UNSETTLED_MISFIT = 1.0  # some state would still move by its σ: what is estimated is not what fits best
FIELD_STEP = 1e-4  # µT, of a central difference
FIELD_SIGMAS = 8.0  # of the Earth's field by the model of it, a third: farther is another minimum of the misfit
SHORTENED_MIN = 0.1  # of a step, at least, when it is shortened
SHORTENED_MAX = 0.5
SHORTENED_TIMES = 2  # at most
SMOOTHER_PASSES = 20  # at most
LEARN_FROM_PASS = 1  # after which densities are learned
WEIGHTS_FROM_PASS = 4  # after which outliers weigh less, whether or not densities have settled
WEIGHTED_PASSES = 2  # at least
DENSITY_NEAR = 0.15  # change of the logarithm of a density
DENSITY_SETTLED = 0.05
LEARNING_MISFIT = 0.1  # that may be left to gain while the noise still changes a little with every pass
FINAL_PASSES = 4  # with the final noise, at most
BIAS_LINEAR = (4e-3, 0.1)  # rad/s, m/s²: a bias further off changes the path by more than its first order
BIAS_LINEAR_LEARNING = 5.0  # times as far it still changes it by less than the noise, while that is being learned
LIKELIHOOD_3 = 6.0  # twice the log likelihood of three axes in an interval, per log of their noise
HUBER = 4.0  # σ beyond which an outlier loses weight
HUBER_SPAN = 7  # neighbours whose median is the typical size
ABOVE_NOISE = 10.0  # times the noise, rms: errors in the variable make a scale wrong by the inverse square, 1 %
SHAKEN_MAX = 10.0  # times that an interval's noise may be larger: beyond, a GPS jump would pass for noise of the IMU
ROUNDING = 1e-8  # of an information, below which a difference is nothing but rounding
ROUNDED_BLOCK = 1e-5  # the same of its eigenvalues: those of an interval at rest are off by 6e-6
BATCH = 128  # keyframes: what is made on the way stays small

# IMUs beside one another
DIFF_BLOCK_S = 2.0  # over which differences are averaged
DIFF_MAX_BLOCKS = 250  # a longer flight has longer ones
DIFF_MIN_READINGS = 3  # of a block
DIFF_MIN_BLOCKS = 12
DIFF_GAP_S = 10.0  # after which the constant between two IMUs is free again
DIFF_GAP_BLOCKS = 1.5  # the same in blocks, where those are longer: one that is left out
DIFF_MAX_LAG = 10  # blocks over which a random walk is told from white noise: a step is in one of eight
DIFF_REACH = 3  # blocks either way from whose median an outlier stands apart: a step does not
DIFF_OUTLIER = 8.0  # median deviations: 5 σ of white noise
DIFF_OUTLIERS_SHARE = 0.1  # of the readings of a block, at most: more are the shorter side of a step
CHI_SQUARE_HALVINGS = 50
CHI_SQUARE_MANY = 100.0  # degrees of freedom, from which on the approximation is right to 4e-4
CHI_SQUARE_MEDIAN = 0.4549  # of one degree of freedom

# Measurements and keyframes
YEAR_S = 365.2425 * 86400.0  # Gregorian
UNDATED_YEAR = 2023.0  # where the log has no date; declination changes by some 0.1° a year
WMM_FIRST = 2010.0  # of the world magnetic models that pygeomag has
WMM_LAST = 2030.0
FIX_SAMPLES_S = 0.1  # between three samples about a keyframe, among which its fix was taken
STEP_FLOOR = (1e-6, 2e-5, 2e-5, 1e-9, 1e-8)  # 1σ of a step: rad, m/s, m, rad/s, m/s²
MICROTESLA = 1e6  # in a tesla
GAP_S = 0.6  # between three samples between which a value is interpolated; two that lie further apart: a gap
KEYFRAME_SPACING_S = (0.2, 2.0)  # at least and at most, but for what is longer than so many keyframes at most:
MAX_KEYFRAMES = 1200  # of some 24 states; with some twenty matrices each they take 200 MB
KEYFRAMES = 500  # a longer flight has them further apart
NO_GPS_SPACING_S = 0.5
FIELD_SAMPLES_S = 0.05  # between three samples between which the field was read, some hundredths of a second ago
FIELD_MEAN_RAD = 0.15  # the mean of a field that turns by so much is short by 0.4 %
MIN_FIXES = 5
GUESS_S = 2.0  # of a keyframe, either way: forces and fields whose mean the first guess is made of
MIN_SAMPLES = 20
MIN_INTERVALS = 8  # between keyframes, without a gap
MIN_RATE_HZ = 1.5  # below it two samples are further apart than a gap that is bridged
BRIDGED_GAP_S = 1.0  # in a longer one a vehicle may have turned by more than is linear
BRIDGED_LAGS = 4  # at which the structure function is taken

# Evidence and the scan over hypotheses
BEAT_S = 5.0  # for which aliased vibration may keep its sign: its mean falls with the time beyond
HOUR_S = 3600.0
LOG_ZERO = -1e6  # log evidence of what cannot be
Z_95 = 1.6448536  # one-sided 95 % point of the standard normal
MAX_SCALE = 0.6  # a range that is set wrong by a factor of two is off by half
KIND_MIN_READINGS = 8  # of an aiding sensor: fewer show no change
LATENCIES_RATIO = 2.0  # of each to the one before
LATENCIES_S = tuple(0.25 * LATENCIES_RATIO**i for i in range(4))  # about which it is made linear too
LATENCY_ROUNDS = 4  # at most
LATENCY_CONVERGED_S = 0.02
SCAN_MIN_KINDS = 3  # at a time
SCAN_SIZE = 16_000  # columns of 10 MB, and as much on the way
SCAN_STRETCHES = 25  # of the flight, between which changes are searched for first
REFINED_KINDS = 6  # the best on the coarse grid,
REFINED_OF_BEST = 0.5  # which explain half as much as the best there,
REFINED_LOG_BAYES = 2.0  # and anything
REFINEMENTS = 3
REFINED_POINTS = 7
ONSETS_PER_BLOCK = 5  # of differences between IMUs; of many blocks no more than a flight has keyframes
PULSE_MIN_S = {"imu": 5.0, "gps": 0.5, "compass": 2.0, "barometer": 2.0}  # what ends sooner is a shock, or a step
CHANGE_MIN_S = 1.0
CHANGE_MARGIN_S = 3.0  # of the flight's first seconds, where no change shows, at most this part of it
CHANGE_MARGIN = 0.1
CREEPS = {"gps_position": 30.0, "compass_field": 10.0}  # s of a slow drift that is stated as detectable
NEGLIGIBLE = 1e-12  # of a probability
DATA_SETS = 100  # that are drawn with each fault
INJECTED_ONSETS = 5  # of a fault, which the data sets take in turn
INJECTED_MIDDLE = (0.3, 0.7)  # parts of the flight, between which they lie
INJECTED_SIGMAS = 3.0  # of the prior of a size: larger ones do not occur
INJECTED_CELL = 1.0 / 6.0  # of a cell of the grid about them, as the first round of the search refines it
UNSEEN_INFORMATION = 1e-9  # of the largest of an axis: one that tells nothing
IDENTIFIABLE_MOST = 8.0  # times the detectable size, up to which the identifiable one is looked for
IDENTIFIABLE_HALVINGS = 7  # of its logarithm, at most: to 2 %
IDENTIFIABLE_SHARE = (0.95, 0.96)  # of the data sets that are told, at least, and enough to know it well
SIGMA_DECIMALS = 3  # at most, that it takes to show the σ of a size in words
RIVAL_LOG_ODDS = 12.0  # below the likeliest hypothesis, from which on another one does not count
DATA_SETS_SIZE = 4e6  # states by data sets, at a time: 32 MB
MAX_EXPLAINED = 4  # hypotheses in one estimate
MOST_LINEARISATIONS = 300  # of one estimate with all of its causes: a healthy flight takes some 25, the worst fault 250
LINEAR_TURN = 0.2  # rad, beyond which what is linear in attitudes does not tell one cause from another: 2 % of a field
TRIAL_PASSES = 8  # of the iteration, after which it shows which of several hypotheses leaves least
ROUGH_STRETCH_S = 2.0  # before a cause, where it shows that the cause lies in rough motion
JUMP_STEPS = 8.0  # median steps, of an onset that is tried besides the grid,
MAX_JUMPS = 8  # and how many are tried
WEIGH_MIN = 2  # at a time
WEIGH_SIZE = 36_000  # columns of 20 MB, and as much on the way

# Rest, biases and mounting
REST_NEIGHBOURS = 5  # keyframes before and after
ALIGNED_LATER_S = (1.0, 10.0, 60.0)  # after alignment, for which errors are predicted
EARTH_RATE_RPS = 7.2921e-5  # which a gyro at rest measures, and after a turn on another axis
CONFOUNDED = 0.7  # correlation of two figures from which on one is reported as not told apart from the other
CAL_NEAR = 1.0  # of the standard errors: a smaller step leaves the derivatives as they are
CAL_BEYOND_S = 5.0  # readings kept beyond the last window: the fit may shift their times
CAL_CONVERGED = 0.02  # of the standard errors that no figure moves by;
CAL_SHORTER = 0.9  # or steps stay this long: with shifted times, windows that begin a sample later cycle
REST_READ_MAX_S = 10.0  # of a rest, that tells errors from the start
REST_READ_MIN_SAMPLES = 10
OBSERVABLE = 0.3  # standard error of a figure, as part of what was possible beforehand

# Drift, consistency and replay
JUDGED_S = 5.0  # the horizon that calibration is judged at, and that a flight has to be long enough for
AGREEING_S = (JUDGED_S, 1.0, 2.0, 10.0, 30.0)  # where the first decides nothing, the others do
MIN_WINDOWS = 3
NOISE_RATE_HZ = 40.0  # below it motion does not look smooth, and second differences show no noise
Z_999 = 3.0902  # one-sided 99.9 % point
TICK_MAX_PIECES = 4  # a stream may be sent at every second or third tick of the autopilot's loop, as it comes
TICK_REGULAR = 0.1  # part of a tick that regular stamps keep to
TICK_MIN_INTERVALS = 20
COVARIANCE_STEP_S = 0.04  # of the trapezoids by which errors grow: a vehicle turns little meanwhile
COARSE_TURN_RAD = 0.5  # in a step: of an even turn rk4 misses 3e-5 then, and 5e-4 of one of 1 rad a step
LOG_MIN_ERROR = 1e-12  # rad, m/s, m: an error of zero has no logarithm
PAIRED_ANCHORS = 0.25  # part of the horizon by which the anchors of one window pair may be apart
Z_975 = 1.959964  # two-sided 95 %
QUARTILES_SIGMA = 1.349  # σ of a normal distribution between its quartiles
HORIZONS_S = (1.0, 2.0, 5.0, 10.0, 30.0)  # that drift is reported at
FREE_RUN_SETTLED_S = 2.0  # older samples change no more: packets come late, and the last cubic is one-sided
POSE_POINTS = 2400
POSE_MAX_S = 120.0  # beyond it the error is no longer linear in its causes, and its covariance says nothing
RANK_TAIL = 0.025  # 95 % in between
RANK_EXACT = 50  # values a side; beyond, the normal approximation is as good
RANK_MAX = 1000  # values a side that are taken: more cost memory and show nothing new
WINDOWS_AT_ONCE = 512  # an hour has 3,600 of a second, each with 10 kB of covariances
SAMPLES_AT_ONCE = 4096  # what is made on the way stays in the processor's cache
CONTEXT = 3  # samples before a state, for the cubic through four
BACK = 4  # before the end: there a sample's state does not change any more when the next ones come
MANY_WINDOWS = 10

# The autopilot's estimator
AP_BIAS_MIN_BLOCKS = 5
AP_BIAS_MAX_RPS = 0.15  # a board trim turns fast rates into false biases: ATTITUDE's rates are not turned by it
POSITION_ORIGIN_SHARE = 0.1  # of the flight: where both positions begin
SIGMAS = 3.0  # from which on something is significant
AP_BIAS_NEWEST = 0.25  # part of the flight, at its end: an estimator learns
