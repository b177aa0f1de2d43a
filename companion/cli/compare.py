"""`companion compare A [B]`: two flights, or one flight before and after a change, side by side."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from companion.app.examination import Examination, examine
from companion.app.recording import Recording
from companion.cli import options, tables
from companion.comparison import DriftRow, Expected
from companion.documents import contrast_document, encode
from companion.model import DataError, SettingsError, words
from companion.present import CALIBRATED, QUANTITIES, clause, dominant, fixed, method_words
from companion.verdict import Change, Contrast, contrast

_OF_B = {
    "config": ("FILE", "settings file"),
    "vehicle": ("SYSID[:COMPID]", "vehicle"),
    "boot": ("N", "boot"),
    "imu": ("NAME", "message to integrate"),
    "imu_model": ("NAME", "IMU noise model"),
    "method": ("NAME", "integrator"),
    "correction": ("FILE", "correction by companion calibrate"),
}
"""Options that B may have otherwise than A: their value and what they are."""

_COLOURS = {"worse": "red", "better": "green", "same": "dim"}


def compare_options(parser: options.Parser) -> None:
    """The command's options."""
    options.add_log(parser, *options.JUDGEMENT)
    parser.add_argument("b", metavar="B", nargs="?", help="the other log (default: the same, with an option for B)")
    changed = parser.add_argument_group("what is different for B (all other options are for both)")
    for name, (value, what) in _OF_B.items():
        kind = int if name == "boot" else str
        changed.add_argument(f"--{name.replace('_', '-')}-b", metavar=value, type=kind, help=f"{what} of B")
    options.add(parser, "--json")
    parser.add_argument(
        "--fail-on-worse",
        type=options.share,
        metavar="PERCENT",
        help="exit with 1 when B drifts more than A by more than this, and by more than the spread between windows",
    )


def run_compare(arguments: argparse.Namespace) -> int:
    """Print both flights side by side."""
    changes = {name: value for name in _OF_B if (value := getattr(arguments, f"{name}_b")) is not None}
    if arguments.b is None and not changes:
        choices = ", ".join(f"--{name.replace('_', '-')}-b" for name in _OF_B)
        raise SettingsError(f"nothing to compare with: name a second log, or what B has otherwise ({choices}).")
    of_b = argparse.Namespace(**(vars(arguments) | changes | {"log": arguments.b or arguments.log}))
    first, a = _examined(arguments)
    second, b = _examined(of_b)
    same = Path(first.source.path).resolve() == Path(second.source.path).resolve()
    same = same and (a.flight.vehicle, a.flight.boot) == (b.flight.vehicle, b.flight.boot)
    difference = contrast(a.assessment, b.assessment, same_flight=same)
    worse = difference.worse_than(arguments.fail_on_worse) if arguments.fail_on_worse is not None else []
    if arguments.json:
        print(encode(contrast_document(difference, (first.source, a), (second.source, b), same_flight=same)))
    else:
        tables.console().lines(*_lines(difference, (first, a), (second, b), same))
        for horizon, quantity, change in worse:
            options.say(f"worse than allowed: {quantity} after {horizon:g} s, {_percent(change.ratio)}")
    return 1 if worse else 0


def _examined(arguments: argparse.Namespace) -> tuple[Recording, Examination]:
    settings, recording, flight = options.one_flight(arguments)
    try:
        return recording, examine(flight, settings, **options.chosen(arguments))
    except DataError as error:
        raise DataError(f"{recording.source.path}: {error}") from None  # there are two logs


def _lines(
    difference: Contrast, a: tuple[Recording, Examination], b: tuple[Recording, Examination], same: bool
) -> Iterator[str | Table]:
    yield f"[bold]{outcome(difference)}[/]\n"
    for name, (recording, examined) in (("A", a), ("B", b)):
        verdict, table, flight = examined.assessment.verdict, examined.assessment.drift, examined.flight
        yield (
            f"[bold]{name}[/]  {tables.status_text(verdict.status)}  {escape(str(recording.source.path))}, vehicle "
            f"{flight.vehicle}, boot {flight.boot}: {table.imu} {flight.imu(table.imu).rate_hz:.1f} Hz, "
            f"{method_words(table.method, table.middle)}"
            + (f", corrected by {escape(examined.correction)}" if examined.correction else "")
        )
        yield f"   {escape(clause(verdict.summary))}"
    if any(row.changes for row in difference.rows):
        yield "\n[bold]Drift: median of the windows, and how B's errors compare with A's[/]"
        yield _drift_table(difference)
        way = "window by window" if same else "one set of windows against the other"
        yield f"* larger than the spread between windows: 95 % intervals of the change, {way}"
        yield from _significant(difference)
        yield "\n[bold]Allowed drift (1σ)[/]"
        yield _budget_table(difference)
    yield ""
    yield from _finding_lines(difference)
    yield from _calibration_lines(difference)


