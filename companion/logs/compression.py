"""Compressed files as the bytes that were compressed: gzip, xz, bzip2, Zstandard, and a ZIP archive of one file."""

from __future__ import annotations

import bz2
import importlib
import lzma
import zipfile
import zlib
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from companion.installation import missing
from companion.model import InputError

_PIECE_BYTES = 1 << 12  # of compressed data: what is lost where it is damaged
_ZLIB = type(zlib.decompressobj())
_MOST_BYTES = 1 << 20  # that come out at a time
_ZSTANDARD_BYTES = 128  # of compressed data, of which 4 MiB may come
_LZMA_BYTES = 1 << 28  # for the dictionary of an xz file; the largest that xz makes by itself is 64 MiB
_ERRORS = (EOFError, OSError, ValueError, zlib.error, lzma.LZMAError, zipfile.BadZipFile)
_ARCHIVES = {b"7z\xbc\xaf\x27\x1c": "a 7-Zip archive", b"Rar!\x1a\x07": "a RAR archive"}
_ZIP = b"PK\x03\x04"
_ZIP_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # of the others, zipfile unpacks what it reads without bound
MAGIC_BYTES = 6

Trouble = str
"""Why the rest of a file could not be decompressed; "" when all of it was."""

Pieces = Iterator[bytes | Trouble]
"""What comes out; at the very end perhaps the trouble that ended it."""


def compression(magic: bytes) -> str | None:
    """The name of the compression that a file with these first bytes has; None for none."""
    return next((name for begin, name in _KINDS.items() if magic.startswith(begin)), None)


def decompressed(path: Path, file: BinaryIO, magic: bytes) -> Pieces:
    """The content of an open file, in pieces.

    Raises InputError for what cannot be read at all: an archive of several files, or a missing library.
    """
    for begin, name in _ARCHIVES.items():
        if magic.startswith(begin):
            raise InputError(f"{path} is {name}: unpack it, and name the log that is in it.")
    if magic.startswith(_ZIP):
        return _unzipped(path, file)
    kind = compression(magic)
    if kind == "Zstandard":
        return _unpacked(file, kind, *_zstandard(path))
    if kind == "xz":
        return _unpacked(file, kind, lambda: lzma.LZMADecompressor(memlimit=_LZMA_BYTES))
    if kind == "bzip2":
        return _unpacked(file, kind, bz2.BZ2Decompressor)
    return _unpacked(file, "gzip", lambda: zlib.decompressobj(wbits=31))


_KINDS = {
    b"\x1f\x8b": "gzip", b"\xfd7zXZ\x00": "xz", b"BZh": "bzip2", b"\x28\xb5\x2f\xfd": "Zstandard", _ZIP: "ZIP",
    **_ARCHIVES,
}  # fmt: skip


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
            if piece := machine.decompress(raw, _MOST_BYTES):
                yield piece
            raw = machine.unconsumed_tail
    elif hasattr(machine, "needs_input"):  # of bz2, lzma and Python's own zstd
        while not machine.eof:
            if piece := machine.decompress(raw, _MOST_BYTES):
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
