"""Recordings of a link: a tlog that is made while it runs, and one that is played on a link again at its own pace.

What is recorded never overwrites anything, and a full disk stops nothing else.

`play`, for those who test clients, is the one place that sends what a log holds, which may be anything. So it never
takes a serial port, and a session with a vehicle, whose allow-list is in `requests`, has no way to it.
"""

from __future__ import annotations

import contextlib
import errno
import os
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from io import FileIO
from pathlib import Path
from typing import Self

import numpy as np

from companion.links.transports import Port
from companion.logs import Contents
from companion.mavlink import Decoder, Dialect, Frames, log_time
from companion.model import InputError, counted

_LOOK_S = 1.0  # between two looks whether the file is still there


class Recorder:
    """Writes every frame as it comes, byte for byte (signatures and unknown extensions too), behind a time stamp.

    Each is with the operating system at once, so that a kill -9 loses none.

    path: a new file; by default `YYYY-MM-DD hh-mm-ss.tlog` in the current folder, as ground stations name theirs.
    Raises InputError when the file exists already, is a pipe or a device, or cannot be written.
    """

    def __init__(self, path: str | Path | None = None) -> None:
        self._file: FileIO | None
        if path is None:
            self.path, self._file = _begun(time.strftime("%Y-%m-%d %H-%M-%S"))
        else:
            self.path, self._file = Path(path), _at(Path(path))
        self.size_bytes = self.frames = 0  # that are in the file, whole
        self.problem = ""  # why nothing is written any more
        self._looked = time.monotonic()

    def write(self, frames: Frames) -> None:
        """Add the frames that have just been received. After a failure nothing is written; see `problem`."""
        if self._file is None or not len(frames):
            return
        stamp = round(time.time() * 1e6).to_bytes(8, "big")
        spans = zip(frames.start.tolist(), frames.size.tolist(), strict=True)
        left = memoryview(b"".join(stamp + frames.data[start : start + size].tobytes() for start, size in spans))
        try:
            while left:  # a disk that is nearly full takes a part
                left = left[self._file.write(left) :]
        except OSError as error:
            full = error.errno in (errno.ENOSPC, errno.EDQUOT)
            self._end(
                f"{self.path}: {'the disk is full' if full else error.strerror}; the recording ends here. "
                f"Safe in it: {counted(self.frames, 'frame')} ({counted(self.size_bytes, 'byte')})."
            )
            return
        self.size_bytes += int(frames.size.sum()) + 8 * len(frames)
        self.frames += len(frames)
        now = time.monotonic()
        if now - self._looked >= _LOOK_S:
            self._looked = now
            if _is_deleted(self._file):
                lost = self.frames
                self.frames = self.size_bytes = 0
                self._end(f"{self.path} has been deleted: the recording ends here, and its {lost:,} frames are lost.")

    def _end(self, problem: str) -> None:
        """Keep what is whole, and say why there is no more."""
        self.problem = problem
        if self._file is not None:
            with contextlib.suppress(OSError):
                self._file.truncate(self.size_bytes)
        self.close()

    def close(self) -> None:
        """Close the file. A recording of nothing is not left behind."""
        if self._file is None:
            return
        deleted = _is_deleted(self._file)  # then what is there now is not ours
        with contextlib.suppress(OSError):  # what a full disk did not take is reported in `problem`
            self._file.close()
        self._file = None
        if not self.size_bytes and not deleted:
            with contextlib.suppress(OSError):  # someone has taken it away
                if self.path.is_file():
                    self.path.unlink()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _is_deleted(file: FileIO) -> bool:
    """Whether it has been removed from its folder, so that nobody can open what is written any more."""
    try:
        return os.fstat(file.fileno()).st_nlink == 0
    except OSError:  # its file system has gone, as the next write says
        return False


def _new(path: Path) -> FileIO:
    """A new file. Raises InputError if there is one, or it cannot be written."""
    try:
        return path.open("xb", buffering=0)
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror}): choose another place.") from None


