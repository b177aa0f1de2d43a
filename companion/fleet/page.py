"""The page of a fleet: who to look at first, how biases move, what is found how often, every flight."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime

from companion.fleet.digest import (
    Key,
    by_concern,
    count_by_status,
    count_findings,
    errors,
    key_of,
    reasons,
    short_names,
    status_of,
    worst_ratios,
)
from companion.fleet.history import MOST_SENSORS, finding_bars, history
from companion.fleet.rows import Row, Rows
from companion.present import markup, short, words
from companion.report import Charts, Section, sheet

_WORST = 25
_JUDGED_S = 5.0


def fleet_html(rows: Rows, about: Sequence[tuple[str, str]]) -> str:
    """The page as HTML that needs no network. about: (what, value) of how the rows were made.

    Raises InputError when plotly is not installed.
    """
    charts = Charts()
    names = short_names([row["log"] for row in rows.flights])
    horizon = min((row["horizon_s"] for row in rows.drift), key=lambda h: abs(h - _JUDGED_S), default=_JUDGED_S)
    after = {key_of(row): row for row in rows.drift if row["horizon_s"] == horizon}
    ordered = by_concern(rows)
    counted = count_findings(rows)
    failed = errors(rows)
    sections = [
        Section("first", "Look at these first", _flights(ordered[:_WORST], rows, names, after, why=True)),
        *_histories(rows, charts, names),
        Section(
            "findings",
            "Findings by kind",
            charts.add(finding_bars(counted), "Flights with each kind of finding.", rows=0.4 + 0.13 * len(counted))
            + markup.table(
                ("finding", "severity", "times", "flights"),
                [(words(kind), severity, times, flights) for kind, severity, times, flights in counted],
                words=2,
            )
            if counted
            else markup.paragraph("Nothing stands out in any flight."),
        ),
        Section("flights", "Every flight", _flights(ordered, rows, names, after, why=False)),
    ]
    if failed:
        body = markup.table(
            ("log", "why there is no analysis"), [(row["log"], row["error"]) for row in failed], words=2
        )
        sections.insert(1, Section("errors", "Not analysed", body))
    sections.append(Section("made", "How this was made", markup.table(("", ""), about, words=2)))
    return sheet("Fleet: IMUs and autopilots", _head(rows), sections, charts, {})


def _counted(count: int, noun: str) -> str:
    return f"{count:,} {noun}" + "s" * (count != 1)


def _head(rows: Rows) -> str:

    logs = len({row["log"] for row in rows.flights})
    cards = "".join(
        f'<div class="card"><b>{count}</b><span>{markup.text(words(status))}</span></div>'
        for status, count in count_by_status(rows).items()
    )
    dates = [row["date_s"] for row in rows.flights if row.get("date_s") is not None]
    days = [_date(t)[:10] for t in (min(dates), max(dates))] if dates else []
    span = f" · {' to '.join(dict.fromkeys(days))}" if days else ""
    flights = sum(1 for row in rows.flights if row.get("vehicle"))
    return (
        f'<header><h1>Fleet</h1><p class="quiet">{_counted(flights, "flight")} in {_counted(logs, "log")}{span}</p>'
        f'<div class="cards">{cards}</div></header>'
    )


def _histories(rows: Rows, charts: Charts, names: dict[str, str]) -> Iterable[Section]:
    """How biases move with the date and with temperature."""
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
        nothing = markup.paragraph("No flight tells a bias together with a date." if against == "date_s" else "")
        if body or against == "date_s":
            yield Section(anchor, f"Biases {title}", body or nothing)


def _flights(
    flights: Sequence[Row],
    rows: Rows,
    names: dict[str, str],
    after: dict[Key, Row],
    *,
    why: bool,
) -> str:

    ratios = worst_ratios(rows)

    def cells(row: Row) -> tuple[object, ...]:
        drift = after.get(key_of(row), {})
        return (
            _named(row, names),
            words(status_of(row)),
            *([", ".join(map(words, reasons(rows, row)))] if why else []),
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
            *("log", "verdict", *(["because"] if why else []), "worst ÷ expected", f"° after {_JUDGED_S:g} s"),
            *(f"m after {_JUDGED_S:g} s", "Hz", "IMU", "vehicle · boot", "date (UTC)"),
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
