"""`companion analyze LOG`: the verdict on one screen; with --full drift, expected drift and calibration.

The screen has the verdict, its evidence, the drift of the IMU, the detectable faults, and what to do.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from rich.markup import escape
from rich.table import Table

from companion import present
from companion.app.examination import Examination, Unexamined, examined_or_not
from companion.cli import many_logs, options, tables
from companion.cli.info import reference_line
from companion.documents import analysis_document
from companion.estimation import HYPOTHESES, BestEstimate, ConfusionMatrix, Identifiability, hypothesis_of
from companion.model import DataError, Flight, counted, words
from companion.verdict import Assessment, Verdict, rate_warning


def analyze_options(parser: options.Parser) -> None:
    """The command's options."""
    options.add_log(parser, *options.JUDGEMENT, "--anchor", takes_several=True)
    parser.add_argument("--full", action="store_true", help="everything: all findings, all tables, the calibration")
    parser.add_argument(
        "--confusion",
        action="store_true",
        help="the smallest size at which each fault is distinguished from the others (takes some 10 s more)",
    )
    options.add(parser, "--json")
    fails = "exit with 1 when the IMU or the autopilot is suspect (insufficient: also without a verdict)"
    options.add_fail_on(parser, fails)


def run_analyze(arguments: argparse.Namespace) -> int:
    """Print the analysis of one flight, or a row for each flight of several logs."""
    if len(arguments.logs) > 1 or Path(arguments.logs[0]).is_dir():
        return many_logs.print_verdicts(arguments)
    arguments.log = arguments.logs[0]
    settings, recording, flight = options.one_flight(arguments)
    if arguments.imu is not None:
        flight.imu(arguments.imu)  # one that was requested and is not there is a mistake, not a poor log
    chosen = {**options.chosen(arguments), "anchor": arguments.anchor, "confusion": arguments.confusion}
    examined = examined_or_not(flight, settings, **chosen)
    tables.show(arguments, _lines(examined, arguments), lambda: analysis_document(recording.source, examined))
    if isinstance(examined, Unexamined) and not examined.says_something:  # a code that no script takes for an analysis
        log = "-" if recording.source.kept_in else recording.source.path
        options.say(f"companion: nothing was analysed. What the log has: companion info {log}")
        return DataError.exit_code
    return options.exit_code(arguments.fail_on, [examined.verdict.status])


def _lines(examined: Examination | Unexamined, arguments: argparse.Namespace) -> Iterator[str | Table]:
    width = tables.console().width
    if isinstance(examined, Unexamined):
        yield from tables.verdict_lines(examined.verdict)
        return
    yield from _everything(examined) if arguments.full else first_screen(examined, width)
    if examined.alignment is not None:
        yield from tables.alignment_lines(examined.alignment)
    if arguments.confusion:
        yield from confusion_lines(examined.assessment.best, width)


def _everything(examined: Examination) -> Iterator[str | Table]:
    flight, assessment = examined.flight, examined.assessment
    drift = assessment.drift
    gaps, track = examined.gaps[drift.imu], flight.imu(drift.imu)
    yield from tables.verdict_lines(assessment.verdict)
    yield ""
    yield f"[bold]Vehicle {flight.vehicle}, boot {flight.boot}[/]: {_vehicle(flight)}"
    yield (
        f"IMU:       {drift.imu} (IMU {track.instance}), {len(track)} samples at {track.rate_hz:.1f} Hz"
        + (f", {counted(gaps, 'gap')}" if gaps else "")
    )
    yield f"IMU noise model: {assessment.imu_spec.name} ({escape(assessment.imu_spec.reason)})"
    yield from tables.noise_lines(assessment)
    yield tables.autopilot_line(assessment)
    yield f"Reference: {reference_line(flight)}"
    how = assessment.comparison.how
    yield f"Method:    {present.method_words(drift.method, drift.middle)}, gravity {how.gravity:.5f} m/s²"
    if examined.correction:
        yield f"Corrected: by {escape(examined.correction)}"
    yield from (f"Note:      {escape(note)}" for note in (*flight.notes, *drift.notes))
    if warning := rate_warning(flight, track.rate_hz):
        yield f"[yellow]Warning:   {warning}[/]"
    yield "\n[bold]Drift of the IMU alone from the autopilot[/]"
    yield tables.rendered(present.drift_table(drift))
    yield from present.left_out_lines(drift)
    if not any(row.windows for row in drift.rows):
        excluded = any(row.excluded for row in drift.rows)
        yield f"No window could be used: {'see above' if excluded else 'the flight is too short'}."
        return
    yield "\n[bold]Allowed drift (1σ)[/]"
    yield tables.rendered(present.expected_table(assessment))
    yield "\n[bold]Windows inside the 95 % bound[/]"
    yield tables.rendered(present.agreement_table(assessment))
    if len(examined.redundant_imus) > 1:
        yield "\n[bold]Every IMU after 5 s[/]"
        yield tables.rendered(present.redundant_imus_table(examined.redundant_imus))
    yield ""
    yield from tables.calibration_lines(assessment)


