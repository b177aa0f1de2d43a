"""Results of tests as JUnit XML, as CI systems read it: https://github.com/testmoapp/junitxml."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal
from xml.etree import ElementTree as ET

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
    cases: Sequence[Case] = field(default=())

    def count(self, outcome: Outcome) -> int:
        return sum(case.outcome == outcome for case in self.cases)


def junit_xml(name: str, suites: Sequence[Suite]) -> bytes:
    """The document, UTF-8."""
    top = ET.Element("testsuites", {"name": name} | _counts(suites))
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
