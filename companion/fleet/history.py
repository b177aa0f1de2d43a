"""The checks before take-off of a vehicle's earlier flights: from its logs, or from the tables of a fleet."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from companion.app.recording import Recording, read_recording
from companion.app.sensors import preflight_of
from companion.app.settings import Settings
from companion.fleet.rows import Row, arrow_table
from companion.fleet.search import digest_of, find_logs
from companion.installation import missing
from companion.model import CompanionError, DataError, Flight, InputError
from companion.telemetry import id_parameters
from companion.verdict import Check

TABLE = "preflight.parquet"
"""Of a fleet's results: a row for each check of each flight."""


def checks_of(flight: Flight) -> tuple[Check, ...]:
    """Those before take-off that have a size; none where the vehicle never stands."""
    try:
        checks = preflight_of(flight).checks
    except DataError:
        return ()
    return tuple(one for one in checks if math.isfinite(one.size) and math.isfinite(one.sigma))


def earlier_checks(history: Path, settings: Settings, recording: Recording, flight: Flight) -> list[tuple[Check, ...]]:
    """Those before each other flight of the same vehicle. history: a folder of logs or results, or a table.

    Raises InputError for a table that is none of a fleet's, or that nothing installed can read.
    """
    table = history / TABLE if history.is_dir() else history
    if table.suffix == ".parquet" and table.is_file():
        return list(_of_table(table, recording, flight))
    return list(_of_logs(history, settings, recording, flight))


def gyros_of(flight: Flight) -> str:
    """The autopilot's ids of all of its gyros, in order; "" where its parameters do not tell them."""
    ids = (int(flight.parameters.get(name, 0.0)) for i in range(3) for name in id_parameters("gyro", i))
    return " ".join(map(str, sorted({number for number in ids if number})))


def _of_logs(folder: Path, settings: Settings, recording: Recording, flight: Flight) -> Iterator[tuple[Check, ...]]:
    own = digest_of(recording.source.file)
    for one in find_logs([str(folder)], dialect=settings.log.dialect).logs:
        try:
            if digest_of(one.path) == own:
                continue
            flights = read_recording(Path(one.path), **settings.log.options).flights
        except (CompanionError, OSError):  # what cannot be read tells of no rest
            continue
        same = (other for other in flights if _is_same(_identity(other), _identity(flight)))
        yield from (checks for other in same if (checks := checks_of(other)))


def _of_table(table: Path, recording: Recording, flight: Flight) -> Iterator[tuple[Check, ...]]:
    """The rows of each flight of the vehicle, but for those of the log itself."""
    own = digest_of(recording.source.file)
    flights: dict[tuple[object, ...], list[Check]] = {}
    for row in _rows(table):
        who = row["gyros"] or "", (row["autopilot"], row["type"], row["vehicle"].partition(":")[0])
        if row["sha256"] != own and _is_same(who, _identity(flight)):
            flights.setdefault((row["log"], row["vehicle"], row["boot"]), []).append(
                Check(row["check"], row["sensor"], row["size"], row["sigma"], row["limit"], row["unit"] or "",
                      row["outcome"], row["probability"], uncorrected=row["uncorrected"])
            )  # fmt: skip
    yield from map(tuple, flights.values())


def _rows(table: Path) -> list[Row]:
    try:
        import pyarrow as pa  # noqa: PLC0415  (an extra)
        import pyarrow.parquet as pq  # noqa: PLC0415
    except ImportError:
        raise missing("fleet", f"{table} is read with pyarrow") from None
    expected = arrow_table("preflight", ()).schema
    try:
        rows: list[Row] = pq.read_table(table).select(expected.names).cast(expected).to_pylist()
    except (OSError, KeyError, pa.ArrowException) as error:
        reason = str(error.args[0] if error.args else error).splitlines()[0]
        raise InputError(
            f"{table} is no table of checks before take-off ({reason}): give the {TABLE} that `companion fleet` writes."
        ) from None
    return rows


_Identity = tuple[str, tuple[str, str, str]]
"""The ids of its gyros, "" where they are not known; autopilot, type and system id."""


def _identity(flight: Flight) -> _Identity:
    vehicle = flight.vehicle
    return gyros_of(flight), (vehicle.autopilot, vehicle.type, str(vehicle.sysid))


def _is_same(one: _Identity, other: _Identity) -> bool:
    return one[0] == other[0] if one[0] and other[0] else one[1] == other[1]
