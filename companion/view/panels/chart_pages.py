"""The charts beside the picture: those of a replay, a page of them at a time, and those of a live page.

And what each page shows: errors, IMU readings, noise, drift, message rates.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import zip_longest

import numpy as np

from companion.comparison import AxisNoise, ImuNoise
from companion.model import STANDARD_GRAVITY, Array, Flight
from companion.noise import AllanDeviation
from companion.present import AXES, QUANTITIES, Rgb, palette
from companion.verdict import Assessment, LiveVerdict
from companion.view.panels.chart import DASHED, DOTTED, Chart, Drawing, Line, LineStyle, LogChart, LogDrawing
from companion.view.panels.controls import Controls
from companion.view.panels.markup import block
from companion.view.state.live import Curves
from companion.view.state.trajectory import DisplayTrajectory, Envelope, Errors, Sample


def _error_drawings(display: DisplayTrajectory, colours: Mapping[str, Rgb]) -> list[Drawing]:
    """How far each IMU is from the autopilot since its anchor, and how far it should be."""
    sources = {name: one.errors for name, one in display.by_imu.items()}
    known = (display.replay.t, display.replay.reference_valid.astype(np.float64))
    return _errors_over_time(sources, colours, display.expected, known, has_position=display.replay.has_position)


def _horizon_drawings(display: DisplayTrajectory, colours: Mapping[str, Rgb]) -> list[Drawing]:
    """The error of the window that ends at each instant, and what the drift table expects of windows of that length."""
    if (result := display.result) is None or not len(result.trailing.t):
        return []
    envelope, expected = None, result.allowed
    if expected is not None:
        allowed = (getattr(expected, quantity.attribute) or 0.0 for quantity in QUANTITIES)
        envelope = Envelope(result.trailing.t[[0, -1]], *(np.full(2, sigma) for sigma in allowed))
    sources, after = {display.source: result.trailing}, f" after {result.horizon_s:g} s"
    return _errors_over_time(sources, colours, envelope, None, after, has_position=display.replay.has_position)


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


def _rate_drawings(flight: Flight, colours: Mapping[str, Rgb]) -> list[Drawing]:
    """How often each IMU and the autopilot's estimate came, and the longest gaps in them."""
    tracks: list[tuple[str, Rgb, Array, tuple[float, ...] | None]] = [
        (name, colours[name], track.t, None) for name, track in flight.imus.items()
    ]
    if flight.attitude is not None:
        tracks.append((flight.attitude.source, palette.AUTOPILOT, flight.attitude.t, None))
    if flight.position is not None:
        tracks.append((flight.position.source, palette.AUTOPILOT, flight.position.t, DASHED))
    end = flight.start + flight.duration
    measured = [(name, colour, dash, rates(t, flight.start, end)) for name, colour, t, dash in tracks]
    return [
        Drawing(
            title, unit, tuple(Line(n, c, r.t, getattr(r, part), 1.6, d, in_title=False) for n, c, d, r in measured)
        )
        for title, unit, part in (("Messages a second", "Hz", "hz"), ("Longest gap, s", "s", "gap_s"))
    ]


