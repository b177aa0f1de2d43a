"""What an IMU and an autopilot are expected to be off by: the 1σ figures that a budget stands on, given or reported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.constants import healthy
from companion.model import Flight, of_kind


@dataclass(frozen=True, slots=True)
class SensorSpec:
    """One three-axis sensor. Its unit u is rad/s for a gyro and m/s² for an accelerometer."""

    noise_density: float  # u/√Hz, white
    bias_walk: float  # u/√s
    residual_bias: float  # u, 1σ of what is left after the autopilot's calibration
    offset: float  # u, the part's own bias before any calibration (tolerance)
    scale: float  # 1σ scale error after calibration, no unit
    full_scale: float  # u
    scale_tolerance: float = 0.01  # 1σ scale error of the part before any calibration, no unit


@dataclass(frozen=True, slots=True)
class ImuSpec:
    """The figures of an IMU, and what part they are of."""

    name: str
    gyro: SensorSpec
    accel: SensorSpec
    reason: str = ""  # why this part is assumed


@dataclass(frozen=True, slots=True)
class ReferenceSpec:
    """1σ of the autopilot's own estimate at one instant, and of what relates it to the IMU. All are settings."""

    tilt: float = 0.005  # rad, each horizontal axis: an error that lasts, and leans gravity over
    heading: float = 0.02  # rad, likewise
    attitude_noise: float = 0.002  # rad, each axis: what changes between the ends of a window
    velocity: float = 0.05  # m/s, each axis
    position: float = 0.1  # m, each axis, over the length of a window: a constant offset cancels
    time_offset: float = 0.01  # s, IMU against the autopilot's estimate: ArduPilot's 20 Hz filter lags by 12 ms
    misalignment: float = 0.005  # rad, between the axes of the IMU and those of the attitude
    gravity: float = 0.003  # m/s²: height, the latitude that "standard" ignores, geoid
    reason: str = "from the settings"  # where they come from


GENERIC = ImuSpec(
    "generic-mems",
    SensorSpec(1.2e-4, 1.94e-5, 4.71e-3, 0.087, 1e-3, 34.9, 0.01),
    SensorSpec(1.57e-3, 3.0e-3, 0.05, 0.49, 2e-3, 157.0, 0.02),
    "no part is named",
)
"""The middle of the parts in config/imu, for use without that library; there `generic-mems.toml` names the sources."""


def reported_by(flight: Flight, autopilot: ReferenceSpec) -> ReferenceSpec:
    """The figures with what the vehicle reports in their place, as it is for most of the flight.

    Tilt, heading and velocity of LOCAL_POSITION_NED_COV, ATTITUDE_QUATERNION_COV and ODOMETRY. The variance of the
    position is not taken: it is that of where the vehicle is on Earth, nearly all of which is the same at both ends of
    a window. EKF_STATUS_REPORT has ratios of innovations to what they may be, which are no variances.
    """
    changed: dict[str, float] = {}
    sources: list[str] = []
    for figure, columns in (
        ("tilt", ("roll_rad2", "pitch_rad2")),
        ("heading", ("yaw_rad2",)),
        ("velocity", ("vn_m2ps2", "ve_m2ps2", "vd_m2ps2")),
    ):
        for series in of_kind(flight.series, "variance"):
            if (sigma := _sigma([series[c] for c in columns])) is not None:
                changed[figure] = sigma
                sources.append(series.source)
                break
    if not changed:
        return autopilot
    reason = f"{', '.join(changed)} from {', '.join(dict.fromkeys(sources))}; the rest from the settings"
    return replace(autopilot, **changed, reason=reason)


def _sigma(variances: Sequence[np.ndarray[tuple[int, ...], np.dtype[np.float64]]]) -> float | None:
    """Median over time of the standard deviation of one axis; None where nothing usable is reported."""
    stacked = np.column_stack(variances)
    good = stacked[(np.isfinite(stacked) & (stacked > 0)).all(axis=1)]
    return max(float(np.sqrt(np.median(good.mean(axis=1)))), healthy.AP_MIN_SIGMA) if len(good) else None
