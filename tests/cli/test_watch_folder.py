"""`companion watch-folder`: a log is judged when it is whole, and not before."""

from __future__ import annotations

import json
import shutil
import signal
import sys
from pathlib import Path

import pytest

from companion.app.settings import Settings
from companion.cli import main
from companion.cli.watch import settled, verdicts
from tests.processes import COMPANION, ended, next_line, started
from tests.tlogs import resting

pytest.importorskip("watchfiles", reason="no watchfiles here: pip install 'mavlink-companion[watch]'")


def test_a_log_is_whole_when_it_has_not_grown_for_a_while(tmp_path: Path) -> None:
    log = tmp_path / "a.tlog"
    log.write_bytes(b"1")
    growing = {log: (-1, 0.0), tmp_path / "gone.part": (-1, 0.0)}
    assert settled(growing, 3.0, 10.0) == []
    assert list(growing) == [log], "a download's temporary name is gone"
    assert settled(growing, 3.0, 12.9) == []
    log.write_bytes(b"12")
    assert settled(growing, 3.0, 13.5) == [], "it has grown"
    assert settled(growing, 3.0, 16.4) == []
    assert settled(growing, 3.0, 16.5) == [log]
    assert growing == {}


def test_what_is_no_log_is_passed_over_and_a_broken_one_is_told(tmp_path: Path) -> None:
    (tmp_path / "firmware.bin").write_bytes(bytes(1000))
    (tmp_path / "empty.tlog").write_bytes(b"")
    (tmp_path / "broken.tlog.gz").write_bytes(b"\x1f\x8b broken")
    told = [line for path in sorted(tmp_path.iterdir()) for line in verdicts(path, tmp_path, Settings())]
    assert [line["log"] for line in told] == ["broken.tlog.gz"]
    assert "error" in told[0]


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C of another process")
def test_each_log_that_comes_is_judged_and_a_command_hears_of_it(tmp_path: Path) -> None:
    folder, heard = tmp_path / "logs", tmp_path / "heard.txt"
    (folder / "QUADROTOR").mkdir(parents=True)
    log = resting(tmp_path / "rest.tlog")
    shutil.copy(log, folder / "old.tlog")
    script = tmp_path / "hear.py"
    script.write_text(f"import sys; open({str(heard)!r}, 'a').write(sys.stdin.read() + chr(10))")
    options = ["--json", "--existing", "--settle", "0.2", "--run", f"{sys.executable} {script}"]
    with started(*COMPANION, "watch-folder", str(folder), *options) as process:
        first = json.loads(next_line(process, process.stdout))
        shutil.copy(log, folder / "QUADROTOR" / "new.tlog")
        second = json.loads(next_line(process, process.stdout))
        ended(process, signal.SIGINT)
    assert process.returncode == 0
    assert [first["log"], second["log"]] == ["old.tlog", str(Path("QUADROTOR", "new.tlog"))]
    assert {first["status"], second["status"]} == {"insufficient_data"}
    assert [json.loads(line) for line in heard.read_text().splitlines()] == [first, second]


def test_a_folder_that_there_is_not(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["watch-folder", str(tmp_path / "none")]) == 2
    assert "there is no folder" in capsys.readouterr().err
