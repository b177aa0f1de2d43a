"""Which of IMU and autopilot is wrong: findings, faults, verdicts. Pure."""

from companion.hypotheses.assessment import Assessment, assess
from companion.hypotheses.deviations import AutopilotBias, AutopilotError, Sensitivity, autopilot_bias, autopilot_error
from companion.hypotheses.difference import Change, Contrast, FigureChange, contrast
from companion.hypotheses.fault_interval import percent
from companion.hypotheses.finding import Cause, Finding, by_severity
from companion.hypotheses.findings.readings import rate_warning
from companion.hypotheses.findings.vibration import Clips, clip_counts
from companion.hypotheses.incident import Incident, Output, ProbableCause, imus_within, incident
from companion.hypotheses.lanes import (
    FLOWN,
    LaneError,
    LaneInSpan,
    Lanes,
    LaneSpan,
    LaneSwitch,
    judge_lanes,
    known_share,
)
from companion.hypotheses.preflight import Ageing, Check, Preflight, ageing, preflight
from companion.hypotheses.standing import StandingFault, believable, carried_on, standing_verdict
from companion.hypotheses.verdict import Alarm, Band, FlightVerdict, LiveVerdict, State, Verdict
from companion.hypotheses.without_imu import verdict_without_imu
