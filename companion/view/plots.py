"""Errors against time, as small charts with a line at the current instant."""

from __future__ import annotations

import math
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

HEIGHT = 182  # of a chart, pixels


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

    def __init__(self, gui: viser.GuiApi, film: Footage, start: float) -> None:
        tilt, heading = ("tilt", palette.DIFFERENCE), ("heading", palette.HEADING)
        drawn = _drawn(film, start)
        _heading(gui, f"Attitude error, degrees: {_key(*tilt)} {_key(*heading)}")
        self._charts = [_chart(gui, "deg", drawn[0], tilt, heading)]
        self._headings = []
        for name, unit, lines in (
            ("Velocity error, metres per second", "m/s", drawn[1]),
            ("Position error, metres", "m", drawn[2]),
        ):
            self._headings.append(_heading(gui, name))
            self._charts.append(_chart(gui, unit, lines, (name, palette.DIFFERENCE)))
        self._drawn, self._now = drawn, math.nan
        self.load(film, start)

    def load(self, film: Footage, start: float) -> None:
        """Draw another reckoning, over seconds since `start` (boot clock)."""
        self._drawn = _drawn(film, start)
        self._now = math.nan  # equal to nothing: the next cursor is sent
        for chart, lines in zip(self._charts, self._drawn, strict=True):
            scales = _scales(lines)
            if chart.scales != scales:  # a change builds the chart anew and forgets how the user has zoomed
                chart.scales = scales
        for heading, chart in zip(self._headings, self._charts[1:], strict=True):
            heading.visible = chart.visible = film.replay.has_position

    def relayout(self) -> None:
        """Make every browser lay its charts out again, by a pixel of height.

        A page whose first width and next data come in one breath shows no time axis: uplot-react 1.2 calls setSize,
        then setData and redraw(), and redraw forgets that the axes were to be laid out again. A new size that comes
        alone mends it, and keeps the user's zoom.
        """
        for chart in self._charts:
            chart.height = HEIGHT + 1 if chart.height == HEIGHT else HEIGHT

    def show(self, now: float) -> None:
        """Move the cursor to `now`, s since the flight's start. A cursor that stands still costs nothing."""
        if now == self._now:
            return
        self._now = now
        for chart, lines in zip(self._charts, self._drawn, strict=True):
            if chart.visible:
                chart.data = lines.at(now)


def _drawn(film: Footage, start: float) -> list[Curves]:
    t = film.replay.t - start
    return [
        curves(t, film.tilt_deg, film.heading_deg),
        curves(t, film.velocity_mps),
        curves(t, film.position_m),
    ]


def _scales(lines: Curves) -> dict[str, uplot.Scale]:
    # The bounds said outright, so that the cursor's points never move them and a zoom stays where it is.
    return {
        "x": uplot.Scale(time=False, range=(float(lines.t[0]), float(lines.t[-1]))),
        "now": uplot.Scale(range=(0.0, 1.0)),
    }


def _heading(gui: viser.GuiApi, markup: str) -> viser.GuiHtmlHandle:
    return gui.add_html(f'<div style="padding:0 1em;font-size:0.8em">{markup}</div>')


def _key(name: str, colour: Rgb) -> str:
    return f'<span style="color:{palette.css(colour)};font-weight:600">{name}</span>'


def _chart(gui: viser.GuiApi, unit: str, drawn: Curves, *lines: tuple[str, Rgb]) -> viser.GuiUplotHandle:
    series = (
        uplot.Series(label="time, s"),
        *(
            uplot.Series(label=name, stroke=palette.css(colour), width=1.6, points={"show": False})
            for name, colour in lines
        ),
        uplot.Series(label="now", scale="now", stroke=palette.css(palette.CURSOR), width=1.2, points={"show": False}),
    )
    return gui.add_uplot(
        drawn.at(float(drawn.t[0])),
        series,
        scales=_scales(drawn),
        axes=(
            uplot.Axis(label="time, s", labelSize=16, size=30, labelGap=0),
            uplot.Axis(label=unit, labelSize=16, size=44, labelGap=0),
        ),
        legend=uplot.Legend(show=False),
        cursor=uplot.Cursor(sync={"key": "time"}, drag={"x": True, "y": False}),
        height=HEIGHT,
        padding=(6, 14, 0, 0),
    )
