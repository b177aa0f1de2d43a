"""Errors against time, as small charts with a line at the current instant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import viser
from viser import uplot

from companion.tracks import Array
from companion.view import palette
from companion.view.moment import Footage
from companion.view.palette import Rgb
from companion.view.thin import extremes

MOST_POINTS = 300
"""Points a chart: a moving cursor resends them all, 5 times a second, to every browser."""


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """What one chart draws: thinned, finite, over seconds since the flight's start."""

    t: Array  # (M,) s
    values: tuple[Array, ...]  # each (M,)

    def at(self, now: float) -> tuple[Array, ...]:
        """The chart's columns: times, values, and a last one that leaps from -1 to 2 and back at `now`.

        On a scale of 0 to 1 that leap is a vertical line from edge to edge and its base lies out of sight. A gap of
        NaN would do as well, but then a number that is not finite would be on its way to the screen.
        """
        k = int(np.searchsorted(self.t, now))
        inserted = (np.insert(v, k, [np.interp(now, self.t, v)] * 3) for v in self.values)
        cursor = np.full(len(self.t) + 3, -1.0)
        cursor[k + 1] = 2.0
        return (np.insert(self.t, k, [now] * 3), *inserted, cursor)


def curves(t: Array, *values: Array) -> Curves:
    """Thin `values` over `t` to what a chart can draw, keeping every peak."""
    kept = extremes(values, MOST_POINTS)
    return Curves(t[kept], tuple(v[kept] for v in values))


class Plots:
    """The three charts: attitude, velocity and position error. Only the view thread may call it."""

    def __init__(self, gui: viser.GuiApi) -> None:
        gui.add_html(
            f'<div style="padding:0 1em;font-size:0.8em">Attitude error, degrees: '
            f"{_key('tilt', palette.DIFFERENCE)} {_key('heading', palette.HEADING)}</div>"
        )
        self._attitude = _chart(gui, "deg", ("tilt", palette.DIFFERENCE), ("heading", palette.HEADING))
        velocity = gui.add_html('<div style="padding:0 1em;font-size:0.8em">Velocity error, metres per second</div>')
        self._velocity = _chart(gui, "m/s", ("velocity error", palette.DIFFERENCE))
        position = gui.add_html('<div style="padding:0 1em;font-size:0.8em">Position error, metres</div>')
        self._position = _chart(gui, "m", ("position error", palette.DIFFERENCE))
        self._headings = (velocity, position)
        self._curves: list[tuple[viser.GuiUplotHandle, Curves]] = []

    def load(self, film: Footage, start: float) -> None:
        """Draw another reckoning, over seconds since `start` (boot clock)."""
        t = film.replay.t - start
        self._curves = [(self._attitude, curves(t, film.tilt_deg, film.heading_deg))]
        if film.replay.has_position:
            self._curves.append((self._velocity, curves(t, film.velocity_mps)))
            self._curves.append((self._position, curves(t, film.position_m)))
        for chart in (self._velocity, self._position):
            chart.visible = film.replay.has_position
        for heading in self._headings:
            heading.visible = film.replay.has_position

    def show(self, now: float) -> None:
        """Move the cursor to `now`, s since the flight's start."""
        for chart, lines in self._curves:
            chart.data = lines.at(now)


def _key(name: str, colour: Rgb) -> str:
    return f'<span style="color:{palette.css(colour)};font-weight:600">{name}</span>'


def _chart(gui: viser.GuiApi, unit: str, *lines: tuple[str, Rgb]) -> viser.GuiUplotHandle:
    series = (
        uplot.Series(label="time, s"),
        *(
            uplot.Series(label=name, stroke=palette.css(colour), width=1.6, points={"show": False})
            for name, colour in lines
        ),
        uplot.Series(label="now", scale="now", stroke=palette.css(palette.CURSOR), width=1.2, points={"show": False}),
    )
    return gui.add_uplot(
        tuple(np.array([0.0, 1.0]) for _ in series),
        series,
        scales={"x": uplot.Scale(time=False), "now": uplot.Scale(range=(0.0, 1.0))},
        axes=(
            uplot.Axis(label="seconds since start", labelSize=18, size=26, labelGap=0),
            uplot.Axis(label=unit, labelSize=18, size=46, labelGap=0),
        ),
        legend=uplot.Legend(show=False),
        cursor=uplot.Cursor(sync={"key": "time"}, drag={"x": True, "y": False}),
        height=170,
        padding=(6, 14, 0, 0),
    )
