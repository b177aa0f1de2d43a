"""What stands out, each with the readings around it; the lanes of the estimator, and the checks before take-off."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from companion.app.examination import redundant_lanes
from companion.app.sensors import preflight_of
from companion.comparison import Replay, errors, length, phases, replay, windows
from companion.model import Array, CompanionError, DataError
from companion.present import (
    FindingGroup,
    capitalised,
    details,
    html_table,
    lane_lines,
    lane_table,
    palette,
    paragraph,
    preflight_headline,
    preflight_table,
    ranked,
    severity_of,
    table,
    text,
    words,
)
from companion.report import traces
from companion.report.html_page import Section
from companion.report.subject import Subject
from companion.strapdown import quaternion
from companion.verdict import Finding, Lanes, Verdict, by_severity

_RAW = ("frozen", "stuck", "clipping", "axes", "noise", "vibration")  # in a kind: what shows in the readings themselves
_OF_IMU = ("gyro", "accel", "imu_lag")  # in a kind: what shows in what the IMU read, not in when
_SENSED = ("gps", "compass", "barometer", "heading", "tilt", "position", "velocity", "height", "declination")
"""In a kind: what shows where both have gone."""
_FREE_S = 30.0  # up to which the IMU alone is a yardstick
_DIFFERENCE_S = 1.0  # windows over which a bias is seen


def findings(subject: Subject) -> str:
    """The findings in groups, the worst of each with a chart; each by itself below."""
    ordered = by_severity(subject.assessment.verdict.findings)
    if not ordered:
        return paragraph("Nothing stands out in this flight.")
    groups, _ = ranked(ordered)
    parts = [_drawn(subject, group) for group in groups]
    if len(ordered) > len(groups):
        every = table(
            ["finding", "side", "severity", "evidence", "from, s", "to, s"],
            [
                [
                    words(f.kind),
                    words(f.side),
                    severity_of(f.severity),
                    f.evidence,
                    f"{f.start_s:.1f}",
                    f"{f.end_s:.1f}",
                ]
                for f in ordered
            ],
            words=4,
        )
        parts.append(details(f"All {len(ordered)} findings", every))
    return "".join(parts)


def _words_of(finding: Finding) -> tuple[str, str, str]:
    """Kind, severity and side."""
    return words(finding.kind), severity_of(finding.severity), words(finding.side)


def bare_findings(verdict: Verdict) -> str:
    """The same of a flight that cannot be examined: without charts."""
    groups, _ = ranked(by_severity(verdict.findings))
    return "".join(_article(group, "") for group in groups) or paragraph("Nothing stands out in what the log has.")


def _article(group: FindingGroup, chart: str) -> str:
    finding = group.worst
    is_note = finding.severity == "info"
    advice = "" if is_note else paragraph(f"What to do: {finding.advice}", "advice")
    drawn = details("Chart", chart) if chart and is_note else chart
    kind, *about = map(text, _words_of(finding))
    return (
        f'<article class="finding {text(finding.severity)}"><h3>{capitalised(kind)} '
        f'<span class="quiet">{", ".join(about)}, {group.whole}</span></h3>'
        f"{paragraph(str(group))}{advice}{drawn}</article>"
    )


def _drawn(subject: Subject, group: FindingGroup) -> str:
    finding = group.worst
    margin = max(5.0, 0.2 * (finding.end_s - finding.start_s))
    first, last = subject.ends
    around = max(finding.start_s - margin, first), min(finding.end_s + margin, last)
    chart = ""
    if around[1] > around[0]:
        panels, caption = _panels(subject, finding, *around)
        if panels:
            spans = [] if subject.is_throughout(finding) else [(finding.start_s, finding.end_s)]
            figure = traces.stack(panels, traces.TIME, spans=spans, range=list(around))
            chart = subject.charts.add(figure, caption)
    return _article(group, chart)


def _panels(subject: Subject, finding: Finding, low: float, high: float) -> tuple[list[traces.Panel], str]:
    """What there is to see of a finding between two times, s."""
    if finding.side == "data" and not any(word in finding.kind for word in (*_OF_IMU, *_SENSED)):
        return _intervals(subject, low, high), "Time between two samples of the IMU."
    if finding.side == "autopilot" or any(word in finding.kind for word in _SENSED):
        caption = "The IMU alone, from the autopilot's state on, and the autopilot."
        return _errors(subject, finding.kind, low, high), caption
    if not any(part in finding.kind for part in _RAW) and (panels := _differences(subject, low, high)):
        return panels, (
            "IMU minus what the autopilot's attitude and velocity did, mean of each second: a bias shows as a level, "
            "a lag or a scale only where the vehicle moves."
        )
    return _readings(subject, finding.kind, low, high), f"What {subject.imu} read around it."


def _readings(subject: Subject, kind: str, low: float, high: float) -> list[traces.Panel]:
    """Gyro and accelerometer; one of them alone for a kind that names it."""
    track = subject.comparison.track
    part = _between(track.t, low, high)
    t, breaks = track.t[part], traces.gaps(track.t[part], subject.longest_step)
    both = {"gyro": ("gyro, rad/s", track.gyro), "accel": ("accel, m/s²", track.accel)}
    named = [one for name, one in both.items() if name in kind] or both.values()
    return [traces.Panel(title, traces.by_axis(t, values[part], breaks=breaks)) for title, values in named]


def _differences(subject: Subject, low: float, high: float) -> list[traces.Panel]:
    """The mean error of rate and specific force in each second, in the body, from short windows of the comparison."""
    comparison = subject.comparison
    chosen = windows(comparison, _DIFFERENCE_S)
    if len(chosen.start) < 3:
        return []
    off = errors(comparison, chosen)
    back = quaternion.conjugate(comparison.reference.at(chosen.start).q_ned_frd)
    span = (off.end_s - off.anchor_s)[:, None]
    middle = 0.5 * (off.end_s + off.anchor_s)
    part = _between(middle, low, high)
    if part.stop - part.start < 2:
        return []
    breaks = traces.gaps(middle[part], 1.5 * _DIFFERENCE_S)
    shown = [("gyro off by, mrad/s", -1e3 * quaternion.rotate(back, off.attitude) / span)]
    if comparison.has_position:
        shown.append(("accel off by, m/s²", -quaternion.rotate(back, off.velocity) / span))
    return [traces.Panel(title, traces.by_axis(middle[part], values[part], breaks=breaks)) for title, values in shown]


def _errors(subject: Subject, kind: str, low: float, high: float) -> list[traces.Panel]:
    """What the kind is about, of both: roll and pitch, heading, velocity, height or place."""
    shown = _replayed(subject, low, high)
    if shown is None:
        return []
    t, breaks = shown.t, shown.anchors

    def panels(names: Sequence[str], unit: str, imu: Array, autopilot: Array) -> list[traces.Panel]:
        return [
            traces.Panel(
                f"{name}, {unit}",
                [
                    traces.line(t, own, "IMU alone", subject.colour, breaks=breaks),
                    traces.line(t, other, "autopilot", palette.AUTOPILOT),
                ],
            )
            for name, own, other in zip(names, imu.T, autopilot.T, strict=True)
        ]

    imu, ref = traces.roll_pitch_heading(shown.q_imu), traces.roll_pitch_heading(shown.q_ref)
    angles = panels(("roll", "pitch", "heading"), "°", imu, ref)
    if "tilt" in kind:
        return angles[:2]
    if not shown.has_position or any(word in kind for word in ("heading", "compass", "declination")):
        return angles[2:]
    if "velocity" in kind:
        return panels(("north", "east", "down"), "m/s", shown.velocity_imu, shown.velocity_ref)
    up = np.array((1.0, 1.0, -1.0))
    places = panels(("north", "east", "height"), "m", up * shown.position_imu, up * shown.position_ref)
    return places[2:] if "height" in kind or "barometer" in kind else places


def _replayed(subject: Subject, low: float, high: float) -> Replay | None:
    """Both between two times; None where the autopilot's state is not known."""
    track = subject.comparison.track
    cut = track[_between(track.t, low, high)]
    try:
        return replay(
            dataclasses.replace(subject.flight, imus={track.source: cut}),
            imu=track.source,
            how=subject.comparison.how,
            reanchor_s=None if high - low <= _FREE_S else _FREE_S,
        )
    except CompanionError:
        return None


