"""The verdict as a headline, and its findings grouped and ranked: the same for terminal, page and report."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from companion.analysis import Cause, Finding, Verdict, by_severity
from companion.analysis import percent as probability
from companion.model import words
from companion.present.formats import capitalised, clause, shown_unit, significant, with_unit

MOST_LINES = 7
"""Groups of findings on a screen."""

_BRACKETS = re.compile(r" \([^()]*\)")


@dataclass(frozen=True, slots=True)
class Headline:
    """A verdict as a plain sentence."""

    sentence: str  # "Accelerometer x wrong, 69-81 s"
    probability: str  # "probability over 99.9 %"; "" where it is not known
    detail: str  # what the sentence rests on


def headline(verdict: Verdict) -> Headline:
    """What a reader has to know first; the numbers behind it are the detail."""
    detail = capitalised(clause(verdict.summary))
    if (cause := verdict.cause) is not None:
        sure, detail = cause.side_probability, _SURE.sub("", detail)
        return Headline(
            f"{wrong(cause)}, {lasting(cause)}", "" if sure is None else f"probability {probability(sure)}", detail
        )
    if verdict.status == "consistent":
        nobody, rest = verdict.probability.get("nobody"), max(verdict.probability.values(), default=0.0)
        sure = nobody if nobody is not None and nobody >= rest else None
        detail = detail if sure is None else _SURE.sub("", detail)
        return Headline("No IMU fault found", "" if sure is None else f"no fault: {probability(sure)}", detail)
    if (doubt := next((one for one in verdict.findings if one.undecided), None)) is not None:
        sides = ", ".join(f"{_SIDES.get(side, side)} {probability(share)}" for side, share in verdict.likeliest)
        return Headline(f"Cannot tell which side is wrong: {words(doubt.kind)}", sides, detail)
    return Headline("Too little in this log to judge", "", detail)


def wrong(cause: Cause) -> str:
    """Which sensor or which part of the autopilot's estimate: "Gyro z wrong"."""
    if cause.sensor in _SENSORS:
        whose = "" if cause.imu is None else f"of IMU {cause.imu}"
        return " ".join(filter(None, (_SENSORS[cause.sensor], cause.axis, whose, "wrong")))
    what = words(cause.kind)
    if cause.sensor:
        return f"{what[:1].upper()}{what[1:]} wrong"
    return f"{'IMU' if cause.side == 'imu' else 'Autopilot'} wrong: {what}"


def lasting(cause: Cause) -> str:
    """When: "69-81 s"; "from 40 s to the end"; "since the start" where it was there already."""
    if cause.onset_sigma_s is None and cause.end_s is None:
        return "since the start"
    if cause.end_s is None:
        return f"from {cause.onset_s:.0f} s to the end"
    start, end = f"{cause.onset_s:.0f}", f"{cause.end_s:.0f}"
    return f"at {start} s" if start == end else f"{start}-{end} s"


_SURE = re.compile(r" \(probability [^()]*\)|; no sensor fault: [^()]*(?=\))")  # stands beside the sentence
_SENSORS = {"gyro": "Gyro", "accel": "Accelerometer"}
_SIDES = {"imu": "IMU", "gps": "GPS"}


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


def flight_lines(verdict: Verdict) -> tuple[tuple[str, str], ...]:
    """Each flight of several: "Flight 2", and when it was, its status and the sentence, where that is a new one.

    Without the numbers in its brackets.
    """
    lines, before = [], {verdict.summary: "as above"}
    for i, flight in enumerate(verdict.flights, 1):
        sentence = before.get(flight.summary) or _BRACKETS.sub("", clause(flight.summary))
        before.setdefault(flight.summary, f"as flight {i}")
        when = f"{flight.start_s:.1f}-{flight.end_s:.1f} s"
        lines.append((f"Flight {i}", f"{when}, {words(flight.status)}: {sentence}"))
    return tuple(lines)


def _size(finding: Finding) -> float:
    return 0.0 if finding.cause is None or finding.cause.size is None else finding.cause.size
