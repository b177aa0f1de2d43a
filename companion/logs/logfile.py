"""Open a log file, compressed or not, and detect its format from its first bytes; every failure is one clear sentence.

Compressed files are read as the bytes that were compressed: gzip, xz, bzip2, Zstandard, and a ZIP archive of one file.
"""

from __future__ import annotations

import bz2
import importlib
import lzma
import mmap
import re
import stat
import zipfile
import zlib
from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np

from companion.installation import missing
from companion.mavlink import DEFAULT_DIALECT, Bytes, Decoder, load_dialect
from companion.model import InputError

CHUNK_BYTES = 4 << 20  # large enough for NumPy's overhead to vanish, small enough for the cache
HEAD_BYTES = 1 << 18
MOST_BYTES = 800_000_000
"""Of content that a compressed log may have, unless more is allowed: a few kilobytes can stand for all memory."""

Format = Literal["mavlink", "dataflash", "dataflash text", "ulog"]

_MAGIC: tuple[tuple[bytes, Format], ...] = ((b"\xa3\x95", "dataflash"), (b"ULog\x01\x12\x35", "ulog"))

_TEXT = re.compile(rb"(?:^|\n)\s*FMT, ?\d+, ?\d+, ?\w+, ?\w+")
TEXT_BYTES = 4096  # in which a log in text declares its first record; older ones begin with a banner


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
            self.compression = compression(file.read(_MAGIC_BYTES))  # "" for none
        self.size_bytes = path.stat().st_size  # of the file
        self.position = 0  # bytes of the file that have been read
        self.content_bytes = 0  # bytes of content that have come out
        self.trouble = ""  # why the rest of it could not be decompressed

    @property
    def facts(self) -> dict[str, Any]:
        """The fields of a `LogFile` that it knows, when all of it has been read."""
        return {name: getattr(self, name) for name in ("path", "size_bytes", "content_bytes", "trouble")}

    def chunks(self, size: int = CHUNK_BYTES) -> Iterator[bytes]:
        """The content in chunks of about `size` bytes.

        A compressed file that is damaged or cut off ends where it can no longer be decompressed; `trouble` says so.
        Raises InputError where nothing can be read, or more than is allowed.
        """
        with open_file(self.path) as file:
            pieces = self._joined(file, size) if self.compression else iter(lambda: file.read(size), b"")
            for chunk in pieces:
                self.position = file.tell()
                self.content_bytes += len(chunk)
                if self.compression and self.content_bytes > self._most:
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
        for piece in decompressed(self.path, file, self.compression):
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
    if b"\0" not in head[:TEXT_BYTES] and _TEXT.search(head[:TEXT_BYTES]):
        return "dataflash text"
    return next((name for magic, name in _MAGIC if head.startswith(magic)), "mavlink")


class Mapped:
    """All bytes of a log. `data` (M,) uint8; those of a compressed file are in memory, as there is no other way."""

    def __init__(self, contents: Contents, progress: Callable[[int], None] | None) -> None:
        """progress: gets how many bytes were looked through. Raises InputError as `Contents` does."""
        self._progress = progress
        self._map: mmap.mmap | None = None
        if not contents.compression:
            with open_file(contents.path) as file:
                self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self.data: Bytes = np.frombuffer(contents.read() if self._map is None else self._map, np.uint8)
        contents.content_bytes = len(self.data)

    def looked_through(self, begin: int, end: int) -> None:
        """Those bytes were read for the first time."""
        self.release(begin, end)
        if self._progress is not None:
            self._progress(end - begin)

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
    return sum(map(len, decoder.decode([read_head(path)]))) >= _FEWEST_FRAMES


_PIECE_BYTES = 1 << 12  # of compressed data: what is lost where it is damaged
_ZLIB = type(zlib.decompressobj())
_MOST_PIECE_BYTES = 1 << 20  # that come out at a time
_ZSTANDARD_BYTES = 128  # of compressed data, of which 4 MiB may come
_LZMA_BYTES = 1 << 28  # for the dictionary of an xz file; the largest that xz makes by itself is 64 MiB
_ERRORS = (EOFError, OSError, ValueError, zlib.error, lzma.LZMAError, zipfile.BadZipFile)
_ZIP_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # of the others, zipfile unpacks what it reads without bound
_MAGIC_BYTES = 6
_KINDS = {
    b"\x1f\x8b": "gzip", b"\xfd7zXZ\x00": "xz", b"BZh": "bzip2", b"\x28\xb5\x2f\xfd": "Zstandard", b"PK\x03\x04": "ZIP",
    b"7z\xbc\xaf\x27\x1c": "a 7-Zip archive", b"Rar!\x1a\x07": "a RAR archive",
}  # fmt: skip
"""What compressed files begin with → the name of the compression; the archives are those that are not unpacked here."""

