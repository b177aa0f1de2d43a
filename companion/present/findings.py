"""Verdict and incident in words: the headline, findings grouped and ranked, the seconds around an incident.

The same for terminal, page and report; an incident in Markdown for a forum post or an issue too. Texts of vehicles and
names of files are untrusted. No place on Earth is shown of an incident: times are relative to the moment, heights and
distances to where the vehicle was then.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from companion.model import Flight, words
from companion.present.formats import capitalised, clause, fixed, shown_unit, significant, vehicle_words, with_unit
from companion.verdict import Cause, Finding, Incident, Output, Verdict, by_severity, leading_doubt
from companion.verdict import percent as probability

MOST_LINES = 7
"""Groups of findings on a screen."""

_BRACKETS = re.compile(r" \([^()]*\)")


@dataclass(frozen=True, slots=True)
class _Headline:
    """A verdict as a plain sentence."""

    sentence: str  # "Accelerometer x wrong, 69-81 s"
    probability: str  # "probability over 99.9 %"; "" where it is not known
    detail: str  # what the sentence rests on


def headline(verdict: Verdict) -> _Headline:
    """What a reader has to know first; the numbers behind it are the detail."""
    detail = capitalised(clause(verdict.summary))
    if (cause := verdict.cause) is not None:
        sure, detail = cause.side_probability, _SURE.sub("", detail)
        return _Headline(
            f"{wrong(cause)}, {lasting(cause)}", "" if sure is None else f"probability {probability(sure)}", detail
        )
    if verdict.status == "consistent":
        nobody, rest = verdict.probability.get("nobody"), max(verdict.probability.values(), default=0.0)
        sure = nobody if nobody is not None and nobody >= rest else None
        detail = detail if sure is None else _SURE.sub("", detail)
        return _Headline("No IMU fault found", "" if sure is None else f"no fault: {probability(sure)}", detail)
    if (doubt := leading_doubt(verdict.findings)) is not None:
        return _Headline(f"Cannot tell which side is wrong: {words(doubt.kind)}", likeliest(verdict), detail)
    return _Headline("Too little in this log to judge", "", detail)


def likeliest(verdict: Verdict) -> str:
    """The two likeliest sides with their probabilities: "compass 71 %, no fault 22 %"; "" where one is sure."""
    return ", ".join(f"{_SIDES.get(side, side)} {probability(share)}" for side, share in verdict.likeliest)


def wrong(cause: Cause) -> str:
    """Which sensor or which part of the autopilot's estimate: "Gyro z wrong"."""
    if cause.sensor in _SENSORS:
        whose = "" if cause.imu is None else f"of IMU {cause.imu}"
        return " ".join(filter(None, (_SENSORS[cause.sensor], cause.axis, whose, "wrong")))
    what = words(cause.kind)
    if cause.sensor:
        return capitalised(what) if what.endswith(" frozen") else f"{capitalised(what)} wrong"
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
_SIDES = {"imu": "IMU", "gps": "GPS", "nobody": "no fault"}


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

    @property
    def whole(self) -> str:
        """From the start of the first to the end of the last."""
        first, last_end_s = self.findings[0], max(f.end_s for f in self.findings)
        return span(replace(first, end_s=last_end_s))

    def __str__(self) -> str:
        """The evidence of a single one; else count, largest size, first and worst time."""
        first, worst = self.findings[0], self.worst
        if len(self.findings) == 1:
            return first.evidence
        unit, factor = shown_unit(worst.cause.unit if worst.cause else "")
        size = f" of up to {with_unit(significant(_size(worst) * factor), unit)}" if _size(worst) else ""
        when = "first and worst" if worst is first else f"first at {first.start_s:.1f} s, worst"
        return f"{len(self.findings)} × {words(first.kind)}{size}, {when} at {worst.start_s:.1f} s"


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


_CAUSES = {
    "mechanical": "a motor, propeller or ESC",
    "installation": "how it was put together: motor order, propellers, frame type, board orientation",
    "power": "the battery or its wiring",
    "imu": "the IMU",
    "aiding": "GPS, compass or barometer",
    "estimator": "the estimator by itself",
    "autopilot": "the estimator by itself",
    "command": "what was asked of it, by pilot or mission",
    "other": "none of these",
    "nobody": "no sensor and not the estimator",
    "gps": "the GPS",
}
"""Cause → in words."""

_MOMENTS = {
    "requested": "The requested moment",
    "loss_of_control": "Loss of control",
    "failsafe": "Failsafe",
    "cause": "The first fault",
    "lane_switch": "Lane switch",
}
_PLACE = re.compile(r"-?\d{1,3}\.\d{4,}")  # four decimals of a degree are 11 m: nothing else is written so finely
_LEAST = 0.01
_MOST_ROWS = 40


