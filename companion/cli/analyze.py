"""`companion analyze LOG`: the verdict on one screen; with --full the drift, what it should be, the calibration.

The screen says the verdict, why, how far the IMU drifts, what could have been seen, and what to do.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from companion.analysis import Assessment, Finding, rate_warning
from companion.app.examination import Examination, Unexamined, examine, unexaminable
from companion.app.recording import Source
from companion.cli import many_logs, options, sensor_lines, tables
from companion.cli.confusion import print_confusion
from companion.cli.info import reference_line
from companion.cli.tables import SIGNS, status_text, wrapped
from companion.documents import analysis_document, encode, unexamined_document
from companion.model import DataError, counted
from companion.present import clause, fixed, flight_words, ranked, vehicle_words, words
from companion.strapdown import METHODS


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    parser = options.add_command(
        commands,
        "analyze",
        "The verdict: do IMU and autopilot agree, or which is wrong?",
        "Do IMU and autopilot agree? How far the IMU drifts by itself, how far it should, and who is wrong.",
        "companion analyze flight.tlog --imu RAW_IMU --horizons 1,5,10",
        takes_several=True,
    )
    options.add_judgement(parser)
    options.add_anchor(parser)
    parser.add_argument("--full", action="store_true", help="everything: all findings, all tables, the calibration")
    parser.add_argument(
        "--confusion",
        action="store_true",
        help="from which size on each fault is told from the others in this flight (takes some 10 s more)",
    )
    parser.add_argument("--json", action="store_true", help="the same as JSON on stdout (docs/json.md)")
    parser.add_argument(
        "--fail-on",
        choices=("suspect", "insufficient"),
        help="exit with 1 when the IMU or the autopilot is suspect (insufficient: also when the log cannot tell)",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print the analysis of one flight, or a row for each flight of several logs."""
    if len(arguments.logs) > 1 or Path(arguments.logs[0]).is_dir():
        return many_logs.print_verdicts(arguments)
    arguments.log = arguments.logs[0]
    settings, recording, flight = options.one_flight(arguments)
    if arguments.imu is not None:
        flight.imu(arguments.imu)  # one that was asked for and is not there is a mistake, not a poor log
    if (lacking := unexaminable(flight, settings)) is not None:
        return _refuse(lacking, recording.source, as_json=arguments.json)
    examined = examine(
        flight,
        settings,
        imu=arguments.imu,
        imu_model=arguments.imu_model,
        correction=arguments.correction,
        anchor=arguments.anchor,
        confusion=arguments.confusion,
    )
    if arguments.json:
        print(encode(analysis_document(recording.source, examined)))
    else:
        console = tables.console()
        if arguments.full:
            _print(examined, console)
        else:
            for line in first_screen(examined, console.width):
                console.print(line, highlight=False)
        _print_alignment(examined, console)
        if arguments.confusion:
            print_confusion(examined.assessment.best, console)
    return options.exit_code(arguments.fail_on, [examined.assessment.verdict.status])


def _refuse(lacking: Unexamined, source: Source, *, as_json: bool) -> int:
    """The verdict on a flight that cannot be examined, and an exit code that no script takes for an analysis."""
    if as_json:
        print(encode(unexamined_document(source, lacking)))
    else:
        for line in tables.verdict_lines(lacking.verdict):
            tables.console().print(line, highlight=False)
    options.say(
        f"companion: nothing was analysed. What the log has: companion info {'-' if source.kept_in else source.path}"
    )
    return DataError.exit_code


def _print(examined: Examination, console: Console) -> None:
    flight, assessment = examined.flight, examined.assessment
    table = assessment.drift
    gaps = examined.gaps[table.imu]
    track, vehicle = flight.imu(table.imu), flight.vehicle
    for line in tables.verdict_lines(assessment.verdict):
        console.print(line, highlight=False)
    middle = f", {table.middle} middle sample" if METHODS[table.method].looks_inside else ""
    lines = [
        "",
        f"[bold]Vehicle {vehicle}, boot {flight.boot}[/]: {vehicle_words(vehicle)}, {flight.duration:.1f} s",
        f"IMU:       {table.imu} (IMU {track.instance}), {len(track)} samples at {track.rate_hz:.1f} Hz"
        + (f", {counted(gaps, 'gap')}" if gaps else ""),
        f"IMU noise model: {assessment.figures.name} ({escape(assessment.figures.reason)})",
        *sensor_lines.noise_lines(assessment),
        sensor_lines.autopilot_line(assessment),
        f"Reference: {reference_line(flight)}",
        f"Method:    {table.method}{middle}, gravity {assessment.comparison.how.gravity:.5f} m/s²",
    ]
    if examined.correction:
        lines.append(f"Corrected: by {escape(examined.correction)}")
    lines += [f"Note:      {escape(note)}" for note in (*flight.notes, *table.notes)]
    if warning := rate_warning(flight, track.rate_hz):
        lines.append(f"[yellow]Warning:   {warning}[/]")
    for line in lines:
        console.print(line, highlight=False)
    console.print("\n[bold]Drift of the IMU alone from the autopilot[/]")
    console.print(tables.drift_table(table), no_wrap=True)
    for line in tables.left_out_lines(table):
        console.print(line, highlight=False)
    if not any(row.windows for row in table.rows):
        excluded = any(row.excluded for row in table.rows)
        console.print(f"No window could be used: {'see above' if excluded else 'the flight is too short'}.")
        return
    console.print("\n[bold]Expected drift (1σ)[/]")
    console.print(tables.expected_table(assessment), no_wrap=True)
    console.print("\n[bold]Windows inside the 95 % bound[/]")
    console.print(tables.agreement_table(assessment), no_wrap=True)
    if len(examined.redundant_imus) > 1:
        console.print("\n[bold]Every IMU after 5 s[/]")
        console.print(tables.redundant_imus_table(examined.redundant_imus), no_wrap=True)
    console.print()
    for line in sensor_lines.calibration_lines(assessment):
        console.print(line, highlight=False)


