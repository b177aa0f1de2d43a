"""Charts with two logarithmic axes, one over the other: drift against horizon, and noise at rest and in flight."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import viser
from viser import uplot

from companion.analysis import Assessment, AxisNoise, ImuNoise
from companion.estimation import AllanDeviation
from companion.model import STANDARD_GRAVITY, Array
from companion.present import AXES, Rgb, palette
from companion.view.charts.chart import DASHED, DOTTED, Dash, heading, legend_style, relayout, series

HEIGHT = 190  # pixels
LEAST = 1e-12  # of any unit: what a logarithm can show

LineStyle = tuple[str, Rgb, float, Dash | None]
"""Name, colour, width in pixels, dash."""


class LogDrawing(NamedTuple):
    """What one chart is to show."""

    title: str
    x: str  # what the first column is
    styles: tuple[LineStyle, ...]  # of the other columns
    columns: tuple[Array, ...]  # each (N,)
    points: bool = False  # whether each value is marked


class LogChart:
    """Only the view thread may call it."""

    def __init__(self, gui: viser.GuiApi) -> None:
        nothing = np.array([1.0, 10.0])
        self._heading = gui.add_html("", visible=False)
        self._chart = gui.add_uplot(
            (nothing, nothing),
            (uplot.Series(label=""), _HIDDEN),
            scales={"x": _logarithmic(), "y": _logarithmic()},
            axes=(uplot.Axis(size=30), uplot.Axis(size=62)),
            legend=uplot.Legend(show=True, live=True),
            cursor=uplot.Cursor(drag={"x": False, "y": False}),
            height=HEIGHT,
            padding=(8, 14, 0, 0),
            visible=False,
        )

    def draw(self, drawing: LogDrawing | None) -> None:
        """Draw something else; None: nothing."""
        if drawing is not None:
            legend = legend_style([dash for *_, dash in drawing.styles])
            self._heading.content = legend + heading(drawing.title, "")
            lines = (series(*style, points=drawing.points) for style in drawing.styles)
            shown = [np.maximum(column, LEAST) for column in drawing.columns]
            self._chart.series = (uplot.Series(label=drawing.x), *lines, _HIDDEN)
            self._chart.data = (*shown, shown[-1])
        self._heading.visible = self._chart.visible = drawing is not None

    def relayout(self) -> None:
        """See `relayout`."""
        relayout(self._chart, HEIGHT)


_HIDDEN = uplot.Series(label="", show=False)  # the style of charts over time hides a legend's last entry


def _logarithmic() -> uplot.Scale:
    return uplot.Scale(time=False, distr=3, log=10)


LEAST_DRIFT = 1e-6  # of any unit that is shown
DRIFT_QUANTITIES = {
    "Attitude, ° after so many s": "attitude_deg",
    "Velocity, m/s": "velocity_mps",
    "Position, m": "position_m",
}


def drift_lines(assessment: Assessment, quantity: str) -> tuple[Array, ...] | None:
    """Horizons, median, 95 %, expected 1σ and 3σ of a quantity of the drift table; None with fewer than two rows."""
    rows: list[tuple[float, ...]] = []
    for row, expected in zip(assessment.drift.rows, assessment.expected, strict=True):
        measured, sigma = getattr(row, quantity), getattr(expected, quantity, None)
        if measured is not None and sigma is not None:
            rows.append((row.horizon_s, measured.median, measured.p95, sigma, 3 * sigma))
    if len(rows) < 2:
        return None
    return tuple(np.maximum(column, LEAST_DRIFT) for column in np.array(sorted(rows)).T)


def drift_drawings(assessment: Assessment, colour: Rgb) -> list[LogDrawing]:
    """The drift table, in the colour of the IMU."""
    styles: tuple[LineStyle, ...] = (
        ("median", colour, 2.2, None),
        ("95 %", colour, 1.2, None),
        ("expected 1σ", palette.CURSOR, 1.4, DASHED),
        ("3σ", palette.CURSOR, 1.4, DOTTED),
    )
    charts = ((title, drift_lines(assessment, quantity)) for title, quantity in DRIFT_QUANTITIES.items())
    return [LogDrawing(title, "after, s", styles, lines, points=True) for title, lines in charts if lines is not None]


NOISE_TITLES = (
    "Gyro in flight, mdps/√Hz over Hz",
    "Accelerometer in flight, µg/√Hz over Hz",
    "Gyro at rest, Allan deviation, mdps over s",
    "Accelerometer at rest, Allan deviation, µg over s",
)
NOISE_STYLES: tuple[LineStyle, ...] = (
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
        return [None] * len(NOISE_TITLES)
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


def noise_drawings(noise: ImuNoise | None) -> list[LogDrawing]:
    """Spectra in flight and Allan deviations at rest, as far as there are any."""
    charts = zip(NOISE_TITLES, noise_lines(noise), strict=True)
    return [LogDrawing(title, "Hz or s", NOISE_STYLES, lines) for title, lines in charts if lines is not None]
