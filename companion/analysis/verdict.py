"""Which of the two is wrong: everything that the analysis says about one IMU of a flight, and the sentence above it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
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
from companion.analysis.comparison import Comparison, Half, Windows, compare, windows
from companion.analysis.correction import NO_CORRECTION, Correction
from companion.analysis.drift import HORIZONS_S, Drift, drift_over
from companion.analysis.figures import ImuFigures, ReferenceFigures, SensorFigures
from companion.analysis.finding import Cause, Finding, by_severity
from companion.analysis.findings import findings, reading_faults
from companion.analysis.findings.axes import misread_finding
from companion.analysis.integration import DEFAULT, Integration
from companion.analysis.phases import phases
from companion.analysis.rest import Rest, rests
from companion.analysis.sensitivity import Sensitivity, sensitivity
from companion.estimation import BestEstimate, other_reading, smooth
from companion.model import Array, DataError, Flight, ImuTrack, Phase

Status = Literal["consistent", "imu_suspect", "autopilot_suspect", "insufficient_data"]

_BLOCKS = {"attitude": ATTITUDE, "velocity": VELOCITY, "position": POSITION}
_JUDGED_S = 5.0  # the horizon that consistency and calibration are judged at
_FEWEST_WINDOWS = 3
_CONSISTENT_SHARE = 0.7  # of windows inside the 95 % bound: the windows of a flight share one draw of its biases
_Z_999 = 3.0902
_SHOWN = 3.0  # σ


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
    cause: Cause | None = None  # the first cause in time, that the summary is about; None where nobody is suspect


@dataclass(frozen=True, eq=False)
class Assessment:
    """One IMU of a flight: drift, what it should be, calibration, verdict."""

    comparison: Comparison  # of the IMU as it was judged, corrected if that was asked for
    sets: tuple[Windows, ...]  # one for each row of the drift
    drift: Drift
    figures: ImuFigures
    autopilot: ReferenceFigures
    measured_noise: tuple[float, float] | None  # rad/s/√Hz, m/s²/√Hz in flight
    rests: tuple[Rest, ...]  # where the vehicle stood still
    autopilot_bias: AutopilotBias | None  # the gyro bias that the autopilot believes in
    verdict: Verdict
    best: BestEstimate | None  # the third opinion; None where the flight allows none
    sensitivity: Sensitivity  # what the flight could have shown

    @cached_property
    def expected(self) -> tuple[Expected | None, ...]:
        """One for each row of the drift; None without windows."""
        return tuple(_expected(self.comparison, chosen, self.figures, self.autopilot) for chosen in self.sets)

    @property
    def calibration(self) -> Calibration | None:
        """What the windows of the flight say of the IMU's errors."""
        return self._calibrated[0]

    @property
    def corrected(self) -> Drift | None:
        """The drift with the calibration, on the windows that it was not fitted to."""
        return self._calibrated[2]

    @property
    def uncorrected(self) -> Drift | None:
        """The same windows without it."""
        return self._calibrated[1]

    @property
    def made_worse(self) -> bool:
        """Whether the calibration spoils windows that it was not fitted to: the errors are not constant."""
        return _made_worse(self.uncorrected, self.corrected, self.autopilot)

    @cached_property
    def _calibrated(self) -> tuple[Calibration | None, Drift | None, Drift | None]:
        """The calibration, and the drift of windows that it was not fitted to without and with it."""
        own = self.comparison
        judged = windows(own, _JUDGED_S)
        if len(judged.start) < _FEWEST_WINDOWS:
            return None, None, None

        def fitted(half: Half | None = None) -> Calibration | None:
            return calibrate(own, self.figures, self.autopilot, horizon=_JUDGED_S, half=half)

        try:
            whole, part = fitted(), fitted("even")
        except np.linalg.LinAlgError:  # the flight does not determine what is asked of it
            return None, None, None
        if part is None or min(part.windows, len(judged.every_other("odd").start)) < _FEWEST_WINDOWS:
            return whole, None, None
        return whole, _held_out(own), _held_out(own.of(part.correction.apply(own.track)))


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
    comparison = compare(flight, track=track, how=how)
    judged = windows(comparison, _JUDGED_S)
    noise = _noise(comparison, judged)
    sets = tuple(windows(comparison, horizon) for horizon in horizons)
    allowed = _expected(comparison, judged, figures, autopilot)
    sampling = allowed.shares["attitude"]["sampling"] if allowed else 0.0
    faults = reading_faults(flight, comparison, figures, autopilot)
    parts = phases(flight)
    lost = next((part for part in parts if part.kind == "impact"), None)
    if lost is not None:
        faults = [f for f in faults if f.start_s < lost.start]
    own = replace(flight, imus={**flight.imus, track.source: track})
    best, misread = _best(own, track.source, how.gravity, faults, lost, enough=len(judged.start) >= _FEWEST_WINDOWS)
    faults += misread
    found, clean = findings(flight, comparison, sampling, figures, noise, autopilot, faults, best)
    if lost is not None:
        found = by_severity((_control_lost(lost), *(f for f in found if f.start_s < lost.start)))
    third = best if best is not None and _independent(best) else None
    usual = figures if third is None else in_flight(figures, third)
    if third is not None:
        clean = comparison.of(_unbiased(clean.track, third))
    judged = _while_judged(windows(clean, _JUDGED_S), clean.track.t, parts)
    return Assessment(
        comparison=comparison,
        sets=sets,
        drift=drift_over(comparison, sets),
        figures=figures,
        autopilot=autopilot,
        measured_noise=noise,
        rests=rests(flight, track, figures),
        autopilot_bias=autopilot_bias(flight, track),
        verdict=_verdict(judged, _expected(clean, judged, usual, autopilot), found, third),
        best=best,
        sensitivity=sensitivity(best),
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


def _control_lost(lost: Phase) -> Finding:
    return Finding(
        "control_lost",
        "data",
        "warning",
        lost.start,
        lost.end,
        f"control was lost at {lost.start:.1f} s ({lost.reason}); nothing after it is judged",
        "Look at motors, propellers and the desired attitude before it: a vehicle that tumbles misleads every sensor.",
    )


_UNTRUSTED = ("frozen", "stuck_axis", "gyro_clipping", "accel_clipping")


def _best(
    flight: Flight, imu: str, gravity: float, faults: Sequence[Finding], lost: Phase | None, *, enough: bool
) -> tuple[BestEstimate | None, list[Finding]]:
    """The best estimate, with the IMU's readings left out where they are none; None where there can be none.

    And whether another way to read the axes fits far better, of a flight in control that is long enough.
    lost: from when on nothing is judged.
    """
    untrusted = [(f.start_s - 0.5, f.end_s + 0.5) for f in faults if f.kind in _UNTRUSTED]
    span = None if lost is None else (-np.inf, lost.start)
    try:
        best = smooth(flight, imu, gravity=gravity, span=span, untrusted=untrusted)
    except DataError:
        return None, []
    if lost is not None or not enough or not _independent(best) or any(f.kind == "axes_wrong" for f in faults):
        return best, []
    other = other_reading(flight, best, gravity=gravity, span=span, untrusted=untrusted)
    return best, [] if other is None else [misread_finding(flight.imu(imu), other)]


def _while_judged(chosen: Windows, t: Array, parts: Sequence[Phase]) -> Windows:
    """The windows in which the estimator has aligned and the vehicle is in control."""
    out = np.zeros(len(chosen.start), np.bool_)
    for part in parts:
        if part.kind in ("aligning", "impact"):
            out |= (t[chosen.start] < part.end) & (t[chosen.end] > part.start)
    if not out.any():
        return chosen
    reasons = {**chosen.excluded, "while the estimator aligned or control was lost": int(out.sum())}
    kept = ~out
    return replace(chosen, start=chosen.start[kept], end=chosen.end[kept], number=chosen.number[kept], excluded=reasons)


def _independent(best: BestEstimate) -> bool:
    """Whether anything but the IMU told the estimate of its turns.

    Without it a bias that steps is learned as noise, and nothing would contradict.
    """
    return not {"gps_position", "compass"}.isdisjoint(best.residuals)


def in_flight(figures: ImuFigures, best: BestEstimate) -> ImuFigures:
    """The part's figures with the noise that it has in this flight, over seconds, and what is not known of its bias.

    A bias that stands out of its σ is one that the flight shows: what is left beside it has to be as small as usual.
    """

    def widened(part: SensorFigures, noise: float, bias: Array, sigma: Array) -> SensorFigures:
        shown = (np.abs(np.median(bias, axis=0)) > _SHOWN * np.median(sigma, axis=0)).any()
        unknown = 0.0 if shown else float(np.sqrt((np.median(sigma, axis=0) ** 2).mean()))
        return replace(
            part, noise_density=max(part.noise_density, noise), residual_bias=max(part.residual_bias, unknown)
        )

    noise, lasting, states = best.noise, best.lasting, best.states
    return replace(
        figures,
        gyro=widened(figures.gyro, noise.gyro_noise * lasting[0], states.gyro_bias, best.gyro_bias_sigma),
        accel=widened(figures.accel, noise.accel_noise * lasting[1], states.accel_bias, best.accel_bias_sigma),
    )


def _unbiased(track: ImuTrack, best: BestEstimate) -> ImuTrack:
    """The track without the usual bias of the best estimate: one that the autopilot knows and removes is no fault."""
    states = best.states
    return replace(
        track,
        gyro=track.gyro - np.median(states.gyro_bias, axis=0),
        accel=track.accel - np.median(states.accel_bias, axis=0),
    )


def _verdict(
    judged: Windows, expected: Expected | None, found: tuple[Finding, ...], best: BestEstimate | None
) -> Verdict:
    """The first cause in time; without one, whether IMU and autopilot agree, as far as the flight can tell."""
    causes = sorted((f for f in found if f.severity == "error" and f.side != "data"), key=lambda f: f.start_s)
    lacking = _lacking(judged, expected, found, bool(causes))
    if lacking is not None or expected is None:
        return Verdict("insufficient_data", lacking or "This log cannot tell.", found)
    if causes:
        first = causes[0]
        whom = "the IMU" if first.side == "imu" else "the autopilot's estimate"
        status: Status = "imu_suspect" if first.side == "imu" else "autopilot_suspect"
        return Verdict(status, f"Suspect {whom}: {_headline(first)}.", found, _cause(first))
    doubt = _doubt(judged, expected, found, best)
    if doubt is not None:
        return Verdict("insufficient_data", f"This log cannot tell: {doubt}.", found)
    return Verdict(
        "consistent",
        f"IMU and autopilot agree within the expected error ({min(expected.inside.values()):.0%} of "
        f"{len(judged.start)} windows of {_JUDGED_S:g} s inside the 95 % bound).",
        found,
    )


def _lacking(judged: Windows, expected: Expected | None, found: tuple[Finding, ...], has_cause: bool) -> str | None:
    """Why nothing can be judged; None where it can."""
    lost = next((f for f in found if f.kind == "control_lost"), None)
    if lost is not None and not has_cause:
        return f"Loss of control: {lost.evidence}. Before it no sensor is at fault."
    data = [f for f in found if f.side == "data" and f.severity == "error"]
    if data:
        return f"This log cannot tell: {data[0].evidence}."
    if expected is None or len(judged.start) < _FEWEST_WINDOWS:
        reasons = ", ".join(f"{n} {reason}" for reason, n in judged.excluded.items()) or "the flight is short"
        return f"This log cannot tell: only {len(judged.start)} windows of {_JUDGED_S:g} s can be used ({reasons})."
    return None


def _doubt(judged: Windows, expected: Expected, found: tuple[Finding, ...], best: BestEstimate | None) -> str | None:
    """What speaks against agreement although nothing explains it; None where nothing does."""
    worst = min(expected.inside, key=lambda name: expected.inside[name])
    share = expected.inside[worst]
    if share < _CONSISTENT_SHARE:
        return (
            f"IMU and autopilot differ in {worst} by more than expected (only {share:.0%} of {len(judged.start)} "
            f"windows of {_JUDGED_S:g} s inside the 95 % bound), and "
            + ("no single cause explains it" if best is not None else "no third witness tells which is wrong")
        )
    return next((f.evidence for f in found if f.undecided), None)


def _headline(finding: Finding) -> str:
    """What is wrong and when, without the rivals and consequences that stand in the finding."""
    if finding.headline and finding.cause is not None:
        return finding.headline  # has its time, with how sure it is
    return f"{finding.headline or finding.evidence}, from {finding.start_s:.1f} to {finding.end_s:.1f} s"


def _cause(finding: Finding) -> Cause:
    return finding.cause or Cause(finding.kind, finding.side, finding.start_s, finding.end_s)