def _vehicle(flight: Flight) -> str:
    return f"{present.vehicle_words(flight.vehicle)}, {flight.duration:.1f} s"


_MOST_LINES = 23  # in _COLUMNS, and the prompt: an old terminal's window; one that is narrower is taller
_COLUMNS = 80
_WIDEST = 100
_SHOWN_S = 10.0  # the horizon that is printed, or the one nearest to it
_LABEL = 18  # columns of what stands before a line
_ADVICES = 2
_FLIGHTS = 3  # of several in a log


def first_screen(examined: Examination, width: int) -> list[str]:
    """Lines of rich markup, mostly at most 23 in 80 columns; but for the gravest finding the rest is behind --full."""
    assessment = examined.assessment
    width = min(width, _WIDEST)
    flight, track = examined.flight, examined.flight.imu(assessment.drift.imu)
    status = words(assessment.verdict.status).upper()
    head = tables.wrapped(f"{status}  {present.clause(assessment.verdict.summary)}", width, 2)
    head[0] = head[0].replace(escape(status), tables.status_text(assessment.verdict.status), 1)
    used = f"{assessment.drift.imu} at {track.rate_hz:.1f} Hz"
    head += tables.wrapped(f"Vehicle {flight.vehicle}, boot {flight.boot}: {_vehicle(flight)}; {used}", width, 2)
    rows = [*_rows(assessment, rate_warning(flight, track.rate_hz) or "")]
    tail = [line for label, text in rows for line in _labelled(label, text, width)]
    room = max(_MOST_LINES, _MOST_LINES * _COLUMNS // width) - len(head) - len(tail) - 4
    shown = _evidence(assessment.verdict, width, room)
    more = "Everything else, with all tables: --full"
    return [*head, "", *shown, *([""] if shown else []), *tail, "", more]


def _rows(assessment: Assessment, warning: str) -> Iterator[tuple[str, str]]:
    """The lines under the evidence: label, text. warning: of a rate too low; "" for none."""
    if warning:
        yield "Warning", warning
    flights = present.flight_lines(assessment.verdict)
    yield from flights[:_FLIGHTS]
    if len(flights) > _FLIGHTS:
        yield "", f"and {counted(len(flights) - _FLIGHTS, 'flight')} more: --full"
    if sides := present.likeliest(assessment.verdict):
        yield "Probability", sides
    yield _drift(assessment)
    could = assessment.sensitivity
    if could.smallest:
        yield "Detectable", str(could)
    for why in could.not_judged:
        yield "Not judged", why
    severe = (f for f in assessment.verdict.findings if f.severity != "info")
    advices = dict.fromkeys(f.advice for f in severe if f.advice and f.advice not in warning)
    for i, advice in enumerate(list(advices)[:_ADVICES]):
        yield "" if i else "What to do", advice


def _drift(assessment: Assessment) -> tuple[str, str]:
    """Measured against expected at one horizon: label, words."""
    rows = assessment.drift.rows
    i = min(range(len(rows)), key=lambda i: (not rows[i].windows, abs(rows[i].horizon_s - _SHOWN_S)))
    row, sigma = rows[i], assessment.expected_of(i)
    label = f"After {row.horizon_s:g} s"
    if sigma is None:
        return label, "no window could be used"
    pairs = ((q, getattr(row, q.attribute), getattr(sigma, q.attribute)) for q in present.QUANTITIES)
    parts = [
        f"{present.fixed(s.median)}{q.after} ({present.fixed(e)} allowed)" for q, s, e in pairs if s and e is not None
    ]
    return label, f"the IMU alone is off by {', '.join(parts)}: median of {counted(row.windows, 'window')}"


def _evidence(verdict: Verdict, width: int, room: int) -> list[str]:
    lines: list[str] = []
    groups, _ = present.ranked(verdict.findings)
    left = len(verdict.findings)
    for group in groups:
        when = f"{group.when}: " if group.when else ""
        said = verdict.cause is None and str(group) in verdict.summary
        own = tables.wrapped(f"{when}{'as above' if said else group}", width - 4, 0)
        if lines and len(lines) + len(own) > room - (len(group.findings) < left):
            break
        left -= len(group.findings)
        lines.append(f"  {tables.SIGNS[group.findings[0].severity]} {own[0]}")
        lines += [f"    {line}" for line in own[1:]]
    if left:
        lines.append(f"  and {left} more: --full")
    return lines


def _labelled(label: str, text: str, width: int) -> list[str]:
    lines = tables.wrapped(text, width - _LABEL, 0)
    return [f"[bold]{label:<{_LABEL}}[/]{lines[0]}", *(" " * _LABEL + line for line in lines[1:])]


_NO_FAULT = ("perhaps harmless", "cannot tell", "nobody")


def confusion_lines(best: BestEstimate | None, width: int) -> Iterator[str | Table]:
    """Both tables; without a best estimate a line that says so."""
    yield ""
    if best is None or best.confusion is None:
        yield "No confusion matrix: no best estimate could be made."
        return
    matrix = best.confusion
    level = float(np.linalg.norm(best.states.constant("earth_field")[:2]))
    yield "[bold]Smallest faults, and what one that is not detected does to the best estimate[/]"
    yield _sizes(matrix, level)
    yield "\n[bold]Confusion matrix: what a fault of the detectable size is called[/]"
    yield _called(matrix)
    yield from _notes(matrix, width)


def _sizes(matrix: ConfusionMatrix, level: float) -> Table:
    """level: of the horizontal Earth field, µT."""
    shown = tables.table("fault", "detectable", "identifiable", "tilt", "heading", "velocity", "position", left=1)
    for row in matrix.rows:
        shown.add_row(
            _fault(row),
            _size(row.kind, row.detectable, level),
            "never" if row.identifiable is None else _size(row.kind, row.identifiable, level),
            f"{_digits(np.degrees(row.tilt))}°",
            f"{_digits(np.degrees(row.heading))}°",
            f"{_digits(row.velocity)} m/s",
            f"{_digits(row.position)} m",
        )
    return shown


def _called(matrix: ConfusionMatrix) -> Table:
    seen = {name for row in matrix.rows for name in row.called}
    names = [name for name in (*(kind.name for kind in HYPOTHESES), *_NO_FAULT) if name in seen]
    shown = tables.table("fault", left=1)
    for name in names:
        shown.add_column(words(name), justify="right")
    for row in matrix.rows:
        shown.add_row(_fault(row), *(present.percent(row.called[name]) if name in row.called else "" for name in names))
    return shown


def _notes(matrix: ConfusionMatrix, width: int) -> Iterator[str]:
    yield from tables.wrapped(
        f"{matrix.draws} data sets a fault, drawn in the middle of the flight with the noise that was learned from it. "
        "Identifiable: the sensor at fault is accused in 95 % of them. Perhaps harmless: one sensor is known to be "
        "off, but not whether by enough to be a fault.",
        width,
        0,
    )
    if matrix.not_shown:
        yield from tables.wrapped(
            f"Not detectable at any likely size: {', '.join(map(words, matrix.not_shown))}.", width, 0
        )


def _fault(row: Identifiability) -> str:
    return f"{words(row.kind)}, {row.lasts:g} s" if row.lasts else words(row.kind)


def _size(name: str, value: float, level: float) -> str:
    """Of a field that turns the angle, as in the verdict."""
    unit = hypothesis_of(name).unit
    if name == "compass_field":
        unit, value = "rad", float(np.arctan(value / max(level, 1e-9)))
    shown, factor = present.shown_unit(unit)
    return present.with_unit(_digits(value * factor), shown)


def _digits(value: float) -> str:
    """Two digits, and no less than 0.01."""
    return f"{value:.{max(0, min(2, 1 - int(np.floor(np.log10(max(value, 1e-9))))))}f}"