def _errors_over_time(
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


_BINS = 120


@dataclass(frozen=True, slots=True, eq=False)
class _Rates:
    """One message, in equal stretches of time."""

    t: Array  # (B,) s, boot clock, middle of each stretch
    hz: Array  # (B,) messages a second in it
    gap_s: Array  # (B,) the longest time between two messages that reaches into it


def rates(t: Array, first: float, last: float, bins: int = _BINS) -> _Rates:
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
    return _Rates((edges[:-1] + edges[1:]) / 2, hz, gap)


_LEAST_DRIFT = 1e-6  # of any unit that is shown
_DRIFT_QUANTITIES = {
    "Attitude, ° after so many s": "attitude_deg",
    "Velocity, m/s": "velocity_mps",
    "Position, m": "position_m",
}


def drift_lines(assessment: Assessment, quantity: str) -> tuple[Array, ...] | None:
    """Horizons, median, 95 %, allowed 1σ and 3σ of a quantity of the drift table; None with fewer than two rows."""
    rows: list[tuple[float, ...]] = []
    for row, expected in zip(assessment.drift.rows, assessment.expected, strict=True):
        measured, sigma = getattr(row, quantity), getattr(expected, quantity, None)
        if measured is not None and sigma is not None:
            rows.append((row.horizon_s, measured.median, measured.p95, sigma, 3 * sigma))
    if len(rows) < 2:
        return None
    return tuple(np.maximum(column, _LEAST_DRIFT) for column in np.array(sorted(rows)).T)


def _drift_drawings(display: DisplayTrajectory, colours: Mapping[str, Rgb]) -> list[LogDrawing]:
    """The drift table, in the colour of the IMU."""
    if display.result is None:
        return []
    colour = colours.get(display.source, palette.IMU)
    styles: tuple[LineStyle, ...] = (
        ("median", colour, 2.2, None),
        ("95 %", colour, 1.2, None),
        ("allowed 1σ", palette.CURSOR, 1.4, DASHED),
        ("3σ", palette.CURSOR, 1.4, DOTTED),
    )
    assessment = display.result.assessment
    charts = ((title, drift_lines(assessment, quantity)) for title, quantity in _DRIFT_QUANTITIES.items())
    return [LogDrawing(title, "after, s", styles, lines, points=True) for title, lines in charts if lines is not None]


_NOISE_TITLES = (
    "Gyro in flight, mdps/√Hz over Hz",
    "Accelerometer in flight, µg/√Hz over Hz",
    "Gyro at rest, Allan deviation, mdps over s",
    "Accelerometer at rest, Allan deviation, µg over s",
)
_NOISE_STYLES: tuple[LineStyle, ...] = (
    *((name, colour, 1.5, None) for name, colour in zip(AXES, palette.AXES, strict=True)),
    ("data sheet", palette.CURSOR, 1.4, DASHED),
)
_MDPS, _MICRO_G = 1e3 * float(np.degrees(1.0)), 1e6 / STANDARD_GRAVITY
_POINTS = 200  # of a spectrum, evenly spread over the decades: the strongest bin of each


def noise_lines(noise: ImuNoise | None) -> list[tuple[Array, ...] | None]:
    """For each title x, the three axes and the data sheet's white noise; None where there is nothing to show.

    An axis that is below quantisation at rest is drawn at its upper bound.
    """
    if noise is None:
        return [None] * len(_NOISE_TITLES)
    gyro, accel = noise.imu_spec.gyro.noise_density, noise.imu_spec.accel.noise_density
    spectrum, rest = noise.flight.spectrum if noise.flight else None, noise.rest
    return [
        _spectrum(spectrum.frequency_hz, spectrum.gyro, gyro, _MDPS) if spectrum else None,
        _spectrum(spectrum.frequency_hz, spectrum.accel, accel, _MICRO_G) if spectrum else None,
        _allan(rest.gyro, rest.gyro_axes, gyro, _MDPS) if rest else None,
        _allan(rest.accel, rest.accel_axes, accel, _MICRO_G) if rest else None,
    ]


def _spectrum(frequency: Array, power: Array, sheet: float, factor: float) -> tuple[Array, ...]:
    """As two-sided amplitude densities: white noise of density N is N in them."""
    edges = np.unique(np.geomspace(1, len(frequency), _POINTS).astype(np.int64))[:-1]
    strongest = np.maximum.reduceat(power, edges, axis=0)
    lines = factor * np.sqrt(0.5 * strongest).T
    return (frequency[edges], *lines, np.full(len(edges), factor * sheet))


def _allan(
    curve: AllanDeviation, axes: tuple[AxisNoise | None, ...], sheet: float, factor: float
) -> tuple[Array, ...] | None:
    """None where every axis is stuck; one of them lies at the bottom of the chart."""
    fall = 1.0 / np.sqrt(curve.tau)
    lines = [
        axis.white.high * fall if axis is not None and axis.hidden else curve.deviation[:, i]
        for i, axis in enumerate(axes)
    ]
    seen = np.array(lines)[np.array(lines) > 0]
    if not len(seen):
        return None
    return (curve.tau, *(factor * np.maximum(line, 0.1 * seen.min()) for line in lines), factor * sheet * fall)


def _noise_drawings(display: DisplayTrajectory) -> list[LogDrawing]:
    """Spectra in flight and Allan deviations at rest, as far as there are any."""
    charts = zip(_NOISE_TITLES, noise_lines(display.result.noise if display.result else None), strict=True)
    return [LogDrawing(title, "Hz or s", _NOISE_STYLES, lines) for title, lines in charts if lines is not None]


_HORIZON, _NOISE = "Errors over the horizon", "IMU noise"
Draw = Callable[[DisplayTrajectory, Flight, Mapping[str, Rgb]], Sequence[Drawing | LogDrawing]]
_PAGES: Mapping[str, Draw] = {
    "Errors since the anchor": lambda display, _, colours: _error_drawings(display, colours),
    _HORIZON: lambda display, _, colours: _horizon_drawings(display, colours),
    "IMU readings": lambda display, flight, _: reading_drawings(display, flight),
    _NOISE: lambda display, *_: _noise_drawings(display),
    "Drift by horizon": lambda display, _, colours: _drift_drawings(display, colours),
    "Rates and gaps": lambda _, flight, colours: _rate_drawings(flight, colours),
}
_NOTHING = {
    _HORIZON: "No window of this length can be used.",
    _NOISE: "Neither a rest of 10 s nor a stretch without gaps that is long enough for a spectrum.",
}
"""Why a page is empty once the analysis has come."""


_CHARTS = 3
_ZOOM = "Drag over a chart to zoom in, double-click to see all of it again"


class ChartPages:
    """Only the view thread may call it."""

    def __init__(self, controls: Controls) -> None:
        gui = controls.gui
        page = gui.add_dropdown("Charts", tuple(_PAGES), hint=_ZOOM)
        controls.on_change(page, self.pick)
        self._charts = [Chart(gui) for _ in range(_CHARTS)]
        self._log_charts = [LogChart(gui) for _ in _NOISE_TITLES]
        self.charts: list[Chart | LogChart] = [*self._charts, *self._log_charts]
        self._hint = gui.add_html("", visible=False)
        self._shown, self._now, self._why = next(iter(_PAGES)), 0.0, ""

    def wait(self, text: str) -> None:
        """There is no analysis, or not yet: why, in words. `text` may hold anything."""
        self._why = text
        self._hint.content = block(escape(text))

    def load(
        self, display: DisplayTrajectory, flight: Flight, colours: Mapping[str, Rgb], part: tuple[float, float]
    ) -> None:
        """Draw another trajectory, between two times (s, boot clock)."""
        self._display, self._flight, self._colours = display, flight, colours
        self.choose_part(part)

    def choose_part(self, part: tuple[float, float]) -> None:
        """Show what lies between two times (s, boot clock), thinned anew: the shorter, the finer."""
        self.part = part
        self._draw()

    def pick(self, page: str) -> None:
        """Show another page of charts."""
        if page in _PAGES:
            self._shown = page
            self._draw()

    def show(self, sample: Sample) -> None:
        """Move the line to `sample`."""
        still, self._now = sample.t == self._now, sample.t
        for chart in self._charts:
            chart.show(sample.t, still=still)

    def _draw(self) -> None:
        drawn = _PAGES[self._shown](self._display, self._flight, self._colours)
        for chart, drawing in zip_longest(self._charts, (one for one in drawn if isinstance(one, Drawing))):
            chart.draw(drawing, self.part)
        for log_chart, log in zip_longest(self._log_charts, (one for one in drawn if isinstance(one, LogDrawing))):
            log_chart.draw(log)
        self._hint.visible = not drawn
        why = self._why if self._display.result is None else _NOTHING.get(self._shown, "")
        self._hint.content = block(escape(why))


_SPANS = (30.0, 60.0, 120.0, 300.0, 600.0, 1800.0, 3600.0)
"""s. A new flight begins with short charts: a change of span builds them anew, and forgets how the user has zoomed."""


class LiveCharts:
    """The last minutes, against seconds before now: errors since the last anchor, or those of the free run.

    So they scroll and keep their zoom. Only the view thread may call it.
    """

    def __init__(self, controls: Controls, window_s: float, picked: Callable[[], object]) -> None:
        """picked: called when others are to be drawn."""
        runs = {"Since anchor": lambda _: self._pick(free=False), "Free run": lambda _: self._pick(free=True)}
        controls.row("Show", runs, _ZOOM)
        self._window, self._picked, self._free = window_s, picked, False
        self.charts = [Chart(controls.gui, time="s before now") for _ in range(_CHARTS)]

    def show(self, curves: Curves, now: float, verdict: LiveVerdict) -> None:
        """Draw the errors and what is expected of them since the anchor, with the line at `now` (s, 0 or less)."""
        errors, known = (curves.free, curves.free_known) if self._free else (curves.errors, curves.known)
        span = next((s for s in _SPANS if s >= min(-float(errors.t[0]), self._window)), self._window)
        drawings = _errors_over_time(
            {"": errors},
            {"": palette.FREE if self._free else palette.IMU},
            None if self._free else expected_over(curves, verdict),
            (errors.t, known.astype(np.float64)),
            has_position=curves.has_position,
        )
        for chart, drawing in zip_longest(self.charts, drawings):
            chart.draw(drawing, (-min(span, self._window), 0.0))
            chart.show(now, still=True)

    def _pick(self, *, free: bool) -> None:
        self._free = free
        self._picked()


def expected_over(curves: Curves, verdict: LiveVerdict) -> Envelope | None:
    """What is expected of the errors since the anchor; None where nothing is."""
    if not verdict.expected:
        return None
    ages, *columns = np.array(verdict.expected).T
    return Envelope(curves.errors.t, *(np.interp(curves.age, ages, column) for column in columns))
