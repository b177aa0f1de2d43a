"""The page of a fleet: which flights to look at first, biases over time, counts of findings, every flight."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from companion.fleet.rows import JUDGED_S, Row, Rows, key_of, status_of
from companion.fleet.search import short_names
from companion.model import counted
from companion.present import markup, short, words
from companion.report import Charts, Figure, Panel, Section, sheet, stack

_WORST = 25


def fleet_html(rows: Rows, about: Sequence[tuple[str, str]]) -> str:
    """The page as HTML that needs no network. about: (what, value) of the run."""
    charts = Charts()
    names = short_names([row["log"] for row in rows.flights])
    horizon = min((row["horizon_s"] for row in rows.drift), key=lambda h: abs(h - JUDGED_S), default=JUDGED_S)
    ordered = rows.by_concern()
    by_kind = rows.count_findings()
    failed = rows.errors()
    sections = [
        Section("first", "Look at these first", _flights(ordered[:_WORST], rows, names, horizon, why=True)),
        *_histories(rows, charts, names),
        Section(
            "findings",
            "Findings by kind",
            charts.add(finding_bars(by_kind), "Flights with each kind of finding.", rows=0.4 + 0.13 * len(by_kind))
            + markup.table(
                ("finding", "severity", "times", "flights"),
                [(words(kind), severity, times, flights) for kind, severity, times, flights in by_kind],
                words=2,
            )
            if by_kind
            else markup.paragraph("Nothing stands out in any flight."),
        ),
        Section("flights", "Every flight", _flights(ordered, rows, names, horizon, why=False)),
    ]
    if failed:
        body = markup.table(
            ("log", "why there is no analysis"), [(row["log"], row["error"]) for row in failed], words=2
        )
        sections.insert(1, Section("errors", "Not analysed", body))
    sections.append(Section("made", "How this was made", markup.table(("", ""), about, words=2)))
    return sheet("Fleet: IMUs and autopilots", _head(rows), sections, charts, {})


def _head(rows: Rows) -> str:
    logs = len({row["log"] for row in rows.flights})
    cards = "".join(
        f'<div class="card"><b>{count}</b><span>{markup.text(words(status))}</span></div>'
        for status, count in rows.count_by_status().items()
    )
    dates = [row["date_s"] for row in rows.flights if row.get("date_s") is not None]
    days = [_date(t)[:10] for t in (min(dates), max(dates))] if dates else []
    span = f" · {' to '.join(dict.fromkeys(days))}" if days else ""
    flights = sum(1 for row in rows.flights if row.get("vehicle"))
    return (
        f'<header><h1>Fleet</h1><p class="quiet">{counted(flights, "flight")} in {counted(logs, "log")}{span}</p>'
        f'<div class="cards">{cards}</div></header>'
    )


def _histories(rows: Rows, charts: Charts, names: dict[str, str]) -> Iterable[Section]:
    """Biases over date and temperature."""
    for against, anchor, title in (
        ("date_s", "history", "over time"),
        ("temperature_degc", "warmth", "and temperature"),
    ):
        body = ""
        for sensor, what in (("gyro", "Gyroscope bias"), ("accel", "Accelerometer bias")):
            if drawn := history(rows.calibration, sensor, against, names):
                figure, sensors = drawn
                most = (
                    f" The {MOST_SENSORS} of {sensors} sensors with the most flights." if sensors > MOST_SENSORS else ""
                )
                body += charts.add(figure, f"{what} of each sensor, with its standard error.{most}", rows=3)
        nothing = markup.paragraph("No flight has both an observable bias and a date." if against == "date_s" else "")
        if body or against == "date_s":
            yield Section(anchor, f"Biases {title}", body or nothing)


def _flights(flights: Sequence[Row], rows: Rows, names: dict[str, str], horizon: float, *, why: bool) -> str:
    ratios = rows.worst_ratios()
    after = {key_of(row): row for row in rows.drift if row["horizon_s"] == horizon}

    def cells(row: Row) -> tuple[object, ...]:
        drift = after.get(key_of(row), {})
        return (
            _named(row, names),
            words(status_of(row)),
            *([", ".join(map(words, rows.reasons(row)))] if why else []),
            short(ratios.get(key_of(row))),
            short(drift.get("attitude_median_deg")),
            short(drift.get("position_median_m")),
            short(row.get("rate_hz")),
            row.get("imu") or "–",
            f"{row['vehicle']} · {row['boot']}" if row.get("vehicle") else "–",
            _date(row.get("date_s")),
        )

    if not flights:
        return markup.paragraph("No flight could be judged.")
    return markup.table(
        (
            *("log", "verdict", *(["because"] if why else []), "worst ÷ expected", f"° after {horizon:g} s"),
            *(f"m after {horizon:g} s", "Hz", "IMU", "vehicle · boot", "date (UTC)"),
        ),
        map(cells, flights),
        words=3 if why else 2,
        sortable=True,
    )


def _named(row: Row, names: dict[str, str]) -> markup.Link | str:
    name = names[row["log"]]
    return markup.Link(name, row["report"]) if row.get("report") else name


def _date(seconds: float | None) -> str:
    return "–" if seconds is None else datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M")


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

    Values that were not observable are left out. None without any.
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


def finding_bars(by_kind: Sequence[tuple[str, str, int, int]]) -> Figure:
    """Flights with each kind of finding, as `Rows.count_findings` gives them."""
    severities = {"error": "#e66101", "warning": "#d69100", "info": "#828282"}
    return {
        "data": [
            {
                "type": "bar",
                "orientation": "h",
                "name": severity,
                "y": [markup.text(words(kind)) for kind, own, _, _ in by_kind if own == severity],
                "x": [flights for _, own, _, flights in by_kind if own == severity],
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
