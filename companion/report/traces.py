"""Charts as plotly's own dictionaries, in the colours of the view: lines, bands, panels; ground track and altitude."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from companion import present
from companion.comparison import Replay
from companion.estimation import BestEstimate
from companion.model import Array, Flight, longest_step
from companion.present import palette, paragraph, short, text
from companion.report.html_page import Charts, Figure
from companion.strapdown import quaternion
from companion.view import best_path, extremes, worst_stretch

Trace = dict[str, Any]

TIME = "seconds since boot"
"""The axis of time."""
LOGARITHMIC: Mapping[str, Any] = {"type": "log", "exponentformat": "none"}
"""An axis of densities: 0.0001 rad/s/√Hz, and not plotly's 100μ."""
_MOST_POINTS = 1200
"""Points of a line: about one a pixel. What is thinned keeps every peak and dip."""
_FINE_S = 1e4
"""Up to which float32 is good for times: of an hour a quarter of a millisecond, a thousandth of a pixel."""

GREY = palette.CURSOR
AXES: tuple[tuple[str, palette.Rgb], ...] = tuple(zip(present.AXES, palette.AXES, strict=True))
"""The body's axes and their colours."""


def line(
    x: Array,
    y: Array,
    name: str,
    colour: palette.Rgb,
    *,
    breaks: Array | None = None,
    limit: int = _MOST_POINTS,
    **more: Any,
) -> Trace:
    """A line (N,) over (N,), thinned, interrupted at `breaks` (times)."""
    kept = extremes((np.nan_to_num(y, posinf=1e300, neginf=-1e300),), limit)
    x, y = x[kept], y[kept]
    if breaks is not None and len(breaks):
        at = _breaks_among(x, breaks)
        x, y = np.insert(x, at, x[at]), np.insert(y, at, np.nan)
    return curve(x, y, name, colour, **more)


def by_axis(x: Array, values: Array, **more: Any) -> list[Trace]:
    """A line for each axis of the body: values (N, 3) over (N,)."""
    return [line(x, values[:, i], name, colour, **more) for i, (name, colour) in enumerate(AXES)]


def roll_pitch_heading(q: Array) -> Array:
    """Those (N, 3) of attitudes (N, 4), °, without steps at ±180°."""
    return np.asarray(np.degrees(np.unwrap(quaternion.to_euler(q), axis=0)))


def _breaks_among(t: Array, breaks: Array) -> npt.NDArray[np.intp]:
    """The indices of samples at times t before which a line is interrupted, each once."""
    at = np.unique(np.searchsorted(t, breaks))
    return at[(at > 0) & (at < len(t))]


def gaps(t: Array, gap: float | None = None) -> Array:
    """(G,) the times after which a track with times t (N,) has a gap (s; None: as of any track)."""
    return t[1:][np.diff(t) > (longest_step(t) if gap is None else gap)]


def curve(x: Array, y: Array, name: str, colour: palette.Rgb, *, width: float = 1.4, **more: Any) -> Trace:
    """A line through all its points."""
    style = {"color": palette.css(colour), "width": width} | more.pop("line", {})
    return {
        "type": "scatter",
        "mode": "lines",
        "x": np.asarray(x, dtype=np.float32 if np.max(x, initial=0.0) < _FINE_S else np.float64),
        "y": np.asarray(y, dtype=np.float32),
        "name": name,
        "line": style,
        "hovertemplate": "%{y:.3~g}",
        **more,
    }


def markers(x: Sequence[object] | Array, y: Sequence[object] | Array, name: str, **more: Any) -> Trace:
    """Points; more: how they look, and what else plotly is given."""
    return {"type": "scatter", "mode": "markers", "x": x, "y": y, "name": name, **more}


def densities(lines: Callable[[str], Sequence[Trace]]) -> Figure:
    """Spectra of both sensors over logarithmic axes; lines: of "gyro" or "accel"."""
    units = {"gyro": "rad/s/√Hz", "accel": "m/s²/√Hz"}
    panels = [Panel(f"{sensor}, {unit}", lines(sensor), LOGARITHMIC) for sensor, unit in units.items()]
    return stack(panels, "frequency, Hz", type="log")


def band(x: Array, y: Array, name: str, colour: palette.Rgb, opacity: float) -> Trace:
    """The area between zero and a line."""
    return curve(x, y, name, colour, width=0, fill="tozeroy", fillcolor=palette.rgba(colour, opacity))


