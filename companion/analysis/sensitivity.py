"""What a flight could have shown: the smallest error of the IMU and of the autopilot that would have been called."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from companion.analysis.departures import least_departure
from companion.estimation import ATTITUDE, CREEPS, POSITION, BestEstimate

_UNITS: Mapping[str, tuple[str, str, float, float]] = {
    "gyro_bias": ("gyro bias", "mrad/s", 1e3, 0.1),
    "accel_bias": ("accelerometer bias", "m/s²", 1.0, 3.0),
    "tilt": ("tilt", "°", np.degrees(1.0), np.radians(20.0)),
    "heading": ("heading", "°", np.degrees(1.0), np.radians(45.0)),
    "position": ("a position step", "m", 1.0, 50.0),
    "gps": ("a GPS creep", f"m in {CREEPS['gps_position']:g} s", 1.0, 100.0),
    "compass": ("a compass turn", f"° in {CREEPS['compass_field']:g} s", np.degrees(1.0), np.radians(90.0)),
}
"""What may be off → its name, unit, units in the SI one, and the size from which on it is no use to have looked."""


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """The smallest errors that the flight would have shown, and what it could not show."""

    smallest: Mapping[str, float]  # rad/s, m/s², rad, m; of GPS and compass, that both estimates may follow, m and rad
    not_judged: tuple[str, ...]  # what could not be judged, and why, in words

    def __str__(self) -> str:
        shown = (f"{_UNITS[k][0]} above {_figure(v * _UNITS[k][2])} {_UNITS[k][1]}" for k, v in self.smallest.items())
        return ", ".join(shown).replace(" °", "°")


def sensitivity(best: BestEstimate | None) -> Sensitivity:
    """What a best estimate could have shown; without one, nothing by a third witness."""
    if best is None:
        return Sensitivity({}, ("which side is wrong: no third witness (GPS, compass, rest) is good enough here",))
    smallest = {}
    for kind in ("gyro_bias", "accel_bias"):
        if kind in best.detectable:
            sizes = [float(np.linalg.norm(e.size)) for e in best.explained if e.kind == kind and e.shape == "step"]
            smallest[kind] = min([best.detectable[kind], *sizes])  # what was found can be found
    lacking = []
    attitude = best.sigma(ATTITUDE)
    smallest["tilt"] = _usual("tilt", attitude[:, :2].max(axis=1))
    if best.heading_from == "first guess":
        lacking.append("heading: no compass, and GPS does not tell it")
    else:
        smallest["heading"] = _usual("heading", attitude[:, 2])
    if "gps_position" in best.residuals:
        smallest["position"] = _usual("position", best.sigma(POSITION)[:, :2].max(axis=1))
    else:
        lacking.append("accelerometer bias, velocity and position: no GPS")
    if "gps_position" in best.detectable:
        smallest["gps"] = best.detectable["gps_position"]
    if "compass_field" in best.detectable:
        level = float(np.linalg.norm(best.states.constant("earth_field")[:2]))
        smallest["compass"] = float(np.arctan(best.detectable["compass_field"] / max(level, 1e-9)))
    for kind, (name, unit, factor, useless) in _UNITS.items():
        if smallest.get(kind, 0.0) > useless:
            lacking.append(f"{name}: none below {_figure(smallest.pop(kind) * factor)} {unit}".replace(" °", "°"))
    return Sensitivity(smallest, tuple(lacking))


def _usual(quantity: str, sigma: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    return float(np.median(least_departure(quantity, sigma)))


def _figure(value: float) -> str:
    """Two digits."""
    return f"{value:.{max(0, 1 - int(np.floor(np.log10(max(value, 1e-9)))))}f}"
