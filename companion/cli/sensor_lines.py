"""The lines of `analyze` and `calibrate` about the sensor: noise, constant errors, alignment at rest."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from rich.markup import escape
from rich.table import Table

from companion.analysis import PARTS, Alignment, Assessment, Calibration
from companion.cli.tables import table
from companion.model import Array, counted
from companion.present import CALIBRATED, SENSORS, by_best_estimate, fixed, held_out_gain, level_force, not_observable

_MOST_RESTS = 3


def noise_lines(assessment: Assessment) -> Iterator[str]:
    """White noise by the data sheet, at rest and in flight (worst axis), in the units of data sheets."""
    flying = assessment.measured_noise
    if not assessment.rests and flying.gyro is None and flying.accel is None:
        return
    for sensor in SENSORS:
        resting = [getattr(rest, f"{sensor.key}_noise") for rest in assessment.rests]
        sheet, moving = getattr(assessment.imu_spec, sensor.key).noise_density, getattr(flying, sensor.key)
        parts = [f"{fixed(sheet * sensor.factor)} {sensor.unit}/√Hz expected"]
        if still := [density for density in resting if density is not None]:
            parts.append(f"{fixed(min(still) * sensor.factor)} at rest")
        elif resting:
            parts.append("at rest: below quantisation")
        if moving is not None:
            parts.append(f"{fixed(moving * sensor.factor)} in flight")
        yield f"{'Noise:' if sensor is SENSORS[0] else '':<11}{sensor.name} {', '.join(parts)}"


def autopilot_line(assessment: Assessment) -> str:
    """The assumed error of the autopilot's own estimate."""
    own = assessment.autopilot
    return (
        f"Assumed autopilot error (1σ): tilt {_degrees(own.tilt)}, heading {_degrees(own.heading)}, "
        f"{fixed(own.velocity)} m/s, {fixed(own.position)} m ({escape(own.reason)})"
    )


def calibration_lines(assessment: Assessment) -> Iterator[str]:
    """The fitted errors with their standard errors, and whether they help on windows they were not fitted to."""
    fit = assessment.calibration
    if fit is None:
        return
    yield f"Calibration from {counted(fit.windows, 'window')} of {fit.horizon_s:g} s (± one standard error):"
    for part, shown in CALIBRATED.items():
        if fit.score(part):
            yield f"  {shown.title:<19}{_values(fit, part)} {shown.unit}"
            if part == "gyro_bias":
                yield from _other_estimates(assessment)
    if by_best := by_best_estimate(fit):
        yield f"  by the best estimate rather than the windows: {', '.join(by_best)}"
    if unknown := not_observable(fit):
        yield f"  not observable     in this flight: {', '.join(unknown)}"
    place = PARTS["accel_bias"]
    if any(fit.assumed[place]):
        best = zip(fit.correction.accel_bias, fit.assumed_sigma[place], fit.assumed[place], strict=True)
        parts = [f"{'xyz'[i]} {value:.3f} ± {sigma:.3f}" for i, (value, sigma, taken) in enumerate(best) if taken]
        yield f"  if mounting is 0   accelerometer bias {', '.join(parts)} m/s²"
    if level := level_force(fit):
        yield f"  at 1 g             z is off by {level}"
    if (gain := held_out_gain(assessment)) is not None:
        yield f"  out of sample      median of {counted(gain.windows, 'window')} of the second half, by the first"
        yield f"    autopilot's      {gain.by_autopilot}"
        if gain.by_best:
            yield f"    best estimate's  {gain.by_best}"
        if assessment.made_worse:
            yield "  [yellow]It makes the rest of the flight worse: the errors are not constant. Do not use it.[/]"


def _values(fit: Calibration, part: str) -> str:
    """The parameters of a part with their standard errors."""
    place = PARTS[part]
    return ", ".join(
        CALIBRATED[part].shown(value, sigma) if seen else "not observable"
        for value, sigma, seen in zip(fit.values[place], fit.sigma[place], fit.observable[place], strict=True)
    )


def _other_estimates(assessment: Assessment) -> Iterator[str]:
    """The gyro bias as the rests and the autopilot have it."""
    for rest in assessment.rests[:_MOST_RESTS]:
        bias = _plus_minus(rest.gyro, rest.gyro_sigma)
        yield f"    at rest          {bias} mrad/s ({rest.start_s:.1f}-{rest.end_s:.1f} s)"
    if (held := assessment.autopilot_bias) is not None:
        bias = _plus_minus(held.gyro, held.sigma)
        yield f"    the autopilot's  {bias} mrad/s ({held.start_s:.1f}-{held.end_s:.1f} s)"


def alignment_lines(alignment: Alignment) -> Iterator[str | Table]:
    """The alignment of the IMU at rest, and the distance of its attitude from the autopilot's later."""
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
    shown = table("after rest", "tilt °", "allowed, 1σ", "heading °", "allowed, 1σ")
    for row in alignment.later:
        errors = (row.tilt_deg, row.expected_tilt_deg, row.heading_deg, row.expected_heading_deg)
        shown.add_row(f"{row.since_s:.1f} s", *map(fixed, errors))
    yield shown


def _degrees(angle: float) -> str:
    return f"{np.degrees(angle):.1f}°"


def _plus_minus(values: Array, sigma: Array) -> str:
    """Biases of the gyro, rad/s, in mrad/s."""
    return ", ".join(map(CALIBRATED["gyro_bias"].shown, values, sigma))