def _at(path: Path) -> FileIO:
    """A new file that was named."""
    if os.path.lexists(path):
        kind = "exists already" if path.is_file() or path.is_symlink() else "is no new file"
        raise InputError(f"{path} {kind}, and a recording is never written over anything: choose another name.")
    return _new(path)


def _begun(stem: str) -> tuple[Path, FileIO]:
    """A new file in this folder: two that begin in one second record beside each other."""
    number = 1
    while True:
        path = Path(f"{stem} {number}.tlog" if number > 1 else f"{stem}.tlog")
        try:
            return path, _new(path)
        except InputError:
            if not os.path.lexists(path):  # it is not the name that is in the way
                raise
        number += 1


_STEP_S = 0.005  # the longest sleep: what the other side says is read and thrown away meanwhile
_SET_S = 3600.0  # a stamp that is further from the latest is of a clock that was set, or damage
_LATE_S = 0.5  # so far behind, the pace begins anew: a machine that was asleep does not send hours at once


@dataclass(slots=True)
class Played:
    """What went out, and what did not."""

    sent: Counter[str] = field(default_factory=Counter)  # message → frames
    unheard: int = 0  # frames that were due while nobody was there
    left_out: Counter[str] = field(default_factory=Counter)  # SYSID:COMPID → frames of senders that were not chosen
    bytes: int = 0


def play(
    path: Path,
    port: Port,
    dialect: Dialect,
    *,
    senders: Collection[tuple[int, int]] | None = None,
    speed: float = 1.0,
    stop: Callable[[], bool] = lambda: False,
) -> Played:
    """Send the frames of a .tlog as they are, byte for byte, at `speed` times the pace of its stamps, until `stop()`.

    senders: (sysid, compid) of those whose frames are sent; None for all. A peer that is there and does not read is
    waited for; the pace begins anew behind it, and where the log's clock was set by more than an hour. Other stamps
    that go back, and those that cannot be, are taken as the one before. Raises InputError for a log without stamps.
    """
    played = Played()
    pace: tuple[float, float] | None = None  # (clock, log time) s that stand for one another
    latest = -np.inf  # s, log time
    for t, who, name, frame in _frames(path, dialect):
        if stop():
            break
        if abs(t - latest) > _SET_S:
            pace, latest = None, t
        latest = max(latest, t)
        if senders is not None and who not in senders:
            played.left_out[f"{who[0]}:{who[1]}"] += 1
            continue
        now = time.monotonic()
        pace = pace or (now, latest)
        due = pace[0] + (latest - pace[1]) / speed
        if now - due > _LATE_S:
            pace = (now, latest)
        while not stop() and (left := due - time.monotonic()) > 0:
            _listen(port)
            time.sleep(min(left, _STEP_S))
        _listen(port)
        while not (went := port.write(frame)) and port.busy and not stop():
            time.sleep(_STEP_S)
            _listen(port)
        if went:
            played.sent[name] += 1
            played.bytes += len(frame)
        elif not stop():
            played.unheard += 1
    return played


def _listen(port: Port) -> None:
    port.wait(0.0)
    port.read()


def _frames(path: Path, dialect: Dialect) -> Iterator[tuple[float, tuple[int, int], str, bytes]]:
    """Stamp in s (that of the one before where there is none), sender, name and bytes of every valid frame."""
    decoder = Decoder(dialect, stamped=True)
    last: float | None = None
    for frames in decoder.decode(Contents(path).chunks()):
        if not len(frames):
            continue
        stamped = log_time(frames.stamp)
        known = np.isfinite(stamped)
        if last is None:  # what stands before the first stamp goes out with it
            if not known.any():
                raise InputError(
                    f"{path} has no time stamps, so that its pace is not known: name a telemetry log (.tlog)."
                )
            last = float(stamped[known][0])
        before = np.maximum.accumulate(np.where(known, np.arange(len(stamped)), -1))
        times = np.where(before < 0, last, stamped[before])
        last = float(times[-1])
        columns = (times, frames.sysid, frames.compid, frames.id, frames.start, frames.size)
        for t, sysid, compid, number, start, size in zip(*(column.tolist() for column in columns), strict=True):
            yield t, (sysid, compid), dialect.by_id[number].name, frames.data[start : start + size].tobytes()
