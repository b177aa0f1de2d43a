"""The lanes of the estimator against the best estimate, and the checks before take-off: a section of each, where it
has something to say.
"""

from __future__ import annotations

import numpy as np

from companion.analysis import Lanes, phases
from companion.app.examination import redundant_lanes
from companion.app.sensors import preflight_of
from companion.model import DataError, words
from companion.present import (
    capitalised,
    details,
    html_table,
    lane_lines,
    lane_table,
    palette,
    paragraph,
    preflight_headline,
    preflight_table,
    text,
)
from companion.report import traces
from companion.report.html_page import Section
from companion.report.subject import Subject

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
                size = factor * np.linalg.norm(one.error[quantity][known], axis=1)
                t = compared.t[known]
                drawn.append(traces.line(t, size, text(one.lane.name), colour, breaks=traces.gaps(t)))
        if drawn:
            panels.append(traces.Panel(title, drawn))
    if not panels:
        return ""
    spans = [(span.start_s, span.end_s) for span in lanes.spans[1:]]
    figure = traces.stack(panels, traces.TIME, spans=spans)
    return subject.charts.add(figure, "How far each lane is from the best estimate. Shaded: faults.", rows=len(panels))


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
