"""Holds the IMU's reckoning against the autopilot's estimate. Pure: imports tracks and strapdown."""

from companion.analysis.alignment import Alignment, Later, align
from companion.analysis.autopilot_bias import AutopilotBias, autopilot_bias
from companion.analysis.calibrate import Calibration, calibrate
from companion.analysis.clips import Clips, clip_counts
from companion.analysis.comparison import Comparison, WindowErrors, Windows, compare, errors, trailing, windows
from companion.analysis.contrast import Change, Contrast, FigureChange, contrast
from companion.analysis.correction import NAMES, NO_CORRECTION, PARTS, Correction
from companion.analysis.drift import HORIZONS_S, Drift, DriftRow, Statistic, drift, drift_of
from companion.analysis.envelope import Expectation, expected_since_anchor
from companion.analysis.figures import GENERIC, ImuFigures, ReferenceFigures, SensorFigures
from companion.analysis.finding import Finding, by_severity
from companion.analysis.findings import rate_warning
from companion.analysis.free_run import FreeRun, FreeState
from companion.analysis.gravity import gravity_for
from companion.analysis.integration import Integration
from companion.analysis.pose_error import PoseError, Spread, ape, rpe
from companion.analysis.reference import Limits, Reference, reference_at
from companion.analysis.replay import Replay, replay, replay_from_rest
from companion.analysis.reported import reported_by
from companion.analysis.rest import Rest, rests
from companion.analysis.running_drift import RunningDrift
from companion.analysis.siblings import Sibling, odd_one_out, siblings
from companion.analysis.spectrum import Spectrum, Vibration, imu_spectrum, vibration, welch
from companion.analysis.verdict import Assessment, Expected, Verdict, assess

__all__ = [
    "GENERIC",
    "HORIZONS_S",
    "NAMES",
    "NO_CORRECTION",
    "PARTS",
    "Alignment",
    "Assessment",
    "AutopilotBias",
    "Calibration",
    "Change",
    "Clips",
    "Comparison",
    "Contrast",
    "Correction",
    "Drift",
    "DriftRow",
    "Expectation",
    "Expected",
    "FigureChange",
    "Finding",
    "FreeRun",
    "FreeState",
    "ImuFigures",
    "Integration",
    "Later",
    "Limits",
    "PoseError",
    "Reference",
    "ReferenceFigures",
    "Replay",
    "Rest",
    "RunningDrift",
    "SensorFigures",
    "Sibling",
    "Spectrum",
    "Spread",
    "Statistic",
    "Verdict",
    "Vibration",
    "WindowErrors",
    "Windows",
    "align",
    "ape",
    "assess",
    "autopilot_bias",
    "by_severity",
    "calibrate",
    "clip_counts",
    "compare",
    "contrast",
    "drift",
    "drift_of",
    "errors",
    "expected_since_anchor",
    "gravity_for",
    "imu_spectrum",
    "odd_one_out",
    "rate_warning",
    "reference_at",
    "replay",
    "replay_from_rest",
    "reported_by",
    "rests",
    "rpe",
    "siblings",
    "trailing",
    "vibration",
    "welch",
    "windows",
]
