"""`companion analyze LOG LOG ...`: the verdict on each flight of several logs, a row each."""

from __future__ import annotations

import argparse
from pathlib import Path

from rich import box
from rich.markup import escape
from rich.table import Table

from companion.app.examination import examine, unexaminable
from companion.app.recording import read_recording
from companion.app.settings import Settings
from companion.cli import options, tables
from companion.model import CompanionError, Flight, SettingsError
from companion.present import fixed

_HORIZON_S = 10.0
_OF_ONE = ("json", "full", "vehicle", "boot")


def print_table(arguments: argparse.Namespace) -> int:
    """Every flight of the logs and folders that were named. Exit code 2 where a log cannot be read, else as for one."""
    from companion.fleet import find_logs, short_names  # noqa: PLC0415  (not needed for one log)

    if given := [f"--{name}" for name in _OF_ONE if getattr(arguments, name)]:
        raise SettingsError(f"{' and '.join(given)} is of one log: name one. For many logs: companion fleet.")
    settings = options.settings_of(arguments)
    logs = [log.path for log in find_logs(options.log_paths(arguments), dialect=settings.log.dialect).logs]
    names, unread, statuses = short_names(logs), 0, list[str]()
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    for heading in ("log", "flight", "verdict", f"after {_HORIZON_S:g} s"):
        table.add_column(heading, overflow="fold")
    for path in logs:
        try:
            flights = _flights(path, arguments.core, settings)
        except CompanionError as error:
            unread += 1
            table.add_row(escape(names[path]), "", f"[red]not read[/]: {escape(str(error))}", "")
            continue
        for flight in flights:
            status, words, drift = _judged(flight, settings, arguments)
            statuses.append(status)
            who = f"{flight.vehicle}, boot {flight.boot}, {flight.duration:.0f} s"
            verdict = f"{tables.status_text(status)}: {escape(words)}"
            table.add_row(escape(names[path]), who, verdict, drift)
        if not flights:
            table.add_row(escape(names[path]), "", "no vehicle", "")
    tables.console().print(table)
    if unread:
        return 2
    return options.exit_code(arguments.fail_on, statuses)


def _judged(flight: Flight, settings: Settings, arguments: argparse.Namespace) -> tuple[str, str, str]:
    """Status, sentence, and how far the IMU drifts."""
    lacking = unexaminable(flight, settings)
    if lacking is not None:
        return lacking.verdict.status, lacking.verdict.summary, ""
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
    return examined.verdict.status, examined.verdict.summary, drift


def _flights(path: str, core: int | None, settings: Settings) -> tuple[Flight, ...]:
    log = settings.log
    return read_recording(
        Path(path), dialect=log.dialect, dequantise=log.dequantise, core=core, max_size_gb=log.max_size_gb
    ).flights
