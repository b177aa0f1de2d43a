"""The fitted errors of an IMU as people read them: names, units and decimals of each part, and what they gain."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from companion.analysis import PARTS, Assessment, Calibration, Drift
from companion.present.formats import short
from companion.present.tables import AXES

_DEGREES = math.degrees(1.0)


@dataclass(frozen=True, slots=True)
class CalibratedPart:
    """One part of a calibration (`analysis.PARTS`)."""

    title: str
    unit: str  # as people read it
    factor: float  # from SI to that
    digits: int  # decimals
    si: str  # unit of the parameters themselves
    axes: tuple[str, ...] = AXES

    def shown(self, value: float, sigma: float) -> str:
        """A parameter and its standard error, without the unit."""
        return f"{value * self.factor:.{self.digits}f} ± {sigma * self.factor:.{self.digits}f}"


CALIBRATED: Mapping[str, CalibratedPart] = {
    "gyro_bias": CalibratedPart("gyro bias", "mrad/s", 1e3, 2, "rad/s"),
    "accel_bias": CalibratedPart("accelerometer bias", "m/s²", 1.0, 3, "m/s²"),
    "gyro_scale": CalibratedPart("gyro scale", "%", 1e2, 3, ""),
    "accel_scale": CalibratedPart("accelerometer scale", "%", 1e2, 3, ""),
    "gyro_misalignment": CalibratedPart(
        "gyro axes", "°", _DEGREES, 2, "rad", ("xy", "xz", "yx", "yz", "zx", "zy")
    ),
    "accel_misalignment": CalibratedPart("accelerometer axes", "°", _DEGREES, 2, "rad", ("yx", "zx", "zy")),
    "mounting": CalibratedPart("mounting", "°", _DEGREES, 2, "rad"),
    "lever_arm": CalibratedPart("lever arm", "m", 1.0, 3, "m"),
    "time_offset": CalibratedPart("lag", "ms", 1e3, 1, "s", ("",)),
}  # fmt: skip
"""Part → its title, unit and decimals, in the order of the tables."""


def not_observable(fit: Calibration) -> list[str]:
    """The titles of the parts that are not observable in the flight."""
    return [part.title for name, part in CALIBRATED.items() if not fit.score(name)]


def by_best_estimate(fit: Calibration) -> list[str]:
    """The titles of the parts that are determined by the best estimate rather than the windows."""
    return [part.title for name, part in CALIBRATED.items() if fit.observed_by_best(name)]


def level_force(fit: Calibration) -> str:
    """The error of accel z at 1 g, where it cannot be separated into bias and scale; else ""."""
    known = fit.observable[PARTS["accel_bias"]][2] and not fit.observable[PARTS["accel_scale"]][2]
    value, sigma = fit.level_force
    return f"{value:.3f} ± {sigma:.3f} m/s²: bias and scale together" if known else ""


@dataclass(frozen=True, slots=True)
class Gain:
    """The change of the median drift in the second half of a flight by the calibration of the first."""

    windows: int  # of the second half
    by_autopilot: str  # "0.31 → 0.12°, 1.20 → 0.50 m"
    by_best: str  # the same against the best estimate; empty without one

    def __str__(self) -> str:
        return self.by_autopilot + (f"; against the best estimate {self.by_best}" if self.by_best else "")


def held_out_gain(assessment: Assessment) -> Gain | None:
    """None where a half has too few windows."""
    if assessment.uncorrected is None or assessment.corrected is None:
        return None
    by_best = assessment.judged_by_best
    return Gain(
        assessment.corrected.rows[0].windows,
        _change(assessment.uncorrected, assessment.corrected),
        _change(*by_best) if by_best and by_best[1].rows[0].windows else "",
    )


def _change(before: Drift, after: Drift) -> str:
    (one, *_), (other, *_) = before.rows, after.rows
    parts = []
    if one.attitude_deg and other.attitude_deg:
        parts.append(f"{short(one.attitude_deg.median)} → {short(other.attitude_deg.median)}°")
    if one.position_m and other.position_m:
        parts.append(f"{short(one.position_m.median)} → {short(other.position_m.median)} m")
    return ", ".join(parts) or "–"
