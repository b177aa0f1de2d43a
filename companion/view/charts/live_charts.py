"""The charts of a live page: the last minutes, against seconds before now, so that they scroll and keep their zoom."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from companion.model import Array
from companion.present import palette
from companion.view.charts.chart import DASHED, DOTTED, STYLE, Chart, Drawing, Line
from companion.view.panels.controls import Controls
from companion.view.state.feed import Judgement
from companion.view.state.history import Curves

SPANS = (30.0, 60.0, 120.0, 300.0, 600.0, 1800.0, 3600.0)
"""s. A new flight begins with short charts: a change of span builds them anew, and forgets how the user has zoomed."""


class LiveCharts:
    """Errors since the last anchor, or those of the free run. Only the view thread may call it."""

    def __init__(self, controls: Controls, window_s: float, picked: Callable[[], object]) -> None:
        """picked: called when others are to be drawn."""
        runs = {"Since anchor": lambda: self._pick(free=False), "Free run": lambda: self._pick(free=True)}
        controls.row("Show", runs, "Drag over a chart to zoom in, double-click to see all of it again")
        controls.gui.add_html(STYLE)
        self._window, self._picked = window_s, picked
        self._charts = [Chart(controls.gui, time="s before now") for _ in range(3)]
        self._free = False

    def _pick(self, *, free: bool) -> None:
        """Show the free run, or the errors since the last anchor."""
        self._free = free
        self._picked()

    def show(self, curves: Curves, now: float, judgement: Judgement) -> None:
        """Draw the errors and what is expected of them since the anchor, with the line at `now` (s, 0 or less)."""
        t, known = curves.t, curves.known.astype(np.float64)
        tilt, heading, velocity, position = curves.errors.T
        if self._free:
            there = np.asarray(np.isfinite(curves.free).all(axis=1))
            tilt, heading, velocity, position = np.where(there[:, None], curves.free, 0.0).T
            known = known * there
        colour = palette.FREE if self._free else palette.IMU
        duration = -float(t[0])
        span = next((s for s in SPANS if s >= min(duration, self._window)), self._window)
        nothing: tuple[Line, ...] = ()
        bands = () if self._free else expected_lines(curves, judgement)
        of_attitude, of_velocity, of_position = bands or (nothing, nothing, nothing)
        lines = (Line("tilt", colour, t, tilt), Line("heading", colour, t, heading, dash=DASHED), *of_attitude)
        drawings = [
            Drawing("Attitude error, °", "deg", lines, (t, known)),
            Drawing("Velocity error, m/s", "m/s", (Line("apart", colour, t, velocity), *of_velocity), (t, known)),
            Drawing("Position error, m", "m", (Line("apart", colour, t, position), *of_position), (t, known)),
        ]
        for i, (chart, drawing) in enumerate(zip(self._charts, drawings, strict=True)):
            shown = i == 0 or curves.has_position
            chart.draw(drawing if shown else None, (-min(span, self._window), 0.0))
            chart.show(now, still=True)

    def relayout(self) -> None:
        """Make every browser lay its charts out again; see Chart.relayout."""
        for chart in self._charts:
            chart.relayout()


def expected_lines(curves: Curves, judgement: Judgement) -> tuple[tuple[Line, ...], ...]:
    """1σ and 3σ of the errors since the anchor: attitude, velocity, position. Empty where nothing is expected."""
    if not judgement.expected:
        return ()
    ages, *columns = np.array(judgement.expected).T
    return tuple(_band(curves.t, np.interp(curves.age, ages, column)) for column in columns)


def _band(t: Array, sigma: Array) -> tuple[Line, ...]:
    return (
        Line("1σ", palette.CURSOR, t, sigma, 1.2, DASHED, said=False, fill=0.16),
        Line("3σ", palette.CURSOR, t, 3 * sigma, 1.2, DOTTED, said=False, fill=0.12),
    )
