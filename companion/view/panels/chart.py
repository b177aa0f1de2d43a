"""The charts: over time with a line at the current instant, whose values stand in the title; on logarithmic axes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import NamedTuple

import numpy as np
import viser
from viser import uplot

from companion.model import Array
from companion.present import Rgb, palette
from companion.view.state.sending import Indices, extremes

HEIGHT, LOG_HEIGHT = 152, 190  # pixels, even: see `relayout`
LEAST = 1e-12  # of any unit: what a logarithm can show
SHARPNESS = 600  # the line at the instant is moved when it would be so small a part of the chart off
PATIENCE = 4  # ... or when so many instants have gone by: a chart that someone has zoomed shows smaller steps
Dash = tuple[float, ...]
DASHED: Dash = (5.0, 4.0)
DOTTED: Dash = (2.0, 4.0)
_BORDERS = {DASHED: "dashed", DOTTED: "dotted"}
_charts = itertools.count()
_HIDDEN = uplot.Series(label="", show=False)  # the style of charts over time hides a legend's last entry


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """One line of a chart."""

    name: str
    colour: Rgb
    t: Array  # (N,) s, boot clock
    values: Array  # (N,)
    width: float = 1.6  # pixels
    dash: Dash | None = None
    in_title: bool = True  # whether its value stands in the title
    fill: float = 0.0  # opacity of the area between it and zero

    @property
    def style(self) -> tuple[str, Rgb, float, Dash | None, float]:
        """What does not depend on the data."""
        return self.name, self.colour, self.width, self.dash, self.fill


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """What one chart is to show."""

    title: str
    unit: str
    lines: tuple[Line, ...]
    known: tuple[Array, Array] | None = None  # times, and 0 where the autopilot's state is not known


class Chart:
    """Only the view thread may call it."""

    def __init__(self, gui: viser.GuiApi, *, time: str = "s since boot") -> None:
        self._time = time
        self._heading = gui.add_html("", visible=False)
        self._legend, t, nothing = "", np.array([0.0, 1.0]), np.zeros(2)
        self._drawing = Drawing("", "", (Line("", palette.CURSOR, t, nothing, 1.0),))  # the last one
        self._drawn = Curves(t, (nothing,), nothing)
        self._part, self._at, self._passed, self._still = (0.0, 1.0), math.nan, 0, True
        self.handle = gui.add_uplot(
            self._drawn.at(0.0),
            self._series(),
            scales=_scales(self._part),
            axes=_axes(""),
            legend=uplot.Legend(show=True, live=True),
            cursor=uplot.Cursor(sync={"key": "time"}, drag={"x": True, "y": False}),
            height=HEIGHT,
            padding=(6, 14, 0, 0),
            visible=False,
        )

    def draw(self, drawing: Drawing | None, part: tuple[float, float]) -> None:
        """Draw something else, between two times (s, boot clock); None: nothing."""
        self._heading.visible = self.handle.visible = drawing is not None
        if drawing is None:
            return
        before, self._drawing, self._part = self._drawing, drawing, part
        self._drawn = curves([(line.t, line.values) for line in drawing.lines], drawing.known, part)
        if drawing.unit != before.unit:
            self.handle.axes = _axes(drawing.unit)
        if [line.style for line in drawing.lines] != [line.style for line in before.lines]:
            self._legend = legend_style([line.dash for line in drawing.lines])
            # Series and data have to change together, or the chart has lines without points.
            self.handle.series, self.handle.data = self._series(), self._drawn.at(part[0])
        scales = _scales(part)
        if self.handle.scales != scales:  # a change builds the chart anew and forgets how the user has zoomed
            self.handle.scales = scales
        if drawing.title != before.title:
            self._heading.content = self._legend + heading(drawing.title, "")
        self._at = math.nan  # equal to nothing: the next line is sent

    def show(self, now: float, *, still: bool) -> None:
        """Write the values at `now`, s, boot clock, and move the line there.

        Moving it sends the whole chart: while the instant is not `still`, only when the eye would see it.
        """
        if not self.handle.visible or (now == self._at and still == self._still):
            return
        self._still = still
        self._passed += 1
        if still or self._passed >= PATIENCE or not abs(now - self._at) < (self._part[1] - self._part[0]) / SHARPNESS:
            self._at, self._passed = now, 0
            self.handle.data = self._drawn.at(now)
        values = "".join(_key(line, now if still else None) for line in self._drawing.lines if line.in_title)
        self._heading.content = self._legend + heading(self._drawing.title, values)

    def _series(self) -> tuple[uplot.Series, ...]:
        now = series("now", palette.CURSOR, 1.2, None, 0.22)
        now["scale"] = "now"
        return (uplot.Series(label=self._time), *(series(*line.style) for line in self._drawing.lines), now)


LineStyle = tuple[str, Rgb, float, Dash | None]
"""Name, colour, width in pixels, dash."""


class LogDrawing(NamedTuple):
    """What one chart on logarithmic axes is to show."""

    title: str
    x: str  # what the first column is
    styles: tuple[LineStyle, ...]  # of the other columns
    columns: tuple[Array, ...]  # each (N,)
    points: bool = False  # whether each value is marked


class LogChart:
    """Only the view thread may call it."""

    def __init__(self, gui: viser.GuiApi) -> None:
        nothing, logarithmic = np.array([1.0, 10.0]), uplot.Scale(time=False, distr=3, log=10)
        self._heading = gui.add_html("", visible=False)
        self.handle = gui.add_uplot(
            (nothing, nothing),
            (uplot.Series(label=""), _HIDDEN),
            scales={"x": logarithmic, "y": logarithmic},
            axes=(uplot.Axis(size=30), uplot.Axis(size=62)),
            legend=uplot.Legend(show=True, live=True),
            cursor=uplot.Cursor(drag={"x": False, "y": False}),
            height=LOG_HEIGHT,
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
            self.handle.series = (uplot.Series(label=drawing.x), *lines, _HIDDEN)
            self.handle.data = (*shown, shown[-1])
        self._heading.visible = self.handle.visible = drawing is not None


def relayout(charts: Iterable[Chart | LogChart]) -> None:
    """Make every browser lay charts out again, by a pixel of their height.

    A page whose first width and next data come in one breath shows no time axis: uplot-react 1.2 calls setSize, then
    setData and redraw(), and redraw forgets that the axes were to be laid out again. A new size that comes alone mends
    it, and keeps the user's zoom.
    """
    for chart in charts:
        chart.handle.height = (chart.handle.height or 0) ^ 1  # one more, and the next time one less


def series(
    label: str, colour: Rgb, width: float, dash: Dash | None, fill: float = 0.0, *, points: bool = False
) -> uplot.Series:
    """A line as uPlot wants it. fill: opacity of the area between it and zero."""
    line = uplot.Series(label=label, stroke=palette.css(colour), width=width, points={"show": points})
    if dash is not None:
        line["dash"] = dash
    if fill > 0:
        line["fill"] = palette.rgba(colour, fill)
    return line


def legend_style(dashes: Sequence[Dash | None]) -> str:
    """A mark, to stand just above a chart, whose legend then shows dashes as the lines have them."""
    name = f"companion-chart-{next(_charts)}"
    rules = "".join(  # uPlot can give all markers one border: the rows are identified by their number, the first is x
        f"div:has(>.{name})+div .u-legend .u-series:nth-child({i}) .u-marker{{border-style:{_BORDERS[dash]}!important}}"
        for i, dash in enumerate(dashes, start=2)
        if dash is not None
    )
    return f'<i class="{name}"></i><style>{rules}</style>'


def heading(title: str, values: str) -> str:
    """The row above a chart; `values` is markup."""
    return (
        '<div style="padding:0 1em;font-size:0.8em;display:flex;justify-content:space-between;flex-wrap:wrap;'
        f'font-variant-numeric:tabular-nums"><span style="font-weight:600">{title}</span><span>{values}</span></div>'
    )


def _scales(part: tuple[float, float]) -> dict[str, uplot.Scale]:
    # The bounds are explicit, so that the line's points never move them and a zoom stays where it is.
    return {"x": uplot.Scale(time=False, range=part), "now": uplot.Scale(range=(0.0, 1.0))}


def _axes(unit: str) -> tuple[uplot.Axis, ...]:
    return (uplot.Axis(size=30, space=40), uplot.Axis(label=unit, labelSize=16, size=44, labelGap=0))


def _key(line: Line, now: float | None) -> str:
    """None: it moves, and the panel's numbers, which come more often, are the only ones."""
    value = "" if now is None else f"{float(np.interp(now, line.t, line.values)) if len(line.values) else 0.0:.2f}"
    border = f"2px {_BORDERS.get(line.dash or (), 'solid')} {palette.css(line.colour)}"
    return (
        f'<span style="font-weight:600;margin-left:0.6em;white-space:nowrap"><span style="display:inline-block;'
        f'width:18px;border-top:{border};vertical-align:middle;margin-right:0.3em"></span>'
        # As wide with a sign and two digits as without: a row that wraps for a moment would move all charts below it.
        f'{escape(line.name)} <span style="display:inline-block;min-width:6ch;text-align:right">{value}</span>'
        "</span>"
    )


