"""White noise as data sheets state it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from companion.estimation import Coefficient, WhiteNoise
from companion.model import STANDARD_GRAVITY
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
