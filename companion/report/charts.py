"""The charts of a page: collected while its sections are made, drawn by plotly.js when the page is opened."""

from __future__ import annotations

import base64
from functools import cache
from importlib.resources import files
from typing import Any

import msgspec
import numpy as np

from companion.present import text
from companion.report.traces import Figure

ROW_PX = 190
"""Height of one panel."""

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

    def add(self, figure: Figure, caption: str, *, rows: float = 1.5, square: bool = False) -> str:
        """The place of a figure, as HTML. `caption` is text; the figure is `rows` panels high, or `square`."""
        self._drawn.append(laid_out(figure))
        kind = "chart square" if square else "chart"
        height = "" if square else f' style="height:{60 + rows * ROW_PX:.0f}px"'
        return (
            f'<figure><div class="{kind}" id="chart{len(self._drawn)}"{height}></div>'
            f"<figcaption>{text(caption)}</figcaption></figure>"
        )

    def json(self) -> str:
        """All figures as one JSON array, chart1 first. Non-finite numbers outside of arrays become null."""
        return msgspec.json.encode(self._drawn, enc_hook=_plain).decode()


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
