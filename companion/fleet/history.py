"""Charts of a fleet: the biases of each sensor over time and temperature, findings by kind."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from companion.fleet.rows import Row
from companion.present import markup, words
from companion.report import Figure, Panel, stack

MOST_SENSORS = 16
"""In one chart: those with the most flights. The table has them all."""

_PALETTE = ("#0072b2", "#e66101", "#009e73", "#cc79a7", "#b59f00", "#56b4e9", "#8c510a", "#7b3294")
_MARKERS = ("circle", "square", "diamond", "cross", "triangle-up", "x", "star", "hexagon")


def sensor_of(row: Row, sensor: str) -> str:
    """The "gyro" or "accel" behind a row by name: its board's serial number, or the vehicle, and the sensor's id."""
    where = f"board …{row['board'][-8:]}" if row.get("board") else f"vehicle {row['vehicle']}"
    number = row.get(f"{sensor}_id")
    return f"{where}, {f'id {number}' if number else row['imu']}"


def history(rows: Sequence[Row], sensor: str, against: str, names: Mapping[str, str]) -> tuple[Figure, int] | None:
    """The biases of every "gyro" or "accel" with 1σ, over "date_s" or "temperature_degc"; and the number of sensors.

    Only what a flight tells: values that were not observable are left out. None without any.
    """
    unit, factor, shown = ("radps", 1e3, "mrad/s") if sensor == "gyro" else ("mps2", 1.0, "m/s²")
    usable = [row for row in rows if row.get(against) is not None]
    kept = [name for name, _ in Counter(sensor_of(row, sensor) for row in usable).most_common(MOST_SENSORS)]
    panels, drawn = [], False
    for axis in "xyz":
        column = f"{sensor}_bias_{axis}"
        traces: list[dict[str, Any]] = []
        for i, name in enumerate(kept):
            of_sensor = [row for row in usable if sensor_of(row, sensor) == name and row[f"{column}_observable"]]
            of_sensor.sort(key=lambda row: row[against])
            drawn = drawn or bool(of_sensor)
            traces.append(
                {
                    "type": "scatter",
                    "mode": "lines+markers" if against == "date_s" else "markers",
                    "name": markup.text(name),  # plotly reads <a href> in texts
                    "x": [_iso(row[against]) if against == "date_s" else row[against] for row in of_sensor],
                    "y": [row[f"{column}_{unit}"] * factor for row in of_sensor],
                    "error_y": {
                        "type": "data",
                        "array": [row[f"{column}_sigma_{unit}"] * factor for row in of_sensor],
                        "thickness": 1,
                    },
                    "text": [markup.text(names[row["log"]]) for row in of_sensor],
                    "hovertemplate": "%{y:.3~g} " + shown + " %{text}",
                    "line": {"width": 1, "color": _PALETTE[i % len(_PALETTE)]},
                    "marker": {"size": 6, "symbol": _MARKERS[i // len(_PALETTE) % len(_MARKERS)]},
                }
            )
        panels.append(Panel(f"{axis}, {shown}", traces))
    if not drawn:
        return None
    if against == "date_s":
        figure = stack(panels, "date (UTC)", type="date")
    else:
        figure = stack(panels, "temperature of the IMU, °C")
    figure["layout"]["hovermode"] = "closest"
    return figure, len({sensor_of(row, sensor) for row in usable})


def finding_bars(counted: Sequence[tuple[str, str, int, int]]) -> Figure:
    """Flights with each kind of finding, as `count_findings` gives them."""

    severities = {"error": "#e66101", "warning": "#d69100", "info": "#828282"}
    return {
        "data": [
            {
                "type": "bar",
                "orientation": "h",
                "name": severity,
                "y": [markup.text(words(kind)) for kind, own, _, _ in counted if own == severity],
                "x": [flights for _, own, _, flights in counted if own == severity],
                "marker": {"color": colour},
                "hovertemplate": "%{x} flights",
            }
            for severity, colour in severities.items()
        ],
        "layout": {
            "barmode": "stack",
            "hovermode": "closest",
            "xaxis": {"title": {"text": "flights"}, "rangemode": "tozero"},
            "yaxis": {"autorange": "reversed", "type": "category"},
        },
    }


def _iso(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M:%S")
