"""Findings about shaking: as the vehicle measures it, as the samples show it, and as noise beyond the data sheet."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from companion.analysis.budget import Expected
from companion.analysis.comparison import Comparison
from companion.analysis.finding import Finding, Severity
from companion.analysis.imu_spec import ImuSpec
from companion.analysis.noise import FlightDensity
from companion.constants import harm, healthy
from companion.estimation import clip_counters, vibration
from companion.model import STANDARD_GRAVITY, Array, Flight, Series, counted, of_kind


@dataclass(frozen=True, slots=True)
class Clips:
    """One counter of a vehicle over a flight."""

    column: str
    readings: float  # by how much it grew
    start_s: float  # boot clock, where it began to grow, and where it ended; the first sample for both where it did not
    end_s: float


def clip_counts(series: Series) -> Iterator[Clips]:
    """Every counter of a "vibration" series that the vehicle tells."""
    for name, t, clipped in clip_counters(series):
        at = np.flatnonzero(np.diff(clipped))
        first, last = (at[0], at[-1] + 1) if len(at) else (0, 0)
        yield Clips(name, float(clipped[-1]), float(t[first]), float(t[last]))


def vibration_findings(comparison: Comparison, flight: Flight) -> Iterator[Finding]:
    """How strongly the vehicle shakes, m/s² as ArduPilot's VIBE defines it: what is above 5 Hz, root mean square.

    The vehicle's own VIBRATION or VIBE is from the IMU at its full rate. Without it, the samples say the least that it
    can be.
    """
    said = False
    for series in of_kind(flight.series, "vibration"):
        if "x_mps2" in series.columns and len(series):
            said = True
            yield from _level(series.t, series.values[:, :3], series.source, harm.VIBRATION_HIGH)
        yield from _clips(series)
    level = vibration(comparison.track, comparison.how.limits.longest_step(comparison.track.t))
    if not said and level is not None:
        yield from _level(
            level.t, level.accel, f"what the samples of {comparison.track.source} show of it", harm.VIBRATION_SAMPLED
        )


def _level(t: Array, each: Array, source: str, high: float) -> Iterator[Finding]:
    each = np.where(np.isfinite(each), each, 0.0)  # an axis that is not told
    worst = each.max(axis=1)
    strong = worst > high
    if strong.mean() < 0.05:
        return
    usual, most = np.percentile(worst[strong], [50, 100])
    severity: Severity = "warning" if most > harm.VIBRATION_LIMIT or high < harm.VIBRATION_HIGH else "info"
    x, y, z = np.median(each[strong], axis=0)
    suffers = f"above {harm.VIBRATION_LIMIT:.0f} the estimator suffers"
    limit = suffers if high == harm.VIBRATION_HIGH else "the vehicle shakes more than they show"
    yield Finding(
        "vibration",
        "imu",
        severity,
        float(t[strong][0]),
        float(t[strong][-1]),
        f"shaking of {usual:.0f} m/s² as a rule, {most:.0f} at most, by {source} (x {x:.0f}, y {y:.0f}, z {z:.0f}); "
        + limit,
        "Balance propellers and motors, and damp the mounting of the autopilot. Shaking that the samples fold down "
        "looks like motion.",
    )


def _clips(series: Series) -> Iterator[Finding]:
    """Counts of readings at the end of the range, which the vehicle takes at its full rate."""
    for clipped in clip_counts(series):
        if not clipped.readings:
            continue
        yield Finding(
            "clipping_counted",
            "imu",
            "warning",
            clipped.start_s,
            clipped.end_s,
            f"{counted(round(clipped.readings), 'reading')} at the end of the accelerometer's range "
            f"({series.source}, {clipped.column})",
            "Damp the mounting: clipped samples are lost and add drift.",
        )


def noise_findings(
    comparison: Comparison, measured: FlightDensity, imu: ImuSpec, allowed: Expected | None
) -> Iterator[Finding]:
    """Readings far noisier than the data sheet: vibration, or a simulator that shakes.

    A warning where it limits what the verdict can tell: where it is the dominant source of the expected drift.
    """
    track = comparison.track
    for name, density, sheet, factor, unit, quantity in (
        ("gyro", measured.gyro, imu.gyro.noise_density, 1e3 * np.degrees(1.0), "mdps/√Hz", "attitude"),
        ("accel", measured.accel, imu.accel.noise_density, 1e6 / STANDARD_GRAVITY, "µg/√Hz", "velocity"),
    ):
        if density is None or density <= healthy.NOISE_OVER_DATA_SHEET * sheet:
            continue
        shares = allowed.shares.get(quantity, {}) if allowed else {}
        limits = max(shares, key=lambda cause: shares[cause], default="") == f"{name}_noise"
        yield Finding(
            f"{name}_noise",
            "imu",
            "warning" if limits else "info",
            float(track.t[0]),
            float(track.t[-1]),
            f"noise of {density * factor:.0f} {unit} in flight, {density / sheet:.0f} times the "
            f"{sheet * factor:.3g} of {imu.name}",
            "Vibration reaches the sensor: check vibration levels and damping. The verdict takes it into account.",
        )
