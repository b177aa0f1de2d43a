"""`companion analyze LOG`: the drift table."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from companion.analysis import Drift, Limits, Statistic, drift, gravity_for
from companion.cli import options, schema
from companion.cli.info import reference_line
from companion.settings import Settings
from companion.tracks import Flight

_LOW_RATE_HZ = 40.0  # RAW_IMU is low-passed at 20 Hz: below twice that, motion aliases into the samples

_REASONS = {
    "imu_gap": "hole in the IMU",
    "no_attitude": "no attitude",
    "attitude_jump": "attitude jump",
    "no_position": "no position",
    "position_jump": "position jump",
}


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    parser = options.add_command(
        commands,
        "analyze",
        "How far the IMU, integrated by itself, drifts from the autopilot's estimate.",
        "companion analyze flight.tlog --imu RAW_IMU --horizons 1,5,10",
    )
    options.add_flight_choice(parser)
    options.add_integration(parser)
    parser.add_argument("--horizons", type=_horizons, metavar="S,S,...", help="seconds (default: 1,2,5,10,30)")
    parser.add_argument("--json", action="store_true", help="the same as JSON on stdout (docs/json.md)")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print the drift of one flight."""
    settings = options.settings_of(arguments)
    recording = options.read(arguments, settings)
    flight = recording.flights[options.choose(recording.flights, arguments)]
    limits = limits_of(settings)
    integration = settings.integration
    gravity = gravity_for(flight, integration.gravity)
    table = drift(
        flight,
        horizons=settings.drift.horizons_s,
        method=integration.method,
        middle=integration.middle,
        segments=integration.segments,
        imu=arguments.imu,
        gravity=gravity,
        limits=limits,
    )
    gaps = {name: int((np.diff(track.t) > limits.hole(track.t)).sum()) for name, track in flight.imus.items()}
    if arguments.json:
        found = schema.analyze_flight(flight, table, gaps, gravity)
        print(schema.encode(schema.Analysis(log=schema.log_object(recording.source), flights=[found])))
    else:
        _print(flight, table, gaps[table.imu], gravity)
    return 0


def limits_of(settings: Settings) -> Limits:
    """What the settings call a hole or a jump."""
    return Limits(
        gap_periods=settings.drift.gap_periods,
        gap_s=settings.drift.gap_s,
        position_jump_m=settings.drift.position_jump_m,
        attitude_jump_deg=settings.drift.attitude_jump_deg,
    )


def _print(flight: Flight, table: Drift, gaps: int, gravity: float) -> None:
    console = Console(soft_wrap=True, emoji=False)
    track, vehicle = flight.imu(table.imu), flight.vehicle
    middle = f", {table.middle} middle sample" if table.method == "rk4" else ""
    lines = [
        f"[bold]Vehicle {vehicle}, boot {flight.boot}[/]: {vehicle.autopilot} {vehicle.firmware} {vehicle.type}, "
        f"{flight.duration:.1f} s",
        f"IMU:       {table.imu} (IMU {track.instance}), {len(track)} samples at {track.rate_hz:.1f} Hz"
        + (f", {gaps} holes" if gaps else ""),
        f"Reference: {reference_line(flight)}",
        f"Method:    {table.method}{middle}, gravity {gravity:.5f} m/s²",
    ]
    lines += [f"Note:      {escape(note)}" for note in (*flight.notes, *table.notes)]
    if track.rate_hz < _LOW_RATE_HZ:
        lines.append(
            f"[yellow]Warning:   {track.rate_hz:.0f} Hz is too low to integrate: motion between the samples is lost, "
            "and most of the drift below is that. Record the IMU at 50-200 Hz, or use the on-board log.[/]"
        )
    for line in lines:
        console.print(line, highlight=False)
    console.print(drift_table(table), no_wrap=True)
    for line in left_out(table):
        console.print(line, highlight=False)
    if not any(row.windows for row in table.rows):
        console.print(
            "No window could be used"
            + (
                ": see above."
                if any(row.excluded for row in table.rows)
                else ": the flight is shorter than the horizons."
            )
        )


def drift_table(table: Drift) -> Table:
    """The drift as a rich table: median, 95 % and worst of the windows of each horizon."""
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    shown.add_column("\nafter", justify="right", no_wrap=True)
    shown.add_column("\nwindows", justify="right", no_wrap=True)
    for quantity in ("attitude, °", "velocity, m/s", "position, m"):
        shown.add_column(f"{quantity:^18}\n{_line('median', '95 %', 'worst')}", no_wrap=True)
    for row in table.rows:
        shown.add_row(
            f"{row.horizon_s:g} s",
            f"{row.windows}",
            *(_cell(statistic) for statistic in (row.attitude_deg, row.velocity_mps, row.position_m)),
        )
    return shown


def left_out(table: Drift) -> Iterator[str]:
    """A line for each horizon that has windows which were not used."""
    for row in table.rows:
        reasons = ", ".join(f"{count} {_REASONS[reason]}" for reason, count in row.excluded.items())
        if reasons:
            yield f"Left out of the windows of {row.horizon_s:g} s: {reasons}"


def _cell(statistic: Statistic | None) -> str:
    if statistic is None:
        return _line("-", "-", "-")
    return _line(*(_short(value) for value in (statistic.median, statistic.p95, statistic.max)))


def _line(*parts: str) -> str:
    """Three numbers under one another, whatever their length: columns within a column."""
    return "".join(f"{part:>6}" for part in parts)


def _short(value: float) -> str:
    """Three digits, never more than three decimals: five characters, so that the table fits into 80 columns."""
    return (
        f"{value:.3f}"
        if value < 1
        else f"{value:.2f}"
        if value < 10
        else f"{value:.1f}"
        if value < 100
        else f"{value:.0f}"
    )


def _horizons(text: str) -> tuple[float, ...]:
    values = tuple(float(part) for part in text.split(","))
    if not all(np.isfinite(v) and v > 0 for v in values):
        raise argparse.ArgumentTypeError(f"must be positive seconds like 1,5,10, got {text!r}")
    return values
