"""The charts of a live page: the last minutes, against seconds before now, so that they scroll and keep their zoom."""

from __future__ import annotations

import numpy as np
import viser

from companion.tracks import Array
from companion.view import events, palette
from companion.view.chart import STYLE, Chart, Drawing
from companion.view.controls import button_row
from companion.view.history import Past

SPANS = (30.0, 60.0, 120.0, 300.0, 600.0, 1800.0, 3600.0)
"""s. A new flight begins with short charts: a change of span builds them anew, and forgets how the user has zoomed."""


class LiveCharts:
    """Errors since the last anchor, or those of the free run. Only the view thread may call it."""

    def __init__(self, gui: viser.GuiApi, window_s: float, post: events.Post) -> None:
        shown = {"Since anchor": events.PickRun(free=False), "Free run": events.PickRun(free=True)}
        button_row(gui, "Show", shown, post, "Drag over a chart to zoom in, double-click to see all of it again")
        gui.add_html(STYLE)
        self._window = window_s
        time = "s before now"
        self._charts = [
            Chart(
                gui,
                "Attitude error, °",
                "deg",
                [("tilt", palette.DIFFERENCE), ("heading", palette.HEADING)],
                time=time,
            ),
            Chart(gui, "Velocity error, m/s", "m/s", [("apart", palette.DIFFERENCE)], time=time),
            Chart(gui, "Position error, m", "m", [("apart", palette.DIFFERENCE)], time=time),
        ]
        self._free = False

    def pick(self, *, free: bool) -> None:
        """Show the free run, or the errors since the last anchor."""
        self._free = free

    def show(self, past: Past, now: float) -> None:
        """Draw the past, with the line at `now` (s, 0 or less)."""
        film = past.film
        known = film.replay.reference_valid.astype(np.float64)
        values: list[tuple[Array, ...]] = [(film.tilt_deg, film.heading_deg), (film.velocity_mps,), (film.position_m,)]
        if self._free:
            there = np.asarray(np.isfinite(past.free).all(axis=1))
            free = np.where(there[:, None], past.free, 0.0)
            known = known * there
            values = [(free[:, 0], free[:, 1]), (free[:, 2],), (free[:, 3],)]
        duration = -float(film.replay.t[0])
        span = next((s for s in SPANS if s >= min(duration, self._window)), self._window)
        at = int(np.clip(np.searchsorted(film.replay.t, now + 1e-6) - 1, 0, len(known) - 1))
        for i, (chart, columns) in enumerate(zip(self._charts, values, strict=True)):
            chart.set_visible(i == 0 or film.replay.has_position)
            chart.load(Drawing(film.replay.t, columns, known), (-min(span, self._window), 0.0))
            chart.show(now, tuple(float(column[at]) for column in columns))

    def relayout(self) -> None:
        """Make every browser lay its charts out again; see Chart.relayout."""
        for chart in self._charts:
            chart.relayout()
