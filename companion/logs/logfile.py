"""Open a log file, compressed or not, and detect its format from its first bytes; every failure is one clear sentence.

Of a file that is no flight log it says what it is instead.
"""

from __future__ import annotations

import mmap
import re
import stat
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Literal

import numpy as np

from companion.logs.compression import MAGIC_BYTES, compression, decompressed
from companion.mavlink import DEFAULT_DIALECT, Bytes, Decoder, load_dialect
from companion.model import InputError

CHUNK_BYTES = 4 << 20  # large enough for NumPy's overhead to vanish, small enough for the cache
HEAD_BYTES = 1 << 18
MOST_BYTES = 800_000_000
"""Of content that a compressed log may have, unless more is allowed: a few kilobytes can stand for all memory."""

Format = Literal["mavlink", "dataflash", "dataflash text", "ulog"]

_MAGIC: tuple[tuple[bytes, Format], ...] = ((b"\xa3\x95", "dataflash"), (b"ULog\x01\x12\x35", "ulog"))

_TEXT = re.compile(rb"(?:^|\n)\s*FMT, ?\d+, ?\d+, ?\w+, ?\w+")
_TEXT_BYTES = 4096  # in which a log in text declares its first record; older ones begin with a banner


def open_file(path: Path) -> BinaryIO:
    """A file opened for reading; every reason why it cannot be is an InputError."""
    try:
        kind = path.stat().st_mode
        if not stat.S_ISREG(kind) and not stat.S_ISDIR(kind):  # to open a pipe may wait for ever
            raise InputError(
                f"{path} is a pipe or a device, and a log is read more than once: save what comes out of it to a file, "
                "and name that."
            )
        return path.open("rb")
    except FileNotFoundError:
        raise InputError(f"There is no file {path}: check the path.") from None
    except IsADirectoryError:
        raise InputError(f"{path} is a directory, not a log: name one of the files in it.") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): check its permissions.") from None


@dataclass(frozen=True, slots=True, eq=False)
class LogFile:
    """What a log file of any format was found to be."""

    path: Path
    size_bytes: int  # of the file
    content_bytes: int  # the same, but of what it holds where it is compressed
    trouble: str  # why the rest could not be decompressed; "" when all of it was
    frames: int  # valid ones, of known ids; records; messages of all types
    skipped_bytes: int  # that belong to none: damage, or the filling of the last page


class Contents:
    """What is in a log file, decompressed: `chunks` reads it, and the rest says how far that has come."""

    def __init__(self, path: Path, most_bytes: int = MOST_BYTES) -> None:
        """most_bytes: of content, where it is compressed. Raises as `open_file`."""
        self.path = path
        self._most = most_bytes
        with open_file(path) as file:
            self._magic = file.read(MAGIC_BYTES)
        self.compression = compression(self._magic)  # None for none
        self.size_bytes = path.stat().st_size  # of the file
        self.position = 0  # bytes of the file that have been read
        self.content_bytes = 0  # bytes of content that have come out
        self.trouble = ""  # why the rest of it could not be decompressed

    def chunks(self, size: int = CHUNK_BYTES) -> Iterator[bytes]:
        """The content in chunks of about `size` bytes.

        A compressed file that is damaged or cut off ends where it can no longer be decompressed; `trouble` says so.
        Raises InputError where nothing can be read, or more than is allowed.
        """
        with open_file(self.path) as file:
            pieces = iter(lambda: file.read(size), b"") if self.compression is None else self._joined(file, size)
            for chunk in pieces:
                self.position = file.tell()
                self.content_bytes += len(chunk)
                if self.compression is not None and self.content_bytes > self._most:
                    raise InputError(
                        f"{self.path} grows to more than {self._most / 1e9:g} GB when it is decompressed, from "
                        f"{self.size_bytes / 1e6:.1f} MB: it is no log, or a very large one. Take it as it is with "
                        "--max-size GB, or decompress it first."
                    )
                yield chunk

    def read(self, progress: Callable[[int], None] | None = None) -> bytes:
        """All of it at once; `progress` gets the bytes of the file that each chunk took."""
        return b"".join(self.watched(progress))

    def watched(self, progress: Callable[[int], None] | None) -> Iterator[bytes]:
        """The chunks; `progress` gets the bytes of the file that each took."""
        position = 0
        for chunk in self.chunks():
            yield chunk
            if progress is not None:
                progress(self.position - position)
                position = self.position

    def _joined(self, file: BinaryIO, size: int) -> Iterator[bytes]:
        pieces: list[bytes] = []
        held = 0
        for piece in decompressed(self.path, file, self._magic):
            if isinstance(piece, str):
                self.trouble = piece
                break
            pieces.append(piece)
            held += len(piece)
            if held >= size:
                yield b"".join(pieces)
                pieces, held = [], 0
        if pieces:
            yield b"".join(pieces)