def heading(incident: Incident) -> str:
    """What the page is about, in a line: untrusted."""
    moment = incident.moment
    return f"{_MOMENTS[moment.kind]} at {moment.t:.1f} s: {_clean(moment.text)}"


def _clean(text: str) -> str:
    """A vehicle's text without what may be a place on Earth."""
    return _PLACE.sub("…", text)


def cause_lines(incident: Incident) -> Iterator[tuple[str, str, str]]:
    """Cause, probability, evidence: the likeliest first, those above 1 %."""
    for one in incident.causes:
        if one.probability >= _LEAST:
            cause = capitalised(_CAUSES.get(one.name, f"the {words(one.name)}"))
            yield cause, probability(one.probability), _clean("; ".join(one.evidence))


def facts(incident: Incident) -> Iterator[tuple[str, str]]:
    """What sensors, controller and motors did, in words."""
    for one in incident.imus:
        before = ""
        if math.isfinite(one.rate_before):
            before = f", before it {fixed(math.degrees(one.rate_before))}°/s and {fixed(one.force_before)} m/s²"
        yield one.imu, f"at most {fixed(math.degrees(one.rate))}°/s and {fixed(one.force)} m/s²{before}"
    tracking = incident.tracking
    if tracking is not None:
        left = "" if tracking.left_s is None else f", more than 30° from {tracking.left_s:+.2f} s on"
        yield (
            "Desired and achieved attitude",
            f"{math.degrees(tracking.before):.1f}° apart before it, {math.degrees(tracking.worst):.0f}° at most "
            f"({tracking.worst_s:+.2f} s){left}; a tilt of up to {math.degrees(tracking.desired):.0f}° was desired",
        )
    if incident.outputs:
        yield "Motors and servos", "; ".join(map(_output, incident.outputs))
    elif "motors and servos" not in incident.missing:
        yield "Motors and servos", "none at an end of its range that was not there before"
    yield "Not in the log", ", ".join(incident.missing)


def _output(one: Output) -> str:
    end = "full" if one.end == "full" else "lowest"
    return f"{one.name} at its {end} output from {one.since_s:+.2f} s on (usually {100.0 * one.usual:.0f} %)"


def timeline(incident: Incident) -> Iterator[tuple[str, str, str]]:
    """Time, kind, text: untrusted. At most forty rows, those nearest to the moment."""
    nearest = sorted(incident.timeline, key=lambda row: abs(row.after_s))[:_MOST_ROWS]
    for row in sorted(nearest, key=lambda row: row.after_s):
        yield f"{row.after_s:+.2f} s", row.what, _clean(row.text)


def incident_markdown(incident: Incident, flight: Flight, verdict: str, name: str) -> str:
    """The whole page in Markdown. name: of the log; verdict: the sentence of the analysis, "" for none."""
    before, after = incident.moment.t - incident.start_s, incident.end_s - incident.moment.t
    blocks = [
        f"## {_escaped(heading(incident))}",
        f"{_escaped(vehicle_words(flight.vehicle))}, log {_code(name)}; from {before:.0f} s before to {after:.0f} s "
        "after the moment. Times with a sign are relative to it, the others are seconds since boot.",
        *([f"**Verdict of the whole flight:** {_escaped(_clean(verdict))}"] if verdict else []),
        "### Probable causes",
        _table(("cause", "probability", "what speaks for it"), cause_lines(incident)),
        "### What sensors and controls did",
        "\n".join(f"- **{_escaped(what)}**: {_escaped(said)}" for what, said in facts(incident)),
        "### Timeline",
        _table(("time", "", "text"), timeline(incident)),
        "_Made by `companion incident`. The probabilities weigh what each cause usually shows; they are no proof, and "
        "what is not in the log was not guessed._",
    ]
    return "\n\n".join(blocks) + "\n"


def _table(titles: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [f"| {' | '.join(map(_escaped, row))} |" for row in rows]
    return "\n".join([f"| {' | '.join(titles)} |", f"|{'---|' * len(titles)}", *lines]) if lines else "Nothing."


def _escaped(text: str) -> str:
    """Text in which Markdown and HTML see no marks, on one line."""
    printable = "".join(c if c.isprintable() else " " for c in text)
    return re.sub(r"([\\`*_{}\[\]<>#|~@])", r"\\\1", printable)


def _code(text: str) -> str:
    return "`" + "".join(c if c.isprintable() and c != "`" else " " for c in text) + "`"
