"""How far off the autopilot says that its own estimate may be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from companion.analysis.imu_spec import ReferenceSpec
from companion.model import Flight, of_kind

_LEAST = 1e-4  # rad, m/s: nobody is more certain


def reported_by(flight: Flight, figures: ReferenceSpec) -> ReferenceSpec:
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
            sigma = _sigma([series[c] for c in columns])
            if sigma is not None:
                changed[figure] = sigma
                sources += [series.source] if series.source not in sources else []
                break
    if not changed:
        return figures
    reason = f"{', '.join(changed)} from {', '.join(sources)}; the rest from the settings"
    return replace(figures, **changed, reason=reason)


def _sigma(variances: Sequence[np.ndarray[tuple[int, ...], np.dtype[np.float64]]]) -> float | None:
    """Median over time of the standard deviation of one axis; None where nothing usable is reported."""
    stacked = np.column_stack(variances)
    good = stacked[(np.isfinite(stacked) & (stacked > 0)).all(axis=1)]
    return max(float(np.sqrt(np.median(good.mean(axis=1)))), _LEAST) if len(good) else None
