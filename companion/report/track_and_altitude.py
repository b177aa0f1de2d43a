"""Where the flight went: ground track and altitude."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.analysis import Replay
from companion.estimation import BestEstimate
from companion.model import Array, Flight
from companion.present import palette, paragraph, short, text
from companion.report import traces
from companion.report.html_page import Charts
from companion.view import best_path, extremes, worst_stretch

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


def ground_track(shown: Replay | None, paths: Sequence[Path]) -> traces.Figure:
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
    heights = [traces.line(p.t, -p.position[:, 2], p.name, p.colour, breaks=p.breaks) for p in paths]
    low, high = (-edge for edge in reversed(_near(paths, 2)))
    panel = traces.Panel("height above origin, m", [*heights, *_events(flight, reference)], {"range": [low, high]})
    altitude = traces.stack([panel], traces.TIME)
    altitude["layout"]["hovermode"] = "x"
    return charts.add(altitude, f"Height over time.{more}")


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
    return [*estimated, Path("autopilot", palette.AUTOPILOT, own.t, own.position, traces.gaps(own.t))]


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


def _events(flight: Flight, reference: Path) -> list[traces.Trace]:
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
    return [traces.markers(t, height, "arming and modes", **shown)]


def _on_the_map(path: Path) -> traces.Trace:
    kept = extremes((path.position[:, 0], path.position[:, 1]), 2 * traces.MOST_POINTS)
    t, position = path.t[kept], path.position[kept]
    at = traces.breaks_among(t, path.breaks)
    east, north = (np.insert(position[:, i], at, np.nan) for i in (1, 0))
    return traces.curve(
        east, north, path.name, path.colour, customdata=np.insert(t, at, np.nan), hovertemplate="%{customdata:.1f} s"
    )


def _spot(position: Array, name: str, symbol: str, colour: palette.Rgb = palette.AUTOPILOT) -> traces.Trace:
    marker = {"symbol": symbol, "size": 10, "color": palette.css(colour)}
    return traces.markers([float(position[1])], [float(position[0])], name, marker=marker, hovertemplate=name)
