"""What is written is whole or not there, and takes the place of nothing but a file."""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from companion.app import files
from companion.cli import main
from companion.model import InputError
from tests.recordings import BUNDLED
from tests.simulated import free_port

DEMO = str(BUNDLED / "copter-mission-default-rates.tlog")


@pytest.mark.parametrize(
    "make",
    [os.mkfifo, lambda path: path.symlink_to("/dev/null"), lambda path: path.symlink_to("nowhere")],
)
def test_what_is_no_file_is_not_replaced(
    tmp_path: Path, make: Callable[[Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "out.json"
    make(path)
    kind = stat.S_IFMT(path.lstat().st_mode)
    assert main(["export", DEMO, "--format", "json", "-o", str(path), "--force"]) == 2
    assert "none of these is replaced" in capsys.readouterr().err
    assert stat.S_IFMT(path.lstat().st_mode) == kind
    assert [entry.name for entry in tmp_path.iterdir()] == ["out.json"]


def test_what_fails_half_way_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "out"
    path.write_text("before")
    with contextlib.suppress(ZeroDivisionError), files.replacing(path) as part:
        part.write_text("half")
        raise ZeroDivisionError
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


def test_a_planted_link_is_not_written_through(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("precious")
    (tmp_path / ".out.part").symlink_to(victim)
    with files.replacing(tmp_path / "out") as part:
        part.write_text("new")
    assert victim.read_text() == "precious"
    assert (tmp_path / "out").read_text() == "new"
    assert (tmp_path / "out").stat().st_mode & 0o777 == 0o666 & ~_umask()


def test_a_link_among_a_folder_of_results_is_not_replaced(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "imu.csv").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="is a link"), files.filling(folder) as part:
        (part / "imu.csv").write_text("new")


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
@pytest.mark.parametrize(("mode", "warned"), [(0o600, False), (0o644, True), (0o640, True)])
def test_a_key_that_others_can_read_is_warned_about(
    tmp_path: Path, mode: int, warned: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    key = tmp_path / "key"
    key.write_text("a passphrase")
    key.chmod(mode)
    link = f"udpin:127.0.0.1:{free_port()}"
    options = ["-o", str(tmp_path / "a.tlog"), "--signing-key-file", str(key), "--duration", "0.1"]
    assert main(["record", link, *options]) == 2, "nobody is heard"
    assert ("chmod 600" in capsys.readouterr().err) == warned


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