def outcome(difference: Contrast) -> str:
    """The answer in a sentence: whether B drifts more, and where the change is largest."""
    if not any(row.changes for row in difference.rows):
        return "No horizon has usable windows in both: nothing to compare."
    parts = []
    for direction, sign in (("worse", 1.0), ("better", -1.0)):
        significant = [
            (sign * change.ratio, f"{quantity} after {row.a.horizon_s:g} s {_percent(change.ratio)}")
            for row in difference.rows
            for quantity, change in row.changes.items()
            if change.direction == direction
        ]
        if significant:
            more = f", and {len(significant) - 1} more" if len(significant) > 1 else ""
            parts.append(f"{direction}: {max(significant)[1]}{more}")
    return f"B is {'; '.join(parts)}." if parts else "No significant change: B differs no more than windows do."


def _drift_table(difference: Contrast) -> Table:
    shown = tables.table("\nafter", "windows\nA    B")
    for quantity in QUANTITIES:
        shown.add_column(f"{quantity.title:^19}\n{'A':>6}{'B':>6}{'change':>7}", no_wrap=True)
    for row in difference.rows:
        cells = (_cell(row.a, row.b, q.attribute, row.changes.get(q.name)) for q in QUANTITIES)
        shown.add_row(f"{row.a.horizon_s:g} s", f"{row.a.windows} {row.b.windows:>4}", *cells)
    return shown


def _cell(a: DriftRow, b: DriftRow, key: str, change: Change | None) -> str:
    before, after = getattr(a, key), getattr(b, key)
    medians = "".join(f"{'-' if s is None else fixed(s.median):>6}" for s in (before, after))
    if change is None:
        return f"{medians}{'-':>6} "
    star = " " if change.direction == "same" else "*"
    return f"{medians}[{_COLOURS[change.direction]}]{_percent(change.ratio):>6}[/]{star}"


def _significant(difference: Contrast) -> list[str]:
    lines = [
        f"  {change.direction}: {quantity} after {row.a.horizon_s:g} s {_percent(change.ratio)} "
        f"({_percent(change.low)} to {_percent(change.high)})"
        for row in difference.rows
        for quantity, change in row.changes.items()
        if change.direction != "same"
    ]
    return lines or ["  nothing is: what differs is no more than windows differ among themselves"]


def _budget_table(difference: Contrast) -> Table:
    shown = tables.table("\nafter")
    quantities = [quantity for quantity in QUANTITIES if quantity.name != "velocity"]
    for quantity in quantities:
        shown.add_column(f"{quantity.title:^12}\n{'A':>6}{'B':>6}", no_wrap=True)
    shown.add_column("mostly\nA", no_wrap=True)
    shown.add_column("\nB", no_wrap=True)
    for row in difference.rows:
        both = (row.expected_a, row.expected_b)
        cells = ("".join(f"{_expected(e, key):>6}" for e in both) for key in (q.attribute for q in quantities))
        mostly = ("-" if e is None else dominant(e) for e in both)
        shown.add_row(f"{row.a.horizon_s:g} s", *cells, *mostly)
    return shown


def _expected(expected: Expected | None, key: str) -> str:
    value = getattr(expected, key, None)
    return "-" if value is None else fixed(value)


def _finding_lines(difference: Contrast) -> list[str]:
    lines = []
    for title, several in (("only in A", difference.gone), ("only in B", difference.new)):
        for kind in dict.fromkeys(finding.kind for finding in several):
            evidence = [finding.evidence for finding in several if finding.kind == kind]
            more = f" (and {len(evidence) - 1} more)" if len(evidence) > 1 else ""
            lines.append(f"Finding {title}: {words(kind)}. {escape(evidence[0])}{more}")
    if difference.kept:
        lines.append(f"Findings in both: {', '.join(words(kind) for kind in difference.kept)}")
    return lines or ["Findings: none in either"]


def _calibration_lines(difference: Contrast) -> list[str]:
    differing = [fitted for fitted in difference.figures if fitted.differs]
    lines = []
    for fitted in differing:
        name = next(part for part in CALIBRATED if fitted.name.startswith(part))
        part, axis = CALIBRATED[name], fitted.name.removeprefix(name).replace("_", " ")
        a, b, sigma = (f"{value * part.factor:.{part.digits}f}" for value in (fitted.a, fitted.b, fitted.sigma))
        lines.append(f"Calibration differs: {part.title}{axis} {a} → {b} {part.unit} (± {sigma})")
    if not differing and difference.figures:
        lines.append(
            f"Calibration: none of the {len(difference.figures)} parameters that both flights determine differs (95 %)"
        )
    return lines


def _percent(ratio: float) -> str:
    change = 100 * (ratio - 1)
    if change > 999:
        return ">999%" if change < float("inf") else "?"
    return f"{change:+.0f}%" if abs(change) >= 0.5 else "±0%"
