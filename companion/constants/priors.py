"""Prior rates and probabilities, and what the posterior ones are compared with."""

from math import log

# Evidence and the scan over hypotheses
NUISANCES_PER_H = 10.0  # of each hypothesis: what healthy parts show, every few minutes
CALM_SHOCK_RATE = 0.1  # of shocks where readings are calm, in times that elsewhere: no missed push in 4.6 h of flight
RAMP_S = 20.0  # what grows takes at least so long to reach its size, as by heat or spoofing: what is sooner is a step
CANDIDATE = -3.0  # log odds of a fault against nothing, from which on an estimate with it is worth its time
LIKELY_NUISANCE = 7.0  # log odds from which on a nuisance is one too
DEVICE_RATE_SIGMA = log(10.0)  # 1σ of the log rate of each device: of the IMU's faults against another's a factor of 26
RATE_NODES = 5  # of the Gauss-Hermite rule over each of them
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
MISLED = 0.3  # probability that an estimator leaves the truth after a sensor that it reads has a fault
MISLED_ODDS = (MISLED / (1.0 - MISLED)) / (ESTIMATOR_ERROR / (1.0 - ESTIMATOR_ERROR))  # against one that does not
MISJUDGED_ESTIMATE = 2e-4  # that the best estimate is as far off itself, for a cause that no hypothesis of it has

# Aiding sensors and jumps
FALSE_ALARM = 1e-3  # of a stretch like it anywhere in the record of a healthy sensor

# Incidents: why control is lost. `prior` is the share of losses, the others how often a cause shows such evidence: that
# motors and propellers are first agrees with the public crash reports of both projects; all is engineering judgement
SENSOR_CLEARED = 0.02  # least probability of a sensor's fault before a loss of control: a verdict may be wrong
INCIDENT_EVIDENCE = (
    "prior", "output_full", "output_zero", "not_followed", "desired_steep", "power_announced", "thrust_announced",
    "taking_off", "log_ends",
)  # fmt: skip
INCIDENT = {
    cause: dict(zip(INCIDENT_EVIDENCE, row, strict=True))
    for cause, row in {
        "mechanical": (0.35, 0.75, 0.40, 0.90, 0.05, 0.05, 0.50, 0.10, 0.10),
        "installation": (0.10, 0.40, 0.40, 0.90, 0.05, 0.03, 0.10, 0.95, 0.05),
        "power": (0.10, 0.60, 0.10, 0.60, 0.05, 0.60, 0.15, 0.05, 0.50),
        "imu": (0.10, 0.30, 0.30, 0.50, 0.20, 0.03, 0.05, 0.15, 0.10),
        "aiding": (0.05, 0.10, 0.10, 0.15, 0.15, 0.03, 0.02, 0.10, 0.10),
        "estimator": (0.10, 0.20, 0.20, 0.30, 0.20, 0.03, 0.05, 0.15, 0.10),
        "command": (0.05, 0.15, 0.15, 0.10, 0.70, 0.03, 0.02, 0.10, 0.10),
        "other": (0.15, 0.40, 0.25, 0.60, 0.10, 0.05, 0.10, 0.10, 0.15),
    }.items()
}
