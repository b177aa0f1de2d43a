"""All findings of one IMU of a flight, those that only follow from others left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from companion.analysis.biases import bias_findings, noise_findings, rate_findings
from companion.analysis.calibrate import NO_CORRECTION, TIME_OFFSET, Calibration, Compare
from companion.analysis.comparison import Comparison
from companion.analysis.figures import ImuFigures, ReferenceFigures
from companion.analysis.finding import Finding
from companion.analysis.jumps import jump_findings
from companion.analysis.readings import axes_findings, reading_findings, stuck_findings
from companion.tracks import Flight


def findings(
    flight: Flight,
    comparison: Comparison,
    sampling_share: float,
    compare_with: Compare,
    figures: ImuFigures,
    noise: tuple[float, float] | None,
    calibration: Calibration | None,
    autopilot: ReferenceFigures,
) -> tuple[Finding, ...]:
    found = [*rate_findings(comparison, sampling_share)]
    found += reading_findings(comparison, flight.require_attitude(), figures)
    if flight.vehicle.autopilot == "PX4" and comparison.track.source == "HIGHRES_IMU":
        found.append(_not_independent(comparison))
    found += stuck_findings(comparison)
    found += axes_findings(comparison)
    found += jump_findings(comparison, flight)
    if noise is not None:
        found += noise_findings(comparison, noise, figures)
    level = comparison
    if calibration is not None and calibration.observable[TIME_OFFSET]:
        lag = calibration.correction.time_offset
        # a lag of 12 ms in a flip looks like a bias of the gyro: take it out before looking for one
        level = compare_with(replace(NO_CORRECTION, time_offset=lag).apply(comparison.track))
        if abs(lag) > 5e-3 and abs(lag) > 3 * calibration.sigma[TIME_OFFSET]:
            found.append(_lag(comparison, lag, float(calibration.sigma[TIME_OFFSET])))
    found += bias_findings(level, figures, autopilot)
    found = [f for f in found if not _follows(f, found)]
    return tuple(sorted(found, key=lambda f: (_ORDER[f.severity], f.start_s)))


def _follows(finding: Finding, found: Sequence[Finding]) -> bool:
    """Whether a bias or a jump is only what another fault looks like from elsewhere.

    A frozen, stuck or turned sensor also looks biased; and once the autopilot's heading has jumped, the forces that it
    sees point the wrong way for as long as it does not notice.
    """
    if finding.kind not in {"gyro_bias", "accel_bias", "heading_jump", "stuck_axis"}:
        return False
    causes = _CAUSES[1:] if finding.kind == "stuck_axis" else _CAUSES
    if any(f.kind in causes and f.start_s < finding.end_s and finding.start_s < f.end_s for f in found):
        return True
    return finding.kind == "accel_bias" and any(
        f.kind == "heading_jump" and f.severity == "error" and f.start_s < finding.start_s + 2 * _JUMP_S for f in found
    )


_JUMP_S = 2.0  # a bias is found in windows of this length
_CAUSES = ("stuck_axis", "frozen", "axes_wrong")

_ORDER = {"error": 0, "warning": 1, "info": 2}


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


def _lag(comparison: Comparison, lag: float, sigma: float) -> Finding:
    return Finding(
        "imu_lag",
        "data",
        "info",
        float(comparison.track.t[0]),
        float(comparison.track.t[-1]),
        f"the IMU lags {lag * 1e3:.1f} ± {sigma * 1e3:.1f} ms behind the attitude",
        "Usual: ArduPilot's 20 Hz filter makes 12 ms. It matters in fast turns alone; the calibration takes it out.",
    )
