"""Charts with two logarithmic axes, one over the other: drift against horizon, and noise at rest and in flight."""

from __future__ import annotations

from collections.abc import Sequence

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


class LogCharts:
    """A chart for each title. Only the view thread may call it."""

    def __init__(
        self, gui: viser.GuiApi, titles: Sequence[str], x: str, styles: Sequence[LineStyle], *, points: bool = False
    ) -> None:
        """x: what the first column is; styles: of the other columns; points: whether each value is marked."""
        self._x, self._points, self._shown = x, points, False
        self._headings, self._charts = [], []
        for title in titles:
            legend = legend_style([dash for *_, dash in styles])
            self._headings.append(gui.add_html(legend + heading(title, ""), visible=False))
            nothing = tuple(np.array([1.0, 10.0]) for _ in range(len(styles) + 2))
            self._charts.append(
                gui.add_uplot(
                    nothing,
                    self._series(styles),
                    scales={"x": _logarithmic(), "y": _logarithmic()},
                    axes=(uplot.Axis(size=30), uplot.Axis(size=62)),
                    legend=uplot.Legend(show=True, live=True),
                    cursor=uplot.Cursor(drag={"x": False, "y": False}),
                    height=HEIGHT,
                    padding=(8, 14, 0, 0),
                    visible=False,
                )
            )
        self._filled = [False] * len(self._charts)

    def draw(self, columns: Sequence[tuple[Array, ...] | None], styles: Sequence[LineStyle]) -> None:
        """Draw other columns (x and a line for each style), each (N,); None for a chart with nothing to show."""
        for i, (chart, data) in enumerate(zip(self._charts, columns, strict=True)):
            self._filled[i] = data is not None
            if data is not None:
                shown = [np.maximum(column, LEAST) for column in data]
                chart.series, chart.data = self._series(styles), (*shown, shown[-1])
        self.pick(shown=self._shown)

    def pick(self, *, shown: bool) -> None:
        """Show those that have something to show, or none."""
        self._shown = shown
        for above, chart, filled in zip(self._headings, self._charts, self._filled, strict=True):
            above.visible = chart.visible = shown and filled

    def relayout(self) -> None:
        """See Chart.relayout."""
        for chart in self._charts:
            relayout(chart, HEIGHT)

    def _series(self, styles: Sequence[LineStyle]) -> tuple[uplot.Series, ...]:
        hidden = uplot.Series(label="", show=False)  # the style of charts over time hides a legend's last entry
        lines = (series(*style, points=self._points) for style in styles)
        return (uplot.Series(label=self._x), *lines, hidden)


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


def drift_styles(colour: Rgb) -> tuple[LineStyle, ...]:
    """The lines of `drift_lines`, in the colour of the IMU."""
    return (
        ("median", colour, 2.2, None),
        ("95 %", colour, 1.2, None),
        ("expected 1σ", palette.CURSOR, 1.4, DASHED),
        ("3σ", palette.CURSOR, 1.4, DOTTED),
    )


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
    gyro, accel = noise.figures.gyro.noise_density, noise.figures.accel.noise_density
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
