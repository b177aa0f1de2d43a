"""A finding: something that stands out in a flight."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, get_args

from companion import estimation
from companion.constants import check, priors

Side = Literal["imu", "autopilot", "data"]
Severity = Literal["info", "warning", "error"]

KINDS: Mapping[str, str] = {
    **{kind.name: kind.about for kind in estimation.HYPOTHESES},
    **{
        f"{quantity}_off": f"the autopilot's {quantity} leaves the best estimate, and no sensor explains it"
        for quantity in ("tilt", "heading", "velocity", "position", "height")
    },
    "heading_jump": "the autopilot's heading jumps, as no gyro turned",
    "position_jump": "the autopilot's position jumps",
    "position_lost": "the autopilot has no valid position for a time in flight",
    "dead_reckoned": "no GPS supports the autopilot's position for a time in flight: no fix, or it doubts it",
    "gyro_bias_known": "a steady bias of the gyro that the estimator knows and removes",
    "accel_bias_known": "a steady bias of the accelerometer that the estimator knows and removes",
    "stuck_axis": "an axis or a whole sensor of the IMU reads the same again and again",
    "frozen": "the whole IMU reads the same again and again",
    "compass_frozen": "the compass reads the same again and again in flight",
    "compass_orientation": "compass and IMU are turned against each other since the start: by mounting or setting",
    "barometer_frozen": "the barometer reads the same again and again in flight",
    "gps_disagrees": "the autopilot's position or velocity is off its GPS, and no IMU tells which is wrong",
    "compass_disagrees": "the autopilot's heading is off its compass, and no IMU tells which is wrong",
    "estimator_reset": "the estimator says that it has set a state anew",
    "gps_inconsistent": "the GPS contradicts itself: positions that do not move as the velocities say",
    "gps_frozen": "the GPS repeats its last fix in flight",
    "gps_poor": "the GPS says itself that it has no good fix for a time in flight: satellites, accuracies",
    "barometer_out_of_range": "the barometer is hotter or colder than it is made for: its heights are invalid",
    "gps_interference": "the GPS says itself that it is jammed or spoofed in flight",
    "gyro_clipping": "the gyro is at the end of its range",
    "accel_clipping": "the accelerometer is at the end of its range",
    "units_wrong": "the IMU's readings are of other units than they are taken for",
    "axes_wrong": "axes of the IMU are exchanged, mirrored or turned",
    "mounting": "the IMU sits askew",
    "lever_arm": "the IMU sits away from the point that the position speaks of",
    "declination": "the heading is off by what the magnetic declination is, or what is set of it",
    "gps_delay": "the GPS is later than is set",
    "antenna_position": "the GPS antenna sits elsewhere than is set",
    "imu_lag": "the IMU lags behind the autopilot's attitude, as behind a low-pass",
    "gyro_noise": "the gyro is far noisier than its data sheet",
    "accel_noise": "the accelerometer is far noisier than its data sheet",
    "vibration": "the vehicle reports strong vibration",
    "clipping_counted": "the vehicle has counted readings at the end of the range",
    "rate_too_low": "too few IMU samples a second to integrate",
    "samples_missing": "IMU samples are missing",
    "samples_irregular": "IMU samples come irregularly",
    "clocks_diverge": "IMU and autopilot stamp with clocks that run apart",
    "control_lost": "out of control, or an impact: nothing is judged until it is armed again or caught",
    "not_independent": "the autopilot's biases are taken off these readings already: they agree with it by themselves",
}
"""What a finding may be of. There is no finding of anything else."""


@dataclass(frozen=True, slots=True)
class Cause:
    """What is wrong, in numbers: SI, boot clock."""

    kind: str
    side: Side
    onset_s: float
    end_s: float | None = None  # None: it lasts to the end
    onset_sigma_s: float | None = None
    sensor: str = ""  # "gyro", "accel", "gps", "compass", "barometer"; "" where it is none, or none alone
    axis: str = ""  # "x", "y", "z" of the body; "" where it is not one alone
    size: float | None = None  # length of the vector, at its greatest
    sigma: float | None = None
    unit: str = ""
    probability: float | None = None  # that this sensor is at fault, against all else; None where not weighed
    side_probability: float | None = None  # that it is the IMU, or a sensor beside the IMU: this accuses
    rival: str = ""  # kind of the next likeliest hypothesis
    rival_probability: float | None = None
    imu: int | None = None  # the IMU whose it is
    consequences: tuple[str, ...] = ()  # what it did to the autopilot's estimate, in words


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that stands out. Raises ValueError for a kind that is not of KINDS."""

    kind: str  # of KINDS
    side: Side  # whom it speaks against
    severity: Severity  # an error decides the verdict; a warning may explain it; info is said
    start_s: float  # boot clock
    end_s: float
    evidence: str
    advice: str
    headline: str = ""  # the evidence in one clause; "" where that is one
    cause: Cause | None = None
    undecided: bool = False  # either may be wrong: it accuses nobody, and nobody is cleared

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"{self.kind!r} is no kind of finding: add it to {__name__}.KINDS")


def by_severity(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Errors first, then warnings, then what is only said; each in order of time."""
    order = get_args(Severity)[::-1]
    return tuple(sorted(findings, key=lambda f: (order.index(f.severity), f.start_s)))


def leading_doubt(findings: Iterable[Finding]) -> Finding | None:
    """What leaves it open who is wrong: the likeliest of those that are more likely an error than not, else the first.

    None where nothing does.
    """
    undecided = [f for f in findings if f.undecided]

    def probability(finding: Finding) -> float:
        stated = 0.0 if finding.cause is None else finding.cause.probability or 0.0
        return stated if stated > priors.PROBABLY_HARMFUL else 0.0

    return max(undecided, key=probability, default=None)


def are_near(findings: Iterable[Finding], t: float) -> bool:
    """Whether any of some findings is of a time t, s, or near it."""
    return any(one.start_s - check.NEAR_S <= t <= one.end_s + check.NEAR_S for one in findings)
