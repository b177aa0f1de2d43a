"""Prior rates and probabilities, and what the posterior ones are compared with."""

from math import log

# Evidence and the scan over hypotheses
NUISANCES_PER_H = 10.0  # of each hypothesis: what healthy parts show, every few minutes
CANDIDATE = -3.0  # log odds of a fault against nothing, from which on what is not in the estimate may be the reason
LIKELY_NUISANCE = 7.0  # log odds from which on a nuisance is one too
ACCUSED = 0.95  # posterior probability from which on a side is accused
ACCUSED_ODDS = log(ACCUSED / (1.0 - ACCUSED))
RECOVERING_SHARE = 1e-3  # of the IMU's faults: those that end in flight
ACCEPT_FAULT = 0.0  # log odds of what is probably harmful,
ACCEPT_NUISANCE = 10.0  # and of what is not
PROBABLY_HARMFUL = 0.5

# Drift, consistency and replay
CONSISTENT_SHARE = 0.7  # of windows inside the 95 % bound: the windows of a flight share one draw of its biases

# Rest, biases and mounting
FAULTY_IMU = 0.01  # share of IMUs that fly with an error from the start: 3 of 86 logs of strangers' vehicles
ESTIMATOR_ERROR = 0.08  # share of flights in which the estimator is off by itself: 7 of 86 logs of strangers' vehicles
MISJUDGED_ESTIMATE = 2e-4  # that the best estimate is as far off itself, for a cause that no hypothesis of it has

# Aiding sensors and jumps
FALSE_ALARM = 1e-3  # of a stretch like it anywhere in the record of a healthy sensor
