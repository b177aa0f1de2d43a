"""One chart over time with a line at the current instant, and the values there in its title."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import viser
from viser import uplot

from companion.tracks import Array
from companion.view import palette
from companion.view.curves import Curves, curves
from companion.view.moment import SAME_TIME
from companion.view.palette import Rgb

HEIGHT = 152  # of a chart, pixels
STYLE = (  # the line at the current instant is a series: its entry in the legend would say nothing
    "<style>.uplot .u-legend{margin:-2px 0 4px}.uplot .u-legend .u-series:last-child{display:none}</style>"
)

Line = tuple[str, Rgb]


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """What one chart is to show. With an envelope the last two of `values` are its 1σ and 3σ."""

    t: Array  # (N,) s, boot clock
    values: tuple[Array, ...]  # each (N,)
    known: Array | None = None  # (N,) 0 where the autopilot's state is not known
    envelope: bool = False


class Chart:
    """One chart with its title, in which the values at the current instant stand."""

    def __init__(
        self, gui: viser.GuiApi, title: str, unit: str, lines: Sequence[Line], *, time: str = "s since boot"
    ) -> None:
        self._title, self._lines, self._time = title, tuple(lines), time
        self._heading = gui.add_html("")
        self._envelope = False
        nothing = Curves(np.array([0.0, 1.0]), (np.zeros(2),) * len(lines), np.zeros(2))
        self._drawing, self._drawn = Drawing(nothing.t, nothing.values), nothing
        self.handle = gui.add_uplot(
            nothing.at(0.0),
            self._series(),
            scales=_scales((0.0, 1.0)),
            axes=(
                uplot.Axis(size=30, space=40),
                uplot.Axis(label=unit, labelSize=16, size=44, labelGap=0),
            ),
            legend=uplot.Legend(show=True, live=True),
            cursor=uplot.Cursor(sync={"key": "time"}, drag={"x": True, "y": False}),
            height=HEIGHT,
            padding=(6, 14, 0, 0),
        )

    def load(self, drawing: Drawing, part: tuple[float, float]) -> None:
        """Draw something else, between two times (s, boot clock)."""
        self._drawing = drawing
        self._drawn = curves(drawing.t, drawing.values, drawing.known, part)
        if drawing.envelope != self._envelope:
            self._envelope = drawing.envelope
            # Series and data have to change together, or the chart has lines without points.
            self.handle.series, self.handle.data = self._series(), self._drawn.at(part[0])
        scales = _scales(part)
        if self.handle.scales != scales:  # a change builds the chart anew and forgets how the user has zoomed
            self.handle.scales = scales

    def show(self, now: float, values: tuple[float, ...] = ()) -> None:
        """Move the line to `now`, s, boot clock, where `values` hold (default: those of the last sample)."""
        if not self.handle.visible:
            return
        self.handle.data = self._drawn.at(now)
        if not values:
            sample = max(int(np.searchsorted(self._drawing.t, now + SAME_TIME, side="right")) - 1, 0)
            values = tuple(float(v[sample]) for v in self._drawing.values)
        said = " ".join(_key(name, v, colour) for (name, colour), v in zip(self._lines, values, strict=True))
        self._heading.content = _row(f'<span style="font-weight:600">{self._title}</span><span>{said}</span>')

    def set_visible(self, visible: bool) -> None:
        """Show it, or not."""
        if self.handle.visible != visible:
            self._heading.visible = self.handle.visible = visible

    def relayout(self) -> None:
        """Make every browser lay the chart out again, by a pixel of height.

        A page whose first width and next data come in one breath shows no time axis: uplot-react 1.2 calls setSize,
        then setData and redraw(), and redraw forgets that the axes were to be laid out again. A new size that comes
        alone mends it, and keeps the user's zoom.
        """
        self.handle.height = HEIGHT + 1 if self.handle.height == HEIGHT else HEIGHT

    def _series(self) -> tuple[uplot.Series, ...]:
        envelope = [("1σ", (5.0, 4.0)), ("3σ", (2.0, 4.0))] if self._envelope else []
        return (
            uplot.Series(label=self._time),
            *(_line(name, colour, 1.6) for name, colour in self._lines),
            *(_line(name, palette.CURSOR, 1.3, dash) for name, dash in envelope),
            _line("now", palette.CURSOR, 1.2, scale="now", fill="rgba(130,130,130,0.22)"),
        )


def _scales(part: tuple[float, float]) -> dict[str, uplot.Scale]:
    # The bounds said outright, so that the line's points never move them and a zoom stays where it is.
    return {"x": uplot.Scale(time=False, range=part), "now": uplot.Scale(range=(0.0, 1.0))}


def _line(
    label: str,
    colour: Rgb,
    width: float,
    dash: tuple[float, ...] | None = None,
    scale: str | None = None,
    fill: str | None = None,
) -> uplot.Series:
    series = uplot.Series(label=label, stroke=palette.css(colour), width=width, points={"show": False})
    if dash is not None:
        series["dash"] = dash
    if scale is not None:
        series["scale"] = scale
    if fill is not None:
        series["fill"] = fill
    return series


def _row(markup: str) -> str:
    return (
        '<div style="padding:0 1em;font-size:0.8em;display:flex;justify-content:space-between;flex-wrap:wrap;'
        f'font-variant-numeric:tabular-nums">{markup}</div>'
    )


def _key(name: str, value: float, colour: Rgb) -> str:
    return f'<span style="color:{palette.css(colour)};font-weight:600;margin-left:0.6em">{name} {value:.2f}</span>'
