"""All findings of one IMU of a flight, those that only follow from others left out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache

import numpy as np

from companion.analysis.calibrate import Compare
from companion.analysis.comparison import Comparison
from companion.analysis.figures import ImuFigures, ReferenceFigures
from companion.analysis.finding import Finding, by_severity
from companion.analysis.findings.axes import axes_findings
from companion.analysis.findings.biases import bias_findings, position_findings
from companion.analysis.findings.blame import own_rates
from companion.analysis.findings.heading import heading_findings
from companion.analysis.findings.held_bias import held, held_findings
from companion.analysis.findings.installation import Installation, installation, level
from companion.analysis.findings.jumps import jump_findings
from companion.analysis.findings.lags import lags
from companion.analysis.findings.readings import reading_findings, stuck_findings
from companion.analysis.findings.residuals import SHORT_S, residuals
from companion.analysis.findings.sampling import rate_findings, stamp_findings
from companion.analysis.findings.steps import step_findings
from companion.analysis.findings.vibration import noise_findings, vibration_findings
from companion.analysis.findings.witnesses import other_imus, with_witnesses
from companion.tracks import Flight


def findings(
    flight: Flight,
    comparison: Comparison,
    sampling_share: float,
    compare_with: Compare,
    figures: ImuFigures,
    noise: tuple[float, float] | None,
    autopilot: ReferenceFigures,
) -> tuple[tuple[Finding, ...], Comparison]:
    """What stands out, and the comparison with what is no fault taken out: how the IMU sits in the vehicle."""
    found = [*rate_findings(flight, comparison, sampling_share)]
    found += reading_findings(comparison, flight.require_attitude(), figures)
    if flight.vehicle.autopilot == "PX4" and comparison.track.source == "HIGHRES_IMU":
        found.append(_not_independent(comparison))
    found += stuck_findings(comparison, autopilot)
    found += axes_findings(comparison)
    found += jump_findings(comparison, flight)
    if noise is not None:
        found += noise_findings(comparison, noise, figures)
    found += vibration_findings(comparison, flight)
    raw = residuals(comparison)
    found += position_findings(comparison, raw)
    if not any(f.kind == "heading_jump" and f.severity == "error" for f in found):
        found += heading_findings(comparison, raw, figures, autopilot)
    wrong = [f.start_s for f in found if f.kind in _HEADING and f.severity == "error"]
    fitted = installation(comparison, raw, figures, autopilot, min(wrong, default=np.inf))
    found += stamp_findings(flight, comparison, lags(comparison))
    clean = comparison
    if fitted is not None and fitted.moved:
        found += _installed(comparison, fitted)
        # a lag of 12 ms in a flip looks like a bias of the gyro: take it out before looking for one
        clean = level(comparison, fitted, compare_with)
        raw = residuals(clean)
    own = own_rates(flight.require_attitude(), raw, comparison.how.limits)
    others = cache(lambda: other_imus(flight, comparison))
    found += bias_findings(clean, raw, own, others, figures, autopilot)
    found += step_findings(clean, raw, figures)
    if (known := held(flight, comparison.track, raw, own)) is not None:  # as sent: HIGHRES_IMU is turned as much
        found += held_findings(raw, known, figures)
    found = [with_witnesses(f, flight) for f in found if not _follows(f, found)]
    return by_severity(found), clean


def _follows(finding: Finding, found: Sequence[Finding]) -> bool:
    """Whether a bias or a jump is only what another fault looks like from elsewhere.

    A frozen, stuck or turned sensor also looks biased; and once the autopilot's heading has jumped, the forces that it
    sees point the wrong way for as long as it does not notice.
    """
    if finding.kind not in _EFFECTS:
        return False
    causes: Sequence[str] = _CAUSES[1:] if finding.kind == "stuck_axis" else _CAUSES
    if finding.kind == "position_diverging":  # the estimator believes a bad IMU for a while
        causes = (*_CAUSES, "gyro_bias", "accel_bias")
    if finding.kind == "bias_step":
        causes = (*_CAUSES, "attitude_diverging", "attitude_tilted")
    errors = [f for f in found if f.severity == "error"]
    if any(f.kind in causes and f.start_s < finding.end_s and finding.start_s < f.end_s for f in errors):
        return True
    return finding.kind in _FORCES and any(
        f.kind in _HEADING and f.start_s < finding.start_s + 2 * SHORT_S for f in errors
    )


_HEADING = ("heading_jump", "heading_wrong")
_FORCES = ("accel_bias", "attitude_tilted", "bias_step")
_EFFECTS = {
    *_FORCES,
    "gyro_bias",
    "attitude_diverging",
    "ekf_bias",
    "heading_jump",
    "heading_wrong",
    "mounting",
    "position_diverging",
    "stuck_axis",
}
_CAUSES = ("stuck_axis", "frozen", "axes_wrong", "clocks_diverge")
_LAG_S, _MOUNTING_RAD = 5e-3, np.radians(2.0)


def _installed(comparison: Comparison, fitted: Installation) -> Iterator[Finding]:
    """What is said of how the IMU sits in the vehicle."""
    begin, end = float(comparison.track.t[0]), float(comparison.track.t[-1])
    if fitted.lag:
        yield Finding(
            "imu_lag",
            "data",
            "info",
            begin,
            end,
            f"the IMU lags {fitted.lag * 1e3:.1f} ± {fitted.lag_sigma * 1e3:.1f} ms behind the attitude",
            "Usual: ArduPilot's 20 Hz filter makes 12 ms. It matters in fast turns alone; the calibration takes it "
            "out.",
        )
    if fitted.mounting.any():
        size = float(np.linalg.norm(fitted.mounting))
        roll, pitch, yaw = np.degrees(fitted.mounting)
        yield Finding(
            "mounting",
            "data",
            "warning" if size > _MOUNTING_RAD else "info",
            begin,
            end,
            f"the IMU is turned by ({roll:.1f}, {pitch:.1f}, {yaw:.1f})° against the axes of the attitude, throughout",
            "A board trim (AHRS_TRIM_X, AHRS_TRIM_Y; SENS_BOARD_X_OFF on PX4) that the log does not name, or the "
            "board sits askew. A flight that stays level cannot tell it from an accelerometer's offset.",
        )
    if fitted.lever.any():
        x, y, z = fitted.lever
        yield Finding(
            "lever_arm",
            "data",
            "info",
            begin,
            end,
            f"the IMU sits ({x:.2f}, {y:.2f}, {z:.2f}) m from the point that the position speaks of",
            "Set INS_POSn_X, _Y, _Z to where the IMU is, so that the autopilot knows too.",
        )


def _not_independent(comparison: Comparison) -> Finding:
    return Finding(
        "not_independent",
        "data",
        "warning",
        float(comparison.track.t[0]),
        float(comparison.track.t[-1]),
        "PX4 has subtracted its EKF's biases from HIGHRES_IMU: it agrees with the autopilot even where both are wrong",
        "Ask for SCALED_IMU (SET_MESSAGE_INTERVAL), or use the .ulg log.",
    )