_DECOMPRESSORS: Mapping[str, Callable[[], Any]] = {
    "gzip": lambda: zlib.decompressobj(wbits=31),
    "xz": lambda: lzma.LZMADecompressor(memlimit=_LZMA_BYTES),
    "bzip2": bz2.BZ2Decompressor,
}

Pieces = Iterator[bytes | str]
"""What comes out; at the very end perhaps, in words, why the rest does not."""


def compression(magic: bytes) -> str:
    """The name of the compression that a file with these first bytes has; "" for none."""
    return next((name for begin, name in _KINDS.items() if magic.startswith(begin)), "")


def decompressed(path: Path, file: BinaryIO, kind: str) -> Pieces:
    """The content of an open file with this compression, in pieces.

    Raises InputError for what cannot be read at all: an archive of several files, or a missing library.
    """
    if kind == "ZIP":
        return _unzipped(path, file)
    if kind == "Zstandard":
        return _unpacked(file, kind, *_zstandard(path))
    if kind in _DECOMPRESSORS:
        return _unpacked(file, kind, _DECOMPRESSORS[kind])
    raise InputError(f"{path} is {kind}: unpack it, and name the log that is in it.")


def _unpacked(file: BinaryIO, name: str, new: Callable[[], Any], error: type[Exception] = EOFError) -> Pieces:
    """All streams of a file, one behind the other, by a decompressor object of the standard library or like those."""
    machine = new()
    while raw := file.read(_PIECE_BYTES):
        while raw:
            if machine.eof:
                raw = raw.lstrip(b"\0")  # gzip and xz allow zeros for padding
                if not raw:
                    break
                machine = new()
            try:
                raw = yield from _unpacked_pieces(machine, raw)
            except (*_ERRORS, MemoryError, error) as reason:
                yield f"its {name} data is damaged ({reason}): what lies before that is read"
                return
    if not machine.eof:
        yield f"its {name} data is cut off: the copy was not finished, and what there is of it is read"


def _unpacked_pieces(machine: Any, raw: bytes) -> Generator[bytes, None, bytes]:
    """What comes out of some compressed bytes, in pieces: a few bytes can stand for gigabytes.

    Returns those that belong to the next stream.
    """
    if isinstance(machine, _ZLIB):
        while raw and not machine.eof:
            if piece := machine.decompress(raw, _MOST_PIECE_BYTES):
                yield piece
            raw = machine.unconsumed_tail
    elif hasattr(machine, "needs_input"):  # of bz2, lzma and Python's own zstd
        while not machine.eof:
            if piece := machine.decompress(raw, _MOST_PIECE_BYTES):
                yield piece
            raw = b""
            if machine.needs_input:
                break
    else:  # the library zstandard bounds nothing, but 4 bytes are 128 KiB at most
        for begin in range(0, len(raw), _ZSTANDARD_BYTES):
            if piece := machine.decompress(raw[begin : begin + _ZSTANDARD_BYTES]):
                yield piece
            if machine.eof:
                return bytes(machine.unused_data) + raw[begin + _ZSTANDARD_BYTES :]
    return bytes(machine.unused_data) if machine.eof else b""


def _zstandard(path: Path) -> tuple[Callable[[], Any], type[Exception]]:
    """What makes a decompressor, and its error: of Python 3.14, else of the library `zstandard`."""
    if (module := _imported("compression.zstd")) is not None:
        return module.ZstdDecompressor, module.ZstdError
    if (module := _imported("zstandard")) is not None:
        return module.ZstdDecompressor().decompressobj, module.ZstdError
    raise missing(
        "zstd",
        f"{path} is compressed with Zstandard, which Python reads by itself from 3.14 on: decompress it first "
        "(zstd -d), or have the library for it",
    )


def _imported(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError:
        return None


def _unzipped(path: Path, file: BinaryIO) -> Pieces:
    try:
        archive = zipfile.ZipFile(file)
        members = [m for m in archive.infolist() if not m.is_dir() and not m.filename.startswith("__MACOSX/")]
        if len(members) != 1:
            names = ", ".join(m.filename for m in members[:5]) + (", ..." if len(members) > 5 else "")
            raise InputError(f"{path} is a ZIP archive of {len(members)} files ({names}): unpack it, and name one log.")
        if members[0].compress_type not in _ZIP_METHODS:
            raise NotImplementedError("it is not packed with Deflate")
        stream = archive.open(members[0])
    except (*_ERRORS, NotImplementedError, RuntimeError) as error:  # RuntimeError: it is encrypted
        raise InputError(f"{path} is a ZIP archive that cannot be unpacked here ({error}): unpack it first.") from None
    return _pieces(stream)


def _pieces(stream: Any) -> Pieces:
    try:
        while piece := stream.read1(1 << 16):
            yield piece
    except (*_ERRORS, MemoryError) as error:
        yield f"its ZIP data is damaged ({error}): what lies before that is read"
