"""Which of IMU and autopilot is wrong: findings, faults, verdicts. Pure."""

from companion.verdict.assessment import Assessment, assess
from companion.verdict.deviations import AutopilotBias, AutopilotError, Sensitivity, autopilot_bias, autopilot_error
from companion.verdict.difference import Change, Contrast, FigureChange, contrast
from companion.verdict.fault_interval import percent
from companion.verdict.finding import Cause, Finding, by_severity, leading_doubt
from companion.verdict.findings.readings import rate_warning
from companion.verdict.findings.vibration import Clips, clip_counts
from companion.verdict.incident import Incident, Output, ProbableCause, imus_within, incident
from companion.verdict.lanes import (
    FLOWN,
    LaneError,
    LaneInSpan,
    Lanes,
    LaneSpan,
    LaneSwitch,
    judge_lanes,
    known_share,
)
from companion.verdict.preflight import Ageing, Check, Preflight, ageing, preflight
from companion.verdict.standing import (
    Doubt,
    StandingFault,
    believable,
    beside_doubt,
    carried_on,
    standing_verdict,
)
from companion.verdict.verdict import Alarm, Band, FlightVerdict, LiveVerdict, State, Verdict
from companion.verdict.without_imu import verdict_without_imu
