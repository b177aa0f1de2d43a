"""One line of a preflight check: a size with its σ against a limit."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist
from typing import Literal

import numpy as np
import numpy.typing as npt

from companion.constants import priors
from companion.model import Array

Outcome = Literal["go", "no_go", "unknown"]


@dataclass(frozen=True, slots=True)
class Check:
    """A size against its limit, SI."""

    name: str  # "gyro_bias", "compass_field", ...
    sensor: str  # the message or record
    size: float
    sigma: float
    limit: float
    unit: str  # "rad/s", "m/s²", "rad", "T", "m", ...; "" for none
    outcome: Outcome
    probability: float  # that the size is beyond the limit
    autopilot: str = ""  # the autopilot's own pre-arm check that it anticipates
    autopilot_limit: float | None = None
    note: str = ""
    uncorrected: float | None = None  # the size before what the estimator takes off; None: it takes nothing off

    @property
    def own(self) -> float:
        """The size that is the sensor's own, whatever is known of it: what ages."""
        return self.size if self.uncorrected is None else self.uncorrected


@dataclass(frozen=True, slots=True)
class Standing:
    """The stretch in which the vehicle stands."""

    start: float  # s, boot clock
    end: float
    motors_off: bool

    def covers(self, t: Array) -> npt.NDArray[np.bool_]:
        """(N,) which times lie in it."""
        return np.asarray((t >= self.start) & (t <= self.end))


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """An IMU's readings while the vehicle stands, and their means (3,) with 1σ."""

    t: Array  # (N,) s
    gyro: Array  # (N, 3) rad/s
    accel: Array  # (N, 3) m/s²
    gyro_mean: Array
    gyro_sigma: Array
    accel_mean: Array
    accel_sigma: Array


def judged(name: str, sensor: str, size: float, sigma: float, limit: float, unit: str) -> Check:
    """No-go where a size is beyond its limit with 95 %, go where it is within with as much."""
    z = (size - limit) / max(sigma, 1e-300)
    p = NormalDist().cdf(z)
    outcome: Outcome = "unknown"
    if p >= priors.ACCUSED:
        outcome = "no_go"
    elif p <= 1.0 - priors.ACCUSED:
        outcome = "go"
    return Check(name, sensor, size, sigma, limit, unit, outcome, p)
