"""Faults that would do harm and that a flight is too short, too calm or too noisy to show."""

from __future__ import annotations

from companion.analysis.fault_interval import BIAS_UNITS, SENSORS
from companion.estimation import BestEstimate, kind_of


def harmful_undetected(best: BestEstimate) -> list[str]:
    """Biases of the IMU between what is harmful and what the flight would have shown: "a gyro bias of 5.0-5.9 mrad/s".

    Those of GPS and compass only mislead where the autopilot follows them, and then it deviates from the best estimate.
    """
    out = []
    for sensor, (unit, scale, decimals) in BIAS_UNITS.items():
        kind = kind_of(f"{sensor}_bias")
        shown = best.detectable.get(kind.name, kind.harmful("step"))
        low, high = (f"{size * scale:.{decimals}f}" for size in (kind.harmful("step"), shown))
        if high != low:
            out.append(f"{_ARTICLE[sensor]} {SENSORS[sensor]} bias of {low}-{high} {unit}")
    return out


_ARTICLE = {"gyro": "a", "accel": "an"}
