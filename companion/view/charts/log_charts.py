"""Charts with two logarithmic axes, one over the other: the same lines in each."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import viser
from viser import uplot

from companion.model import Array
from companion.present import Rgb
from companion.view.charts.chart import Dash, heading, legend_style, series

HEIGHT = 190  # pixels
LEAST = 1e-12  # of any unit: what a logarithm can show

_charts = itertools.count()

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
            legend = legend_style(f"companion-log-chart-{next(_charts)}", [dash for *_, dash in styles])
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
            chart.height = HEIGHT + 1 if chart.height == HEIGHT else HEIGHT

    def _series(self, styles: Sequence[LineStyle]) -> tuple[uplot.Series, ...]:
        hidden = uplot.Series(label="", show=False)  # the style of charts over time hides a legend's last entry
        lines = (series(*style, points=self._points) for style in styles)
        return (uplot.Series(label=self._x), *lines, hidden)


def _logarithmic() -> uplot.Scale:
    return uplot.Scale(time=False, distr=3, log=10)
