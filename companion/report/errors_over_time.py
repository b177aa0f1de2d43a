"""The errors over the flight with what to expect of them."""

from __future__ import annotations

import numpy as np

from companion.analysis import Expectation, Replay
from companion.model import Array
from companion.present import palette, paragraph
from companion.report import traces
from companion.report.subject import Subject
from companion.report.track_and_altitude import regained


def errors(subject: Subject) -> str:
    """Attitude, velocity and position errors over the flight with their 1σ and 3σ."""
    shown = subject.replay
    if shown is None:
        return paragraph(f"Not drawn: {subject.why_no_replay}")
    expected = subject.expected
    panels = error_panels(shown, expected, subject.colour)
    severe = [f for f in subject.assessment.verdict.findings if f.severity != "info" and not subject.is_throughout(f)]
    figure = traces.stack(panels, traces.TIME, spans=[(f.start_s, f.end_s) for f in severe])
    period = subject.settings.view.reanchor_s
    caption = (
        f"The IMU alone, started again from the autopilot's state every {period:g} s{_anew(shown, period)}. "
        if period
        else "The IMU alone from beginning to end. "
    )
    caption += (
        "Grey: what is allowed since the anchor, 1σ and 3σ. "
        if expected is not None
        else "Nothing is expected here: the IMU runs for longer than two minutes, or starts again too often. "
    )
    caption += "Shaded: warnings and errors that do not last all through the flight." if severe else ""
    note = "" if shown.has_position else paragraph("This flight has no position: attitude alone is compared.")
    return note + subject.charts.add(figure, caption, rows=len(panels))


def _anew(shown: Replay, period: float) -> str:
    """Where the page opens there is an anchor of its own."""
    early = np.flatnonzero(np.diff(shown.anchors) < 0.99 * period)
    return "".join(f", counted anew from {t:.1f} s" for t in shown.anchors[early + 1])


def error_panels(shown: Replay, expected: Expectation | None, colour: palette.Rgb) -> list[traces.Panel]:
    """Attitude, tilt and heading, velocity and position error over time, in the colour of the IMU.

    expected: of them; None where it is not known.
    """
    sigma = None if expected is None else expected.lengths
    degrees = np.degrees(shown.attitude_error)
    measured = [("attitude", "°", np.linalg.norm(degrees, axis=1))]
    if shown.has_position:
        measured.append(("velocity", "m/s", np.linalg.norm(shown.velocity_error, axis=1)))
        measured.append(("position", "m", np.linalg.norm(shown.position_error, axis=1)))
    panels = []
    for i, (name, unit, error) in enumerate(measured):
        drawn = [] if expected is None or sigma is None else _envelope(expected.t, sigma[i])
        drawn.append(traces.line(shown.t, error, "IMU from autopilot", colour, breaks=regained(shown)))
        panels.append(traces.Panel(f"{name}, {unit}", drawn, _room(error, None if sigma is None else sigma[i])))
    horizontal = np.linalg.norm(degrees[:, :2], axis=1)
    panels.insert(
        1,
        traces.Panel(
            "tilt, heading, °",
            [
                traces.line(shown.t, horizontal, "tilt", colour, line={"dash": "dot"}),
                traces.line(shown.t, degrees[:, 2], "heading", colour),
            ],
        ),
    )
    return panels


def _envelope(t: Array, sigma: Array) -> list[traces.Trace]:
    return [
        traces.band(t, 3 * sigma, "allowed 3σ", traces.GREY, 0.16),
        traces.band(t, sigma, "allowed 1σ", traces.GREY, 0.28),
    ]


def _room(error: Array, sigma: Array | None) -> dict[str, object]:
    """The range of an axis: all of the error, and no more of the envelope than leaves the error readable."""
    top = float(np.max(error, initial=0.0))
    if sigma is not None and len(sigma):
        top = max(1.1 * top, min(3.3 * float(sigma.max()), 3.0 * top))
    return {"range": [0, top or 1.0]}
