"""Holds the IMU's dead reckoning against the autopilot's estimate. Pure: imports tracks and strapdown."""

from companion.analysis.alignment import Alignment, Later, Rest, align, rests
from companion.analysis.assessment import Assessment, assess
from companion.analysis.budget import Agreement, Expected, expected_over
from companion.analysis.calibrate import NAMES, NO_CORRECTION, PARTS, Calibration, Correction, calibrate, known_from
from companion.analysis.comparison import (
    Comparison,
    Integration,
    compare,
    errors,
    gravity_for,
    left_out,
    trailing,
    windows,
)
from companion.analysis.deviations import AutopilotBias, AutopilotError, Sensitivity, autopilot_bias, autopilot_error
from companion.analysis.difference import Change, Contrast, FigureChange, contrast
from companion.analysis.drift import (
    Drift,
    DriftRow,
    RedundantImu,
    RunningDrift,
    Statistic,
    drift,
    each_imu,
    newest_stands_out,
)
from companion.analysis.fault_interval import percent
from companion.analysis.finding import Cause, Finding, by_severity
from companion.analysis.findings import rate_warning
from companion.analysis.findings.vibration import Clips, clip_counts
from companion.analysis.imu_spec import GENERIC, ImuSpec, ReferenceSpec, SensorSpec, reported_by
from companion.analysis.incident import Incident, Output, ProbableCause, imus_within, incident
from companion.analysis.inventory import Item, inventory, used_aiding, used_imus
from companion.analysis.lanes import FLOWN, LaneError, LaneInSpan, Lanes, LaneSpan, LaneSwitch, judge_lanes, known_share
from companion.analysis.noise import (
    AxisNoise,
    FlightNoise,
    ImuNoise,
    ModelFigure,
    RestNoise,
    imu_noise,
    noise_in_flight,
    noise_model,
)
from companion.analysis.phases import AIRBORNE_REPORTS, phases
from companion.analysis.pose_error import Expectation, PoseError, ape, expected_by_age, expected_since_anchor, rpe
from companion.analysis.preflight import Ageing, Check, Preflight, ageing, preflight
from companion.analysis.reference import Limits, Reference, reference_at, window
from companion.analysis.replay import Continued, FreeRun, FreeState, Replay, extend, replay, replay_from_rest
from companion.analysis.standing import StandingFault, believable, carried_on, standing_verdict
from companion.analysis.verdict import Alarm, Band, FlightVerdict, LiveVerdict, State, Verdict
from companion.analysis.without_imu import verdict_without_imu
from companion.constants.num import HORIZONS_S
