"""What `analyze` and `calibrate` print about the sensor: its noise, its constant errors, how it aligns by itself."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from rich import box
from rich.markup import escape
from rich.table import Table

from companion.analysis import PARTS, Alignment, Assessment, Calibration
from companion.model import STANDARD_GRAVITY, Array, counted
from companion.present import fixed, held_out_gain

_DEGREES = float(np.degrees(1.0))
_MDPS, _MICRO_G = 1e3 * _DEGREES, 1e6 / STANDARD_GRAVITY
_MOST_RESTS = 3

_CALIBRATED = {
    "gyro_bias": ("gyro bias", "mrad/s", 1e3, 2),
    "accel_bias": ("accelerometer bias", "m/s²", 1.0, 3),
    "gyro_scale": ("gyro scale", "%", 1e2, 2),
    "accel_scale": ("accelerometer scale", "%", 1e2, 2),
    "gyro_misalignment": ("gyro axes", "°", _DEGREES, 2),
    "accel_misalignment": ("accelerometer axes", "°", _DEGREES, 2),
    "mounting": ("mounting", "°", _DEGREES, 2),
    "lever_arm": ("lever arm", "m", 1.0, 3),
    "time_offset": ("lag", "ms", 1e3, 1),
}
"""Part of a calibration → its name here, unit, factor and decimals."""


def figure_name(name: str) -> tuple[str, str, float, int]:
    """What a figure of a calibration (`analysis.NAMES`) is called here, its unit, the factor to it, and decimals."""
    part = next(part for part in PARTS if name.startswith(part))
    title, unit, factor, digits = _CALIBRATED[part]
    axis = name.removeprefix(part).strip("_")
    return f"{title} {axis}".strip(), unit, factor, digits


def noise_lines(assessment: Assessment) -> Iterator[str]:
    """White noise by the data sheet, at rest and in flight (worst axis), in the units of data sheets."""
    flying = assessment.measured_noise
    if not assessment.rests and flying.gyro is None and flying.accel is None:
        return
    gyro, accel = assessment.figures.gyro.noise_density, assessment.figures.accel.noise_density
    rows = (
        ("Noise:", "gyro", gyro, [r.gyro_noise for r in assessment.rests], flying.gyro, _MDPS, "mdps/√Hz"),
        ("", "accelerometer", accel, [r.accel_noise for r in assessment.rests], flying.accel, _MICRO_G, "µg/√Hz"),
    )
    for label, name, sheet, resting, moving, factor, unit in rows:
        parts = [f"{fixed(sheet * factor)} {unit} expected"]
        still = [density for density in resting if density is not None]
        if still:
            parts.append(f"{fixed(min(still) * factor)} at rest")
        elif resting:
            parts.append("at rest: below quantisation")
        if moving is not None:
            parts.append(f"{fixed(moving * factor)} in flight")
        yield f"{label:<11}{name} {', '.join(parts)}"


def autopilot_line(assessment: Assessment) -> str:
    """How far off the autopilot's own estimate is taken to be."""
    own = assessment.autopilot
    return (
        f"Assumed autopilot error (1σ): tilt {own.tilt * _DEGREES:.1f}°, heading {own.heading * _DEGREES:.1f}°, "
        f"{fixed(own.velocity)} m/s, {fixed(own.position)} m ({escape(own.reason)})"
    )