@dataclass(frozen=True, slots=True)
class Panel:
    """One of several charts over one another with a common time axis."""

    title: str  # of the y axis, with its unit
    traces: Sequence[Trace]
    axis: Mapping[str, Any] | None = None  # more about the y axis


def stack(panels: Sequence[Panel], x_title: str, *, spans: Sequence[tuple[float, float]] = (), **axis: Any) -> Figure:
    """Panels from top to bottom over one x axis; `spans` are shaded; `axis`: more about the x axis.

    A name that comes again is one entry of the legend.
    """
    gap = 0.28 / (len(panels) + 1)
    height = (1.0 - gap * (len(panels) - 1)) / len(panels)
    data: list[Trace] = []
    numbers = ["", *map(str, range(2, len(panels) + 1))]  # plotly's first axis has none
    layout: dict[str, Any] = {"xaxis": {"title": {"text": x_title}, "anchor": f"y{numbers[-1]}", **axis}}
    seen: set[str] = set()
    for i, (number, panel) in enumerate(zip(numbers, panels, strict=True)):
        top = 1.0 - i * (height + gap)
        layout[f"yaxis{number}"] = {
            "title": {"text": panel.title},
            "domain": [max(top - height, 0.0), top],
            **(panel.axis or {}),
        }
        for trace in panel.traces:
            name = str(trace.get("name", ""))
            data.append(
                trace
                | {"xaxis": "x", "yaxis": f"y{number}", "legendgroup": name}
                | ({"showlegend": False} if name in seen else {})
            )
            seen.add(name)
    shade, edge = palette.rgba(palette.DIFFERENCE, 0.12), {"width": 1, "color": palette.rgba(palette.DIFFERENCE, 0.35)}
    rectangle = {"type": "rect", "xref": "x", "yref": "paper", "y0": 0, "y1": 1, "layer": "below"}
    layout["shapes"] = [rectangle | {"x0": a, "x1": b, "fillcolor": shade, "line": edge} for a, b in spans]
    return {"data": data, "layout": layout}


_MOST_EVENTS = 200
_LEAST_ROOM_M = 5.0
_EXCURSION = 3.0  # times the size of the autopilot's track, that the map has room for beside it


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """A track on the map."""

    name: str
    colour: palette.Rgb
    t: Array  # (N,) s
    position: Array  # (N, 3) NED, m
    breaks: Array  # s, where the line is interrupted


def ground(flight: Flight, shown: Replay | None, paths: Sequence[Path], charts: Charts) -> str:
    """The ground track as HTML, with the place where IMU and autopilot are farthest apart; "" without a position."""
    if not paths:
        return ""
    where = f"North is up.{_leaves(paths)} Metres from the flight's origin"
    if (origin := flight.origin) is not None:
        place = f"{np.degrees(origin.latitude):.5f}°, {np.degrees(origin.longitude):.5f}°"
        where += f" at {place}" if origin.t is None else f"; the vehicle was at {place} at {origin.t:.1f} s"
    return charts.add(ground_track(shown, paths), f"{where}.", square=True)


def ground_track(shown: Replay | None, paths: Sequence[Path]) -> Figure:
    """East and north of every path."""
    reference = paths[-1]
    spots = [_spot(reference.position[0], "start", "circle"), _spot(reference.position[-1], "end", "square")]
    if shown is not None and (worst := worst_stretch(shown)) is not None:
        at = int(np.searchsorted(shown.t, worst.end_s))
        name = f"farthest apart: {short(worst.apart_m)} m at {worst.end_s:.1f} s"
        spots.append(_spot(shown.position_ref[at], name, "x", palette.DIFFERENCE))
    return {
        "data": [*map(_on_the_map, paths), *spots],
        "layout": {
            "xaxis": {"title": {"text": "east, m"}, "range": _near(paths, 1)},
            "yaxis": {"title": {"text": "north, m"}, "scaleanchor": "x", "scaleratio": 1, "range": _near(paths, 0)},
            "hovermode": "closest",
        },
    }


def track(flight: Flight, paths: Sequence[Path], charts: Charts) -> str:
    """Height over time, of the autopilot alone where there is no replay."""
    if not paths:
        return paragraph("Not drawn: this flight has no position.")
    more = " Double-click shows all of the IMU where it runs off." if len(paths) > 1 else ""
    reference = paths[-1]
    heights = [line(p.t, -p.position[:, 2], p.name, p.colour, breaks=p.breaks) for p in paths]
    low, high = (-edge for edge in reversed(_near(paths, 2)))
    panel = Panel("height above origin, m", [*heights, *_events(flight, reference)], {"range": [low, high]})
    altitude = stack([panel], TIME)
    altitude["layout"]["hovermode"] = "x"
    return charts.add(altitude, f"Height over time.{more}", rows=1.5)


