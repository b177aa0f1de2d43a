"""Drift against horizon, both logarithmic: measured and expected."""

from __future__ import annotations

import numpy as np
import viser
from viser import uplot

from companion.analysis import Assessment
from companion.tracks import Array
from companion.view import palette
from companion.view.chart import DASHED, DOTTED, Dash, heading, series
from companion.view.palette import Rgb

HEIGHT = 190  # pixels
LEAST = 1e-6  # of any unit: what a logarithm can show
QUANTITIES = {
    "Attitude, ° after so many s": "attitude_deg",
    "Velocity, m/s": "velocity_mps",
    "Position, m": "position_m",
}


class DriftCharts:
    """A chart for each quantity. Only the view thread may call it."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._shown = False
        self._headings, self._charts = [], []
        for title in QUANTITIES:
            self._headings.append(gui.add_html(heading(title, ""), visible=False))
            nothing = tuple(np.array([1.0, 10.0]) for _ in range(6))
            self._charts.append(
                gui.add_uplot(
                    nothing,
                    _series(palette.IMU),
                    scales={"x": _logarithmic(), "y": _logarithmic()},
                    axes=(uplot.Axis(size=30), uplot.Axis(size=54)),
                    legend=uplot.Legend(show=True, live=True),
                    cursor=uplot.Cursor(drag={"x": False, "y": False}),
                    height=HEIGHT,
                    padding=(8, 14, 0, 0),
                    visible=False,
                )
            )
        self._filled = [False] * len(self._charts)

    def load(self, found: Assessment | None, colour: Rgb) -> None:
        """Draw the drift table of an assessment, in the colour of its IMU; None: nothing is known yet."""
        for i, (name, chart) in enumerate(zip(QUANTITIES.values(), self._charts, strict=True)):
            data = None if found is None else drift_lines(found, name)
            self._filled[i] = data is not None
            if data is not None:
                chart.series, chart.data = _series(colour), (*data, data[-1])
        self.pick(shown=self._shown)

    def pick(self, *, shown: bool) -> None:
        """Show those that have something to show, or none."""
        self._shown = shown
        for above, chart, filled in zip(self._headings, self._charts, self._filled, strict=True):
            above.visible = chart.visible = shown and filled

    def relayout(self) -> None:
        """See Chart.relayout."""
        for chart in self._charts:
            chart.height = HEIGHT + 1 if chart.height == HEIGHT else HEIGHT


def drift_lines(found: Assessment, quantity: str) -> tuple[Array, ...] | None:
    """Horizons, median, 95 %, expected 1σ and 3σ of a quantity of the drift table; None with fewer than two rows."""
    rows: list[tuple[float, ...]] = []
    for row, expected in zip(found.drift.rows, found.expected, strict=True):
        measured, sigma = getattr(row, quantity), getattr(expected, quantity, None)
        if measured is not None and sigma is not None:
            rows.append((row.horizon_s, measured.median, measured.p95, sigma, 3 * sigma))
    if len(rows) < 2:
        return None
    return tuple(np.maximum(column, LEAST) for column in np.array(sorted(rows)).T)


def _logarithmic() -> uplot.Scale:
    return uplot.Scale(time=False, distr=3, log=10)


def _series(colour: Rgb) -> tuple[uplot.Series, ...]:
    lines: tuple[tuple[str, Rgb, float, Dash | None], ...] = (
        ("median", colour, 2.2, None),
        ("95 %", colour, 1.2, None),
        ("expected 1σ", palette.CURSOR, 1.4, DASHED),
        ("3σ", palette.CURSOR, 1.4, DOTTED),
    )
    hidden = uplot.Series(label="", show=False)  # the style of the charts over time hides the last entry of a legend
    return (uplot.Series(label="after, s"), *(series(*line, points=True) for line in lines), hidden)
