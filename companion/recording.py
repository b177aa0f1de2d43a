"""From a file to its flights: the one way in for logs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from companion.mavlink import Log, load_dialect, read_tlog
from companion.telemetry import flights
from companion.tracks import Flight


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A log and the flights found in it."""

    log: Log  # what was read: bytes, frames, damage, messages by type
    flights: tuple[Flight, ...]


def read_recording(path: str | Path, *, dialect: str = "ardupilotmega", dequantise: bool = False) -> Recording:
    """The flights of a .tlog: one per vehicle and boot, in SI units, FRD and NED.

    A damaged log is read as far as possible; `Recording.log` has the counts. Raises InputError when there is no such
    file or no MAVLink in it, SettingsError for an unknown dialect.
    """
    names = load_dialect(dialect)
    log = read_tlog(path, dialect=dialect)
    return Recording(log, tuple(flights(log, names, dequantise=dequantise)))


def open_log(path: str | Path, *, dialect: str = "ardupilotmega", dequantise: bool = False) -> list[Flight]:
    """The flights of a log, as `read_recording` gives them: an empty list when no vehicle speaks in it."""
    return list(read_recording(path, dialect=dialect, dequantise=dequantise).flights)
