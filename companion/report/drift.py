"""The errors over the flight, the drift of the IMU alone, expected drift and its causes; plots of it for a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from companion.comparison import Drift, Expectation, Expected, Replay, expected_since_anchor, length
from companion.estimation import BestEstimate
from companion.installation import missing
from companion.model import Array, DataError, Flight, InputError
from companion.present import (
    QUANTITIES,
    STATISTICS,
    agreement_table,
    details,
    drift_table,
    html_table,
    left_out_lines,
    palette,
    paragraph,
    table,
    words,
)
from companion.report import traces
from companion.report.html_page import height_px, laid_out
from companion.report.subject import Subject
from companion.report.traces import ground_track, paths_of, regained
from companion.verdict import Assessment

_ACCEL = palette.mix(palette.IMU, (255, 225, 0), 0.6)  # of the IMU too, and not to be taken for its gyro
_CAUSES: dict[str, tuple[palette.Rgb, float]] = {
    "gyro_bias": (palette.IMU, 0.0),
    "gyro_noise": (palette.IMU, 0.3),
    "accel_bias": (_ACCEL, 0.0),
    "accel_noise": (_ACCEL, 0.5),
    "bias_walk": (palette.IMU, 0.55),
    "scale": (palette.IMU, 0.72),
    "autopilot_attitude": (palette.AUTOPILOT, 0.0),
    "autopilot_anchor": (palette.AUTOPILOT, 0.35),
    "autopilot_end": (palette.AUTOPILOT, 0.65),
    "sampling": (palette.DIFFERENCE, 0.0),
    "quantisation": (palette.DIFFERENCE, 0.4),
    "time_offset": (palette.HEADING, 0.0),
    "time_jitter": (palette.HEADING, 0.2),
    "misalignment": (palette.HEADING, 0.4),
    "gravity": (palette.HEADING, 0.65),
}
"""Each cause of a budget → the colour of its source, and the share of white in it."""


def drift(subject: Subject) -> str:
    """Drift against horizon, measured and expected."""
    drift, expected = subject.assessment.drift, subject.assessment.expected
    excluded = list(left_out_lines(drift))
    if not any(row.windows for row in drift.rows):
        reason = "No window could be used: the flight is too short." if not excluded else "No window could be used."
        return "".join(map(paragraph, (reason, *excluded)))
    caption = (
        "Every window starts from the autopilot's own state and is compared with it at its end. 1σ: what is expected."
    )
    chart = subject.charts.add(drift_chart(drift, expected), caption)
    has_position = subject.comparison.has_position
    if not has_position:
        chart += paragraph("This flight has no position: attitude alone is compared.")
    results = drift_table(drift, expected, QUANTITIES if has_position else QUANTITIES[:1])
    return chart + html_table(results, "drift-table") + "".join(paragraph(e, "quiet") for e in excluded)


def budget(subject: Subject) -> str:
    """What the expected error is made of."""
    assessment = subject.assessment
    shares = {
        f"{row.horizon_s:g} s": expected.shares
        for row, expected in zip(assessment.drift.rows, assessment.expected, strict=True)
        if expected is not None
    }
    if not shares:
        return paragraph("Without windows there is no error to expect.")
    names = [quantity.name for quantity in QUANTITIES if any(quantity.name in of for of in shares.values())]
    percents = {c: {name: [100 * of[name][c] for of in shares.values()] for name in names} for c in _CAUSES}
    panels = []
    for name in names:
        bars = [
            {
                "type": "bar",
                "x": list(shares),
                "y": percents[cause][name],
                "name": words(cause),
                "marker": {"color": palette.css(palette.mix(colour, (255, 255, 255), white))},
                "hovertemplate": "%{y:.1f} %",
            }
            for cause, (colour, white) in _CAUSES.items()
            if max(map(max, percents[cause].values())) > 1.0
        ]
        panels.append(traces.Panel(f"{name}, %", bars, {"range": [0, 100]}))
    figure = traces.stack(panels, "seconds on the IMU alone", type="category")
    figure["layout"] |= {"barmode": "stack", "bargap": 0.35, "hovermode": "closest"}
    chart = subject.charts.add(
        figure, "Part of the expected mean square that each cause has; causes below 1 % everywhere are not drawn."
    )
    every = table(
        ["cause", *(f"{name} {horizon}" for name in names for horizon in shares)],
        [[words(c), *(f"{percent:.1f} %" for row in of.values() for percent in row)] for c, of in percents.items()],
        name="shares-table",
    )
    spec, noise = assessment.imu_spec, assessment.measured_noise
    lines = [f"IMU noise model: {spec.name} ({spec.reason})."]
    densities = ((noise.gyro, "rad/s/√Hz"), (noise.accel, "m/s²/√Hz"))
    if measured := " and ".join(f"{density:.2g} {unit}" for density, unit in densities if density is not None):
        lines.append(f"White noise in flight, worst axis: {measured}.")
    lines.append("The budget takes what the samples of a window scatter by where that is more than the data sheet's.")
    return (
        "".join(map(paragraph, lines))
        + f"{chart}<h3>Windows inside their 95 % bound</h3>{html_table(agreement_table(assessment), 'inside-table')}"
        + details("Every cause in numbers", every)
    )


def drift_chart(drift: Drift, expected: Sequence[Expected | None] = ()) -> traces.Figure:
    """Each error against the seconds on the IMU alone, both axes logarithmic."""
    panels = [
        traces.Panel(quantity.title, curves, {"type": "log", "dtick": 1})
        for quantity in QUANTITIES
        if (curves := _curves(drift, expected or [None] * len(drift.rows), quantity.attribute))
    ]
    ticks = [row.horizon_s for row in drift.rows]
    named = [f"{horizon:g}" for horizon in ticks]
    return traces.stack(panels, "seconds on the IMU alone", type="log", tickvals=ticks, ticktext=named)


def _curves(drift: Drift, expected: Sequence[Expected | None], attribute: str) -> list[traces.Trace]:
    """Median, 95 % and worst of the windows, and what was expected; nothing without windows."""
    rows = [(row, allowed) for row, allowed in zip(drift.rows, expected, strict=True) if getattr(row, attribute)]
    horizons = np.array([row.horizon_s for row, _ in rows])
    curves = [
        traces.curve(
            horizons,
            np.array([getattr(getattr(row, attribute), key) for row, _ in rows]),
            title,
            palette.DIFFERENCE,
            mode="lines+markers",
            **style,
        )
        for (key, title), style in zip(STATISTICS.items(), _STYLES, strict=True)
        if rows
    ]
    sigma = [(row.horizon_s, getattr(allowed, attribute)) for row, allowed in rows if allowed]
    known = np.array([(h, s) for h, s in sigma if s is not None]).reshape(-1, 2)
    for factor, name, width in ((1.0, "allowed 1σ", 2.0), (3.0, "allowed 3σ", 1.0)):
        if sigma:
            curves.append(traces.curve(known[:, 0], factor * known[:, 1], name, traces.GREY, width=width))
    return curves


_STYLES: tuple[dict[str, Any], ...] = ({"width": 2.5}, {"line": {"dash": "dash"}}, {"line": {"dash": "dot"}})
"""Of the statistics."""


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
    caption += "Shaded: warnings and faults that do not last all through the flight." if severe else ""
    note = "" if shown.has_position else paragraph("This flight has no position: attitude alone is compared.")
    return note + subject.charts.add(figure, caption)


def _anew(shown: Replay, period: float) -> str:
    """Where the page opens there is an anchor of its own."""
    early = np.flatnonzero(np.diff(shown.anchors) < 0.99 * period)
    times = ", ".join(f"{t:.1f}" for t in shown.anchors[early + 1])
    return f", counted anew from {times} s" if times else ""


def error_panels(shown: Replay, expected: Expectation | None, colour: palette.Rgb) -> list[traces.Panel]:
    """Attitude, tilt and heading, velocity and position error over time, in the colour of the IMU.

    expected: of them; None where it is not known.
    """
    degrees = np.degrees(shown.attitude_error)
    vectors = (degrees, shown.velocity_error, shown.position_error) if shown.has_position else (degrees,)
    t, sigmas = (np.zeros(0), 3 * (np.zeros(0),)) if expected is None else (expected.t, expected.lengths)
    panels = []
    for quantity, vector, sigma in zip(QUANTITIES, vectors, sigmas, strict=False):
        error = length(vector)
        drawn = _envelope(t, sigma) if len(t) else []
        drawn.append(traces.line(shown.t, error, "IMU from autopilot", colour, breaks=regained(shown)))
        panels.append(traces.Panel(quantity.title, drawn, _room(error, sigma)))
    tilt = traces.line(shown.t, length(degrees[:, :2]), "tilt", colour, line={"dash": "dot"})
    heading = traces.line(shown.t, degrees[:, 2], "heading", colour)
    panels.insert(1, traces.Panel("tilt, heading, °", [tilt, heading]))
    return panels


def _envelope(t: Array, sigma: Array) -> list[traces.Trace]:
    return [
        traces.band(t, 3 * sigma, "allowed 3σ", traces.GREY, 0.16),
        traces.band(t, sigma, "allowed 1σ", traces.GREY, 0.28),
    ]


def _room(error: Array, sigma: Array) -> dict[str, object]:
    """The range of an axis: all of the error, and no more of the envelope than leaves the error readable."""
    top = float(np.max(error, initial=0.0))
    if len(sigma):
        top = max(1.1 * top, min(3.3 * float(sigma.max()), 3.0 * top))
    return {"range": [0, top or 1.0]}


def plot_errors(shown: Replay, assessment: Assessment | None = None) -> Any:
    """The IMU alone minus the autopilot over time; with an assessment, beside the expected error (1σ, 3σ).

    Returns a `plotly.graph_objects.Figure`; so do the others. Raises InputError when plotly is not installed.
    """
    expected = None
    if assessment is not None:
        expected = expected_since_anchor(assessment.comparison, assessment.imu_spec, assessment.autopilot, shown)
    return _figure(traces.stack(error_panels(shown, expected, palette.IMU), traces.TIME))


def plot_path(flight: Flight, shown: Replay | None = None, best: BestEstimate | None = None) -> Any:
    """The ground track of the autopilot, and of the IMU alone and the best estimate where they are given.

    Raises DataError for a flight without a position.
    """
    paths = paths_of(flight, shown, palette.IMU, best)
    if not paths:
        raise DataError("This flight has no position: there is no path to draw.")
    return _figure(ground_track(shown, paths)).update_layout(height=600)


def plot_drift(table: Drift) -> Any:
    """The drift table: median, 95 % and worst of each error against the seconds on the IMU alone."""
    if not any(row.windows for row in table.rows):
        raise InputError("No window of this table could be used: there is nothing to draw.")
    return _figure(drift_chart(table))


def _figure(figure: Any) -> Any:
    try:
        from plotly import graph_objects  # noqa: PLC0415  (an extra)
    except ImportError:
        raise missing("report", "charts need plotly") from None
    return graph_objects.Figure(laid_out(figure)).update_layout(height=height_px(figure))