def _intervals(subject: Subject, low: float, high: float) -> list[traces.Panel]:
    t = subject.comparison.track.t
    part = _between(t[1:], low, high)
    if part.stop - part.start < 2:
        return []
    drawn = traces.line(t[1:][part], np.diff(t)[part], subject.imu, subject.colour, line={"shape": "vh"})
    return [traces.Panel("interval, s", [drawn], {"rangemode": "tozero"})]


def _between(t: Array, low: float, high: float) -> slice:
    return slice(int(np.searchsorted(t, low)), int(np.searchsorted(t, high, side="right")))


_DRAWN = (
    ("tilt", "tilt, °", np.degrees(1.0)),
    ("heading", "heading, °", np.degrees(1.0)),
    ("velocity", "velocity, m/s", 1.0),
)


def lanes_section(subject: Subject) -> list[Section]:
    """One, where the flight has two lanes or more and a best estimate; else none."""
    judged = redundant_lanes(subject.flight, subject.settings, subject.assessment)
    if judged is None:
        return []
    lanes, best = judged
    body = paragraph(f"By the best estimate of {best.imu.source}, which none of the lanes is part of.")
    body += "".join(map(paragraph, lane_lines(lanes, in_table=True)))
    for i, span in enumerate(lanes.spans):
        if span.lanes:
            when = f"{capitalised(words(span.what))}, {span.start_s:.1f}-{span.end_s:.1f} s"
            each = html_table(lane_table(span), f"lanes{i}")
            title = f"{when}: each lane would have stayed within this for 95 % of it, ± of the estimate"
            body += details(when, each) if i else f"<h3>{text(title)}</h3>{each}"
    return [Section("lanes", "Lanes of the estimator", body + _chart(subject, lanes))]


