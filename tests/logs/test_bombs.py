"""Small files that stand for large ones end early, in one sentence, and in little memory."""

from __future__ import annotations

import bz2
import gzip
import lzma
import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest

import companion as c
from companion.app.recording import read_recording
from companion.logs.dataflash import read_dataflash
from companion.logs.dataflash_text import read_dataflash_text
from companion.logs.logfile import compression, decompressed
from companion.model import InputError

pytestmark = pytest.mark.slow

FMT = b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", 128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
ULOG = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1000)
ZEROS = bytes(30_000_000)


def zstandard(data: bytes) -> bytes:
    found = pytest.importorskip("zstandard")
    packed: bytes = found.ZstdCompressor().compress(data)
    return packed


@pytest.mark.parametrize("pack", [gzip.compress, lzma.compress, bz2.compress, zstandard])
def test_what_is_decompressed_comes_in_pieces(tmp_path: Path, pack: Callable[[bytes], bytes]) -> None:
    path = tmp_path / "zeros"
    path.write_bytes(pack(ZEROS))
    size = most = 0
    tracemalloc.start()
    with path.open("rb") as file:
        kind = compression(file.read(6))
        file.seek(0)
        assert kind
        for piece in decompressed(path, file, kind):
            assert isinstance(piece, bytes)
            size, most = size + len(piece), max(most, len(piece))
    assert tracemalloc.get_traced_memory()[1] < 20_000_000
    tracemalloc.stop()
    assert size == len(ZEROS)
    assert most <= 4 << 20


@pytest.mark.parametrize("head", [FMT, ULOG, b""])
def test_a_compressed_log_that_grows_too_large_says_so(tmp_path: Path, head: bytes) -> None:
    path = tmp_path / "bomb.gz"
    path.write_bytes(gzip.compress(head + ZEROS))
    with pytest.raises(InputError, match=r"bomb.gz grows to more than 0.01 GB .* --max-size"):
        read_recording(path, max_size_gb=0.01)


def test_a_log_of_nothing_but_heads_takes_little_memory(tmp_path: Path) -> None:
    path = tmp_path / "heads.bin"
    path.write_bytes(FMT + b"\xa3\x95\x80" * 1_000_000)
    tracemalloc.start()
    log = read_dataflash(path)
    assert tracemalloc.get_traced_memory()[1] < 80_000_000
    tracemalloc.stop()
    assert log.frames <= 2


NAMES = b",".join(b"c%d" % i for i in range(20_000))


@pytest.mark.parametrize(
    "lines",
    [
        b"\n" * 120_000,
        b",\n" * 60_000,
        b"".join(b"N%d,\n" % i for i in range(25_000)),
        b"".join(b"FMT, 130, 9, N%d, B, X\n" % i for i in range(6_000)),
        b"FMT, 130, 9, BIG, " + b"B" * 20_000 + b", " + NAMES + b"\nBIG, 1\n",
        b"FMT, " + b"9" * 5000 + b", 9, BIG, B, X\n",
        b"FMT, 130, 9, ONE, Q, TimeUS\n" + b"ONE, 1\n" * 20_000 + b"ONE, " + b"1" * 100_000 + b"\n",
        b"FMT, 131, 9, UNIT, QbZ, TimeUS,Id,Label\nUNIT, 1, " + b"9" * 5000 + b", m\n",
    ],
    ids=["ends of lines", "commas", "names", "types", "columns", "a long type", "a long number", "a long unit"],
)
def test_a_text_log_of_absurd_sizes_takes_little_memory(tmp_path: Path, lines: bytes) -> None:
    path = tmp_path / "log.log"
    path.write_bytes(
        b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 1, 9, X, Q, TimeUS\nX, 7\n" + lines
    )
    tracemalloc.start()
    log = read_dataflash_text(path)
    assert tracemalloc.get_traced_memory()[1] < 10_000_000
    tracemalloc.stop()
    assert len(log.messages["X"]) == 1


@pytest.mark.parametrize(
    "formats",
    [
        [f"t{i}:t{i + 1}[200] a;" for i in range(8)] + ["t8:float[200] a;"],
        ["t0:t0 a;"],
        ["t0:t1 a;", "t1:t0 a;"],
        [f"t{i}:t{i + 1} a;" for i in range(200)] + ["t200:float a;"],
        ["t0:float[65535] a;"],
        ["t0:float[999999999] a;"],
    ],
)
def test_a_ulog_type_that_no_message_can_hold_is_a_clear_error(tmp_path: Path, formats: list[str]) -> None:
    body = b"".join(struct.pack("<HB", len(text), ord("F")) + text.encode() for text in formats)
    added = b"\0\1\0t0"
    (tmp_path / "deep.ulg").write_bytes(ULOG + body + struct.pack("<HB", len(added), ord("A")) + added)
    with pytest.raises(InputError, match=r"deep.ulg .* declares 't\d+' with more bytes than a message can have"):
        c.open_log(tmp_path / "deep.ulg")
