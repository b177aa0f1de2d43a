"""`-`: a log that is piped in."""

from __future__ import annotations

import gzip
import io
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

from companion.cli import main
from tests.dataflash_writer import write_dataflash
from tests.processes import COMPANION, ended, started
from tests.recordings import BUNDLED
from tests.waiting import wait_for

LOG = BUNDLED / "copter-mission-default-rates.tlog"

Captured = pytest.CaptureFixture[str]
Piped = Callable[..., int]


class Terminal(io.BytesIO):
    """A stdin at which somebody sits."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def piped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Piped:
    """Runs a command with this on its stdin, and sees that nothing of it is left."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))

    def run(content: bytes | io.BytesIO, *words: str) -> int:
        monkeypatch.setattr(
            sys, "stdin", io.TextIOWrapper(io.BytesIO(content) if isinstance(content, bytes) else content)
        )
        code = main(words)
        assert not list(folder.iterdir())
        return code

    return run


@pytest.mark.parametrize("pack", [bytes, gzip.compress])
def test_it_is_the_log_of_that_content(pack: Callable[[bytes], bytes], piped: Piped, capsys: Captured) -> None:
    assert piped(pack(LOG.read_bytes()), "info", "-", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert main(["info", str(LOG), "--json"]) == 0
    named = json.loads(capsys.readouterr().out)
    assert found["flights"] == named["flights"]
    assert found["log"]["path"] == "stdin"
    assert found["log"]["content_bytes"] == named["log"]["content_bytes"]


def test_its_kind_is_told_by_its_bytes(piped: Piped, tmp_path: Path, capsys: Captured) -> None:
    log = write_dataflash(
        tmp_path / "of.bin", {"PARM": ("QNf", "TimeUS,Name,Value")}, [("PARM", (1, "SYSID_THISMAV", 1.0))]
    )
    assert piped(log.read_bytes(), "info", "-") == 0
    assert "stdin: 209 bytes, 3 messages" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ["analyze", "-"],
        ["analyze", "-", "demo"],
        ["info", "demo", "-"],
        ["smooth", "-"],
        ["noise", "-"],
        ["lanes", "-"],
        ["incident", "-", "--at", "60"],
        ["preflight", "-"],
        ["calibrate", "-"],
        ["compare", "-", "demo"],
        ["compare", "demo", "-"],
        ["compare", "-", "--method-b", "euler"],
        ["export", "-", "--format", "json", "-o", "OUT.json"],
        ["report", "-", "-o", "OUT.html", "--no-playback"],
    ],
    ids=" ".join,
)
def test_every_command_that_takes_a_log_takes_it(
    words: list[str], piped: Piped, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Captured
) -> None:
    monkeypatch.chdir(tmp_path)
    content = (BUNDLED / "copter-hover-100hz.tlog").read_bytes()
    assert piped(content, *words) == 0
    said = capsys.readouterr()
    assert "temporary" not in said.out + said.err
    for file in tmp_path.glob("OUT.*"):
        assert "temporary" not in file.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("content", "words", "reason"),
    [
        (b"", ["analyze", "-"], r"stdin is empty \(0 bytes\)"),
        (Terminal(), ["analyze", "-"], "stdin is a terminal: pipe a log in"),
        (bytes(2000), ["analyze", "-", "--max-size", "1e-6"], "stdin has more than 1e-06 GB: .*--max-size"),
        (gzip.compress(bytes(9_000_000)), ["info", "-", "--max-size", "1e-3"], r"stdin grows to more than 0\.001 GB"),
        (b"no log", ["analyze", "-"], r'stdin is not a flight log: it is text that begins with "no log"'),
        (b"7z\xbc\xaf\x27\x1c", ["info", "-"], "companion: stdin is a 7-Zip archive"),
        (b"a log", ["compare", "-", "-"], "- stands for the log on stdin, which is read once"),
        (b"a log", ["info", "-", "demo", "-"], "which is read once"),
    ],
    ids=["empty", "terminal", "limit", "bomb", "no log", "7-Zip", "twice", "twice beside a log"],
)
def test_what_is_no_log_is_one_sentence(
    content: bytes | io.BytesIO, words: list[str], reason: str, piped: Piped, capsys: Captured
) -> None:
    assert piped(content, *words) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1
    assert re.search(reason, said), said


def test_a_closed_stdin_is_said(capsys: Captured, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", None)
    assert main(["analyze", "-"]) == 2
    assert "stdin is closed" in capsys.readouterr().err


def test_a_full_disk_is_said(piped: Piped, capsys: Captured) -> None:
    class Full(io.BytesIO):
        def read(self, *_: object) -> bytes:
            raise OSError(28, "No space left on device")

    assert piped(Full(), "analyze", "-") == 2
    assert "stdin cannot be kept in" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="no signal that can be caught")
@pytest.mark.parametrize("end", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_leaves_no_file(end: signal.Signals, tmp_path: Path) -> None:
    environment = os.environ | {"TMPDIR": str(tmp_path)}
    with started(*COMPANION, "analyze", "-", stdin=subprocess.PIPE, env=environment) as process:
        wait_for(lambda: list(tmp_path.glob("companion-*/stdin")), "stdin is kept")
        ended(process, end)
    assert process.returncode == 128 + end
    assert not list(tmp_path.iterdir())
