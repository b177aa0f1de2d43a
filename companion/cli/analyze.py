"""`companion analyze LOG`: the verdict, the drift, what it should be, the calibration."""

from __future__ import annotations

import argparse
from dataclasses import replace

import msgspec
import numpy as np
from rich.markup import escape

from companion.analysis import (
    NO_CORRECTION,
    Assessment,
    Comparison,
    ImuFigures,
    Limits,
    ReferenceFigures,
    Sibling,
    assess,
    compare,
    gravity_for,
    odd_one_out,
    siblings,
)
from companion.cli import documents, options, tables
from companion.cli.info import reference_line
from companion.correction import load_correction
from companion.sensors import figures_of, load_imu_figures
from companion.settings import Settings
from companion.tracks import Flight

_LOW_RATE_HZ = 40.0  # RAW_IMU is low-passed at 20 Hz: below twice that, motion aliases into the samples


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    parser = options.add_command(
        commands,
        "analyze",
        "Do IMU and autopilot agree? How far the IMU drifts by itself, how far it should, and who is wrong.",
        "companion analyze flight.tlog --imu RAW_IMU --horizons 1,5,10",
    )
    options.add_flight_choice(parser)
    options.add_integration(parser)
    options.add_figures(parser)
    parser.add_argument("--correction", metavar="FILE", help="take the errors out that companion calibrate found")
    parser.add_argument("--horizons", type=_horizons, metavar="S,S,...", help="seconds (default: 1,2,5,10,30)")
    parser.add_argument("--json", action="store_true", help="the same as JSON on stdout (docs/json.md)")
    parser.add_argument(
        "--fail-on",
        choices=("suspect", "insufficient"),
        help="exit with 1 when the IMU or the autopilot is suspect (insufficient: also when the log cannot tell)",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print the analysis of one flight."""
    settings = options.settings_of(arguments)
    recording = options.read(arguments, settings)
    flight = recording.flights[options.choose(recording.flights, arguments)]
    found = assessment_of(flight, arguments, settings)
    others = _siblings(flight, arguments, settings)
    if (odd := odd_one_out(others)) is not None:
        verdict = replace(found.verdict, findings=(*found.verdict.findings, odd))
        found = replace(found, verdict=verdict)
    gravity = gravity_for(flight, settings.integration.gravity)
    limits = limits_of(settings)
    gaps = {name: int((np.diff(track.t) > limits.hole(track.t)).sum()) for name, track in flight.imus.items()}
    if arguments.json:
        document = documents.analysis(recording.source, flight, found, others, gaps, gravity, arguments.correction)
        print(documents.encode(document))
    else:
        _print(flight, found, others, gaps[found.drift.imu], gravity, arguments.correction)
    status = found.verdict.status
    failed = {"suspect": status.endswith("suspect"), "insufficient": status != "consistent"}
    return 1 if arguments.fail_on and failed[arguments.fail_on] else 0


def assessment_of(flight: Flight, arguments: argparse.Namespace, settings: Settings) -> Assessment:
    """Everything about the IMU that was asked for."""
    return assess_imu(flight, arguments.imu, arguments.imu_model, arguments.correction, settings)


def assess_imu(
    flight: Flight, imu: str | None, imu_model: str | None, correction: str | None, settings: Settings
) -> Assessment:
    """Everything about one IMU of a flight, as the settings have it."""
    integration = settings.integration
    name = flight.imu(imu).source
    return assess(
        flight,
        _figures(flight, name, imu_model),
        autopilot=_autopilot(settings),
        horizons=settings.drift.horizons_s,
        imu=name,
        method=integration.method,
        middle=integration.middle,
        segments=integration.segments,
        gravity=gravity_for(flight, integration.gravity),
        limits=limits_of(settings),
        correction=load_correction(correction) if correction else NO_CORRECTION,
    )


def _siblings(flight: Flight, arguments: argparse.Namespace, settings: Settings) -> tuple[Sibling, ...]:
    """Every IMU of the flight, integrated alike. A correction is of one IMU, and is left aside here."""
    integration = settings.integration

    def compare_imu(imu: str) -> Comparison:
        return compare(
            flight,
            imu=imu,
            method=integration.method,
            middle=integration.middle,
            segments=integration.segments,
            gravity=gravity_for(flight, integration.gravity),
            limits=limits_of(settings),
        )

    return siblings(flight, compare_imu, lambda imu: _figures(flight, imu, arguments.imu_model), _autopilot(settings))


def _figures(flight: Flight, imu: str, imu_model: str | None) -> ImuFigures:
    """The sensor figures that were asked for, else those of the part that the vehicle names."""
    return load_imu_figures(imu_model) if imu_model else figures_of(flight, imu)


def _autopilot(settings: Settings) -> ReferenceFigures:
    """How far the settings let the autopilot be off."""
    return ReferenceFigures(**msgspec.structs.asdict(settings.autopilot))


def limits_of(settings: Settings) -> Limits:
    """What the settings call a hole or a jump."""
    return Limits(
        gap_periods=settings.drift.gap_periods,
        gap_s=settings.drift.gap_s,
        position_jump_m=settings.drift.position_jump_m,
        attitude_jump_deg=settings.drift.attitude_jump_deg,
    )


def _print(
    flight: Flight,
    found: Assessment,
    others: tuple[Sibling, ...],
    gaps: int,
    gravity: float,
    correction: str | None,
) -> None:
    console, table = tables.console(), found.drift
    track, vehicle = flight.imu(table.imu), flight.vehicle
    for line in tables.verdict_lines(found):
        console.print(line, highlight=False)
    middle = f", {table.middle} middle sample" if table.method == "rk4" else ""
    lines = [
        "",
        f"[bold]Vehicle {vehicle}, boot {flight.boot}[/]: {vehicle.autopilot} {vehicle.firmware} {vehicle.type}, "
        f"{flight.duration:.1f} s",
        f"IMU:       {table.imu} (IMU {track.instance}), {len(track)} samples at {track.rate_hz:.1f} Hz"
        + (f", {gaps} holes" if gaps else ""),
        f"Figures:   {found.figures.name} ({escape(found.figures.reason)})",
        f"Reference: {reference_line(flight)}",
        f"Method:    {table.method}{middle}, gravity {gravity:.5f} m/s²",
    ]
    if correction:
        lines.append(f"Corrected: by {escape(correction)}")
    lines += [f"Note:      {escape(note)}" for note in (*flight.notes, *table.notes)]
    if track.rate_hz < _LOW_RATE_HZ:
        lines.append(
            f"[yellow]Warning:   {track.rate_hz:.0f} Hz is too low to integrate: motion between the samples is lost, "
            "and most of the drift below is that. Record the IMU at 50-200 Hz, or use the on-board log.[/]"
        )
    for line in lines:
        console.print(line, highlight=False)
    console.print("\n[bold]Drift of the IMU alone from the autopilot[/]")
    console.print(tables.drift_table(table), no_wrap=True)
    for line in tables.left_out(table):
        console.print(line, highlight=False)
    if not any(row.windows for row in table.rows):
        excluded = any(row.excluded for row in table.rows)
        console.print(f"No window could be used: {'see above' if excluded else 'the flight is too short'}.")
        return
    console.print("\n[bold]What it should be, with these figures[/]")
    console.print(tables.expected_table(found), no_wrap=True)
    if len(others) > 1:
        console.print("\n[bold]Every IMU after 5 s[/]")
        console.print(tables.siblings_table(others), no_wrap=True)
    console.print()
    for line in tables.calibration_lines(found):
        console.print(line, highlight=False)


def _horizons(text: str) -> tuple[float, ...]:
    values = tuple(float(part) for part in text.split(","))
    if not all(np.isfinite(v) and v > 0 for v in values):
        raise argparse.ArgumentTypeError(f"must be positive seconds like 1,5,10, got {text!r}")
    return values
