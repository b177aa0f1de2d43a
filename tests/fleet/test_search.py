"""Which files of a folder are taken for logs."""

from __future__ import annotations

import gzip
import os
import sys
import zipfile
from pathlib import Path

import pytest

from companion.fleet import find_logs, short_names
from companion.model import InputError
from tests.recordings import BUNDLED

TLOG = (BUNDLED / "copter-mission-default-rates.tlog").read_bytes()[:20000]
DATAFLASH = b"\xa3\x95\x80\x80\x59" + bytes(100)


def names(*paths: Path | str) -> list[str]:
    return [Path(log.path).name for log in find_logs([str(path) for path in paths]).logs]


def test_a_folder_is_searched_by_content(tmp_path: Path) -> None:
    below = tmp_path / "2024" / "märz 🚁"
    below.mkdir(parents=True)
    (below / "a.TLOG").write_bytes(TLOG)
    (below / "a.tlog.gz").write_bytes(gzip.compress(TLOG))
    for name, logs in {"b.zip": ["b.tlog"], "two.zip": ["b.tlog", "c.tlog"]}.items():
        with zipfile.ZipFile(tmp_path / name, "w") as archive:
            for log in logs:
                archive.writestr(log, TLOG)
    (tmp_path / "b.BIN").write_bytes(DATAFLASH)
    (tmp_path / "c.ulg").write_bytes(b"ULog\x01\x12\x35")
    (tmp_path / "firmware.bin").write_bytes(bytes(range(256)) * 40)
    (tmp_path / "archive.gz").write_bytes(gzip.compress(b"letters " * 500))
    (tmp_path / "notes.txt").write_text("no log")
    found = find_logs([str(tmp_path)])
    assert [Path(log.path).name for log in found.logs] == ["a.TLOG", "a.tlog.gz", "b.BIN", "b.zip", "c.ulg"]
    assert sorted(Path(path).name for path in found.no_logs) == ["archive.gz", "firmware.bin", "two.zip"]


def test_what_cannot_be_read_is_taken_so_that_its_row_says_why(tmp_path: Path) -> None:
    (tmp_path / "empty.bin").touch()
    (tmp_path / "dangling.tlog").symlink_to(tmp_path / "nowhere")
    assert names(tmp_path) == ["dangling.tlog", "empty.bin"]


def test_each_file_once_however_it_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.tlog").write_bytes(TLOG)
    (tmp_path / "other name.tlog").symlink_to("a.tlog")
    (tmp_path / "circle").symlink_to(tmp_path, target_is_directory=True)
    assert len(names(tmp_path, tmp_path / "a.tlog", f"{tmp_path}/*.tlog")) == 1


def test_logs_of_one_name_in_two_folders_are_two(tmp_path: Path) -> None:
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "a.tlog").write_bytes(TLOG)
    assert names(tmp_path) == ["a.tlog", "a.tlog"]


def test_patterns(tmp_path: Path) -> None:
    (tmp_path / "deep" / "er").mkdir(parents=True)
    (tmp_path / "deep" / "er" / "a.tlog").write_bytes(TLOG)
    (tmp_path / "[b].tlog").write_bytes(TLOG)
    assert names(f"{tmp_path}/**/*.tlog") == ["[b].tlog", "a.tlog"]
    assert names(tmp_path / "[b].tlog") == ["[b].tlog"], "a file whose name looks like a pattern"


def test_a_named_file_is_taken_whatever_it_is_called(tmp_path: Path) -> None:
    (tmp_path / "telemetry.dat").write_bytes(TLOG)
    assert names(tmp_path / "telemetry.dat") == ["telemetry.dat"]


@pytest.mark.skipif(sys.platform in {"win32", "darwin"}, reason="names are UTF-8 there")
def test_a_name_that_is_not_utf8(tmp_path: Path) -> None:
    Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xff.tlog")).write_bytes(TLOG)
    assert len(names(tmp_path)) == 1


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.tlog")
    os.mkfifo(tmp_path / "pipe.bin")
    with pytest.raises(InputError, match="no logs"):
        find_logs([str(tmp_path)])


@pytest.mark.parametrize(
    ("path", "expected"),
    [("", "no logs in .*are searched for"), ("/nowhere", "no file or folder"), ("/*.x", "no file matches")],
)
def test_nothing_found(path: str, expected: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=expected):
        find_logs([f"{tmp_path}{path}"])


@pytest.mark.skipif(sys.platform == "win32", reason="there it parts folders")
def test_a_backslash_in_a_name_is_of_the_name() -> None:
    """As the fleet writes the bytes of a name that is no UTF-8."""
    assert short_names([path := "/logs/b\\xe4r.tlog"]) == {path: "b\\xe4r.tlog"}
