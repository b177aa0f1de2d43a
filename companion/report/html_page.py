"""The HTML file that a page is written to: its sections, style, charts and data, and no request to anybody.

Charts are collected while the sections are made, and drawn by plotly.js when the page is opened.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import msgspec
import numpy as np

from companion.present import details, text

Figure = dict[str, Any]
"""As plotly has it: `data` and `layout`."""

_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob:; style-src 'unsafe-inline'; "
    "img-src data: blob:; connect-src data: blob:; font-src data:; worker-src blob:; "
    "base-uri 'none'; form-action 'none'"
)
"""No address may be loaded from or sent to. Scripts are the page's own; the player's compiles WebAssembly."""


def sheet(title: str, head: str, sections: Sequence[Section], charts: Charts, data: Mapping[str, str]) -> str:
    """A whole page. title: text; head: HTML above the contents; data: JSON that the page carries, by its id."""
    documents = {**data, "figures": charts.json()}
    carried = [
        f'<script type="application/json" id="{name}">{_inert(json)}</script>' for name, json in documents.items()
    ]
    scripts = "\n".join([*carried, f'<script type="application/gzip" id="plotly">{plotly_js()}</script>'])
    contents = "".join(f'<a href="#{section.anchor}">{text(section.title)}</a>' for section in sections)
    bodies = "".join(map(_section, sections))
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="referrer" content="no-referrer">'
        f'<meta name="color-scheme" content="light dark"><title>{text(title)}</title>'
        f"<style>{_own('page.css')}</style></head><body>{head}<nav>{contents}</nav><main>{bodies}</main>"
        '<noscript><p class="warning">The charts need JavaScript; the tables are complete.</p></noscript>'
        f"{scripts}<script>{_own('page.js')}</script></body></html>\n"
    )


def _section(one: Section) -> str:
    if one.folded:
        return f'<section id="{one.anchor}" class="folded">{details(one.title, one.body)}</section>'
    return f'<section id="{one.anchor}"><h2>{text(one.title)}</h2>{one.body}</section>'


def _inert(json: str) -> str:
    """JSON that cannot end the element that it stands in."""
    return json.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _own(name: str) -> str:
    """A file beside this module."""
    return (files("companion.report") / name).read_text(encoding="utf-8")


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a page."""

    anchor: str
    title: str
    body: str  # HTML
    folded: bool = False  # on screen, until it is opened


_LAYOUT: dict[str, Any] = {
    "template": {},
    "autosize": True,
    "hovermode": "x unified",
    "margin": {"l": 62, "r": 14, "t": 8, "b": 44},
    "legend": {"orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom", "bgcolor": "rgba(0,0,0,0)"},
    "paper_bgcolor": "rgba(0,0,0,0)",
    "plot_bgcolor": "rgba(0,0,0,0)",
    "font": {"family": "system-ui, sans-serif", "size": 12},
}
"""Beneath every chart. Its colours of text and lines come from the page's style sheet, so that they follow the reader's
choice of dark or light, and paper."""
_TYPED = {np.dtype(np.float32): "f4", np.dtype(np.float64): "f8"}
_AXIS: dict[str, Any] = {"zeroline": False, "automargin": True, "title": {"standoff": 6}}


class Charts:
    """The figures of one page."""

    def __init__(self) -> None:
        self._drawn: list[Figure] = []

    def add(self, figure: Figure, caption: str, *, rows: float | None = None, square: bool = False) -> str:
        """The place of a figure, as HTML. `caption` is text; the figure is `height_px` high, or `square`."""
        self._drawn.append(laid_out(figure))
        kind = "chart square" if square else "chart"
        height = "" if square else f' style="height:{height_px(figure, rows):.0f}px"'
        return (
            f'<figure><div class="{kind}" id="chart{len(self._drawn)}"{height}></div>'
            f"<figcaption>{text(caption)}</figcaption></figure>"
        )

    def json(self) -> str:
        """All figures as one JSON array, chart1 first. Non-finite numbers outside of arrays become null."""
        return msgspec.json.encode(self._drawn, enc_hook=_plain).decode()


def height_px(figure: Figure, rows: float | None = None) -> float:
    """How high a figure is drawn that is `rows` panels high; None: as many as it has."""
    panels = sum(name.startswith("yaxis") for name in figure["layout"])
    return 60 + 190 * (panels if rows is None else rows)


@cache
def plotly_js() -> str:
    """plotly.js 4.1.1, gzip and base64: npm's plotly.js-basic-dist-min, which has the kinds of charts drawn here.

    The whole library, as plotly for Python brings it, is four times as large.
    """
    return base64.b64encode((files("companion.report") / "plotly-basic.min.js.gz").read_bytes()).decode()


def _plain(value: Any) -> Any:
    """What msgspec does not know in a figure: arrays, in plotly.js's own coding, and NumPy's numbers.

    plotly's Figure writes the same, but validates every value and is slow to import: the tests do that.
    """
    if isinstance(value, np.ndarray) and value.dtype in _TYPED and value.size:
        return {"dtype": _TYPED[value.dtype], "bdata": base64.b64encode(value.tobytes()).decode()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"a figure of {type(value).__name__}")


def laid_out(figure: Figure) -> Figure:
    """A figure with what all of them have in common."""
    layout = _merged(_LAYOUT, figure["layout"])
    for axis in [name for name in layout if name[1:5] == "axis"] or ["xaxis", "yaxis"]:
        layout[axis] = _merged(_AXIS, layout.get(axis, {}))
    return {"data": figure["data"], "layout": layout}


def _merged(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    """Two layouts, the second over the first, table by table."""
    both = dict(below)
    for key, value in above.items():
        both[key] = _merged(both[key], value) if isinstance(value, dict) and isinstance(both.get(key), dict) else value
    return both