def _chart(subject: Subject, lanes: Lanes) -> str:
    """The size of each lane's error over the flight; shaded: the spans of faults."""
    compared = lanes.compared
    panels = []
    colours = (palette.AUTOPILOT, *palette.IMUS)
    for quantity, title, factor in _DRAWN:
        drawn = []
        for one, colour in zip(compared.lanes, colours, strict=False):
            known = one.known(quantity) & compared.judged
            if known.sum() > 1:
                size = factor * length(one.error[quantity][known])
                t = compared.t[known]
                drawn.append(traces.line(t, size, text(one.lane.name), colour, breaks=traces.gaps(t)))
        if drawn:
            panels.append(traces.Panel(title, drawn))
    if not panels:
        return ""
    spans = [(span.start_s, span.end_s) for span in lanes.spans[1:]]
    figure = traces.stack(panels, traces.TIME, spans=spans)
    shaded = " Shaded: faults." if spans else ""
    return subject.charts.add(figure, f"How far each lane is from the best estimate.{shaded}")


def preflight_section(subject: Subject) -> list[Section]:
    """One, where the vehicle stands and never leaves the ground; else none."""
    flight = subject.flight
    if any(part.kind in ("flight", "impact") for part in phases(flight)):
        return []
    try:
        result = preflight_of(flight)
    except DataError:
        return []
    body = paragraph(preflight_headline(result))
    body += "".join(paragraph(f"Not checked: {one}") for one in result.missing)
    body += "".join(paragraph(f"The vehicle says: {one}") for one in result.vehicle_reports)
    return [Section("preflight", "Before take-off", body + html_table(preflight_table(result), "checks"))]
