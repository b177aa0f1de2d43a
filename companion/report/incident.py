"""The seconds around an incident as one HTML file: causes, charts on one time axis, what happened, a timeline."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import cycle

import numpy as np

from companion.analysis import Incident, imus_within, window
from companion.estimation import BestEstimate
from companion.model import Array, Flight
from companion.present import (
    cause_lines,
    facts,
    heading,
    palette,
    paragraph,
    table,
    text,
    timeline,
    vehicle_words,
)
from companion.report import traces
from companion.report.html_page import Charts, Section, sheet
from companion.strapdown import quaternion

_AXIS = "seconds from the moment"
_ANGLES = (("roll", 0), ("pitch", 1))


def incident_html(incident: Incident, flight: Flight, best: BestEstimate | None, verdict: str, name: str) -> str:
    """One page. name: of the log; verdict: the analysis in a sentence, or ""."""
    charts = Charts()
    panels = list(_panels(incident, flight, best))
    figure = charts.add(
        traces.stack(panels, _AXIS, spans=[(0.0, incident.end_s - incident.moment.t)]),
        "Everything on one time axis; the moment is at zero. Heights are from where the vehicle was then.",
        rows=len(panels),
    )  # fmt: skip
    titles = ("cause", "probability", "what speaks for it")
    sections = [
        Section("causes", "Probable causes", table(titles, cause_lines(incident), words=3)),
        Section("charts", "The seconds around it", figure),
        Section("facts", "What sensors and controls did", table(("", ""), facts(incident), words=2)),
        Section("timeline", "Timeline", table(("time", "", "text"), timeline(incident), words=3)),
    ]  # fmt: skip
    head = f"<header><h1>{text(heading(incident))}</h1>" + paragraph(f"{vehicle_words(flight.vehicle)}, log {name}")
    head += (paragraph(f"Sensors and estimator until then: {verdict}") if verdict else "") + "</header>"
    return sheet(f"{name}: {heading(incident)}", head, sections, charts, {})


def _panels(incident: Incident, flight: Flight, best: BestEstimate | None) -> Iterator[traces.Panel]:
    start, stop, zero = incident.start_s, incident.end_s, incident.moment.t
    yield from _attitudes(flight, best, start, stop, zero)
    imus = imus_within(flight, start, stop)
    colours = palette.of_imus(flight.imus)
    for title, sensor, factor in (("rate, °/s", "gyro", np.degrees(1.0)), ("force, m/s²", "accel", 1.0)):
        lines = [
            traces.line(one.t - zero, factor * np.linalg.norm(getattr(one, sensor), axis=1), text(one.source),
                        colours[one.source])
            for one in imus
        ]  # fmt: skip
        if lines:
            yield traces.Panel(title, lines)
    if flight.actuators is not None:
        part = window(flight.actuators.t, start, stop)
        t, output = flight.actuators.t[part] - zero, flight.actuators.output[part]
        used = [
            i
            for i in range(output.shape[1])
            if len(t) > 1 and np.isfinite(output[:, i]).all() and output[:, i].std() > 0
        ]
        colour = cycle((*palette.IMUS, palette.AUTOPILOT, palette.DIFFERENCE, palette.GPS))
        if used:
            lines = [traces.line(t, 100.0 * output[:, i], f"output {i + 1}", next(colour)) for i in used]
            yield traces.Panel("outputs, %", lines, {"range": [-2, 102]})
    if flight.position is not None:
        part = window(flight.position.t, start, stop)
        t = flight.position.t[part]
        if len(t) > 1:
            at = int(np.argmin(np.abs(t - zero)))
            moved = flight.position.position[part] - flight.position.position[part][at]
            yield traces.Panel("height, m", [traces.line(t - zero, -moved[:, 2], "estimator", palette.AUTOPILOT)])
            speed = np.linalg.norm(flight.position.velocity[part], axis=1)
            yield traces.Panel(
                "speed, m/s",
                [traces.line(t - zero, speed, "estimator", palette.AUTOPILOT), *_gps(flight, start, stop, zero)],
            )


def _gps(flight: Flight, start: float, stop: float, zero: float) -> Iterator[traces.Trace]:
    for one in flight.gps[:1]:
        part = window(one.t, start, stop)
        speed = np.linalg.norm(np.nan_to_num(one.velocity[part]), axis=1)
        if len(speed) > 1:
            yield traces.line(one.t[part] - zero, speed, "GPS", palette.GPS)


def _attitudes(
    flight: Flight, best: BestEstimate | None, start: float, stop: float, zero: float
) -> Iterator[traces.Panel]:
    """Roll and pitch as desired, as the estimator had it, and by the best estimate."""
    curves: list[tuple[str, palette.Rgb, Array, Array]] = []
    if flight.control is not None and len(flight.control):
        curves.append(("desired", palette.HEADING, flight.control.t, flight.control.q_ned_frd))
    if flight.attitude is not None:
        curves.append(("estimator", palette.AUTOPILOT, flight.attitude.t, flight.attitude.q_ned_frd))
    if best is not None:
        curves.append(("best estimate", palette.BEST, best.t, best.q_ned_frd))
    for name, axis in _ANGLES:
        lines = []
        for source, colour, t, q in curves:
            part = window(t, start, stop)
            if len(t[part]) > 1:
                lines.append(
                    traces.line(
                        t[part] - zero, np.degrees(np.unwrap(quaternion.to_euler(q[part])[:, axis])), source, colour
                    )
                )
        if lines:
            yield traces.Panel(f"{name}, °", lines)
