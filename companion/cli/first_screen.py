"""What `analyze` says first: the verdict, why, how far the IMU drifts, what could have been seen, what to do."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.markup import escape

from companion.analysis import Assessment, Finding, rate_warning
from companion.app.examination import Examination
from companion.cli.tables import SIGNS, span, status_text, wrapped
from companion.model import counted
from companion.present import fixed, words

_MOST_LINES = 23  # in _COLUMNS, and the prompt: an old terminal's window; one that is narrower is taller
_COLUMNS = 80
_WIDEST = 100
_SHOWN_S = 10.0  # the horizon that is told
_LABEL = 18  # columns of "Would have shown"
_ADVICES = 2


def first_screen(examined: Examination, width: int) -> list[str]:
    """Lines of rich markup, at most 23 in 80 columns; what does not fit is behind --full."""
    assessment = examined.assessment
    width = min(width, _WIDEST)
    flight, track = examined.flight, examined.flight.imu(assessment.drift.imu)
    status = words(assessment.verdict.status).upper()
    head = wrapped(f"{status}  {assessment.verdict.summary}", width, 2)
    head[0] = head[0].replace(escape(status), status_text(assessment.verdict.status), 1)
    vehicle = flight.vehicle
    kind = " ".join(filter(None, (vehicle.autopilot, vehicle.firmware, vehicle.type)))
    head += wrapped(
        f"Vehicle {vehicle}, boot {flight.boot}: {kind}, {flight.duration:.1f} s; "
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
    yield f"After {_SHOWN_S:g} s", _drift(assessment)
    could = assessment.sensitivity
    if could.smallest:
        yield "Would have shown", str(could)
    for why in could.not_judged:
        yield "Not judged", why
    told = [
        f.advice for f in assessment.verdict.findings if f.severity != "info" and f.advice and f.advice not in warning
    ]
    for i, advice in enumerate(list(dict.fromkeys(told))[:_ADVICES]):
        yield "" if i else "What to do", advice


def _drift(assessment: Assessment) -> str:
    """Measured against expected at one horizon, in words."""
    for i, row in enumerate(assessment.drift.rows):
        if row.horizon_s == _SHOWN_S and (expected := assessment.expected_of(i)) is not None:
            pairs = (
                (row.attitude_deg, expected.attitude_deg, "°"),
                (row.velocity_mps, expected.velocity_mps, " m/s"),
                (row.position_m, expected.position_m, " m"),
            )
            parts = [f"{fixed(s.median)}{unit} ({fixed(e)} expected)" for s, e, unit in pairs if s and e is not None]
            return f"the IMU alone is off by {', '.join(parts)}: median of {counted(row.windows, 'window')}"
    return "no window could be used"


def _evidence(findings: Sequence[Finding], width: int, room: int) -> list[str]:
    lines: list[str] = []
    for i, finding in enumerate(findings):
        text = _when(finding) + finding.evidence
        own = wrapped(text, width - 4, 0)
        if len(lines) + len(own) > room - (i + 1 < len(findings)):
            left = len(findings) - i
            return [*lines, f"  and {left} more: --full" if lines else f"  {counted(left, 'finding')}: --full"]
        lines.append(f"  {SIGNS[finding.severity]} {own[0]}")
        lines += [f"    {line}" for line in own[1:]]
    return lines


def _when(finding: Finding) -> str:
    timed = finding.cause is not None and finding.headline != "" and finding.cause.onset_sigma_s is not None
    return "" if timed else f"{span(finding)}: "  # an episode's words have its time


def _labelled(label: str, text: str, width: int) -> list[str]:
    lines = wrapped(text, width - _LABEL, 0)
    return [f"[bold]{label:<{_LABEL}}[/]{lines[0]}", *(" " * _LABEL + line for line in lines[1:])]
