"""Holds the IMU's reckoning against the autopilot's estimate. Pure: imports tracks and strapdown."""

from companion.analysis.drift import HORIZONS_S, Drift, DriftRow, Statistic, WindowErrors, drift
from companion.analysis.gravity import gravity_for
from companion.analysis.reference import Limits, Reference, reference_at
from companion.analysis.replay import Replay, replay

__all__ = [
    "HORIZONS_S",
    "Drift",
    "DriftRow",
    "Limits",
    "Reference",
    "Replay",
    "Statistic",
    "WindowErrors",
    "drift",
    "gravity_for",
    "reference_at",
    "replay",
]
