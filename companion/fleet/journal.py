"""The record of an examined log, and the journal that keeps it: a line of JSON per log, written as soon as it is done.

So no end of a run loses it. A record has a digest of the program's analysis and of the settings that made it: rows of
another version are made anew.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import msgspec

from companion.app.files import check, write
from companion.app.sensors import load_imu_spec
from companion.app.settings import Settings
from companion.documents import Document
from companion.fleet.search import FoundLog
from companion.installation import data_folder
from companion.model import InputError, Vehicle
from companion.verdict import Check

MEMORY_GB = 4.0  # for one log
TIMEOUT_S = 600.0


class FlightRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One flight of a log: who flew, with which sensors, and the analysis that `companion analyze --json` prints."""

    vehicle: Vehicle
    boot: int
    duration_s: float
    date_s: float | None = None  # UNIX time of the flight's beginning, s
    board: str | None = None  # serial number of the flight controller
    gyro_ids: Mapping[str, int] = {}  # IMU message → the autopilot's id of the sensor behind it
    accel_ids: Mapping[str, int] = {}
    temperatures_degc: Mapping[str, float] = {}  # IMU message → median over the flight
    gyros: str = ""  # the ids of all gyros that the parameters name
    checks: tuple[Check, ...] = ()  # those before take-off, where it stands
    analysis: Document | None = None
    error: str | None = None  # why there is no analysis
    report: str | None = None  # its page, relative to the folder of the results
    report_error: str | None = None  # why it was not written


class LogRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One log. Without flights, `error` has the reason."""

    sha256: str | None = None  # None when it could not be read
    format: str | None = None
    flights: tuple[FlightRecord, ...] = ()
    error: str | None = None
    settled: bool = True  # False: not the log's own fault, so another run tries again


class Plan(msgspec.Struct, frozen=True, kw_only=True):
    """The options of a run, sent to the workers with each path."""

    version: str  # of program and settings: `version_of`
    settings: bytes  # Settings as MessagePack
    imu: str | None = None
    imu_model: str | None = None
    folder: str | None = None  # of the results, to write reports into; None: no reports
    memory_gb: float = MEMORY_GB  # for one log
    timeout_s: float = TIMEOUT_S  # for one log


MAKING = {
    "model", "mavlink", "installation", "logs", "telemetry", "strapdown", "constants.healthy", "constants.harm",
    "constants.priors", "constants.num", "constants.check", "noise", "estimation", "comparison", "verdict",
    "app.files", "app.settings", "app.sensors", "app.correction", "app.recording", "app.examination",
    "documents", "fleet",
}  # fmt: skip
"""The parts of the program that determine the rows."""

_SHOWING = ("view", "live")  # settings that change no number


def version_of(settings: Settings, imu: str | None, imu_model: str | None) -> str:
    """A digest of everything that the rows of a log depend on, beside the log.

    Raises InputError or SettingsError for an imu_model that is none.
    """
    known = msgspec.to_builtins(settings)
    for section in _SHOWING:
        known.pop(section, None)
    spec = repr(load_imu_spec(imu_model)) if imu_model else None
    made_of = msgspec.json.encode([_program_version(), known, imu, spec], order="sorted")
    return hashlib.sha256(made_of).hexdigest()[:16]


@functools.cache
def _program_version() -> str:
    """A digest of the source that makes the numbers, so that any change of it is noticed, released or not."""
    package = Path(str(files("companion")))
    parts = tuple(f"{part}." for part in MAKING)
    sources = [
        path for path in sorted(package.rglob("*.py")) if ".".join(path.relative_to(package).parts).startswith(parts)
    ]
    digest = hashlib.sha256()
    for path in [*sources, *sorted((data_folder("config") / "imu").glob("*.toml"))]:
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


NAME = "fleet.jsonl"


class _Line(msgspec.Struct, frozen=True):
    path: str
    size_bytes: int
    stamp: str
    version: str
    record: msgspec.Raw  # a LogRecord; of another version it may have had another form


class Journal:
    """The records of one version in a folder: read when opened, and appended to. Another run may append beside it.

    Raises InputError when the folder cannot be made or written to.
    """

    def __init__(self, folder: Path, version: str) -> None:
        self._path = folder / NAME
        self._version = version
        self._known: dict[str, tuple[FoundLog, LogRecord]] = {}  # by path, the latest
        self._same_size: dict[int, dict[str, LogRecord]] = {}  # size → sha256 → record: content under any name
        with _failing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            check(self._path, force=True)
            lines = list(_lines(self._path))
            self._shorten(lines)
            with self._path.open("ab") as file:
                if file.tell() and self._path.read_bytes()[-1:] != b"\n":
                    file.write(b"\n")  # the last run was cut off in the middle of a line
        for line in lines:
            if line.version == version:
                with contextlib.suppress(msgspec.DecodeError):
                    record = msgspec.json.decode(line.record, type=LogRecord)
                    self._remember(FoundLog(line.path, line.size_bytes, line.stamp), record)

    def record(self, log: FoundLog) -> LogRecord | None:
        """What is known of a log that has not changed since, by its name, size and times. None: examine it."""
        log = _printable(log)
        known, record = self._known.get(log.path, (None, None))
        return record if known == log else None

    def same_size(self, log: FoundLog) -> Mapping[str, LogRecord]:
        """What is known of contents of the size of this log, by their sha256."""
        return self._same_size.get(log.size_bytes, {})

    def add(self, log: FoundLog, record: LogRecord) -> LogRecord:
        """Keep what a worker found, and return it: completed when it was a known content under another name."""
        log = _printable(log)
        if record.sha256 and not record.flights and record.error is None:
            record = self._renamed(self._same_size[log.size_bytes][record.sha256], log.path)
        raw = msgspec.Raw(msgspec.json.encode(record))
        line = _Line(log.path, log.size_bytes, log.stamp, self._version, raw)
        with _failing(self._path), self._path.open("ab") as file:
            file.write(msgspec.json.encode(line) + b"\n")
        self._remember(log, record)
        return record

    def _shorten(self, lines: Sequence[_Line]) -> None:
        """Write the file anew without what is superseded when that is more than half of it.

        A record of another version is superseded when this one has its log: a run of a few logs with other options, or
        one that was interrupted, costs the others nothing.
        """
        own = {line.path: line for line in lines if line.version == self._version}
        others = {(line.path, line.version): line for line in lines if line.path not in own}
        latest = [*others.values(), *own.values()]
        if len(lines) > 2 * len(latest):
            write(self._path, b"".join(msgspec.json.encode(line) + b"\n" for line in latest))

    def _renamed(self, record: LogRecord, path: str) -> LogRecord:
        """The record of a known content under another name: its error speaks of the file of its own row."""
        if record.error is None:
            return record
        known = next((name for name, (_, one) in self._known.items() if one is record), path)
        return msgspec.structs.replace(record, error=record.error.replace(known, path))

    def _remember(self, log: FoundLog, record: LogRecord) -> None:
        self._known[log.path] = log, record
        if record.sha256 and record.settled:
            self._same_size.setdefault(log.size_bytes, {})[record.sha256] = record


def _printable(log: FoundLog) -> FoundLog:
    return replace(log, path=printable(log.path))


def printable(path: str) -> str:
    """A path as text: a name need not be UTF-8, JSON and Parquet have to be."""
    return os.fsencode(path).decode("utf-8", "backslashreplace")


def _lines(path: Path) -> Iterator[_Line]:
    if not path.exists():
        return
    for text in path.read_bytes().splitlines():
        with contextlib.suppress(msgspec.DecodeError):  # a line that a crash cut off: that log is examined again
            yield msgspec.json.decode(text, type=_Line)


@contextlib.contextmanager
def _failing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}. Choose another folder with -o.") from None
