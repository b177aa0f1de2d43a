"""What the program says of a flight, in the few words that the accuracy benchmarks compare with the truth.

`answer` is the one place of the benchmarks that knows the form of a verdict.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from companion.app.examination import examine, unexaminable
from companion.model import Flight
from companion.verdict import Verdict

Side = Literal["none", "imu", "autopilot", "cannot_tell"]

_SIDES: dict[str, Side] = {
    "consistent": "none",
    "imu_suspect": "imu",
    "autopilot_suspect": "autopilot",
    "insufficient_data": "cannot_tell",
}

# kind of cause → cause and sensor, in the words of the labels
CAUSES = {
    "gyro_bias": ("gyro_bias", "gyro"),
    "accel_bias": ("accel_bias", "accel"),
    "gyro_scale": ("gyro_scale", "gyro"),
    "accel_scale": ("accel_scale", "accel"),
    "gyro_shock": ("noise", "gyro"),
    "accel_shock": ("noise", "accel"),
    "gps_position": ("position", "gps"),
    "gps_motion": ("position", "gps"),
    "gps_height": ("position", "gps"),
    "gps_velocity": ("velocity", "gps"),
    "gps_latency": ("latency", "gps"),
    "compass_field": ("heading", "compass"),
    "compass_turn": ("heading", "compass"),
    "compass_iron": ("heading", "compass"),
    "barometer": ("position", "baro"),
    "compass_frozen": ("heading", "compass"),
    "compass_orientation": ("heading", "compass"),
    "barometer_frozen": ("position", "baro"),
    "gps_inconsistent": ("position", "gps"),
    "gps_frozen": ("position", "gps"),
    "tilt_off": ("tilt", ""),
    "heading_off": ("heading", ""),
    "velocity_off": ("velocity", ""),
    "position_off": ("position", ""),
    "height_off": ("position", ""),
    "frozen": ("stuck", ""),
    "stuck_axis": ("stuck", ""),
    "units_wrong": ("units", ""),
    "axes_wrong": ("axes", ""),
    "gyro_clipping": ("saturation", "gyro"),
    "accel_clipping": ("saturation", "accel"),
    "gyro_noise": ("noise", "gyro"),
    "accel_noise": ("noise", "accel"),
    "position_jump": ("position", ""),
    "position_lost": ("position", ""),
    "heading_jump": ("heading", ""),
}


@dataclass(frozen=True, slots=True)
class Answer:
    """The verdict's headline. Its cause is the first in time, "" where nobody is suspect."""

    side: Side
    cause: str = ""  # a word of the labels, or the finding's own kind where they have none
    sensor: str = ""  # gyro, accel, compass, gps, baro; "" where it is not told
    axis: str = ""  # x, y, z; "" where it is not told
    onset: float | None = None  # s, boot clock
    end: float | None = None  # s
    size: float | None = None  # SI; None where it is not told
    sigma: float | None = None  # 1σ of it
    stated: float | None = None
    """Probability of the side that is accused; of nobody, or of a sensor that misled nobody; None where none is."""
    summary: str = ""
    smallest: Mapping[str, float] = field(default_factory=dict)  # that it would have shown, SI; not judged is missing


def answer(flight: Flight) -> Answer:
    """What a user with default settings is told about a flight. Raises whatever the analysis raises."""
    lacking = unexaminable(flight)
    if lacking:
        return read_verdict(lacking.verdict)
    assessment = examine(flight).assessment
    return replace(read_verdict(assessment.verdict), smallest=assessment.sensitivity.smallest)


def read_verdict(verdict: Verdict) -> Answer:
    """The adapter: the form of `Verdict` is known here alone."""
    side = _SIDES[verdict.status]
    first = verdict.cause
    if first is None:
        stated = max(verdict.probability.values(), default=None) if side == "none" else None
        return Answer(side, stated=stated, summary=verdict.summary)
    cause, sensor = CAUSES.get(first.kind, (first.kind, ""))
    of_imu = verdict.probability.get("imu") if side == "imu" else None  # its readings themselves accuse it
    return Answer(
        side,
        cause,
        sensor or first.sensor,
        first.axis,
        onset=first.onset_s,
        end=first.end_s,
        size=first.size,
        sigma=first.sigma,
        stated=first.side_probability if first.side_probability is not None else of_imu,
        summary=verdict.summary,
    )
