"""The JSON that the commands print, as types. docs/json.md describes it; keys are added, never renamed."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from companion.analysis import Statistic
from companion.documents.confusion import ConfusionObject
from companion.documents.verdict import VerdictObject

SCHEMA = 2


class LogObject(msgspec.Struct, frozen=True):
    """What was read."""

    path: str
    size_bytes: int
    frames: int
    bad_crc_frames: int
    skipped_bytes: int
    content_bytes: int
    trouble: str


class VehicleObject(msgspec.Struct, frozen=True):
    """Who flew."""

    sysid: int
    compid: int
    autopilot: str
    type: str
    firmware: str


class StatsObject(msgspec.Struct, frozen=True):
    """How a message arrived."""

    count: int
    rate_hz: float | None
    longest_gap_s: float | None
    duplicates: int


class ReferenceObject(msgspec.Struct, frozen=True):
    """The messages that the autopilot's state is taken from."""

    attitude: str | None
    position: str | None


class SensorObject(msgspec.Struct, frozen=True):
    """A sensor or estimate that a flight has."""

    kind: str
    source: str
    samples: int
    rate_hz: float | None
    gaps: int
    longest_gap_s: float | None
    about: str


class PhaseObject(msgspec.Struct, frozen=True):
    """A part of a flight."""

    kind: str
    start_s: float
    end_s: float
    reason: str


class SensorInUseObject(msgspec.Struct, frozen=True):
    """From when on the estimator used an IMU, a receiver, a compass, ..."""

    t_s: float
    instance: int


class ResetObject(msgspec.Struct, frozen=True):
    """A jump that the estimator announced."""

    t_s: float
    kind: str
    text: str
    core: int | None


class ParameterObject(msgspec.Struct, frozen=True):
    """A parameter that got another value."""

    t_s: float
    name: str
    value: float


class InfoFlight(msgspec.Struct, frozen=True):
    """A flight in `companion info`."""

    vehicle: VehicleObject
    boot: int
    start_s: float
    duration_s: float
    default_imu: str | None
    reference: ReferenceObject
    notes: tuple[str, ...]
    phases: list[PhaseObject]
    sensors: list[SensorObject]
    imu_in_use: list[SensorInUseObject] | None
    aiding_in_use: Mapping[str, list[SensorInUseObject]]
    resets: list[ResetObject]
    parameter_changes: list[ParameterObject]
    messages: Mapping[str, StatsObject]


class OtherObject(msgspec.Struct, frozen=True):
    """Someone who speaks in the log and is no vehicle."""

    sysid: int
    compid: int
    reason: str


class Info(msgspec.Struct, frozen=True, kw_only=True):
    """`companion info --json`."""

    schema: int = SCHEMA
    log: LogObject
    flights: list[InfoFlight]
    others: list[OtherObject]
    crowd: int
    unknown_frames: Mapping[str, int]


class ImuObject(msgspec.Struct, frozen=True):
    """An IMU message of a flight."""

    message: str
    samples: int
    rate_hz: float
    gaps: int
    longest_gap_s: float | None
    duplicates: int


class ExpectedObject(msgspec.Struct, frozen=True):
    """The drift that the budget allows, 1σ, and what it is made of."""

    attitude_deg: float
    velocity_mps: float | None
    position_m: float | None
    shares: Mapping[str, Mapping[str, float]]


class DriftObject(msgspec.Struct, frozen=True):
    """Drift at one horizon."""

    horizon_s: float
    windows: int
    excluded: Mapping[str, int]
    attitude_deg: Statistic | None
    velocity_mps: Statistic | None
    position_m: Statistic | None
    expected: ExpectedObject | None


class JudgedObject(msgspec.Struct, frozen=True):
    """The same of the windows that the verdict judges, with the known errors of the IMU removed."""

    windows: int
    attitude: float | None
    velocity: float | None
    position: float | None


class ConsistencyObject(msgspec.Struct, frozen=True):
    """Share of the windows of a horizon whose normalised error is inside the 95 % bound."""

    horizon_s: float
    attitude: float
    velocity: float | None
    position: float | None
    judged: JudgedObject


