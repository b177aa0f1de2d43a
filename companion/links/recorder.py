"""The recording of a live link: a tlog that is never overwritten and whose full disk stops nothing else."""

from __future__ import annotations

import contextlib
import errno
import os
import time
from pathlib import Path
from typing import Self

from companion.logs import TlogWriter
from companion.mavlink import Frames
from companion.model import InputError, counted

_LOOK_S = 1.0  # between two looks whether the file is still there


class Recorder:
    """Writes every frame as it comes; each is with the operating system at once, so that a kill -9 loses none.

    path: a new file; by default `YYYY-MM-DD hh-mm-ss.tlog` in the current folder, as ground stations name theirs.
    Raises InputError when the file exists already, is a pipe or a device, or cannot be written.
    """

    def __init__(self, path: str | Path | None = None) -> None:
        self._writer: TlogWriter | None
        if path is None:
            self.path, self._writer = _begun(time.strftime("%Y-%m-%d %H-%M-%S"))
        else:
            self.path, self._writer = Path(path), _at(Path(path))
        self.size_bytes = self.frames = 0  # that are in the file, whole
        self.problem = ""  # why nothing is written any more
        self._looked = time.monotonic()

    def write(self, frames: Frames) -> None:
        """Add the frames that have just been received. After a failure nothing is written; see `problem`."""
        if self._writer is None or not len(frames):
            return
        try:
            self._writer.write(frames, time.time())
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
            if self._writer.deleted:
                lost = self.frames
                self.frames = self.size_bytes = 0
                self._end(f"{self.path} has been deleted: the recording ends here, and its {lost:,} frames are lost.")

    def _end(self, problem: str) -> None:
        """Keep what is whole, and say why there is no more."""
        self.problem = problem
        if self._writer is not None:
            with contextlib.suppress(OSError):
                self._writer.cut(self.size_bytes)
        self.close()

    def close(self) -> None:
        """Close the file. A recording of nothing is not left behind."""
        if self._writer is None:
            return
        deleted = self._writer.deleted  # then what is there now is not ours
        with contextlib.suppress(OSError):  # what a full disk did not take is reported in `problem`
            self._writer.close()
        self._writer = None
        if not self.size_bytes and not deleted and self.path.is_file():
            with contextlib.suppress(OSError):  # someone has taken it away
                self.path.unlink()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _at(path: Path) -> TlogWriter:
    """A new file that was named."""
    if os.path.lexists(path):
        kind = "exists already" if path.is_file() or path.is_symlink() else "is no new file"
        raise InputError(f"{path} {kind}, and a recording is never written over anything: choose another name.")
    return TlogWriter(path)


def _begun(stem: str) -> tuple[Path, TlogWriter]:
    """A new file in this folder: two that begin in one second record beside each other."""
    number = 1
    while True:
        path = Path(f"{stem} {number}.tlog" if number > 1 else f"{stem}.tlog")
        try:
            return path, TlogWriter(path)
        except InputError:
            if not os.path.lexists(path):  # it is not the name that is in the way
                raise
        number += 1
