"""The seconds around an incident as one HTML file: causes, charts on one time axis, what happened, a timeline."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import cycle

import numpy as np

from companion.comparison import length, window
from companion.estimation import BestEstimate, receiver_of
from companion.model import Array, AttitudeTrack, ControlTrack, Flight
from companion.present import cause_lines, facts, heading, palette, paragraph, table, text, timeline, vehicle_words
from companion.report import traces
from companion.report.html_page import Charts, Section, sheet
from companion.verdict import Incident, imus_within

_AXIS = "seconds from the moment"


def incident_html(incident: Incident, flight: Flight, best: BestEstimate | None, verdict: str, name: str) -> str:
    """One page. name: of the log; verdict: the analysis in a sentence, or ""."""
    charts = Charts()
    figure = paragraph("No attitude, IMU, motor or height was recorded in these seconds.")
    if panels := list(_panels(incident, flight, best)):
        figure = charts.add(
            traces.stack(panels, _AXIS, spans=[(0.0, incident.end_s - incident.moment.t)]),
            "Everything on one time axis; the moment is at zero. Heights are from where the vehicle was then.",
        )
    titles = ("cause", "probability", "what speaks for it")
    sections = [
        Section("causes", "Probable causes", table(titles, cause_lines(incident), words=3)),
        Section("charts", "The seconds around it", figure),
        Section("facts", "What sensors and controls did", table(("", ""), facts(incident), words=2)),
        Section("timeline", "Timeline", table(("time", "", "text"), timeline(incident), words=3)),
    ]  # fmt: skip
    head = f"<header><h1>{text(heading(incident))}</h1>" + paragraph(f"{vehicle_words(flight.vehicle)}, log {name}")
    head += (paragraph(f"Verdict of the whole flight: {verdict}") if verdict else "") + "</header>"
    return sheet(f"{name}: {heading(incident)}", head, sections, charts, {})


def _panels(incident: Incident, flight: Flight, best: BestEstimate | None) -> Iterator[traces.Panel]:
    start, stop, zero = incident.start_s, incident.end_s, incident.moment.t
    sources: tuple[tuple[str, palette.Rgb, AttitudeTrack | ControlTrack | BestEstimate | None], ...] = (
        ("desired", palette.HEADING, flight.control),
        ("estimator", palette.AUTOPILOT, flight.attitude),
        ("best estimate", palette.BEST, best),
    )
    attitudes = [(name, colour, one.t, one.q_ned_frd) for name, colour, one in sources if one is not None]
    colours = palette.of_imus(flight.imus)
    imus = [(text(one.source), colours[one.source], one) for one in imus_within(flight, start, stop)]
    rates = [(name, shade, one.t, one.gyro) for name, shade, one in imus]
    forces = [(name, shade, one.t, one.accel) for name, shade, one in imus]
    for title, lines in (
        ("roll, °", _lines(incident, attitudes, lambda q: traces.roll_pitch_heading(q)[:, 0])),
        ("pitch, °", _lines(incident, attitudes, lambda q: traces.roll_pitch_heading(q)[:, 1])),
        ("rate, °/s", _lines(incident, rates, lambda rate: np.degrees(1.0) * length(rate))),
        ("force, m/s²", _lines(incident, forces, length)),
    ):
        if lines:
            yield traces.Panel(title, lines)
    if flight.actuators is not None:
        part = window(flight.actuators.t, start, stop)
        t, output = flight.actuators.t[part] - zero, flight.actuators.output[part]
        colour = cycle((*palette.IMUS, palette.AUTOPILOT, palette.DIFFERENCE, palette.GPS))
        lines = [
            traces.line(t, 100.0 * one, f"output {i}", next(colour))
            for i, one in enumerate(output.T, 1)
            if len(t) > 1 and np.isfinite(one).all() and one.std() > 0
        ]
        if lines:
            yield traces.Panel("outputs, %", lines, {"range": [-2, 102]})
    if (position := flight.position) is not None:
        part = window(position.t, start, stop)
        t, down = position.t[part] - zero, position.position[part, 2]
        if len(t) > 1:
            moved = down - down[np.argmin(np.abs(t))]
            yield traces.Panel("height, m", [traces.line(t, -moved, "estimator", palette.AUTOPILOT)])
            speeds = [("estimator", palette.AUTOPILOT, position.t, position.velocity)]
            if (one := receiver_of(flight, position.t)) is not None:
                known = np.isfinite(one.velocity[:, :2]).all(axis=1)  # the down part alone is not in every message
                speeds.append(("GPS", palette.GPS, one.t[known], np.nan_to_num(one.velocity[known])))
            yield traces.Panel("speed, m/s", _lines(incident, speeds, length))


def _lines(
    incident: Incident, tracks: Iterable[tuple[str, palette.Rgb, Array, Array]], of: Callable[[Array], Array]
) -> list[traces.Trace]:
    """A line for each track (name, colour, times, values) with two samples or more: `of` its values."""
    lines = []
    for name, colour, t, values in tracks:
        part = window(t, incident.start_s, incident.end_s)
        if len(t[part]) > 1:
            lines.append(traces.line(t[part] - incident.moment.t, of(values[part]), name, colour))
    return lines
