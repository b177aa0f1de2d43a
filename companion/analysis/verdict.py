"""Which of the two is wrong: everything that the analysis says about one IMU of a flight, and the sentence above it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from companion.analysis.autopilot_bias import AutopilotBias, autopilot_bias
from companion.analysis.budget import (
    ATTITUDE,
    POSITION,
    VELOCITY,
    budget,
    chi_square,
    chi_square_95,
    nees,
    stacked,
    window_noise,
)
from companion.analysis.calibrate import Calibration, calibrate
from companion.analysis.comparison import Comparison, Windows, compare, windows
from companion.analysis.correction import NO_CORRECTION, Correction
from companion.analysis.drift import HORIZONS_S, Drift, drift_over
from companion.analysis.figures import ImuFigures, ReferenceFigures
from companion.analysis.finding import Finding, Side
from companion.analysis.findings import findings
from companion.analysis.integration import DEFAULT, Integration
from companion.analysis.rest import Rest, rests
from companion.tracks import Flight, ImuTrack

Status = Literal["consistent", "imu_suspect", "autopilot_suspect", "insufficient_data"]

_BLOCKS = {"attitude": ATTITUDE, "velocity": VELOCITY, "position": POSITION}
_JUDGED_S = 5.0  # the horizon that consistency and calibration are judged at
_FEWEST_WINDOWS = 3
_CONSISTENT_SHARE = 0.7  # of windows inside the 99.9 % bound: the windows of a flight share one draw of its biases
_Z_999 = 3.0902


@dataclass(frozen=True, slots=True)
class Expected:
    """The drift that the budget allows at one horizon, 1σ of the error's length, and what it is made of."""

    attitude_deg: float
    velocity_mps: float | None
    position_m: float | None
    shares: Mapping[str, Mapping[str, float]]  # attitude, velocity, position → cause → part of the mean square
    inside: Mapping[str, float]  # attitude, velocity, position → share of windows inside the 95 % bound of their NEES
    plausible: Mapping[str, float]  # the same for the 99.9 % bound


