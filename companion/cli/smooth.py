"""`companion smooth LOG`: the best estimate of the trajectory by the sensors alone, and the autopilot's error.

`companion lanes LOG`: which lane of its estimator should have been flown by that, and whether each switch was right.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from rich.markup import escape
from rich.table import Table

from companion.app import files
from companion.app.examination import assess_imu, integration_of, lanes_of
from companion.app.sensors import imu_spec_of
from companion.cli import options, tables
from companion.comparison import Limits, noise_in_flight
from companion.documents import estimate_document, lanes_document
from companion.estimation import (
    AIDING_SENSORS,
    CONSTANTS,
    SLOPED,
    BestEstimate,
    Explained,
    hypothesis_of,
    probabilities,
    smooth,
)
from companion.export import write_estimate_tum
from companion.model import BiasTrack, Flight
from companion.present import SENSORS, capitalised, fixed, lane_lines, lane_table, shown_unit, words
from companion.verdict import AutopilotError, Lanes, autopilot_error, percent

_CONSTANTS: Mapping[str, tuple[str, str, float]] = {
    "earth_field": ("compass", "µT, NED", 1.0), "hard_iron": ("compass", "µT, FRD", 1.0),
    "gps_latency": ("gps", "ms", 1e3), "lever_arm": ("gps", "m, FRD", 1.0),
    **{f"{name}_offset": (name, row.unit, 1.0) for name, row in AIDING_SENSORS.items() if row.offset},
    "compass_latency": ("compass", "ms", 1e3),
}  # fmt: skip
"""Constant of the flight (the matrices are in --json) → the aiding sensor that determines it, its unit, the factor."""


def _add_carrier(parser: options.Parser) -> None:
    """The IMU of a best estimate."""
    parser.add_argument("--imu", metavar="NAME", help="IMU message that carries the estimate (default: the best)")


def smooth_options(parser: options.Parser) -> None:
    """The command's options."""
    options.add_log(parser, *options.FLIGHT)
    _add_carrier(parser)
    options.add(parser, "--json")
    options.add_output(parser, "FILE.tum", "write the trajectory, a pose for each IMU sample")


def run_smooth(arguments: argparse.Namespace) -> int:
    """Print the estimate; write it where requested."""
    path = options.output(arguments, (".tum",), " companion export has more formats.")
    settings, recording, flight = options.one_flight(arguments)
    how = integration_of(settings, flight)
    best = smooth(flight, arguments.imu, gravity=how.gravity)
    errors = autopilot_error(flight, best, how.limits)
    # the biases of the same IMU by the autopilot's estimator
    believed = next((one for one in flight.biases if one.imu_instance in (None, best.imu.instance)), None)
    lines = _lines(flight, best, errors, believed, how.limits)
    tables.show(arguments, lines, lambda: estimate_document(recording.source, flight, best, errors, believed))
    if path is not None:
        with files.replacing(path) as part:
            write_estimate_tum(part, flight, best)
        options.say(f"written: {path} ({best.imu.source})")
    return 0


def _lines(
    flight: Flight, best: BestEstimate, errors: Sequence[AutopilotError], believed: BiasTrack | None, limits: Limits
) -> Iterator[str | Table]:
    yield (
        f"Best estimate of vehicle {flight.vehicle}, boot {flight.boot}, {best.t[0]:.1f}-{best.t[-1]:.1f} s: "
        f"{escape(best.imu.source)} {best.imu.rate_hz:.1f} Hz, {len(best.t)} keyframes; heading from "
        f"{best.heading_from}"
    )
    for title, table in (
        ("Measurements used", _measurements(best)),
        ("Biases (truth = reading - bias)", _biases(best, believed)),
        ("White noise in flight, worst axis", _noise(flight, best, limits)),
        ("Constants of the flight", _constants(best)),
        ("Autopilot minus best estimate", _errors(errors)),
    ):
        if table.row_count:
            yield from (f"\n[bold]{title}[/]", table)
    yield "\n[bold]Where the sensors disagree[/]"
    yield from explained_lines(best.explained)
    yield from (f"Note: {escape(note)}" for note in best.notes)


def _measurements(best: BestEstimate) -> Table:
    shown = tables.table("", "used", "residual, rms", "in σ", "σ, times stated", "doubted", left=1)
    for name, left in best.residuals.items():
        factor, unit = (1e3, "mrad/s") if left.unit == "rad/s" else (1.0, left.unit)
        scales = (f"{left.normalised_rms:.2f}", f"{best.measurement_scale[name]:.2f}", f"{left.doubted:.0%}")
        shown.add_row(words(name), f"{len(left.t)}", f"{fixed(left.rms * factor)} {unit}", *scales)
    return shown


