"""From paths to logs: files, folders searched for logs by their content, and patterns."""

from __future__ import annotations

import glob
import hashlib
import os
import stat
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from companion.logs import looks_like_a_log
from companion.mavlink import DEFAULT_DIALECT
from companion.model import CompanionError, InputError

_LOGS = (".tlog", ".ulg", ".px4log")
# Firmware and archives have these names too: logs are detected from their content.
_PERHAPS = (".bin", ".log", ".gz", ".xz", ".bz2", ".zst", ".zip")


@dataclass(frozen=True, slots=True)
class FoundLog:
    """A file to examine, as it was when it was found."""

    path: str  # absolute
    size_bytes: int
    stamp: str  # changes when the file does: modification and change times, ns


def find_logs(paths: Sequence[str], *, dialect: str = DEFAULT_DIALECT) -> Search:
    """The logs that the paths stand for, each file once.

    A file that is named is taken as it is. A folder is searched through and through, symbolic links followed: .tlog and
    .ulg are taken, .bin, .log and compressed files when their content is a log's. A path with * ? or [ is a
    pattern, ** any depth. Raises InputError for a path that is none of these, and when no log is found.
    """
    search = Search(dialect)
    for path in paths:
        for name in _expanded(path):
            if Path(name).is_dir():
                search.folder(name)
            else:
                search.file(name)
    if not search.logs:
        searched = ", ".join(paths)
        names = [*(f"{folder} ({why})" for folder, why in search.closed.items()), *search.no_logs]
        passed = f" Passed over: {_some(names)}." if names else ""
        raise InputError(
            f"no logs in {searched}: folders are searched for .tlog, .ulg, .bin, .log and compressed logs."
            f"{passed} Name the folder or the files."
        )
    return search


def short_names(paths: Sequence[str]) -> dict[str, str]:
    """Each path by as many of its last parts as make it unique."""
    short: dict[str, str] = {}
    waiting, parts = sorted(set(paths)), 1
    while waiting:
        names = {path: "/".join(path.replace(os.sep, "/").split("/")[-parts:]) for path in waiting}
        counts = Counter(names.values())
        whole = {path for path, name in names.items() if len(name) >= len(path)}
        short |= {path: name for path, name in names.items() if counts[name] == 1 or path in whole}
        waiting = [path for path in waiting if path not in short]
        parts += 1
    return short


def digest_of(path: str | Path) -> str:
    """The sha256 of a file. Raises OSError where it cannot be read."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


class Search:
    """What was found, what was passed over, and where it has been."""

    def __init__(self, dialect: str) -> None:
        self._dialect = dialect
        self._logs: dict[str, FoundLog] = {}  # by the path without symbolic links
        self.no_logs: list[str] = []  # named like logs, but something else by their content
        self.closed: dict[str, str] = {}  # folders that cannot be searched → the reason
        self._been: set[tuple[int, int]] = set()  # device and inode of folders: links may run in circles

    @property
    def logs(self) -> tuple[FoundLog, ...]:
        """In the order of their paths."""
        return tuple(sorted(self._logs.values(), key=lambda log: log.path))

    def folder(self, top: str) -> None:
        """Take the logs in a folder and below it."""
        for folder, below, files in os.walk(top, followlinks=True, onerror=self._refused):
            status = Path(folder).stat()
            if (status.st_dev, status.st_ino) in self._been:
                below.clear()
                continue
            self._been.add((status.st_dev, status.st_ino))
            below.sort()
            for name in files:
                path = os.path.join(folder, name)  # noqa: PTH118  (a folder may hold tens of thousands)
                ending = os.path.splitext(name)[1].lower()  # noqa: PTH122
                if ending in _LOGS or (ending in _PERHAPS and self._is_log(path)):
                    self.file(path)

    def file(self, path: str) -> None:
        """Take a file, unless it is no regular one: a pipe would never end."""
        path = os.path.abspath(path)  # noqa: PTH100  (resolve would follow links, and lose the name the user knows)
        try:
            status = os.stat(path)  # noqa: PTH116
        except OSError:
            log = FoundLog(path, 0, "unknown")  # a dangling link, no permission: the worker reports the error
        else:
            if not stat.S_ISREG(status.st_mode):
                self.no_logs.append(path)
                return
            log = FoundLog(path, status.st_size, f"{status.st_mtime_ns}-{status.st_ctime_ns}")
        self._logs.setdefault(os.path.realpath(path), log)

    def _is_log(self, path: str) -> bool:
        try:
            if not stat.S_ISREG(os.stat(path).st_mode):  # noqa: PTH116
                return False
            if looks_like_a_log(path, dialect=self._dialect):
                return True
        except OSError:
            return True  # it cannot be read: the error goes into its row
        except CompanionError:
            if not path.lower().endswith(".zip"):  # of several files, or of something else
                return True
        self.no_logs.append(path)
        return False

    def _refused(self, error: OSError) -> None:
        self.closed[str(error.filename)] = error.strerror or str(error)


def _expanded(path: str) -> Iterator[str]:
    """A path, or what a pattern stands for. A file whose name has brackets is a file."""
    if os.path.lexists(path):
        yield path
        return
    if not glob.has_magic(path):
        raise InputError(f"there is no file or folder {path}: check the path.")
    matches = sorted(glob.glob(path, recursive=True))  # noqa: PTH207  (of a text that may be absolute)
    if not matches:
        raise InputError(f"no file matches {path}: check the pattern.")
    yield from matches


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - 5} more" if len(names) > 5 else ""
    return ", ".join(names[:5]) + more