def regained(shown: Replay) -> Array:
    """When the autopilot's state becomes known again after a gap, s: there its line is interrupted."""
    return shown.t[1:][np.diff(shown.reference_valid.astype(np.int8)) > 0]


def paths_of(flight: Flight, shown: Replay | None, colour: palette.Rgb, best: BestEstimate | None) -> list[Path]:
    """The autopilot's comes last; none without a position. colour: of the IMU."""
    third = None if best is None else best_path(flight, best)
    estimated = [] if third is None else [Path("best estimate", palette.BEST, third.t, third.position, np.zeros(0))]
    if shown is not None and shown.has_position:
        return [
            Path("IMU alone", colour, shown.t, shown.position_imu, shown.anchors),
            *estimated,
            Path("autopilot", palette.AUTOPILOT, shown.t, shown.position_ref, regained(shown)),
        ]
    if flight.position is None or len(flight.position) < 2:
        return []
    own = flight.position
    return [*estimated, Path("autopilot", palette.AUTOPILOT, own.t, own.position, gaps(own.t))]


def _near(paths: Sequence[Path], axis: int) -> list[float]:
    """The range of an axis: the autopilot's track, and the IMU's up to a few times that off."""
    reference = paths[-1].position
    room = _room(reference)
    lowest, highest = float(reference[:, axis].min()), float(reference[:, axis].max())
    low = max(min(float(path.position[:, axis].min()) for path in paths), lowest - room)
    high = min(max(float(path.position[:, axis].max()) for path in paths), highest + room)
    margin = 0.05 * max(high - low, 1.0)
    return [low - margin, high + margin]


def _room(reference: Array) -> float:
    return _EXCURSION * max(float(np.ptp(reference, axis=0).max()), _LEAST_ROOM_M)


def _leaves(paths: Sequence[Path]) -> str:
    """How far a path leaves the map, in a sentence; "" where none does."""
    reference, room = paths[-1].position, _room(paths[-1].position)
    sentences = []
    for path in paths[:-1]:
        beyond = np.maximum(path.position - reference.max(axis=0), reference.min(axis=0) - path.position)[:, :2].max(
            axis=1
        )
        at = int(np.argmax(beyond))
        if beyond[at] > room:
            sentences.append(
                f" {path.name} leaves the map: {short(float(beyond[at]))} m off the track at {path.t[at]:.1f} s."
            )
    return "".join(sentences)


def _events(flight: Flight, reference: Path) -> list[Trace]:
    """Arming, modes and errors, on the autopilot's line."""
    events = [e for e in flight.events if reference.t[0] <= e.t <= reference.t[-1]][:_MOST_EVENTS]
    if not events:
        return []
    t = np.array([event.t for event in events])
    colours = [palette.HEADING if e.kind in {"armed", "disarmed"} else palette.AUTOPILOT for e in events]
    height = -np.interp(t, reference.t, reference.position[:, 2])
    marker = {"symbol": "diamond", "size": 8, "color": [palette.css(colour) for colour in colours]}
    words = [text(f"{event.kind}: {event.text}") for event in events]  # plotly reads <a href> in texts
    shown = {"marker": marker, "text": words, "hovertemplate": "%{text}<extra></extra>"}
    return [markers(t, height, "arming and modes", **shown)]


def _on_the_map(path: Path) -> Trace:
    kept = extremes((path.position[:, 0], path.position[:, 1]), 2 * _MOST_POINTS)
    t, position = path.t[kept], path.position[kept]
    at = _breaks_among(t, path.breaks)
    east, north = (np.insert(position[:, i], at, np.nan) for i in (1, 0))
    return curve(
        east, north, path.name, path.colour, customdata=np.insert(t, at, np.nan), hovertemplate="%{customdata:.1f} s"
    )


def _spot(position: Array, name: str, symbol: str, colour: palette.Rgb = palette.AUTOPILOT) -> Trace:
    marker = {"symbol": symbol, "size": 10, "color": palette.css(colour)}
    return markers([float(position[1])], [float(position[0])], name, marker=marker, hovertemplate=name)
