"""The recording of a live link: a tlog that is never overwritten and whose full disk stops nothing else."""

from __future__ import annotations

import contextlib
import errno
import time
from itertools import count
from pathlib import Path
from typing import Self

from companion.errors import InputError
from companion.mavlink.frames import Frames
from companion.mavlink.tlog import TlogWriter


class Recorder:
    """Writes every frame as it comes; each is with the operating system at once, so that a kill -9 loses none.

    path: a new file; by default `YYYY-MM-DD hh-mm-ss.tlog` in the current folder, as ground stations name theirs.
    Raises InputError when the file exists already or cannot be written.
    """

    def __init__(self, path: str | Path | None = None) -> None:
        self.path = Path(path) if path is not None else _unused(time.strftime("%Y-%m-%d %H-%M-%S"))
        if path is not None and self.path.is_file():
            raise InputError(f"{self.path} exists already, and a recording is never overwritten: choose another name.")
        self.size_bytes = 0
        self.problem = ""  # why nothing is written any more
        self._writer: TlogWriter | None = TlogWriter(self.path)

    def write(self, frames: Frames) -> None:
        """Add the frames that have just been received. After a failure nothing is written; see `problem`."""
        if self._writer is None or not len(frames):
            return
        try:
            self._writer.write(frames, time.time())
        except OSError as error:
            full = error.errno in (errno.ENOSPC, errno.EDQUOT)
            self.problem = (
                f"{self.path}: {'the disk is full' if full else error.strerror}; the recording ends here, after "
                f"{self.size_bytes:,} bytes. Everything else goes on."
            )
            self.close()
            return
        self.size_bytes += int(frames.size.sum()) + 8 * len(frames)

    def close(self) -> None:
        """Close the file. A recording of nothing is not left behind."""
        if self._writer is None:
            return
        with contextlib.suppress(OSError):  # what a full disk did not take is reported in `problem`
            self._writer.close()
        self._writer = None
        if not self.size_bytes and self.path.is_file():  # and no device
            with contextlib.suppress(OSError):  # someone has taken it away
                self.path.unlink()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _unused(stem: str) -> Path:
    """A new file in this folder: two that begin in one second record beside each other."""
    for number in count(1):
        path = Path(f"{stem} {number}.tlog" if number > 1 else f"{stem}.tlog")
        try:
            path.touch(exist_ok=False)
        except FileExistsError:
            continue
        except OSError:  # the writer says what is wrong with this place
            pass
        break
    return path
