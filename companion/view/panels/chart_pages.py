"""The charts beside the picture: those of a replay, a page of them at a time, and those of a live page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import zip_longest

import numpy as np

from companion.analysis import LiveVerdict
from companion.model import Flight
from companion.present import Rgb, palette
from companion.view.panels.chart import Chart, Drawing, LogChart, LogDrawing
from companion.view.panels.controls import Controls
from companion.view.panels.drawings import NOISE_TITLES, NOTHING, PAGES, errors_over_time
from companion.view.panels.markup import block
from companion.view.state.live import Curves
from companion.view.state.trajectory import DisplayTrajectory, Envelope, Sample

CHARTS = 3
_ZOOM = "Drag over a chart to zoom in, double-click to see all of it again"


class ChartPages:
    """Only the view thread may call it."""

    def __init__(self, controls: Controls) -> None:
        gui = controls.gui
        page = gui.add_dropdown("Charts", tuple(PAGES), hint=_ZOOM)
        controls.on_change(page, self.pick)
        self._charts = [Chart(gui) for _ in range(CHARTS)]
        self._log_charts = [LogChart(gui) for _ in NOISE_TITLES]
        self.charts: list[Chart | LogChart] = [*self._charts, *self._log_charts]
        self._hint = gui.add_html("", visible=False)
        self._shown, self._now = next(iter(PAGES)), 0.0

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
        if page in PAGES:
            self._shown = page
            self._draw()

    def show(self, sample: Sample) -> None:
        """Move the line to `sample`."""
        still, self._now = sample.t == self._now, sample.t
        for chart in self._charts:
            chart.show(sample.t, still=still)

    def _draw(self) -> None:
        drawn = PAGES[self._shown](self._display, self._flight, self._colours)
        for chart, drawing in zip_longest(self._charts, (one for one in drawn if isinstance(one, Drawing))):
            chart.draw(drawing, self.part)
        for log_chart, log in zip_longest(self._log_charts, (one for one in drawn if isinstance(one, LogDrawing))):
            log_chart.draw(log)
        self._hint.visible = not drawn
        why = "Analysis in progress." if self._display.result is None else NOTHING.get(self._shown, "")
        self._hint.content = block(why)


SPANS = (30.0, 60.0, 120.0, 300.0, 600.0, 1800.0, 3600.0)
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
        self.charts = [Chart(controls.gui, time="s before now") for _ in range(CHARTS)]

    def show(self, curves: Curves, now: float, verdict: LiveVerdict) -> None:
        """Draw the errors and what is expected of them since the anchor, with the line at `now` (s, 0 or less)."""
        errors, known = (curves.free, curves.free_known) if self._free else (curves.errors, curves.known)
        span = next((s for s in SPANS if s >= min(-float(errors.t[0]), self._window)), self._window)
        drawings = errors_over_time(
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
