"""`companion check LOG...`: every flight as a test that passes or fails, for continuous integration.

The results are written as JUnit XML (https://github.com/testmoapp/junitxml). A baseline holds how far the IMU drifted
and what was detectable in flights of one kind.
"""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree as ET

import msgspec
from rich.markup import escape

from companion.app import files
from companion.app.examination import Examination, examined_or_not
from companion.app.recording import read_recording
from companion.app.settings import Settings
from companion.cli import options, tables
from companion.documents import SCHEMA
from companion.model import CompanionError, DataError, InputError, counted
from companion.present import QUANTITIES, span
from companion.verdict import Verdict

Measures = Mapping[str, float]
"""What a flight is compared by, the smaller the better: "detectable gyro_bias", "drift 10 s position_m". SI, °."""


class BaselineFlight(msgspec.Struct, frozen=True):
    """One flight of the baseline; limits that somebody sets by hand are one too."""

    measures: dict[str, float]
    log: str = ""
    vehicle: str = ""
    boot: int = 1


class Baseline(msgspec.Struct, frozen=True):
    """The file. The worst of its flights is the limit: of N alike, one more is worse than all in 1 of N + 1 cases."""

    flights: tuple[BaselineFlight, ...]
    schema: int = SCHEMA

    @property
    def limits(self) -> Measures:
        """The largest of each measure."""
        names = dict.fromkeys(name for flight in self.flights for name in flight.measures)
        return {name: max(f.measures[name] for f in self.flights if name in f.measures) for name in names}

    @property
    def always(self) -> frozenset[str]:
        """The measures that every flight of it has."""
        return frozenset(self.limits).intersection(*(flight.measures for flight in self.flights))


def measures_of(examined: Examination) -> Measures:
    """The detectable size of each fault, and the median drift at each horizon."""
    could, rows = examined.assessment.sensitivity.smallest, examined.assessment.drift.rows
    drift = {
        f"drift {row.horizon_s:g} s {quantity.attribute}": statistic.median
        for row in rows
        for quantity in QUANTITIES
        if (statistic := getattr(row, quantity.attribute)) is not None
    }
    return {f"detectable {kind}": size for kind, size in could.items()} | drift


def read_baseline(path: str) -> Baseline:
    """Raises InputError for a file that cannot be read or is no baseline."""
    try:
        baseline = msgspec.json.decode(Path(path).read_bytes(), type=Baseline)
    except OSError as error:
        raise InputError(f"cannot read the baseline {path}: {error.strerror}. Write one: --write-baseline.") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path} is no baseline: {error}. Write one: --write-baseline.") from None
    if not baseline.limits:
        raise InputError(f"the baseline {path} has no measures: it would let everything pass.")
    return baseline


def write_baseline(path: Path, flights: Sequence[BaselineFlight]) -> None:
    """Raises InputError where there is nothing to write, or no place."""
    if not flights:
        raise InputError("no baseline written: none of the flights could be examined.")
    files.write(path, msgspec.json.format(msgspec.json.encode(Baseline(tuple(flights))), indent=2) + b"\n")


Outcome = Literal["passed", "failure", "error", "skipped"]

