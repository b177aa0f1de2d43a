"""The flight on one time axis and on the map: errors with what to expect of them, ground track, altitude."""

from __future__ import annotations

import numpy as np

from companion.analysis import Replay, expected_since_anchor
from companion.report import traces
from companion.report.markup import paragraph, text
from companion.report.subject import Section, Subject
from companion.tracks import Array
from companion.view import extremes, palette

TIME = "seconds since boot"
_MOST_EVENTS = 200


def errors(subject: Subject) -> Section:
    """Attitude, velocity and position errors over the flight with their 1σ and 3σ."""
    title = "Errors over the flight"
    shown = subject.replay
    if shown is None:
        return Section("errors", title, paragraph(f"Not drawn: {subject.why_no_replay}"))
    expected = expected_since_anchor(subject.found, shown)
    sigma = None if expected is None else expected.lengths
    degrees = np.degrees(shown.attitude_error)
    measured = [("attitude", "°", np.linalg.norm(degrees, axis=1))]
    if shown.has_position:
        measured.append(("velocity", "m/s", np.linalg.norm(shown.velocity_error, axis=1)))
        measured.append(("position", "m", np.linalg.norm(shown.position_error, axis=1)))
    panels = []
    for i, (name, unit, error) in enumerate(measured):
        drawn = [] if expected is None or sigma is None else _envelope(expected.t, sigma[i])
        drawn.append(traces.line(shown.t, error, "IMU from autopilot", palette.DIFFERENCE, breaks=_unknown(shown)))
        panels.append(traces.Panel(f"{name}, {unit}", drawn, _room(error, None if sigma is None else sigma[i])))
    horizontal = np.linalg.norm(degrees[:, :2], axis=1)
    panels.insert(
        1,
        traces.Panel(
            "tilt, heading, °",
            [
                traces.line(shown.t, horizontal, "tilt", palette.DIFFERENCE, line={"dash": "dot"}),
                traces.line(shown.t, degrees[:, 2], "heading", palette.HEADING),
            ],
        ),
    )
    severe = [(f.start_s, f.end_s) for f in subject.severe if not subject.is_throughout(f)]
    figure = traces.stack(panels, TIME, spans=severe)
    period = subject.settings.view.reanchor_s
    caption = (
        f"The IMU alone, started again from the autopilot's state every {period:g} s. "
        if period
        else "The IMU alone from beginning to end. "
    )
    caption += (
        "Grey: what is expected since the start, 1σ and 3σ. "
        if sigma
        else "Nothing is expected here: the IMU runs for longer than two minutes, or starts again too often. "
    )
    caption += "Shaded: warnings and errors that do not last all through the flight." if severe else ""
    note = "" if shown.has_position else paragraph("This flight has no position: attitude alone is compared.")
    return Section("errors", title, note + subject.charts.add(figure, caption, rows=len(panels)))


def track(subject: Subject) -> Section:
    """Ground track and altitude."""
    title = "Ground track and altitude"
    shown = subject.replay
    if shown is None:
        return Section("track", title, paragraph(f"Not drawn: {subject.why_no_replay}"))
    if not shown.has_position:
        return Section("track", title, paragraph("Not drawn: this flight has no position."))
    both = [
        ("IMU alone", subject.colour, shown.position_imu, shown.anchors),
        ("autopilot", palette.AUTOPILOT, shown.position_ref, _unknown(shown)),
    ]
    start = shown.position_ref[0]
    figure = {
        "data": [
            *(_map(shown.t, position, name, colour, breaks) for name, colour, position, breaks in both),
            _place(start, "start", "circle"),
            _place(shown.position_ref[-1], "end", "square"),
        ],
        "layout": {
            "xaxis": {"title": {"text": "east, m"}, "range": _near(shown, 1)},
            "yaxis": {"title": {"text": "north, m"}, "scaleanchor": "x", "scaleratio": 1, "range": _near(shown, 0)},
            "hovermode": "closest",
        },
    }
    origin = subject.flight.origin
    where = "North is up. Double-click shows all of the IMU where it runs off. Metres from the flight's origin"
    if origin is not None:
        place = f"{np.degrees(origin.latitude):.5f}°, {np.degrees(origin.longitude):.5f}°"
        where += f" at {place}" if origin.t is None else f"; the vehicle was at {place} at {origin.t:.1f} s"
    chart = subject.charts.add(figure, f"{where}.", square=True)
    heights = [traces.line(shown.t, -p[:, 2], name, colour, breaks=breaks) for name, colour, p, breaks in both]
    heights += _events(subject, shown)
    low, high = (-edge for edge in reversed(_near(shown, 2)))
    panel = traces.Panel("height above origin, m", heights, {"range": [low, high]})
    altitude = traces.stack([panel], TIME)
    altitude["layout"]["hovermode"] = "x"
    return Section(
        "track",
        title,
        chart
        + subject.charts.add(
            altitude, "Height of both over time. Double-click shows all of the IMU where it runs off."
        ),
    )


