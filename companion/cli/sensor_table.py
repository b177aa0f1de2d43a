"""`companion info LOG... --table`: which sensors and estimates each of many flights has, a line per flight."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

from companion.analysis import Item, inventory, used_imus
from companion.app.recording import read_recording
from companion.app.settings import Settings
from companion.cli import options
from companion.model import CompanionError, Flight, counted

_COLUMNS = {
    "IMU": "IMU", "GPS": "GPS", "compass": "compass", "barometer": "barometer", "airspeed": "airspeed",
    "range finder": "range", "optical flow": "flow", "attitude": "attitude", "other attitude": "other attitude",
    "position": "position", "IMU bias": "bias", "test ratios": "ratios", "innovations": "innovations",
    "aiding": "aiding", "variances": "variances", "accuracies": "accuracies", "vibration": "vibration",
    "desired attitude": "desired", "motors and servos": "motors", "batches": "batches", "truth": "truth",
}  # fmt: skip
"""Kind of an item of the inventory → heading; in this order."""

_HEADINGS = ("log", "vehicle", *_COLUMNS.values(), "IMU used", "announced", "notes")


def print_table(arguments: argparse.Namespace) -> int:
    """A Markdown table of all flights in the logs: of each kind the rates of its sources, Hz. Exit code 2 where a log
    cannot be read.
    """
    from companion.fleet import find_logs, short_names  # noqa: PLC0415  (not needed for one log)

    settings = options.settings_of(arguments)
    logs = [log.path for log in find_logs(options.log_paths(arguments), dialect=settings.log.dialect).logs]
    names, unread = short_names(logs), 0
    print(_line(_HEADINGS))
    print(_line("---" for _ in _HEADINGS))
    for path in logs:
        try:
            flights = _flights(path, arguments.core, settings)
        except CompanionError as error:
            unread += 1
            print(_line((names[path], f"not read: {error}", *("" for _ in _HEADINGS[2:]))))
            continue
        for flight in flights:
            print(_line(_cells(names[path], flight)), flush=True)
        if not flights:
            print(_line((names[path], "no vehicle", *("" for _ in _HEADINGS[2:]))))
    return 2 if unread else 0


def _flights(path: str, core: int | None, settings: Settings) -> tuple[Flight, ...]:
    log = settings.log
    return read_recording(
        Path(path), dialect=log.dialect, dequantise=log.dequantise, core=core, max_size_gb=log.max_size_gb
    ).flights


def _cells(name: str, flight: Flight) -> Iterable[str]:
    items: dict[str, list[Item]] = {}
    for item in inventory(flight):
        items.setdefault(item.kind, []).append(item)
    yield name
    yield f"{flight.vehicle.autopilot} {flight.vehicle}, boot {flight.boot}"
    for kind in _COLUMNS:
        yield " ".join(_rate(item) for item in items.get(kind, []))
    yield used_imus(flight)
    changes = counted(len(flight.parameter_changes), "parameter")
    yield f"{counted(len(flight.resets), 'reset')}, {changes}"
    yield str(len(flight.notes))


def _rate(item: Item) -> str:
    """Hz, or how many where there is no rate."""
    return f"{item.samples}×" if item.rate_hz is None else f"{item.rate_hz:.3g}"


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "/").replace("\n", " ") for cell in cells) + " |"
