"""`companion analyze LOG LOG ...` and `companion info LOG LOG ...`: a row for every flight of many logs."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator
from typing import TypeAlias

from rich.markup import escape
from rich.table import Table

from companion.app.examination import Examination, examined_or_not
from companion.app.recording import read_recording
from companion.app.settings import Settings
from companion.cli import options, tables
from companion.model import CompanionError, Flight, Item, SettingsError, counted, inventory, used_imus
from companion.present import autopilot_words, clause, fixed

_HORIZON_S = 10.0
_OF_ONE = ("json", "full", "confusion", "vehicle", "boot")

_COLUMNS = {
    "IMU": "IMU", "GPS": "GPS", "compass": "compass", "barometer": "barometer", "airspeed": "airspeed",
    "range finder": "range", "optical flow": "flow", "attitude": "attitude", "other attitude": "other attitude",
    "position": "position", "IMU bias": "bias", "test ratios": "ratios", "innovations": "innovations",
    "aiding": "aiding", "variances": "variances", "accuracies": "accuracies", "vibration": "vibration",
    "desired attitude": "desired", "motors and servos": "motors", "batches": "batches", "truth": "truth",
}  # fmt: skip
"""Kind of an item of the inventory → heading; in this order."""

_OVERVIEW = ("IMU", "attitude", "position", "GPS")
"""Those of them that fit a terminal."""

_HEADINGS = ("log", "vehicle", *_COLUMNS.values(), "IMU used", "announced", "notes")


def print_verdicts(arguments: argparse.Namespace) -> int:
    """The verdict on each flight of the logs and folders that were named.

    Exit code: 2 where one cannot be read or has no vehicle, as for one log.
    """
    given = [f"--{name}" for name in _OF_ONE if getattr(arguments, name)]
    if given := given + ["--anchor rest"] * (arguments.anchor == "rest"):
        raise SettingsError(f"{' and '.join(given)} is of one log: name one. For many logs: companion fleet.")
    settings = options.settings_of(arguments)
    statuses = list[str]()

    def cells(flight: Flight) -> Iterator[str]:
        status, sentence, drift = _judged(flight, settings, arguments)
        statuses.append(status)
        yield f"{flight.vehicle}, boot {flight.boot}, {flight.duration:.0f} s"
        yield f"{tables.status_text(status)}: {escape(sentence)}"
        yield drift

    table = tables.folded_table("log", "flight", "verdict", f"after {_HORIZON_S:g} s")
    _fill(table, arguments, cells, lambda error: ("", f"[red]not read[/]: {escape(error)}"))
    return 2 if len(statuses) < table.row_count else options.exit_code(arguments.fail_on, statuses)


def print_overview(arguments: argparse.Namespace) -> int:
    """All flights in the logs: duration, and rates of the sensors that a verdict needs.

    Exit code: 2 where a log cannot be read.
    """

    def cells(flight: Flight) -> Iterator[str]:
        yield _vehicle(flight) + (f", boot {flight.boot}" if flight.boot > 1 else "")
        yield f"{flight.duration:.0f}"
        yield from _rates(flight, _OVERVIEW)

    headings = ("\nlog", "\nvehicle", "\ns", *(f"{kind}\nHz" for kind in _OVERVIEW))
    table = tables.folded_table(*headings, numbers=range(2, len(headings)))
    unread = _fill(table, arguments, cells, lambda _: ("[red]not read[/]",))
    for sentence in unread:
        options.say(sentence)
    return 2 if unread else 0


def print_sensors(arguments: argparse.Namespace) -> int:
    """A Markdown table of all flights: the rates of each kind of sensor and estimate, Hz. Exit code as above."""

    def cells(flight: Flight) -> Iterator[str]:
        yield f"{_vehicle(flight)}, boot {flight.boot}"
        yield from _rates(flight, _COLUMNS)
        yield used_imus(flight)
        changes = counted(len(flight.parameter_changes), "parameter")
        yield f"{counted(len(flight.resets), 'reset')}, {changes}"
        yield str(len(flight.notes))

    rows, unread = _rows(arguments, cells), 0
    print(_line(_HEADINGS))
    print(_line("---" for _ in _HEADINGS))
    for name, row, error in rows:
        unread += error is not None
        known = [name, f"not read: {error}"] if error else [name, *row]
        print(_line([*known, *[""] * (len(_HEADINGS) - len(known))]), flush=True)
    return 2 if unread else 0


_Cells: TypeAlias = Callable[[Flight], Iterable[str]]


def _fill(
    table: Table, arguments: argparse.Namespace, cells: _Cells, refused: Callable[[str], Iterable[str]]
) -> list[str]:
    """Print a row for each flight, or the cells of `refused` for a log that cannot be read. Returns those."""
    unread = []
    for name, row, error in _rows(arguments, cells):
        if error:
            unread.append(f"{name}: {error}")
        table.add_row(escape(name), *(refused(str(error)) if error else row))
    tables.console().print(table)
    return unread


def _rows(arguments: argparse.Namespace, cells: _Cells) -> Iterator[tuple[str, tuple[str, ...], CompanionError | None]]:
    """The log's name and the cells of each flight of the logs that were named or are in a folder; or the error."""
    settings = options.settings_of(arguments)
    names = options.logs_named(arguments, settings)

    def read() -> Iterator[tuple[str, tuple[str, ...], CompanionError | None]]:
        for path, name in names.items():
            try:
                flights = read_recording(path, core=arguments.core, **settings.log.options).flights
            except CompanionError as error:
                yield name, (), error
                continue
            for flight in flights:
                yield name, tuple(cells(flight)), None
            if not flights:
                yield name, ("no vehicle",), None

    return read()


def _judged(flight: Flight, settings: Settings, arguments: argparse.Namespace) -> tuple[str, str, str]:
    """Status, sentence, and drift of the IMU."""
    try:
        examined = examined_or_not(flight, settings, **options.chosen(arguments))
    except CompanionError as error:
        return "insufficient_data", str(error), ""
    drift = ""
    for row in examined.assessment.drift.rows if isinstance(examined, Examination) else ():
        if row.horizon_s == _HORIZON_S and row.attitude_deg is not None:
            parts = [f"{fixed(row.attitude_deg.median)}°"]
            parts += [f"{fixed(row.position_m.median)} m"] if row.position_m is not None else []
            drift = ", ".join(parts)
    return examined.verdict.status, clause(examined.verdict.summary), drift


def _vehicle(flight: Flight) -> str:
    return f"{autopilot_words(flight.vehicle.autopilot)} {flight.vehicle}"


def _rates(flight: Flight, kinds: Iterable[str]) -> Iterator[str]:
    """Of each kind the rates of its sources, Hz."""
    items: dict[str, list[Item]] = {}
    for item in inventory(flight):
        items.setdefault(item.kind, []).append(item)
    return (" ".join(map(_rate, items.get(kind, []))) for kind in kinds)


def _rate(item: Item) -> str:
    """Hz, or how many where there is no rate."""
    return f"{item.samples}×" if item.rate_hz is None else f"{item.rate_hz:.3g}"


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "/").replace("\n", " ") for cell in cells) + " |"