def _envelope(t: Array, sigma: Array) -> list[traces.Trace]:
    return [
        traces.band(t, 3 * sigma, "expected 3σ", traces.GREY, 0.16),
        traces.band(t, sigma, "expected 1σ", traces.GREY, 0.28),
    ]


def _room(error: Array, sigma: Array | None) -> dict[str, object]:
    """The range of an axis: all of the error, and no more of the envelope than leaves the error readable."""
    top = float(np.max(error, initial=0.0))
    if sigma is not None and len(sigma):
        top = max(1.1 * top, min(3.3 * float(sigma.max()), 3.0 * top))
    return {"range": [0, top or 1.0]}


def _near(shown: Replay, axis: int) -> list[float]:
    """The range of an axis: the autopilot's track, and the IMU's as far as it is no farther off than that is long."""
    reference, imu = shown.position_ref[:, axis], shown.position_imu[:, axis]
    low, high = float(reference.min()), float(reference.max())
    room = max(float(np.ptp(shown.position_ref, axis=0).max()), 5.0)
    low, high = max(min(low, float(imu.min())), low - room), min(max(high, float(imu.max())), high + room)
    margin = 0.05 * max(high - low, 1.0)
    return [low - margin, high + margin]


def _unknown(shown: Replay) -> Array:
    """Where the autopilot's state becomes known again after a hole: there its line is interrupted."""
    return shown.t[1:][np.diff(shown.reference_valid.astype(np.int8)) > 0]


def _events(subject: Subject, shown: Replay) -> list[traces.Trace]:
    """Arming, modes and errors, on the autopilot's line."""
    events = [e for e in subject.flight.events if shown.t[0] <= e.t <= shown.t[-1]][:_MOST_EVENTS]
    if not events:
        return []
    t = np.array([event.t for event in events])
    colours = [palette.HEADING if e.kind in {"armed", "disarmed"} else palette.AUTOPILOT for e in events]
    return [
        {
            "type": "scatter",
            "mode": "markers",
            "x": t,
            "y": -np.interp(t, shown.t, shown.position_ref[:, 2]),
            "name": "arming and modes",
            "marker": {"symbol": "diamond", "size": 8, "color": [palette.css(c) for c in colours]},
            "text": [text(f"{event.kind}: {event.text}") for event in events],  # plotly reads <a href> in texts
            "hovertemplate": "%{text}<extra></extra>",
        }
    ]


def _map(t: Array, position: Array, name: str, colour: palette.Rgb, breaks: Array) -> traces.Trace:
    kept = extremes((position[:, 0], position[:, 1]), 2 * traces.MOST_POINTS)
    t, position = t[kept], position[kept]
    at = np.unique(np.searchsorted(t, breaks))
    at = at[(at > 0) & (at < len(t))]
    east, north = (np.insert(position[:, i], at, np.nan) for i in (1, 0))
    return traces.curve(
        east, north, name, colour, customdata=np.insert(t, at, np.nan), hovertemplate="%{customdata:.1f} s"
    )


def _place(position: Array, name: str, symbol: str) -> traces.Trace:
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [float(position[1])],
        "y": [float(position[0])],
        "name": name,
        "marker": {"symbol": symbol, "size": 10, "color": palette.css(palette.AUTOPILOT)},
        "hovertemplate": name,
    }
