"""Lines, bands and panels of charts as plotly's own dictionaries, in the colours of the view."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.model import Array, longest_step
from companion.present import palette
from companion.view import extremes

Trace = dict[str, Any]
Figure = dict[str, Any]

TIME = "seconds since boot"
"""The axis of time."""
MOST_POINTS = 1200
"""Points of a line: about one a pixel. What is thinned keeps every peak and dip."""

GREY = palette.CURSOR


def line(
    x: Array,
    y: Array,
    name: str,
    colour: palette.Rgb,
    *,
    breaks: Array | None = None,
    limit: int = MOST_POINTS,
    **more: Any,
) -> Trace:
    """A line (N,) over (N,), thinned, interrupted at `breaks` (times)."""
    kept = extremes((np.nan_to_num(y, posinf=1e300, neginf=-1e300),), limit)
    x, y = x[kept], y[kept]
    if breaks is not None and len(breaks):
        at = breaks_among(x, breaks)
        x, y = np.insert(x, at, x[at]), np.insert(y, at, np.nan)
    return curve(x, y, name, colour, **more)


def breaks_among(t: Array, breaks: Array) -> npt.NDArray[np.intp]:
    """The indices of samples at times t before which a line is interrupted, each once."""
    at = np.unique(np.searchsorted(t, breaks))
    return at[(at > 0) & (at < len(t))]


def gaps(t: Array, gap: float | None = None) -> Array:
    """(G,) the times after which a track with times t (N,) has a gap (s; None: as of any track)."""
    return t[1:][np.diff(t) > (longest_step(t) if gap is None else gap)]


def curve(x: Array, y: Array, name: str, colour: palette.Rgb, *, width: float = 1.4, **more: Any) -> Trace:
    """A line through all its points."""
    style = {"color": palette.css(colour), "width": width} | more.pop("line", {})
    return {
        "type": "scatter",
        "mode": "lines",
        "x": np.asarray(x, dtype=np.float32),  # of an hour: a quarter of a millisecond, a thousandth of a pixel
        "y": np.asarray(y, dtype=np.float32),
        "name": name,
        "line": style,
        "hovertemplate": "%{y:.3~g}",
        **more,
    }


def markers(x: Sequence[object] | Array, y: Sequence[object] | Array, name: str, **more: Any) -> Trace:
    """Points; more: how they look, and what else plotly is given."""
    return {"type": "scatter", "mode": "markers", "x": x, "y": y, "name": name, **more}


def densities(lines: Callable[[str], Sequence[Trace]]) -> list[Panel]:
    """Both sensors over logarithmic axes; lines: of "gyro" or "accel"."""
    units = {"gyro": "rad/s/√Hz", "accel": "m/s²/√Hz"}
    return [Panel(f"{sensor}, {unit}", lines(sensor), {"type": "log"}) for sensor, unit in units.items()]


def band(x: Array, y: Array, name: str, colour: palette.Rgb, opacity: float) -> Trace:
    """The area between zero and a line."""
    return curve(x, y, name, colour, width=0, fill="tozeroy", fillcolor=palette.rgba(colour, opacity))


@dataclass(frozen=True, slots=True)
class Panel:
    """One of several charts over one another with a common time axis."""

    title: str  # of the y axis, with its unit
    traces: Sequence[Trace]
    axis: Mapping[str, Any] | None = None  # more about the y axis


def stack(panels: Sequence[Panel], x_title: str, *, spans: Sequence[tuple[float, float]] = (), **axis: Any) -> Figure:
    """Panels from top to bottom over one x axis; `spans` are shaded; `axis`: more about the x axis.

    A name that comes again is one entry of the legend.
    """
    gap = 0.28 / (len(panels) + 1)
    height = (1.0 - gap * (len(panels) - 1)) / len(panels)
    data: list[Trace] = []
    numbers = ["", *map(str, range(2, len(panels) + 1))]  # plotly's first axis has none
    layout: dict[str, Any] = {"xaxis": {"title": {"text": x_title}, "anchor": f"y{numbers[-1]}", **axis}}
    seen: set[str] = set()
    for i, (number, panel) in enumerate(zip(numbers, panels, strict=True)):
        top = 1.0 - i * (height + gap)
        layout[f"yaxis{number}"] = {
            "title": {"text": panel.title},
            "domain": [max(top - height, 0.0), top],
            **(panel.axis or {}),
        }
        for trace in panel.traces:
            name = str(trace.get("name", ""))
            data.append(
                trace
                | {"xaxis": "x", "yaxis": f"y{number}", "legendgroup": name}
                | ({"showlegend": False} if name in seen else {})
            )
            seen.add(name)
    shade, edge = palette.rgba(palette.DIFFERENCE, 0.12), {"width": 1, "color": palette.rgba(palette.DIFFERENCE, 0.35)}
    rectangle = {"type": "rect", "xref": "x", "yref": "paper", "y0": 0, "y1": 1, "layer": "below"}
    layout["shapes"] = [rectangle | {"x0": a, "x1": b, "fillcolor": shade, "line": edge} for a, b in spans]
    return {"data": data, "layout": layout}
