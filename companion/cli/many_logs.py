"""`companion analyze LOG LOG ...` and `companion info LOG LOG ...`: every flight of many logs, a row each."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from pathlib import Path

from rich import box
from rich.markup import escape
from rich.table import Table

from companion.analysis import Item, inventory, used_imus
from companion.app.examination import examine, unexaminable
from companion.app.recording import read_recording
from companion.app.settings import Settings
from companion.cli import options, tables
from companion.model import CompanionError, Flight, SettingsError, counted
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

    Exit code 2 where a log cannot be read, else as for one.
    """
    if given := [f"--{name}" for name in _OF_ONE if getattr(arguments, name)]:
        raise SettingsError(f"{' and '.join(given)} is of one log: name one. For many logs: companion fleet.")
    settings = options.settings_of(arguments)
    unread, statuses = 0, list[str]()
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    for heading in ("log", "flight", "verdict", f"after {_HORIZON_S:g} s"):
        table.add_column(heading, overflow="fold")
    for name, flights in _logs(arguments, settings):
        if isinstance(flights, CompanionError):
            unread += 1
            table.add_row(escape(name), "", f"[red]not read[/]: {escape(str(flights))}", "")
            continue
        for flight in flights:
            status, words, drift = _judged(flight, settings, arguments)
            statuses.append(status)
            who = f"{flight.vehicle}, boot {flight.boot}, {flight.duration:.0f} s"
            verdict = f"{tables.status_text(status)}: {escape(words)}"
            table.add_row(escape(name), who, verdict, drift)
        if not flights:
            table.add_row(escape(name), "", "no vehicle", "")
    tables.console().print(table)
    return 2 if unread else options.exit_code(arguments.fail_on, statuses)


def print_overview(arguments: argparse.Namespace) -> int:
    """A table of all flights in the logs: how long they are, and at which rates the sensors that a verdict needs came.

    Exit code 2 where a log cannot be read.
    """
    unread = list[str]()
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    table.add_column("\nlog", overflow="fold")
    table.add_column("\nvehicle", no_wrap=True)
    table.add_column("\ns", justify="right")
    for kind in _OVERVIEW:
        table.add_column(f"{kind}\nHz", justify="right", overflow="fold")
    for name, flights in _logs(arguments, options.settings_of(arguments)):
        if isinstance(flights, CompanionError):
            unread.append(f"{name}: {flights}")
            table.add_row(escape(name), "[red]not read[/]")
        elif not flights:
            table.add_row(escape(name), "no vehicle")
        else:
            for flight in flights:
                vehicle = _vehicle(flight) + (f", boot {flight.boot}" if flight.boot > 1 else "")
                table.add_row(escape(name), vehicle, f"{flight.duration:.0f}", *_rates(flight, _OVERVIEW))
    tables.console().print(table)
    for sentence in unread:
        options.say(sentence)
    return 2 if unread else 0


def print_sensors(arguments: argparse.Namespace) -> int:
    """A Markdown table of all flights in the logs: of each kind of sensor and estimate the rates of its sources, Hz.

    Exit code 2 where a log cannot be read.
    """
    logs, unread = _logs(arguments, options.settings_of(arguments)), 0
    print(_line(_HEADINGS))
    print(_line("---" for _ in _HEADINGS))
    for name, flights in logs:
        if isinstance(flights, CompanionError):
            unread += 1
            print(_line((name, f"not read: {flights}", *("" for _ in _HEADINGS[2:]))))
            continue
        for flight in flights:
            print(_line(_cells(name, flight)), flush=True)
        if not flights:
            print(_line((name, "no vehicle", *("" for _ in _HEADINGS[2:]))))
    return 2 if unread else 0


def _logs(
    arguments: argparse.Namespace, settings: Settings
) -> Iterator[tuple[str, tuple[Flight, ...] | CompanionError]]:
    """The name of each log that was named or is in a folder, with its flights, or with why it cannot be read."""
    from companion.fleet import find_logs, short_names  # noqa: PLC0415  (not needed for one log)

    paths = [log.path for log in find_logs(options.log_paths(arguments), dialect=settings.log.dialect).logs]
    names = short_names(paths)
    return ((names[path], _flights(path, arguments.core, settings)) for path in paths)


def _flights(path: str, core: int | None, settings: Settings) -> tuple[Flight, ...] | CompanionError:
    log = settings.log
    try:
        return read_recording(
            Path(path), dialect=log.dialect, dequantise=log.dequantise, core=core, max_size_gb=log.max_size_gb
        ).flights
    except CompanionError as error:
        return error


def _judged(flight: Flight, settings: Settings, arguments: argparse.Namespace) -> tuple[str, str, str]:
    """Status, sentence, and how far the IMU drifts."""
    lacking = unexaminable(flight, settings)
    if lacking is not None:
        return lacking.verdict.status, clause(lacking.verdict.summary), ""
    try:
        examined = examine(
            flight, settings, imu=arguments.imu, imu_model=arguments.imu_model, correction=arguments.correction
        ).assessment
    except CompanionError as error:
        return "insufficient_data", str(error), ""
    drift = ""
    for row in examined.drift.rows:
        if row.horizon_s == _HORIZON_S and row.attitude_deg is not None:
            parts = [f"{fixed(row.attitude_deg.median)}°"]
            parts += [f"{fixed(row.position_m.median)} m"] if row.position_m is not None else []
            drift = ", ".join(parts)
    return examined.verdict.status, clause(examined.verdict.summary), drift


def _cells(name: str, flight: Flight) -> Iterable[str]:
    yield name
    yield f"{_vehicle(flight)}, boot {flight.boot}"
    yield from _rates(flight, _COLUMNS)
    yield used_imus(flight)
    changes = counted(len(flight.parameter_changes), "parameter")
    yield f"{counted(len(flight.resets), 'reset')}, {changes}"
    yield str(len(flight.notes))


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