class FigureObject(msgspec.Struct, frozen=True):
    """A fitted error of the IMU."""

    value: tuple[float, ...]
    sigma: tuple[float, ...]
    observable: tuple[bool, ...]
    confounded: tuple[str | None, ...]
    from_best_estimate: tuple[bool, ...]


class EstimateObject(msgspec.Struct, frozen=True):
    """A number and its standard error."""

    value: float
    sigma: float


class CalibrationObject(msgspec.Struct, frozen=True):
    """The IMU errors that explain the flight best, and what they gain on windows they were not fitted to."""

    windows: int
    horizon_s: float
    gyro_bias_radps: FigureObject
    accel_bias_mps2: FigureObject
    mounting_rad: FigureObject
    time_offset_s: FigureObject
    gyro_scale: FigureObject
    accel_scale: FigureObject
    gyro_misalignment_rad: FigureObject
    accel_misalignment_rad: FigureObject
    lever_arm_m: FigureObject
    level_force_mps2: EstimateObject
    before: DriftObject | None
    after: DriftObject | None
    best_estimate_before: DriftObject | None
    best_estimate_after: DriftObject | None


class RedundantImuObject(msgspec.Struct, frozen=True):
    """One IMU of several, through the same windows."""

    message: str
    rate_hz: float
    horizon_s: float
    windows: int
    attitude_deg: Statistic | None
    position_m: Statistic | None
    inside: Mapping[str, float]


class RestObject(msgspec.Struct, frozen=True):
    """A stretch in which the vehicle stood still; noise is null where the steps of the readings hide it."""

    start_s: float
    end_s: float
    gyro_bias_radps: tuple[float, ...]
    gyro_bias_sigma_radps: tuple[float, ...]
    accel_mps2: tuple[float, ...]
    gyro_noise: float | None
    accel_noise: float | None


class AutopilotBiasObject(msgspec.Struct, frozen=True):
    """The gyro bias that the autopilot believes in, towards the end of the flight."""

    start_s: float
    end_s: float
    value: tuple[float, ...]
    sigma: tuple[float, ...]


class LaterObject(msgspec.Struct, frozen=True):
    """The attitude reckoned from rest, held against the autopilot's."""

    since_s: float
    tilt_deg: float
    heading_deg: float
    expected_tilt_deg: float
    expected_heading_deg: float


class AlignmentObject(msgspec.Struct, frozen=True):
    """The IMU aligned by itself at rest."""

    start_s: float
    end_s: float
    q_ned_frd: tuple[float, ...]
    heading_from: str
    tilt_sigma_rad: float
    heading_sigma_rad: float
    magnetic_heading_rad: float | None
    declination_rad: float
    magnetic_minus_autopilot_rad: float | None
    later: list[LaterObject]
    notes: tuple[str, ...]


class FiguresObject(msgspec.Struct, frozen=True):
    """The sensor figures that the budget stands on."""

    name: str
    reason: str
    measured_gyro_noise: float | None
    measured_accel_noise: float | None


class AnalyzeFlight(msgspec.Struct, frozen=True):
    """A flight in `companion analyze`; one that lacks an IMU or an attitude has null where it was not examined."""

    vehicle: VehicleObject
    boot: int
    duration_s: float
    imu: list[ImuObject]
    reference: ReferenceObject
    used_imu: str | None
    method: str | None
    middle: str | None
    gravity_mps2: float | None
    correction: str | None
    notes: tuple[str, ...]
    drift: list[DriftObject]
    figures: FiguresObject | None
    consistency: list[ConsistencyObject]
    calibration: CalibrationObject | None
    rests: list[RestObject]
    autopilot_gyro_bias: AutopilotBiasObject | None
    alignment: AlignmentObject | None
    imus: list[RedundantImuObject]
    verdict: VerdictObject
    confusion: ConfusionObject | None = None


class Analysis(msgspec.Struct, frozen=True, kw_only=True):
    """`companion analyze --json`."""

    schema: int = SCHEMA
    log: LogObject
    flights: list[AnalyzeFlight]