def calibration_lines(assessment: Assessment) -> Iterator[str]:
    """The fitted errors with their standard errors, and whether they help on windows they were not fitted to."""
    fit = assessment.calibration
    if fit is None:
        return
    yield f"Calibration from {counted(fit.windows, 'window')} of {fit.horizon_s:g} s (± one standard error):"
    untold, by_best = [], []
    for part, (name, unit, *_) in _CALIBRATED.items():
        if not fit.told(part):
            untold.append(name)
            continue
        yield f"  {name:<19}{_figures(fit, part)} {unit}"
        if part == "gyro_bias":
            yield from _other_witnesses(assessment)
        if fit.told_by_best(part):
            by_best.append(name)
    if by_best:
        yield f"  told by the best estimate rather than the windows: {', '.join(by_best)}"
    if untold:
        yield f"  not observable     in this flight: {', '.join(untold)}"
    place = PARTS["accel_bias"]
    if any(fit.assumed[place]):
        best = zip(fit.correction.accel_bias, fit.assumed_sigma[place], fit.assumed[place], strict=True)
        parts = [f"{'xyz'[i]} {value:.3f} ± {sigma:.3f}" for i, (value, sigma, taken) in enumerate(best) if taken]
        yield f"  if mounting is 0   accelerometer bias {', '.join(parts)} m/s²"
    if fit.observable[place][2] and not fit.observable[PARTS["accel_scale"]][2]:
        value, sigma = fit.level_force
        yield f"  at 1 g             z is off by {value:.3f} ± {sigma:.3f} m/s²: bias and scale together"
    if (gain := held_out_gain(assessment)) is not None:
        yield f"  out of sample      median of {counted(gain.windows, 'window')} of the second half, by the first"
        yield f"    autopilot's      {gain.by_autopilot}"
        if gain.by_best:
            yield f"    best estimate's  {gain.by_best}"
        if assessment.made_worse:
            yield "  [yellow]It makes the rest of the flight worse: the errors are not constant. Do not use it.[/]"


def _figures(of: Calibration, part: str) -> str:
    """The figures of a part with their standard errors."""
    _, _, factor, digits = _CALIBRATED[part]
    place = PARTS[part]
    return ", ".join(
        f"{value * factor:.{digits}f} ± {sigma * factor:.{digits}f}" if seen else "not observable"
        for value, sigma, seen in zip(of.values[place], of.sigma[place], of.observable[place], strict=True)
    )


def _other_witnesses(assessment: Assessment) -> Iterator[str]:
    """The gyro bias as the rests and the autopilot have it."""
    for rest in assessment.rests[:_MOST_RESTS]:
        bias = _plus_minus(rest.gyro, rest.gyro_sigma)
        yield f"    at rest          {bias} mrad/s ({rest.start_s:.1f}-{rest.end_s:.1f} s)"
    if (held := assessment.autopilot_bias) is not None:
        bias = _plus_minus(held.gyro, held.sigma)
        yield f"    the autopilot's  {bias} mrad/s ({held.start_s:.1f}-{held.end_s:.1f} s)"


def alignment_lines(alignment: Alignment) -> Iterator[str | Table]:
    """How the IMU aligned itself at rest, and how far its attitude is from the autopilot's later."""
    rest = alignment.rest
    yield f"\n[bold]The IMU alone, from rest[/] ({rest.start_s:.1f}-{rest.end_s:.1f} s)"
    heading = {"nothing": "unknown: taken as north"}.get(alignment.heading_from, f"from the {alignment.heading_from}")
    yield f"Roll and pitch from gravity (± {_degrees(alignment.tilt_sigma)} each), heading {heading}" + (
        f" (± {_degrees(alignment.heading_sigma)})" if alignment.heading_from != "nothing" else ""
    )
    yield f"Gyro bias  {_plus_minus(rest.gyro, rest.gyro_sigma)} mrad/s taken off"
    if alignment.magnetic_error_rad is not None:
        declination = "declination added" if alignment.declination_rad else "the declination is part of it"
        yield f"Magnetometer minus autopilot: {_degrees(alignment.magnetic_error_rad)} of heading ({declination})"
    for note in alignment.notes:
        yield f"Note:      {escape(note)}"
    if not alignment.later:
        yield "The autopilot's attitude is not known after the rest."
        return
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    for column in ("after rest", "tilt °", "expected, 1σ", "heading °", "expected, 1σ"):
        shown.add_column(column, justify="right", no_wrap=True)
    for row in alignment.later:
        figures = (row.tilt_deg, row.expected_tilt_deg, row.heading_deg, row.expected_heading_deg)
        shown.add_row(f"{row.since_s:.1f} s", *(fixed(value) for value in figures))
    yield shown


def _degrees(angle: float) -> str:
    return f"{angle * _DEGREES:.1f}°"


def _plus_minus(values: Array, sigma: Array) -> str:
    """In thousandths of their unit."""
    return ", ".join(f"{v * 1e3:.2f} ± {s * 1e3:.2f}" for v, s in zip(values, sigma, strict=True))
