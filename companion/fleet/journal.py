"""What is already done: one line of JSON per log, written as soon as it is, so that no end of a run loses it."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

import msgspec

from companion.app.destination import check, replacing
from companion.fleet.records import LogRecord
from companion.fleet.search import FoundLog
from companion.model import InputError

NAME = "fleet.jsonl"


class _Line(msgspec.Struct, frozen=True):
    path: str
    size_bytes: int
    stamp: str
    version: str
    record: msgspec.Raw  # a LogRecord; of another version it may have had another form


class Journal:
    """The records of one version in a folder: read when opened, appended to, closed after use.

    Raises InputError when the folder cannot be made or written to.
    """

    def __init__(self, folder: Path, version: str) -> None:
        self._path = folder / NAME
        self._version = version
        self._lines: dict[str, _Line] = {}  # by path, the latest
        self._records: dict[str, LogRecord] = {}  # by path
        self._same_size: dict[int, dict[str, LogRecord]] = {}  # size → sha256 → record: content under any name
        self._superseded = 0
        with _failing("write", folder):
            folder.mkdir(parents=True, exist_ok=True)
            check(self._path, force=True)
            for line in _lines(self._path):
                self._remember(line)
            self._file = self._path.open("ab")
            if self._file.tell() and self._path.read_bytes()[-1:] != b"\n":
                self._file.write(b"\n")  # the last run was cut off in the middle of a line

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def record(self, log: FoundLog) -> LogRecord | None:
        """What is known of a log that has not changed since, by its name, size and times. None: examine it."""
        line = self._lines.get(printable(log.path))
        if line is None or (line.size_bytes, line.stamp) != (log.size_bytes, log.stamp):
            return None
        return self._records[line.path]

    def same_size(self, log: FoundLog) -> Mapping[str, LogRecord]:
        """What is known of contents of the size of this log, by their sha256."""
        return self._same_size.get(log.size_bytes, {})

    def add(self, log: FoundLog, record: LogRecord) -> LogRecord:
        """Keep what a worker found, and return it: completed when it was a known content under another name."""
        if record.sha256 and not record.flights and record.error is None:
            record = self._same_size[log.size_bytes][record.sha256]
        raw = msgspec.Raw(msgspec.json.encode(record))
        line = _Line(printable(log.path), log.size_bytes, log.stamp, self._version, raw)
        with _failing("write", self._path):
            self._file.write(msgspec.json.encode(line) + b"\n")
            self._file.flush()
        self._remember(line)
        return record

    def close(self) -> None:
        """Close the file; written anew without what is superseded when that is more than half of it."""
        self._file.close()
        if self._superseded <= len(self._lines):
            return
        with _failing("write", self._path), replacing(self._path) as path:
            path.write_bytes(b"".join(msgspec.json.encode(line) + b"\n" for line in self._lines.values()))

    def _remember(self, line: _Line) -> None:
        if line.version != self._version:
            self._superseded += 1
            return
        try:
            record = msgspec.json.decode(line.record, type=LogRecord)
        except msgspec.DecodeError:
            return
        self._superseded += line.path in self._lines
        self._lines[line.path], self._records[line.path] = line, record
        if record.sha256 and record.settled:
            self._same_size.setdefault(line.size_bytes, {})[record.sha256] = record


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
def _failing(what: str, path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot {what} {path}: {error.strerror}. Choose another folder with -o.") from None