MOST_POINTS = 250
"""Points a chart: a moving cursor resends them all, several times a second, to every browser."""
MOST_GAPS = 20
"""Gaps a chart can show; of more, the longest."""


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """What one chart draws: thinned and finite."""

    t: Array  # (M,) s, boot clock
    values: tuple[Array, ...]  # each (M,)
    gap: Array  # (M,) 1 where the autopilot's state is not known, else 0

    def at(self, now: float) -> tuple[Array, ...]:
        """The chart's columns: times, values, and a last one that shades the gaps and has a line at `now`.

        On a scale of 0 to 1 a gap is a block from edge to edge (2), and elsewhere the column's base lies out of sight
        (-1). The line leaps from the base to the other and back. A gap of NaN would do as well, but then a number that
        is not finite would be on its way to the screen.
        """
        k = int(np.searchsorted(self.t, now))
        inserted = (np.insert(v, k, [np.interp(now, self.t, v)] * 3) for v in self.values)
        inside = float(self.gap[min(k, len(self.gap) - 1)] * self.gap[max(k - 1, 0)])
        here = np.array([inside, 1 - inside, inside])
        shade = 3 * np.insert(self.gap, k, here) - 1
        return (np.insert(self.t, k, [now] * 3), *inserted, shade)


def curves(
    lines: Sequence[tuple[Array, Array]],
    known: tuple[Array, Array] | None = None,
    part: tuple[float, float] = (-np.inf, np.inf),
) -> Curves:
    """Thin lines, each times (N,) and values (N,), to MOST_POINTS on one time axis, keeping every peak of each.

    Lines with the same array of times share their points; the others are drawn straight between their own.
    known: times and flags, False (0) where the autopilot's state is not known. part: s, only what lies between two
    times, and one sample more on either side so that the lines reach the edges.
    """
    groups: dict[int, tuple[Array, list[Array]]] = {}
    for t, values in lines:
        cut = _cut(t, part)
        groups.setdefault(id(t), (t[cut], []))[1].append(values[cut])
    gaps, flags, edges = np.zeros(1), np.zeros(1), np.zeros(0)
    if known is not None:
        cut = _cut(known[0], part)
        gaps = known[0][cut]
        beside, flags = _edges(gaps, 1.0 - known[1][cut])
        edges = gaps[beside]
    share = (MOST_POINTS - len(edges)) // len(groups)
    kept = [t[extremes(tuple(values), max(share, 2 * len(values) + 2))] for t, values in groups.values() if len(t)]
    times = np.unique(np.concatenate([*kept, edges]))
    drawn = tuple(np.interp(times, t, v) if len(t) else np.zeros(len(times)) for t, v in lines)
    last = np.clip(np.searchsorted(gaps, times, side="right") - 1, 0, len(gaps) - 1)
    return Curves(times, drawn, flags[last])


def _cut(t: Array, part: tuple[float, float]) -> slice:
    low = max(int(np.searchsorted(t, part[0], side="right")) - 1, 0)
    return slice(low, min(int(np.searchsorted(t, part[1], side="left")) + 1, len(t)))


def _edges(t: Array, gap: Array) -> tuple[Indices, Array]:
    """The samples on both sides of where a gap begins or ends, and the gaps without those too many to show."""
    flags = np.concatenate([[0.0], gap, [0.0]])
    begins, ends = np.flatnonzero(np.diff(flags) > 0), np.flatnonzero(np.diff(flags) < 0)  # [begin, end)
    if len(begins) > MOST_GAPS:
        longest = np.sort(np.argsort(t[ends - 1] - t[begins])[-MOST_GAPS:])
        begins, ends = begins[longest], ends[longest]
        gap = np.zeros(len(t))
        for begin, end in zip(begins, ends, strict=True):
            gap[begin:end] = 1.0
    beside = np.concatenate([begins - 1, begins, ends - 1, ends])
    return np.unique(beside[(beside >= 0) & (beside < len(t))]).astype(np.intp), gap
