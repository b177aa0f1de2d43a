"""Holds the IMU's reckoning against the autopilot's estimate. Pure: imports tracks and strapdown."""

from companion.analysis.comparison import Comparison, WindowErrors, Windows, compare, errors, windows
from companion.analysis.drift import HORIZONS_S, Drift, DriftRow, Statistic, drift, drift_of
from companion.analysis.figures import GENERIC, ImuFigures, ReferenceFigures, SensorFigures
from companion.analysis.gravity import gravity_for
from companion.analysis.reference import Limits, Reference, reference_at
from companion.analysis.replay import Replay, replay

__all__ = [
    "GENERIC",
    "HORIZONS_S",
    "Comparison",
    "Drift",
    "DriftRow",
    "ImuFigures",
    "Limits",
    "Reference",
    "ReferenceFigures",
    "Replay",
    "SensorFigures",
    "Statistic",
    "WindowErrors",
    "Windows",
    "compare",
    "drift",
    "drift_of",
    "errors",
    "gravity_for",
    "reference_at",
    "replay",
    "windows",
]
