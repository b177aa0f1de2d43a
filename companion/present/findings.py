"""Findings, grouped and ranked: the same few lines for terminal, page and report."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from companion.analysis import Finding, FlightVerdict, by_severity
from companion.model import words
from companion.present.formats import clause, shown_unit, significant, with_unit

MOST_LINES = 7
"""Groups of findings on a screen."""

_BRACKETS = re.compile(r" \([^()]*\)")


@dataclass(frozen=True, slots=True)
class FindingGroup:
    """Findings of one kind, side and severity; one or more, in order of time."""

    findings: tuple[Finding, ...]

    @property
    def worst(self) -> Finding:
        """The largest; of those without a size the one that lasts longest."""
        return max(self.findings, key=lambda f: (_size(f), f.end_s - f.start_s))

    @property
    def when(self) -> str:
        """57.3-81.0 s, or 57.7 s for a moment; "" for several, and where the evidence has the time."""
        one = self.findings[0]
        timed = one.cause is not None and one.headline != "" and one.cause.onset_sigma_s is not None
        return "" if timed or len(self.findings) > 1 else span(one)

    def __str__(self) -> str:
        """The evidence of a single one; else count, largest size, first and worst time."""
        first, worst = self.findings[0], self.worst
        if len(self.findings) == 1:
            return first.evidence
        unit, factor = shown_unit(worst.cause.unit if worst.cause else "")
        size = f" of up to {with_unit(significant(_size(worst) * factor), unit)}" if _size(worst) else ""
        return (
            f"{len(self.findings)} × {words(first.kind)}{size}, first at {first.start_s:.1f} s, "
            f"worst at {worst.start_s:.1f} s"
        )


def grouped(findings: Sequence[Finding]) -> tuple[FindingGroup, ...]:
    """All findings in groups: the most serious first, then in order of the first one's time."""
    groups: dict[tuple[str, str, str, bool], list[Finding]] = {}
    for one in by_severity(findings):
        groups.setdefault((one.kind, one.side, one.severity, one.undecided), []).append(one)
    return tuple(FindingGroup(tuple(group)) for group in groups.values())


def ranked(findings: Sequence[Finding], most: int = MOST_LINES) -> tuple[tuple[FindingGroup, ...], int]:
    """The groups that stand on a screen, and how many findings are in none of them."""
    shown = grouped(findings)[:most]
    return shown, len(findings) - sum(len(group.findings) for group in shown)


def span(finding: Finding) -> str:
    """57.3-81.0 s, or 57.7 s for a moment."""
    start, end = f"{finding.start_s:.1f}", f"{finding.end_s:.1f}"
    return f"{start} s" if start == end else f"{start}-{end} s"


def flight_words(flight: FlightVerdict) -> str:
    """One flight of several: when it was, its status and the sentence without the numbers in its brackets."""
    sentence = _BRACKETS.sub("", clause(flight.summary))
    return f"{flight.start_s:.1f}-{flight.end_s:.1f} s, {words(flight.status)}: {sentence}"


def _size(finding: Finding) -> float:
    return 0.0 if finding.cause is None or finding.cause.size is None else finding.cause.size
