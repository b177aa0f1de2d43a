"""Whether a file of any name is a log: told by its first bytes alone."""

from __future__ import annotations

from pathlib import Path

from companion.mavlink.dialect import DEFAULT_DIALECT, load_dialect
from companion.mavlink.frames import Decoder
from companion.mavlink.logfile import log_format, read_head

_FEWEST_FRAMES = 3  # a right checksum happens by chance, in a large file of something else


def looks_like_a_log(path: str | Path, *, dialect: str = DEFAULT_DIALECT) -> bool:
    """Whether a file, compressed or not, begins as an on-board log does or has MAVLink frames in its first 256 KiB.

    Raises InputError if it cannot be opened, is empty or cannot be decompressed.
    """
    path = Path(path)
    if log_format(path) != "mavlink":
        return True
    decoder = Decoder(load_dialect(dialect), stamped=False)
    return len(decoder.push(read_head(path))) + len(decoder.finish()) >= _FEWEST_FRAMES
