"""The charts beside the picture, a page of them at a time."""

from __future__ import annotations

from collections.abc import Mapping

from companion.model import Flight
from companion.present import Rgb, palette
from companion.view.charts.chart import STYLE, Chart, Drawing
from companion.view.charts.flight_charts import error_drawings, horizon_drawings, rate_drawings, reading_drawings
from companion.view.charts.log_charts import (
    DRIFT_QUANTITIES,
    NOISE_STYLES,
    NOISE_TITLES,
    LogCharts,
    drift_lines,
    drift_styles,
    noise_lines,
)
from companion.view.panels.controls import Controls
from companion.view.state.sample import Footage, Sample

PAGES = (
    "Errors since the anchor",
    "Errors over the horizon",
    "IMU readings",
    "IMU noise",
    "Drift by horizon",
    "Rates and gaps",
)
ERRORS, HORIZON, READINGS, NOISE, DRIFT, RATES = PAGES
CHARTS = 3
_NOTHING = {
    HORIZON: "No window of this length can be used.",
    NOISE: "Neither a rest of 10 s nor a stretch without gaps that is long enough for a spectrum.",
}


class ChartPages:
    """Only the view thread may call it."""

    def __init__(self, controls: Controls) -> None:
        gui = controls.gui
        page = gui.add_dropdown(
            "Charts", PAGES, hint="Drag over a chart to zoom in, double-click to see all of it again"
        )
        controls.on_change(page, self.pick)
        gui.add_html(STYLE)
        self._charts = [Chart(gui) for _ in range(CHARTS)]
        self._drift = LogCharts(gui, tuple(DRIFT_QUANTITIES), "after, s", drift_styles(palette.IMU), points=True)
        self._noise = LogCharts(gui, NOISE_TITLES, "Hz or s", NOISE_STYLES)
        self._hint = gui.add_html("", visible=False)
        self._film: Footage | None = None
        self._flight: Flight | None = None
        self._colours: Mapping[str, Rgb] = {}
        self._part = (0.0, 1.0)
        self._shown, self._now = ERRORS, 0.0

    def load(self, film: Footage, flight: Flight, colours: Mapping[str, Rgb], part: tuple[float, float]) -> None:
        """Draw another reckoning, between two times (s, boot clock)."""
        self._film, self._flight, self._colours, self._part = film, flight, colours, part
        insight = film.insight
        assessment = insight.assessment if insight else None
        drifts = [None if assessment is None else drift_lines(assessment, name) for name in DRIFT_QUANTITIES.values()]
        self._drift.draw(drifts, drift_styles(colours.get(film.source, palette.IMU)))
        self._noise.draw(noise_lines(insight.noise if insight else None), NOISE_STYLES)
        self._draw()

    def choose_part(self, part: tuple[float, float]) -> None:
        """Show what lies between two times (s, boot clock), thinned anew: the shorter, the finer."""
        self._part = part
        self._draw()

    def pick(self, page: str) -> None:
        """Show another page of charts."""
        if page in PAGES:
            self._shown = page
            self._draw()

    def relayout(self) -> None:
        """Make every browser lay its charts out again; see Chart.relayout."""
        for chart in self._charts:
            chart.relayout()
        self._drift.relayout()
        self._noise.relayout()

    def show(self, sample: Sample) -> None:
        """Move the line to `sample`."""
        still, self._now = sample.t == self._now, sample.t
        for chart in self._charts:
            chart.show(sample.t, still=still)

    def _draw(self) -> None:
        if self._film is None or self._flight is None:
            return
        drawings = self._drawings(self._film, self._flight)
        for i, chart in enumerate(self._charts):
            chart.draw(drawings[i] if i < len(drawings) else None, self._part)
        self._drift.pick(shown=self._shown == DRIFT)
        self._noise.pick(shown=self._shown == NOISE)
        insight = self._film.insight
        waiting = self._shown in (HORIZON, NOISE, DRIFT) and insight is None
        silent = self._shown == NOISE and insight is not None and insight.noise is None
        empty = silent or (self._shown == HORIZON and not drawings)
        self._hint.visible = waiting or empty
        said = "The analysis is still at work." if waiting else _NOTHING.get(self._shown, "")
        self._hint.content = f'<div style="padding:0.5em 1em;font-size:0.8em">{said}</div>'

    def _drawings(self, film: Footage, flight: Flight) -> list[Drawing]:
        if self._shown == ERRORS:
            return error_drawings(film, self._colours)
        if self._shown == HORIZON:
            return horizon_drawings(film, self._colours)
        if self._shown == READINGS:
            return reading_drawings(film, flight)
        return rate_drawings(flight, self._colours) if self._shown == RATES else []