@dataclass(frozen=True, slots=True)
class Verdict:
    """The answer."""

    status: Status
    summary: str
    findings: tuple[Finding, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Assessment:
    """One IMU of a flight: drift, what it should be, calibration, verdict."""

    comparison: Comparison  # of the IMU as it was judged, corrected if that was asked for
    drift: Drift
    expected: tuple[Expected | None, ...]  # one for each row of the drift; None without windows
    figures: ImuFigures
    autopilot: ReferenceFigures
    measured_noise: tuple[float, float] | None  # rad/s/√Hz, m/s²/√Hz in flight
    rests: tuple[Rest, ...]  # where the vehicle stood still
    autopilot_bias: AutopilotBias | None  # the gyro bias that the autopilot believes in
    calibration: Calibration | None
    corrected: Drift | None  # with the calibration, on the windows that it was not fitted to
    uncorrected: Drift | None  # the same windows without it
    verdict: Verdict
    made_worse: bool  # whether the calibration spoils windows that it was not fitted to: the errors are not constant


def assess(
    flight: Flight,
    figures: ImuFigures,
    *,
    autopilot: ReferenceFigures | None = None,
    horizons: Sequence[float] = HORIZONS_S,
    imu: str | None = None,
    how: Integration = DEFAULT,
    correction: Correction = NO_CORRECTION,
) -> Assessment:
    """Everything about one IMU of a flight. Raises as `drift` does."""
    autopilot = autopilot or ReferenceFigures()
    track = correction.apply(flight.imu(imu))

    def compare_with(changed: ImuTrack) -> Comparison:
        return compare(flight, track=changed, how=how)

    comparison = compare_with(track)
    judged = windows(comparison, _JUDGED_S)
    noise = _noise(comparison, judged)
    sets = [windows(comparison, horizon) for horizon in horizons]
    allowed = _expected(comparison, judged, figures, autopilot)
    calibration = before = after = None
    if len(judged.start) >= _FEWEST_WINDOWS:
        calibration = calibrate(track, compare_with, figures, autopilot, horizon=_JUDGED_S)
        half = calibrate(track, compare_with, figures, autopilot, horizon=_JUDGED_S, half="even")
        if half is not None and min(half.windows, len(judged.every_other("odd").start)) >= _FEWEST_WINDOWS:
            before = _held_out(comparison)
            after = _held_out(compare_with(half.correction.apply(track)))
    sampling = allowed.shares["attitude"]["sampling"] if allowed else 0.0
    found, clean = findings(flight, comparison, sampling, compare_with, figures, noise, autopilot)
    if clean is not comparison:
        judged = windows(clean, _JUDGED_S)
        allowed = _expected(clean, judged, figures, autopilot)
    return Assessment(
        comparison=comparison,
        drift=drift_over(comparison, sets),
        expected=tuple(_expected(comparison, chosen, figures, autopilot) for chosen in sets),
        figures=figures,
        autopilot=autopilot,
        measured_noise=noise,
        rests=rests(flight, track, figures),
        autopilot_bias=autopilot_bias(flight, track),
        calibration=calibration,
        corrected=after,
        uncorrected=before,
        verdict=_verdict(judged, allowed, found),
        made_worse=_made_worse(before, after, autopilot),
    )


def _made_worse(before: Drift | None, after: Drift | None, autopilot: ReferenceFigures) -> bool:
    """Twice as far off, and further than what the autopilot itself may be off at the two ends of a window."""
    if before is None or after is None:
        return False
    ends = np.sqrt(2.0 * 3.0)  # both, three axes
    pairs = (
        (before.rows[0].attitude_deg, after.rows[0].attitude_deg, np.degrees(autopilot.attitude_noise) * ends),
        (before.rows[0].position_m, after.rows[0].position_m, autopilot.position * ends),
    )
    return any(b is not None and a is not None and a.median > max(2 * b.median, least) for b, a, least in pairs)


def _noise(comparison: Comparison, judged: Windows) -> tuple[float, float] | None:
    """White-noise densities of gyro and accelerometer as they are in flight, median over windows."""
    if not len(judged.start):
        return None
    gyro, accel = np.median(window_noise(comparison.track, judged), axis=0)
    return float(gyro), float(accel)


def _expected(
    comparison: Comparison, chosen: Windows, figures: ImuFigures, autopilot: ReferenceFigures
) -> Expected | None:
    if not len(chosen.start):
        return None
    allowed = budget(comparison, chosen, figures, autopilot)
    error, total = stacked(comparison, chosen), allowed.total
    blocks = _BLOCKS if comparison.has_position else {"attitude": ATTITUDE}
    sigma = {name: float(np.median(allowed.sigma(block))) for name, block in blocks.items()}
    normalised = {name: nees(error[:, block], total[:, block, block]) for name, block in blocks.items()}
    return Expected(
        attitude_deg=float(np.degrees(sigma["attitude"])),
        velocity_mps=sigma.get("velocity"),
        position_m=sigma.get("position"),
        shares={name: allowed.shares(block) for name, block in blocks.items()},
        inside={name: float(np.mean(value < chi_square_95(3))) for name, value in normalised.items()},
        plausible={name: float(np.mean(value < chi_square(3, _Z_999))) for name, value in normalised.items()},
    )


def _held_out(comparison: Comparison) -> Drift:
    """The drift over every other window, those that a fit to the rest has not seen."""
    return drift_over(comparison, [replace(windows(comparison, _JUDGED_S).every_other("odd"), excluded={})])


def _verdict(judged: Windows, expected: Expected | None, found: tuple[Finding, ...]) -> Verdict:
    sides: tuple[Side, ...] = ("data", "imu", "autopilot")
    errors_of = {side: [f for f in found if f.side == side and f.severity == "error"] for side in sides}
    if errors_of["data"]:
        finding = errors_of["data"][0]
        return Verdict("insufficient_data", f"This log cannot tell: {finding.evidence}.", found)
    if expected is None or len(judged.start) < _FEWEST_WINDOWS:
        reasons = ", ".join(f"{n} {reason}" for reason, n in judged.excluded.items()) or "the flight is short"
        return Verdict(
            "insufficient_data",
            f"This log cannot tell: only {len(judged.start)} windows of {_JUDGED_S:g} s can be used ({reasons}).",
            found,
        )
    for side in sides[1:]:
        if errors_of[side]:
            first = errors_of[side][0]
            name = "IMU" if side == "imu" else "autopilot's estimate"
            return Verdict(
                "imu_suspect" if side == "imu" else "autopilot_suspect",
                f"Suspect the {name}: {_KINDS[first.kind]} from {first.start_s:.1f} to {first.end_s:.1f} s.",
                found,
            )
    outside = {name: 1 - share for name, share in expected.plausible.items() if share < _CONSISTENT_SHARE}
    if outside:
        worst = max(outside, key=lambda name: outside[name])
        noisy = [f for f in found if f.kind in {"gyro_noise", "accel_noise"}]
        if noisy:
            return Verdict(
                "imu_suspect",
                f"Suspect the IMU's noise, not a bias: {noisy[0].evidence}. {outside[worst]:.0%} of the windows of "
                f"{_JUDGED_S:g} s are beyond the 99.9 % bound in {worst}.",
                found,
            )
        return Verdict(
            "imu_suspect",
            f"The IMU drifts more than it should: {outside[worst]:.0%} of the windows are beyond the 99.9 % bound in "
            f"{worst}, and no single cause stands out.",
            found,
        )
    return Verdict(
        "consistent",
        f"IMU and autopilot agree: what drifts is within what this sensor's errors explain (in "
        f"{min(expected.inside.values()):.0%} of {len(judged.start)} windows of {_JUDGED_S:g} s).",
        found,
    )


_KINDS = {
    "gyro_bias": "a gyro bias",
    "accel_bias": "an accelerometer offset",
    "frozen": "its readings stand still",
    "stuck_axis": "an axis stands still",
    "axes_wrong": "its axes are not the body's",
    "gyro_clipping": "the gyro is at the end of its range",
    "accel_clipping": "the accelerometer is at the end of its range",
    "position_jump": "its position jumps",
    "heading_jump": "its heading jumps",
    "heading_wrong": "its heading is wrong",
    "attitude_diverging": "its attitude drifts away",
    "attitude_tilted": "its attitude leans over",
    "position_diverging": "its position drifts away",
}