def explained_lines(explanations: Sequence[Explained]) -> Iterator[str]:
    """A line for each explanation: kind, size, time, probabilities and the next likely kind."""
    for one in explanations:
        kind = hypothesis_of(one.kind)
        unit, factor = shown_unit(kind.unit)
        unit += "/s" if one.shape in SLOPED else ""
        size = ", ".join(
            f"{value:.3g} ± {sigma:.2g}" for value, sigma in zip(one.size * factor, one.sigma * factor, strict=True)
        )
        until = f" to {one.end:.1f}" if np.isfinite(one.end) else ""
        other = next((rival.kind for rival in one.rivals if rival.kind != one.kind), "")
        shares = sorted(probabilities(one.rivals).items(), key=lambda pair: -pair[1])
        likely = "; ".join(f"{words(side)} {percent(share)}" for side, share in shares if share > 0.005)
        second = f"; runner-up: {words(other)}" if other else ""
        yield (
            f"  {words(one.kind)}, {one.shape}: {size} {unit} from {one.onset:.1f} ± "
            f"{one.onset_sigma:.1f}{until} s ({likely}{second})"
        )
    if not explanations:
        yield "  nothing: they agree within their noise"


def _biases(best: BestEstimate, believed: BiasTrack | None) -> Table:
    shown = tables.table("", "", "forward", "right", "down", left=2)
    for name, unit, factor, value, sigma, own in (
        ("gyro", "mrad/s", 1e3, best.states.gyro_bias, best.gyro_bias_sigma, believed.gyro if believed else None),
        ("accel", "m/s²", 1.0, best.states.accel_bias, best.accel_bias_sigma, believed.accel if believed else None),
    ):
        cells = (
            f"{v:.3f} ± {s:.3f}"
            for v, s in zip(value.mean(axis=0) * factor, np.median(sigma, axis=0) * factor, strict=True)
        )
        shown.add_row(name, unit, *cells)
        if believed is not None and own is not None and np.isfinite(own).all(axis=1).any():
            shown.add_row("", f"by {believed.source}", *(f"{v:.3f}" for v in np.nanmean(own, axis=0) * factor))
    return shown


def _noise(flight: Flight, best: BestEstimate, limits: Limits) -> Table:
    """The noise as `companion noise` measures it, and the learned noise by which the estimate weighs the IMU."""
    shown = tables.table("", "", "N /√Hz", "data sheet", "times", "weighed as", "lasting", left=2)
    sheet = imu_spec_of(flight, best.imu.source)
    measured = noise_in_flight(flight, flight.imu(best.imu.source), sheet, limits)
    for i, sensor in enumerate(SENSORS):
        given = getattr(sheet, sensor.key).noise_density
        weighed = getattr(best.noise, f"{sensor.key}_noise")
        value = getattr(measured, sensor.key)
        seen, times = ("-", "-") if value is None else (fixed(value * sensor.factor), f"{value / given:.1f}")
        stated, used = fixed(given * sensor.factor), fixed(weighed * sensor.factor)
        shown.add_row(sensor.key, sensor.unit, seen, stated, times, used, f"{best.correlated[i]:.1f}")
    return shown


def _constants(best: BestEstimate) -> Table:
    shown = tables.table("", "", "value", "1σ", left=2)
    for name, (needed, unit, factor) in _CONSTANTS.items():
        if any(sensor.startswith(needed) for sensor in best.residuals):
            place, _ = CONSTANTS[name]
            numbers = (best.states.constants[place] * factor, best.constants_sigma[place] * factor)
            shown.add_row(words(name), unit, *(", ".join(f"{value:.2f}" for value in values) for values in numbers))
    return shown


def _errors(errors: Sequence[AutopilotError]) -> Table:
    shown = tables.table("", "", "median", "95 %", "worst", "at s", "its 1σ", left=2)
    for one in errors:
        unit, factor = shown_unit(one.unit)
        numbers = (fixed(value * factor) for value in (one.median, one.p95, one.worst))
        shown.add_row(one.quantity, unit, *numbers, f"{one.worst_s:.1f}", fixed(one.sigma * factor))
    return shown


_LANES_WIDTH = 100  # columns, at most: longer lines are hard to read


def lanes_options(parser: options.Parser) -> None:
    """The command's options."""
    options.add_log(parser, *options.FLIGHT)
    _add_carrier(parser)
    options.add(parser, "--json")


def run_lanes(arguments: argparse.Namespace) -> int:
    """Print every lane against the best estimate."""
    settings, recording, flight = options.one_flight(arguments)
    own = assess_imu(flight, settings, imu=arguments.imu)
    lanes, best = lanes_of(flight, settings, own)
    tables.show(arguments, _lane_lines(lanes, best), lambda: lanes_document(recording.source, flight, best, lanes))
    return 0


def _lane_lines(lanes: Lanes, best: BestEstimate) -> Iterator[str | Table]:
    yield f"By the best estimate of {best.imu.source}, {best.t[0]:.1f}-{best.t[-1]:.1f} s, without the estimator's own"
    width = min(tables.console().width, _LANES_WIDTH)
    for line in lane_lines(lanes):
        yield from tables.wrapped(line, width, 2)
    for span in lanes.spans:
        if span.lanes:
            title = capitalised(words(span.what))
            yield f"\n[bold]{title}, {span.start_s:.1f}-{span.end_s:.1f} s[/]: error, 95 %, ± of the best estimate"
            yield tables.rendered(lane_table(span))
