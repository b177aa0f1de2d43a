"""Open a log file, compressed or not, and tell its format by its first bytes; every failure is one clear sentence."""

from __future__ import annotations

import contextlib
import gzip
import importlib
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, Literal

from companion.errors import InputError

CHUNK_BYTES = 2 << 20  # large enough for NumPy's overhead to vanish, small enough for the cache
HEAD_BYTES = 1 << 18

Format = Literal["mavlink", "dataflash", "ulog"]

_GZIP = b"\x1f\x8b"
_ZSTD = b"\x28\xb5\x2f\xfd"
_MAGIC: tuple[tuple[bytes, Format], ...] = ((b"\xa3\x95", "dataflash"), (b"ULog\x01\x12\x35", "ulog"))


def open_file(path: Path) -> BinaryIO:
    """A file opened for reading; every reason why it cannot be is an InputError."""
    try:
        return path.open("rb")
    except FileNotFoundError:
        raise InputError(f"There is no file {path}: check the path.") from None
    except IsADirectoryError:
        raise InputError(f"{path} is a directory, not a log: name one of the files in it.") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): check its permissions.") from None


def read_head(path: Path) -> bytes:
    """The first 256 KiB of a log, decompressed.

    Raises InputError if it cannot be opened, is empty or cannot be decompressed.
    """
    head = next(read_chunks(path, HEAD_BYTES), b"")
    if head:
        return head
    if path.stat().st_size:
        raise InputError(f"{path} is compressed, but nothing can be decompressed from it: copy it again.")
    raise InputError(f"{path} is empty (0 bytes): nothing was recorded, or the copy failed. Copy it again.")


def log_format(path: str | Path) -> Format:
    """What a file is by its first bytes; "mavlink" where nothing else is recognised. Raises as `read_head`."""
    head = read_head(Path(path))
    return next((name for magic, name in _MAGIC if head.startswith(magic)), "mavlink")


def read_chunks(path: Path, size: int = CHUNK_BYTES) -> Iterator[bytes]:
    """The content of a file in chunks of about `size` bytes, decompressed; raises as `open_file`.

    A compressed file that is damaged or cut off ends where it can no longer be decompressed.
    """
    with open_file(path) as file:
        magic = file.read(len(_ZSTD))
        file.seek(0)
        if magic.startswith(_GZIP):
            yield from _decompressed(gzip.GzipFile(fileobj=file), size)
        elif magic == _ZSTD:
            yield from _decompressed(_zstd(path).open(file), size)
        else:
            while chunk := file.read(size):
                yield chunk


def is_compressed(path: Path) -> bool:
    """Whether `read_chunks` decompresses it; raises as `open_file`."""
    with open_file(path) as file:
        magic = file.read(len(_ZSTD))
    return magic.startswith(_GZIP) or magic == _ZSTD


def _decompressed(file: Any, size: int) -> Iterator[bytes]:
    """The chunks of a file object of gzip or compression.zstd."""
    pieces: list[bytes] = []
    with contextlib.suppress(EOFError, OSError, zlib.error):  # what came before the damage is still worth reading
        while piece := file.read1(1 << 16):  # what it has; `read` would lose it where the data is cut
            pieces.append(piece)
            if sum(map(len, pieces)) >= size:
                yield b"".join(pieces)
                pieces = []
    if pieces:
        yield b"".join(pieces)


def _zstd(path: Path) -> Any:
    try:
        return importlib.import_module("compression.zstd")
    except ModuleNotFoundError:
        raise InputError(
            f"{path} is compressed with Zstandard, which Python reads from 3.14 on: decompress it first (zstd -d)."
        ) from None
