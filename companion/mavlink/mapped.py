"""The bytes of a log for random access: mapped where they lie in a file, and let go again behind the reader."""

from __future__ import annotations

import mmap

import numpy as np

from companion.mavlink.crc import Bytes
from companion.mavlink.logfile import Contents, open_file


class Mapped:
    """All bytes of a log. `data` (M,) uint8; those of a compressed file are in memory, as there is no other way."""

    def __init__(self, contents: Contents) -> None:
        """Raises InputError as `Contents` does."""
        self._map: mmap.mmap | None = None
        if contents.compression is None:
            with open_file(contents.path) as file:
                self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self.data: Bytes = np.frombuffer(contents.read() if self._map is None else self._map, np.uint8)

    def release(self, begin: int, end: int) -> None:
        """Those bytes were read: the system may take their memory back. They can be read again all the same."""
        if self._map is None or not hasattr(self._map, "madvise"):  # Windows takes it back by itself
            return
        first, last = begin - begin % mmap.PAGESIZE, end - end % mmap.PAGESIZE
        if last > first:
            self._map.madvise(mmap.MADV_DONTNEED, first, last - first)
