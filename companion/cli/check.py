"""`companion check LOG...`: every flight as a test that passes or fails, for continuous integration."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

from rich.markup import escape

from companion.app import destination
from companion.app.examination import Examination, Unexamined, examine, unexaminable
from companion.app.recording import read_recording
from companion.app.settings import Settings
from companion.cli import options, parsers, tables
from companion.cli.baseline import Baseline, BaselineFlight, compared, measures_of, read_baseline, write_baseline
from companion.cli.junit import Case, Outcome, Suite, junit_xml
from companion.fleet import find_logs, short_names
from companion.model import CompanionError, DataError, Flight, counted
from companion.present import span

_SIGNS: dict[Outcome, str] = {
    "passed": "[green]PASS[/]", "failure": "[red]FAIL[/]", "error": "[red]ERROR[/]", "skipped": "[yellow]SKIP[/]",
}  # fmt: skip
_TOLERANCE = 0.1


def add_options(parser: parsers.Parser) -> None:
    """The command's options."""
    parsers.add_log(parser, takes_several=True)
    parsers.add_integration(parser)
    parsers.add_imu_model(parser)
    parsers.add_core(parser)
    parser.add_argument(
        "--fail-on",
        choices=("suspect", "insufficient"),
        default="suspect",
        help="which verdict fails (default: suspect; insufficient: also a flight without a verdict)",
    )
    parser.add_argument("--junit", metavar="FILE", help="write the results as JUnit XML")
    parser.add_argument("--baseline", metavar="FILE", help="fail where drift or a detectable fault is worse than there")
    parser.add_argument(
        "--tolerance",
        type=parsers.share,
        metavar="PERCENT",
        default=_TOLERANCE,
        help="by how much it may be worse (default: 10%%)",
    )
    parser.add_argument("--write-baseline", metavar="FILE", help="make a baseline of these flights, several at best")


def run(arguments: argparse.Namespace) -> int:
    """Examine every flight, print a line for each and write the files. Exit code: 0, 1 (failed), 2 (not read)."""
    settings = options.settings_of(arguments)
    baseline = read_baseline(arguments.baseline) if arguments.baseline else None
    for name in (arguments.junit, arguments.write_baseline):
        if name:
            destination.check(Path(name), force=True)
    console, suites, flown = tables.console(), list[Suite](), list[BaselineFlight]()
    paths = [one.path for one in find_logs(options.log_paths(arguments), dialect=settings.log.dialect).logs]
    names = short_names(paths)
    for path in paths:
        began, cases = time.monotonic(), list[Case]()
        for case in _cases(path, names[path], settings, arguments, baseline, flown):
            cases.append(case)
            if case.text:
                console.lines(f"{_SIGNS[case.outcome]}  {escape(f'{names[path]}, {case.name}: {case.text}')}")
        suites.append(Suite(names[path], time.monotonic() - began, cases))
    if arguments.junit:
        with destination.replacing(Path(arguments.junit)) as part:
            part.write_bytes(junit_xml("companion", suites))
    if arguments.write_baseline:
        write_baseline(Path(arguments.write_baseline), flown)
    console.lines(_summary(suites))
    bad = {outcome for suite in suites for case in suite.cases if (outcome := case.outcome) in ("failure", "error")}
    return DataError.exit_code if "error" in bad else int("failure" in bad)


def _cases(
    path: str,
    name: str,
    settings: Settings,
    arguments: argparse.Namespace,
    baseline: Baseline | None,
    flown: list[BaselineFlight],
) -> Iterator[Case]:
    """The tests of one log. What a flight was measured at is added to `flown`."""
    try:
        recording = read_recording(path, core=arguments.core, **settings.log.options)
    except CompanionError as error:
        yield Case("is read", "error", str(error))
        return
    if not recording.flights:
        yield Case("has a flight", "error", recording.no_flight)
    for flight in recording.flights:
        vehicle = f"vehicle {flight.vehicle}, boot {flight.boot}"
        try:
            if arguments.imu is not None:
                flight.imu(arguments.imu)
        except DataError as error:  # what was requested was not done, which no run of CI may pass
            yield Case(f"{vehicle}: verdict", "error", str(error))
            continue
        try:
            examined = _examined(flight, settings, arguments)
        except DataError as error:
            yield Case(f"{vehicle}: verdict", "skipped" if arguments.fail_on == "suspect" else "failure", str(error))
            continue
        yield _verdict(vehicle, examined, arguments.fail_on)
        if isinstance(examined, Examination):
            measures = measures_of(examined)
            flown.append(BaselineFlight(dict(measures), name, str(flight.vehicle), flight.boot))
            for one in compared(measures, baseline, arguments.tolerance) if baseline else ():
                yield Case(f"{vehicle}: {one.name}", *(("failure", str(one)) if one.is_worse else ()))


def _examined(flight: Flight, settings: Settings, arguments: argparse.Namespace) -> Examination | Unexamined:
    lacking = unexaminable(flight, settings)
    return lacking or examine(flight, settings, imu=arguments.imu, imu_model=arguments.imu_model)


def _verdict(vehicle: str, of: Examination | Unexamined, fail_on: str) -> Case:
    verdict = of.assessment.verdict if isinstance(of, Examination) else of.verdict
    outcome: Outcome = "passed"
    if options.exit_code(fail_on, [verdict.status]):
        outcome = "failure"
    elif verdict.status != "consistent":
        outcome = "skipped"  # nobody is accused, and nobody cleared
    evidence = "\n".join(f"{span(one)}: {one.evidence}" for one in verdict.findings)
    return Case(f"{vehicle}: verdict", outcome, verdict.summary, evidence or verdict.summary)


def _summary(suites: list[Suite]) -> str:
    totals = {what: sum(suite.count(what) for suite in suites) for what in _SIGNS}
    words = {"failure": "failed", "error": "in error"}
    parts = ", ".join(f"{count} {words.get(what, what)}" for what, count in totals.items() if count)
    seconds = sum(suite.seconds for suite in suites)
    return f"{counted(len(suites), 'log')}, {counted(sum(totals.values()), 'test')}: {parts} ({seconds:.1f} s)"
