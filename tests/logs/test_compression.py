"""Compressed logs are read as they are, as far as they go, and say where that is."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
import zstandard

from companion.logs import Contents, log_format, read_tlog
from companion.model import InputError
from tests.links.link import link_frames, stamped
from tests.recordings import BUNDLED

pytestmark = pytest.mark.slow


def zipped(data: bytes, *names: str) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in names or ("flights/one.tlog",):
            archive.writestr(name, data)
        archive.writestr("__MACOSX/._one.tlog", b"resource fork")
    return buffer.getvalue()


PACKERS: dict[str, Callable[[bytes], bytes]] = {
    "gzip": gzip.compress,
    "xz": lzma.compress,
    "bzip2": bz2.compress,
    "Zstandard": lambda data: zstandard.ZstdCompressor().compress(data),
    "ZIP": zipped,
}
STREAMS = [name for name in PACKERS if name != "ZIP"]
LOG = b"".join(stamped(frame, 1_700_000_000_000_000) for frame in link_frames(3000))


@pytest.mark.parametrize("name", PACKERS)
def test_a_compressed_log_is_the_same_log(tmp_path: Path, name: str) -> None:
    path = tmp_path / "any.name"
    path.write_bytes(PACKERS[name](LOG))
    told: list[int] = []
    log = read_tlog(path, progress=told.append)
    assert (log.frames, log.skipped_bytes, log.trouble) == (3000, 0, "")
    assert (log.size_bytes, log.content_bytes) == (path.stat().st_size, len(LOG))
    assert Contents(path).compression == name
    assert log_format(path) == "mavlink"
    if name != "ZIP":  # whose directory stands at the end
        assert sum(told) == path.stat().st_size, "progress is that of the file"


@pytest.mark.parametrize("name", STREAMS)
@pytest.mark.parametrize("lost", [1, 100_000])
def test_a_log_that_was_cut_off_is_read_as_far_as_it_goes_and_says_so(tmp_path: Path, name: str, lost: int) -> None:
    whole = BUNDLED / "copter-demo-100hz.tlog"
    frames = read_tlog(whole).frames
    packed = PACKERS[name](whole.read_bytes())
    path = tmp_path / "cut"
    path.write_bytes(packed[:-lost])
    log = read_tlog(path)
    block = {"bzip2": 0.8, "Zstandard": 0.12}.get(name, 0.0)  # there is no part of a block, which has 900 or 128 kB
    assert frames * (1 - 1.2 * lost / len(packed) - block) - 100 <= log.frames <= frames
    assert f"its {name} data is cut off" in log.trouble


def test_damage_in_the_middle_costs_what_lies_behind_it(tmp_path: Path) -> None:
    path = tmp_path / "damaged.gz"
    packed = bytearray(gzip.compress(LOG))
    packed[len(packed) // 2 : len(packed) // 2 + 64] = bytes(64)
    path.write_bytes(packed)
    log = read_tlog(path)
    assert 1000 < log.frames < 2500
    assert "gzip data is damaged" in log.trouble


def test_logs_packed_one_behind_the_other_are_one(tmp_path: Path) -> None:
    half = len(LOG) // 2
    for name in STREAMS:
        path = tmp_path / name
        path.write_bytes(PACKERS[name](LOG[:half]) + PACKERS[name](LOG[half:]))
        assert Contents(path).read() == LOG
    path = tmp_path / "padded.gz"
    path.write_bytes(gzip.compress(LOG) + bytes(1000))
    contents = Contents(path)
    assert contents.read() == LOG
    assert contents.trouble == ""


def test_an_archive_of_several_logs_names_them(tmp_path: Path) -> None:
    path = tmp_path / "flights.zip"
    path.write_bytes(zipped(LOG, "one.tlog", "two.tlog"))
    with pytest.raises(InputError, match=r"ZIP archive of 2 files \(one.tlog, two.tlog\): unpack it"):
        read_tlog(path)
    path.write_bytes(zipped(LOG)[:5000])
    with pytest.raises(InputError, match="cannot be unpacked"):
        read_tlog(path)
    path.write_bytes(b"7z\xbc\xaf\x27\x1c" + bytes(100))
    with pytest.raises(InputError, match="7-Zip archive: unpack it"):
        read_tlog(path)


def test_without_the_library_the_error_names_the_line_that_installs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.zst"
    path.write_bytes(PACKERS["Zstandard"](LOG))

    def missing(name: str) -> None:
        raise ModuleNotFoundError(name)

    monkeypatch.setattr("importlib.import_module", missing)
    with pytest.raises(InputError, match=r"\[zstd\]'"):
        read_tlog(path)