def read_head(path: Path) -> bytes:
    """The first 256 KiB of a log, decompressed.

    Raises InputError if it cannot be opened, is empty or cannot be decompressed.
    """
    contents = Contents(path)
    head = next(contents.chunks(HEAD_BYTES), b"")
    if head:
        return head
    if contents.size_bytes:
        why = f" ({contents.trouble.partition(':')[0]})" if contents.trouble else ""
        raise InputError(f"{path} is compressed, but nothing can be decompressed from it{why}: copy it again.")
    raise InputError(f"{path} is empty (0 bytes): nothing was recorded, or the copy failed. Copy it again.")


def log_format(path: str | Path) -> Format:
    """What a file is by its first bytes; "mavlink" where nothing else is recognised. Raises as `read_head`."""
    head = read_head(Path(path))
    if b"\0" not in head[:_TEXT_BYTES] and _TEXT.search(head[:_TEXT_BYTES]):
        return "dataflash text"
    return next((name for magic, name in _MAGIC if head.startswith(magic)), "mavlink")


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


_OTHER_MAGIC = {
    b"\x89PNG\r\n\x1a\n": "a PNG picture",
    b"\xff\xd8\xff": "a JPEG picture",
    b"GIF8": "a GIF picture",
    b"%PDF-": "a PDF document",
    b"\x7fELF": "a program (ELF)",
    b"MZ": "a program for Windows",
    b"SQLite format 3\0": "an SQLite database",
    b"#ROSBAG V": "a ROS bag",
    b"\x89MCAP0\r\n": "an MCAP recording",
    b"MATLAB 5.0 MAT-file": "a MATLAB file",
    b"\x89HDF\r\n\x1a\n": "an HDF5 file",
    b"PAR1": "a Parquet table",
    b"H Product:Blackbox": "a blackbox log of Betaflight or INAV",
    b"\xd4\xc3\xb2\xa1": "a network capture (pcap)",
    b"\n\r\r\n": "a network capture (pcapng)",
    b"version https://git-lfs": "a pointer of Git LFS in place of the file itself (git lfs pull fetches it)",
}
"""First bytes → what begins so."""

_WITHIN = {  # at another place than the beginning: where, bytes
    b"ftyp": (4, "a video (MP4)"),
    b"WEBP": (8, "a WebP picture"),
    b"AVI ": (8, "a video (AVI)"),
}

_MARKUP = re.compile(rb"\s*(?:\xef\xbb\xbf)?<(?P<tag>!doctype html|html|\?xml|svg|kml|gpx)", re.IGNORECASE)
_TEXT_SHOWN = 40
_FOREIGN = 0.05  # of the letters, in another encoding than UTF-8
_NO_TEXT = re.compile(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f\x7f]")  # commands to a terminal, without ESC and blanks


def what_else(path: Path, head: bytes) -> str:
    """What a file is: "a PNG picture", "blank, nothing but zeros"; "" where that is unknown.

    head: its first bytes, decompressed.
    """
    if kind := next((kind for magic, kind in _OTHER_MAGIC.items() if head.startswith(magic)), ""):
        return kind
    if kind := next((kind for magic, (at, kind) in _WITHIN.items() if head.startswith(magic, at)), ""):
        return kind
    if head.strip(head[:1]) == b"" and _is_blank(path, head[:1]):
        filling = "zeros" if head[:1] == b"\0" else f"bytes of {head[:1].hex().upper()}"
        return f"blank, nothing but {filling}"
    return _text(head[:_TEXT_BYTES])


def _is_blank(path: Path, filling: bytes) -> bool:
    return all(chunk.strip(filling) == b"" for chunk in Contents(path).chunks())


def _text(head: bytes) -> str:
    if _NO_TEXT.search(head):
        return ""
    if markup := _MARKUP.match(head):
        tag = markup["tag"].decode("ascii").lower()
        return "a web page (HTML)" if "html" in tag else "an XML document"
    text = head.decode("utf-8", "replace")
    if text.count("\N{REPLACEMENT CHARACTER}") > _FOREIGN * len(text):
        return ""
    line = next((line.strip() for line in text.splitlines() if line.strip()), "")
    shown = "".join(letter for letter in line if letter.isprintable())[:_TEXT_SHOWN]
    return f'text that begins with "{shown}"' if shown else "blank, nothing but white space"
