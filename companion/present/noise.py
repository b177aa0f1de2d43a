"""White noise as data sheets state it, and vibration as autopilots judge it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from companion.constants import harm
from companion.estimation import Coefficient, WhiteNoise
from companion.model import STANDARD_GRAVITY, Flight, of_kind
from companion.present.formats import fixed


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor of an IMU."""

    key: str  # of attributes
    name: str
    unit: str  # of its readings on a data sheet; with /√Hz of a density
    factor: float  # from SI to that


SENSORS = (
    Sensor("gyro", "gyro", "mdps", 1e3 * math.degrees(1.0)),
    Sensor("accel", "accelerometer", "µg", 1e6 / STANDARD_GRAVITY),
)


def interval(coefficient: Coefficient | None, factor: float) -> str:
    """4.2 (4.1-4.3), its 95 % interval; or < 5 for a bound."""
    if coefficient is None:
        return "-"
    if coefficient.value is None:
        return f"< {fixed(coefficient.high * factor)}"
    value, low, high = (fixed(v * factor) for v in (coefficient.value, coefficient.low, coefficient.high))
    return f"{value} ({low}-{high})"


def density(white: WhiteNoise, axis: int, factor: float) -> str:
    """4.2 ± 0.1 in flight; or < 4.2 below quantisation."""
    value = fixed(float(white.sampled[axis]) * factor)
    return f"< {value}" if white.hidden[axis] else f"{value} ± {fixed(float(white.sigma[axis]) * factor)}"


def vibration_words(flight: Flight) -> str:
    """How strongly the vehicle shakes, as it measures that itself: "3 m/s² typical, 5 peak: good"; "" if not told.

    Good, fair or bad by the limits that ArduPilot's documentation gives, over the flight of the worst axis.
    """
    for series in of_kind(flight.series, "vibration"):
        if "x_mps2" in series.columns and len(series):
            worst = np.nan_to_num(series.values[:, :3]).max(axis=1)
            typical, peak = np.percentile(worst, [50, 100])
            grade = "good" if peak <= harm.VIBRATION_HIGH else "fair" if peak <= harm.VIBRATION_LIMIT else "bad"
            return f"{typical:.0f} m/s² typical, {peak:.0f} peak: {grade} (limit {harm.VIBRATION_LIMIT:.0f})"
    return ""
