"""What the charts can show of a flight: the errors, the IMU's readings, how the messages came."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from companion.model import Array, Flight
from companion.present import AXES, Rgb, palette
from companion.view.charts.chart import DASHED, DOTTED, Drawing, Line
from companion.view.state.trajectory import DisplayTrajectory, Envelope, Errors


def error_drawings(display: DisplayTrajectory, colours: Mapping[str, Rgb]) -> list[Drawing]:
    """How far each IMU is from the autopilot since its anchor, and how far it should be."""
    sources = {display.source: display.errors} | {name: other.errors for name, other in display.others.items()}
    known = (display.replay.t, display.replay.reference_valid.astype(np.float64))
    return errors_over_time(sources, colours, display.expected, known, has_position=display.replay.has_position)


def horizon_drawings(display: DisplayTrajectory, colours: Mapping[str, Rgb]) -> list[Drawing]:
    """The error of the window that ends at each instant, and what the drift table expects of windows of that length."""
    if display.result is None or display.trailing is None or not len(display.trailing.t):
        return []
    name, horizon = display.source, display.result.horizon_s
    envelope, expected = None, display.result.allowed
    if expected is not None:
        figures = (expected.attitude_deg, expected.velocity_mps or 0.0, expected.position_m or 0.0)
        ends = display.trailing.t[[0, -1]]
        envelope = Envelope(ends, *(np.full(len(ends), sigma) for sigma in figures))
    after = f" after {horizon:g} s"
    sources, has_position = {name: display.trailing}, display.replay.has_position
    return errors_over_time(sources, colours, envelope, None, after, has_position=has_position)


def reading_drawings(display: DisplayTrajectory, flight: Flight) -> list[Drawing]:
    """What the IMU read, and as dotted lines what it read before it was corrected."""
    raw = flight.imus[display.source]
    track = display.track or raw

    def lines(now: Array, before: Array) -> tuple[Line, ...]:
        axes = [Line(axis, c, track.t, v) for axis, c, v in zip(AXES, palette.AXES, now.T, strict=True)]
        if track is not raw:
            axes += [
                Line(f"{axis} raw", c, raw.t, v, 1.1, DOTTED, in_title=False)
                for axis, c, v in zip(AXES, palette.AXES, before.T, strict=True)
            ]
        return tuple(axes)

    return [
        Drawing("Gyro, °/s", "deg/s", lines(np.degrees(track.gyro), np.degrees(raw.gyro))),
        Drawing("Accelerometer, m/s²", "m/s²", lines(track.accel, raw.accel)),
    ]


def rate_drawings(flight: Flight, colours: Mapping[str, Rgb]) -> list[Drawing]:
    """How often each IMU and the autopilot's estimate came, and the longest gaps in them."""
    tracks: list[tuple[str, Rgb, Array, tuple[float, ...] | None]] = [
        (name, colours[name], track.t, None) for name, track in flight.imus.items()
    ]
    if flight.attitude is not None:
        tracks.append((flight.attitude.source, palette.AUTOPILOT, flight.attitude.t, None))
    if flight.position is not None:
        tracks.append((flight.position.source, palette.AUTOPILOT, flight.position.t, DASHED))
    measured = [(name, colour, dash, rates(t, *_span(flight))) for name, colour, t, dash in tracks]
    return [
        Drawing(
            title, unit, tuple(Line(n, c, r.t, getattr(r, part), 1.6, d, in_title=False) for n, c, d, r in measured)
        )
        for title, unit, part in (("Messages a second", "Hz", "hz"), ("Longest gap, s", "s", "gap_s"))
    ]


def _span(flight: Flight) -> tuple[float, float]:
    return flight.start, flight.start + flight.duration


def errors_over_time(
    sources: Mapping[str, Errors],
    colours: Mapping[str, Rgb],
    envelope: Envelope | None,
    known: tuple[Array, Array] | None,
    after: str = "",
    *,
    has_position: bool,
) -> list[Drawing]:
    """Attitude, velocity and position: how far each source is off, and how far it should be.

    known: times, and 0 where the autopilot's state is not known.
    """
    first = next(iter(sources))

    def lines(columns: Mapping[str, str], sigma: str) -> tuple[Line, ...]:
        drawn = []
        for source, errors in sources.items():
            for (column, name), dash in zip(columns.items(), (None, DASHED), strict=False):
                if column == "heading_deg" and source != first:
                    continue
                label = name if len(sources) == 1 else f"{source} {name}".strip()
                values = getattr(errors, column)
                room = len(sources) == 1 or dash is None  # of several, the title has room for one figure each
                drawn.append(Line(label, colours[source], errors.t, values, 1.7, dash, in_title=room))
        if envelope is not None:
            one = getattr(envelope, sigma)
            drawn.append(Line("1σ", palette.CURSOR, envelope.t, one, 1.2, DASHED, in_title=False, fill=0.16))
            drawn.append(Line("3σ", palette.CURSOR, envelope.t, 3 * one, 1.2, DOTTED, in_title=False, fill=0.12))
        return tuple(drawn)

    attitude = {"tilt_deg": "tilt", "heading_deg": "heading"}
    drawings = [Drawing(f"Attitude error{after}, °", "deg", lines(attitude, "attitude_deg"), known)]
    if has_position:
        apart = "" if len(sources) > 1 else "apart"
        velocity, position = lines({"velocity_mps": apart}, "velocity_mps"), lines({"position_m": apart}, "position_m")
        drawings.append(Drawing(f"Velocity error{after}, m/s", "m/s", velocity, known))
        drawings.append(Drawing(f"Position error{after}, m", "m", position, known))
    return drawings


BINS = 120


@dataclass(frozen=True, slots=True, eq=False)
class Rates:
    """One message, in equal stretches of time."""

    t: Array  # (B,) s, boot clock, middle of each stretch
    hz: Array  # (B,) messages a second in it
    gap_s: Array  # (B,) the longest time between two messages that reaches into it


def rates(t: Array, first: float, last: float, bins: int = BINS) -> Rates:
    """The rates and gaps of messages at `t` (N,) s, between two times (s): a second a stretch, or longer ones.

    A message that is late is a gap in every stretch that it is missed in; before the first and after the last too.
    """
    count = int(np.clip(last - first, 1, bins))
    edges = np.linspace(first, max(last, first + 1e-3), count + 1)
    hz = np.histogram(t, edges)[0] / np.diff(edges)
    times = np.concatenate([[first], t[(t > first) & (t < last)], [last]])
    waits = np.diff(times)
    gap = np.zeros(count)
    begin = np.clip(np.searchsorted(edges, times[:-1], side="right") - 1, 0, count - 1)
    end = np.clip(np.searchsorted(edges, times[1:], side="left") - 1, 0, count - 1)
    np.maximum.at(gap, begin, waits)
    np.maximum.at(gap, end, waits)
    for i in np.flatnonzero(end > begin + 1):  # a gap over several stretches
        gap[begin[i] : end[i] + 1] = np.maximum(gap[begin[i] : end[i] + 1], waits[i])
    return Rates((edges[:-1] + edges[1:]) / 2, hz, gap)
