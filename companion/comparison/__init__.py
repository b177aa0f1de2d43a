"""Holds the IMU's dead reckoning against the autopilot's estimate, window by window. Pure."""

from companion.comparison.alignment import Alignment, Later, Rest, align, power_at_rest, rests
from companion.comparison.budget import (
    ATTITUDE,
    VELOCITY,
    Agreement,
    Expected,
    agreement,
    expected_over,
    turn_jacobian,
    while_judged,
    window_noise,
)
from companion.comparison.calibrate import (
    NAMES,
    NO_CORRECTION,
    PARTS,
    Calibration,
    Correction,
    calibrate,
    known_from,
    lever_jacobian,
)
from companion.comparison.drift import (
    Drift,
    DriftRow,
    RedundantImu,
    RunningDrift,
    Statistic,
    drift,
    drift_over,
    each_imu,
    newest_stands_out,
)
from companion.comparison.imu_noise import (
    AxisNoise,
    FlightDensity,
    FlightNoise,
    ImuNoise,
    ModelFigure,
    RestNoise,
    imu_noise,
    noise_in_flight,
    noise_model,
)
from companion.comparison.imu_spec import GENERIC, ImuSpec, ReferenceSpec, SensorSpec, reported_by
from companion.comparison.phases import (
    AIRBORNE_REPORTS,
    ON_THE_GROUND,
    UPRIGHT,
    aligned_at,
    between,
    controlled,
    down_in_body,
    flight_of,
    flown,
    in_control,
    in_the_air,
    judged_at,
    judged_parts,
    landed_at,
    phases,
    unjudged,
)
from companion.comparison.pose_error import Expectation, PoseError, ape, expected_by_age, expected_since_anchor, rpe
from companion.comparison.reference import (
    InterpolationError,
    Limits,
    Reference,
    States,
    attitude_error,
    attitude_jumps,
    block_means,
    known_at,
    length,
    position_jumps,
    reference_at,
    turn_between,
    window,
    within,
    within_any,
    wrapped,
)
from companion.comparison.replay import Continued, FreeRun, FreeState, Replay, extend, replay, replay_from_rest
from companion.comparison.spans import Span, ends_of, grouped, run_edges, runs, spans, standing_still, unchanged
from companion.comparison.windows import (
    DEFAULT,
    Comparison,
    Integration,
    Windows,
    compare,
    errors,
    gravity_for,
    left_out,
    means_between,
    trailing,
    windows,
)
from companion.constants.num import HORIZONS_S
from companion.model import BoolArray, IntArray
