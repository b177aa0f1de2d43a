"""Whatever is wrong ends in one sentence; a traceback goes into a report, never to the terminal."""

from __future__ import annotations

import errno
import os
import re
import subprocess
import sys
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

from companion.app.files import read_toml
from companion.app.settings import load_settings
from companion.cli import main
from companion.model import SettingsError
from tests.recordings import BUNDLED

DEMO = str(BUNDLED / "copter-demo-100hz.tlog")


@pytest.mark.parametrize(
    "error", [IndexError("20"), MemoryError(), RecursionError("deep"), ZeroDivisionError(), TimeoutError()]
)
def test_what_nobody_foresaw_is_one_sentence_a_report_and_an_exit_code(
    error: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("companion.cli.info.run_info", broken)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert main(["info", DEMO]) == 70
    said = capsys.readouterr().err
    assert said.startswith("companion: internal error (a bug in companion)")
    assert "Traceback" not in said
    assert said.count("\n") == 1
    found = re.search(r"Send in (\S+)", said)
    assert found
    report = Path(found[1])
    assert report.parent == tmp_path
    assert report.stat().st_mode & 0o077 == 0, "the command line may hold what others need not see"
    text = report.read_text()
    assert "Traceback (most recent call last)" in text
    assert type(error).__name__ in text
    assert repr(DEMO) in text


def test_a_broken_installation_is_one_sentence_too(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def gone(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr("importlib.metadata.version", gone)
    monkeypatch.setattr(sys.modules["companion.cli.main"], "parser", lambda _: gone("x"))
    assert main(["info", DEMO]) == 70
    assert capsys.readouterr().err.count("\n") == 1


def test_an_output_that_takes_nothing_is_no_fault_of_ours(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("companion.cli.info.run_info", full)
    monkeypatch.setattr("sys.stdout", None)
    assert main(["info", DEMO]) == 2
    assert capsys.readouterr().err == "companion: the output cannot be written: No space left on device\n"


def test_a_report_that_cannot_be_written_is_no_second_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def broken(*_: object) -> None:
        raise KeyError("gone")

    monkeypatch.setattr("companion.cli.info.run_info", broken)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "missing"))
    assert main(["info", DEMO]) == 70
    assert "cannot be written" in capsys.readouterr().err


def test_warnings_of_numpy_stay_off_the_terminal() -> None:
    """-W shows them again to who develops."""
    code = (
        "import warnings, companion.__main__ as m; import companion.cli as c; c.main = lambda: warnings.warn('x') or 0"
    )
    for option, shown in ((), False), (("-W", "always"), True):
        done = subprocess.run(
            [sys.executable, *option, "-c", f"{code}; m.main()"],
            capture_output=True, text=True, check=True, env={**os.environ, "PYTHONWARNINGS": ""},
        )  # fmt: skip
        assert bool(done.stderr) == shown


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("[live]\nimu_hz = 1  # µs\n".encode("cp1252"), "line 2: the byte B5 is not UTF-8"),
        (b"a = 1\nb = " + b"[" * 3000 + b"]" * 3000, "line 2: .* nested too deep"),
        (b"a = " + b"9" * 5000, "too long"),
        (b"a = = 1", "not valid TOML"),
        (b"\xff\xfe\x00", "line 1: the byte FF"),
    ],
)
def test_a_toml_file_that_is_none_is_a_clear_error(tmp_path: Path, content: bytes, told: str) -> None:
    path = tmp_path / "file.toml"
    path.write_bytes(content)
    with pytest.raises(SettingsError, match=f"file.toml.*{told}"):
        read_toml(path)
    with pytest.raises(SettingsError, match=told):
        load_settings(path)


def test_a_byte_order_mark_is_none_of_the_settings(tmp_path: Path) -> None:
    path = tmp_path / "file.toml"
    path.write_bytes(b"\xef\xbb\xbf[live]\r\nimu_hz = 50\r\n")
    assert load_settings(path).live.imu_hz == 50
