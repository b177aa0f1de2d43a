"""Numbers and identifiers as people read them, noise as data sheets state it: one rule each."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from companion.model import STANDARD_GRAVITY, Vehicle, words
from companion.noise import Coefficient, WhiteNoise
from companion.strapdown import METHODS

_SHOWN_UNITS = {"rad": ("°", math.degrees(1.0)), "rad/s": ("mrad/s", 1e3), "": ("%", 100.0)}
_SEVERITIES = ("emergency", "alert", "critical", "error", "warning", "notice", "info", "debug")


def short(value: float | None) -> str:
    """Three digits, at most three decimals: five characters from 0.0005 to 99,999, so that tables fit into 80 columns.

    "–" for a number that does not exist.
    """
    if value is None or not math.isfinite(value):
        return "–"
    size = abs(value)
    if size >= 1e5 or 0 < size < 5e-4:
        return f"{value:.2g}"
    return f"{value:.{_decimals(size)}f}"


def fixed(value: float) -> str:
    """The same where columns must not widen: what is tiny is 0.000, and every number is written."""
    return f"{value:.{_decimals(value)}f}"


def significant(value: float) -> str:
    """Three digits that matter, two of what is small."""
    return f"{value:.0f}" if abs(value) >= 99.95 else f"{value:#.3g}" if abs(value) >= 0.1 else f"{value:.2g}"


def plus_minus(value: float, sigma: float) -> str:
    """A number and its standard error to the same decimals, the error to a digit, two if that is 1: 8.14 ± 0.02."""
    decimals = -math.floor(math.log10(0.5 * sigma)) if 0 < sigma < math.inf else _decimals(abs(value))
    decimals = min(max(decimals, 0), 3)
    return f"{value:.{decimals}f} ± {sigma:.{decimals}f}"


def capitalised(sentence: str) -> str:
    """With a capital first letter."""
    return sentence[:1].upper() + sentence[1:]


def percent(share: float | None) -> str:
    """A share as whole per cent."""
    return "–" if share is None else f"{share:.0%}"


def shown_unit(unit: str) -> tuple[str, float]:
    """The unit that a number in SI is shown in, and the factor to it; a share is in per cent."""
    return _SHOWN_UNITS.get(unit, (unit, 1.0))


def with_unit(number: str, unit: str) -> str:
    """A number and its unit: 3°, 3 m/s."""
    return f"{number}{unit}" if unit == "°" else f"{number} {unit}"


def length(metres: float) -> str:
    """A length in m or km."""
    if metres < 10:
        return f"{metres:.2f} m"
    if metres < 1000:
        return f"{metres:.1f} m" if metres < 100 else f"{metres:.0f} m"
    return f"{metres / 1000:.2f} km"


def autopilot_words(autopilot: str) -> str:
    """The common name of an autopilot of MAV_AUTOPILOT."""
    return {"ARDUPILOTMEGA": "ArduPilot"}.get(autopilot, autopilot)


def vehicle_words(vehicle: Vehicle) -> str:
    """Autopilot, firmware where it is known, and type: `ArduPilot 4.7.0 quadrotor`; untrusted text."""
    return words(" ".join(filter(None, (autopilot_words(vehicle.autopilot), vehicle.firmware, vehicle.type.lower()))))


def method_words(method: str, middle: str) -> str:
    """An integrator and its interpolation, if it has one: `rk4, cubic middle sample`."""
    return f"{method}, {middle} middle sample" if METHODS[method].looks_inside else method


def severity_word(severity: int) -> str:
    """MAV_SEVERITY in a word; the number where there is none."""
    return _SEVERITIES[severity] if 0 <= severity < len(_SEVERITIES) else str(severity)


def severity_of(severity: str) -> str:
    """A finding's severity in the words that are shown: "fault", "warning", "note"."""
    return {"error": "fault", "info": "note"}.get(severity, severity)


def clause(sentence: str) -> str:
    """A verdict's sentence without its status: "Suspect the IMU: stuck." is "stuck."."""
    return re.sub(r"^((Suspect the IMU|Suspect the autopilot's estimate|Cannot tell):|Cannot tell) ", "", sentence)


def _decimals(size: float) -> int:
    return 3 if size < 1 else 2 if size < 10 else 1 if size < 100 else 0


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
    value = float(white.sampled[axis]) * factor
    return f"< {fixed(value)}" if white.hidden[axis] else plus_minus(value, float(white.sigma[axis]) * factor)