def _print_alignment(examined: Examination, console: Console) -> None:
    if examined.alignment is not None:
        for line in sensor_lines.alignment_lines(examined.alignment):
            console.print(line, highlight=False)


_MOST_LINES = 23  # in _COLUMNS, and the prompt: an old terminal's window; one that is narrower is taller
_COLUMNS = 80
_WIDEST = 100
_SHOWN_S = 10.0  # the horizon that is told, or the one nearest to it
_LABEL = 18  # columns of what stands before a line
_ADVICES = 2
_FLIGHTS = 3  # of several in a log


def first_screen(examined: Examination, width: int) -> list[str]:
    """Lines of rich markup, at most 23 in 80 columns; what does not fit is behind --full."""
    assessment = examined.assessment
    width = min(width, _WIDEST)
    flight, track = examined.flight, examined.flight.imu(assessment.drift.imu)
    status = words(assessment.verdict.status).upper()
    head = wrapped(f"{status}  {clause(assessment.verdict.summary)}", width, 2)
    head[0] = head[0].replace(escape(status), status_text(assessment.verdict.status), 1)
    vehicle = flight.vehicle
    head += wrapped(
        f"Vehicle {vehicle}, boot {flight.boot}: {vehicle_words(vehicle)}, {flight.duration:.1f} s; "
        f"{assessment.drift.imu} at {track.rate_hz:.1f} Hz",
        width,
        2,
    )
    rows = [*_rows(assessment, rate_warning(flight, track.rate_hz) or "")]
    tail = [line for label, text in rows for line in _labelled(label, text, width)]
    room = max(_MOST_LINES, _MOST_LINES * _COLUMNS // width) - len(head) - len(tail) - 4
    shown = _evidence(assessment.verdict.findings, width, room)
    more = "Everything else, with all tables: --full"
    return [*head, "", *shown, *([""] if shown else []), *tail, "", more]


def _rows(assessment: Assessment, warning: str) -> Iterator[tuple[str, str]]:
    """What is said under the evidence: label, words. warning: of a rate too low; "" for none."""
    if warning:
        yield "Warning", warning
    flights = assessment.verdict.flights
    for i, flight in enumerate(flights[:_FLIGHTS], 1):
        yield f"Flight {i}", flight_words(flight)
    if len(flights) > _FLIGHTS:
        yield "", f"and {counted(len(flights) - _FLIGHTS, 'flight')} more: --full"
    yield _drift(assessment)
    could = assessment.sensitivity
    if could.smallest:
        yield "Detectable", str(could)
    for why in could.not_judged:
        yield "Not judged", why
    told = [
        f.advice for f in assessment.verdict.findings if f.severity != "info" and f.advice and f.advice not in warning
    ]
    for i, advice in enumerate(list(dict.fromkeys(told))[:_ADVICES]):
        yield "" if i else "What to do", advice


def _drift(assessment: Assessment) -> tuple[str, str]:
    """Measured against expected at one horizon: label, words."""
    rows = assessment.drift.rows
    i = min(range(len(rows)), key=lambda i: (not rows[i].windows, abs(rows[i].horizon_s - _SHOWN_S)))
    row, expected = rows[i], assessment.expected_of(i)
    label = f"After {row.horizon_s:g} s"
    if expected is None:
        return label, "no window could be used"
    pairs = (
        (row.attitude_deg, expected.attitude_deg, "°"),
        (row.velocity_mps, expected.velocity_mps, " m/s"),
        (row.position_m, expected.position_m, " m"),
    )
    parts = [f"{fixed(s.median)}{unit} ({fixed(e)} expected)" for s, e, unit in pairs if s and e is not None]
    return label, f"the IMU alone is off by {', '.join(parts)}: median of {counted(row.windows, 'window')}"


def _evidence(findings: Sequence[Finding], width: int, room: int) -> list[str]:
    lines: list[str] = []
    groups, _ = ranked(findings)
    left = len(findings)
    for group in groups:
        when = f"{group.when}: " if group.when else ""
        own = wrapped(f"{when}{group}", width - 4, 0)
        if len(lines) + len(own) > room - (len(group.findings) < left):
            break
        left -= len(group.findings)
        lines.append(f"  {SIGNS[group.findings[0].severity]} {own[0]}")
        lines += [f"    {line}" for line in own[1:]]
    if left:
        lines.append(f"  and {left} more: --full" if lines else f"  {counted(left, 'finding')}: --full")
    return lines


def _labelled(label: str, text: str, width: int) -> list[str]:
    lines = wrapped(text, width - _LABEL, 0)
    return [f"[bold]{label:<{_LABEL}}[/]{lines[0]}", *(" " * _LABEL + line for line in lines[1:])]