_ILLEGAL = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What no XML 1.0 document may hold: texts of a vehicle and names of files are of any bytes."""


@dataclass(frozen=True, slots=True)
class Case:
    """One test."""

    name: str
    outcome: Outcome = "passed"
    text: str = ""  # why it did not pass
    output: str = ""  # what else there is to know


@dataclass(frozen=True, slots=True)
class Suite:
    """The tests of one log."""

    name: str
    seconds: float
    cases: Sequence[Case]

    def count(self, outcome: Outcome) -> int:
        return sum(case.outcome == outcome for case in self.cases)


def compared(vehicle: str, measures: Measures, baseline: Baseline, tolerance: float) -> Iterator[Case]:
    """Each measure of the baseline. One fails when it is larger by more than the tolerance (0.1 is 10 %).

    So does one that every flight of the baseline has and this one lacks.
    """
    for measure, limit in baseline.limits.items():
        name, value = f"{vehicle}: {measure}", measures.get(measure)
        if value is None:
            if measure in baseline.always:
                yield Case(name, "failure", f"not known of this flight, {limit:.3g} in the baseline")
        elif value > limit * (1.0 + tolerance):
            change = f", {100 * (value / limit - 1):+.0f} %" if limit > 0 else ""
            yield Case(name, "failure", f"{value:.3g}, at most {limit:.3g} in the baseline{change}")
        else:
            yield Case(name)


def junit_xml(suites: Sequence[Suite]) -> bytes:
    """The document, UTF-8."""
    top = ET.Element("testsuites", {"name": "companion"} | _counts(suites))
    for suite in suites:
        of_log = ET.SubElement(top, "testsuite", {"name": _legal(suite.name)} | _counts([suite]))
        for case in suite.cases:
            one = ET.SubElement(of_log, "testcase", classname=_legal(suite.name), name=_legal(case.name))
            if case.outcome != "passed":
                first, _, _ = case.text.partition("\n")
                ET.SubElement(one, case.outcome, message=_legal(first)).text = _legal(case.text)
            if case.output:
                ET.SubElement(one, "system-out").text = _legal(case.output)
    ET.indent(top)
    text: bytes = ET.tostring(top, encoding="utf-8", xml_declaration=True)
    return text


def _counts(suites: Sequence[Suite]) -> dict[str, str]:
    totals: dict[str, Outcome] = {"failures": "failure", "errors": "error", "skipped": "skipped"}
    return {
        "tests": str(sum(len(suite.cases) for suite in suites)),
        **{name: str(sum(suite.count(outcome) for suite in suites)) for name, outcome in totals.items()},
        "time": f"{sum(suite.seconds for suite in suites):.3f}",
    }


def _legal(text: str) -> str:
    return _ILLEGAL.sub("\N{REPLACEMENT CHARACTER}", text)


_SIGNS: dict[Outcome, str] = {
    "passed": "[green]PASS[/]", "failure": "[red]FAIL[/]", "error": "[red]ERROR[/]", "skipped": "[yellow]SKIP[/]",
}  # fmt: skip


def check_options(parser: options.Parser) -> None:
    """The command's options."""
    options.add_log(parser, *options.INTEGRATION, "--imu-model", "--core", takes_several=True)
    fails = "which verdict fails (default: suspect; insufficient: also a flight without a verdict)"
    options.add_fail_on(parser, fails, default="suspect")
    parser.add_argument("--junit", metavar="FILE", help="write the results as JUnit XML")
    parser.add_argument("--baseline", metavar="FILE", help="fail where drift or a detectable fault is worse than there")
    parser.add_argument(
        "--tolerance",
        type=options.share,
        metavar="PERCENT",
        default=0.1,
        help="by how much it may be worse (default: 10%%)",
    )
    parser.add_argument("--write-baseline", metavar="FILE", help="make a baseline of these flights, several at best")


def run_check(arguments: argparse.Namespace) -> int:
    """Examine every flight, print a line for each and write the files. Exit code: 0, 1 (failed), 2 (not read)."""
    settings = options.settings_of(arguments)
    baseline = read_baseline(arguments.baseline) if arguments.baseline else None
    for written in (arguments.junit, arguments.write_baseline):
        if written:
            files.check(Path(written), force=True)
    console, suites, flown = tables.console(), list[Suite](), list[BaselineFlight]()
    for path, name in options.logs_named(arguments, settings).items():
        began, cases = time.monotonic(), list[Case]()
        for case in _cases(path, name, settings, arguments, baseline, flown):
            cases.append(case)
            if case.text:
                console.lines(f"{_SIGNS[case.outcome]}  {escape(f'{name}, {case.name}: {case.text}')}")
        suites.append(Suite(name, time.monotonic() - began, cases))
    if arguments.junit:
        files.write(Path(arguments.junit), junit_xml(suites))
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
            examined = examined_or_not(flight, settings, imu=arguments.imu, imu_model=arguments.imu_model)
        except DataError as error:
            yield Case(f"{vehicle}: verdict", "skipped" if arguments.fail_on == "suspect" else "failure", str(error))
            continue
        yield _verdict(vehicle, examined.verdict, arguments.fail_on)
        if isinstance(examined, Examination):
            measures = measures_of(examined)
            flown.append(
                BaselineFlight(
                    dict(measures), name.encode("utf-8", "replace").decode(), str(flight.vehicle), flight.boot
                )
            )
            if baseline is not None:
                yield from compared(vehicle, measures, baseline, arguments.tolerance)


def _verdict(vehicle: str, verdict: Verdict, fail_on: str) -> Case:
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
