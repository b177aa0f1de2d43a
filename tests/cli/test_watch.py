"""`companion watch` as services run it: JSON lines, a recording, an exit code; what it tells others, and when.

`companion watch-folder`: a log is judged when it is whole, and not before.
"""

from __future__ import annotations

import json
import shlex
import shutil
import signal
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import companion as c
from companion.app.settings import Settings
from companion.cli import main, watch
from companion.cli.watch import settled, verdicts
from companion.links.requests import ALLOWED_MESSAGES
from companion.verdict import LiveVerdict
from tests.links.link import link_frames
from tests.links.peers import listener
from tests.processes import COMPANION, ended, next_line, started
from tests.simulated import flying, free_port
from tests.tlogs import resting
from tests.waiting import meanwhile, wait_for


def lines(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


@pytest.mark.slow
def test_a_service_watches_records_and_leaves_the_vehicle_as_it_was(tmp_path: Path) -> None:
    port = free_port()
    command = f"{shlex.quote(sys.executable)} -c \"import sys; open('changes', 'a').write(sys.stdin.read() + chr(10))\""
    words = ("-o", "a.tlog", "--on-change", command, "--fail-on", "insufficient")
    with (
        flying(port, since=30.0) as vehicle,
        started(*COMPANION, "watch", f"udpin:127.0.0.1:{port}", *words, cwd=tmp_path) as process,
    ):
        found: list[dict[str, Any]] = []

        def consistent() -> bool:
            found.append(json.loads(next_line(process, process.stdout)))  # one a second
            return bool(found[-1]["status"] == "consistent")

        wait_for(consistent)
        wait_for(lambda: (tmp_path / "changes").exists() and "consistent" in (tmp_path / "changes").read_text())
        rest, told = ended(process, signal.SIGTERM)
        assert process.returncode == 0
        assert set(vehicle.received) <= ALLOWED_MESSAGES
        wait_for(lambda: vehicle.interval_us("RAW_IMU") == -1)
    found += lines(rest)
    before = ["", *(line["status"] for line in found)]
    assert [line["changed"] for line in found] == [line["status"] != b for line, b in zip(found, before, strict=False)]
    assert (found[-1]["vehicle"], found[-1]["status_so_far"], found[-1]["alarms"]) == ("1:1", "consistent", [])
    assert found[-1]["received_hz"]["RAW_IMU"] > 10.0
    assert "Traceback" not in told
    (flight,) = c.open_log(tmp_path / "a.tlog")
    assert len(flight.imu()) > 500
    assert flight.gps
    assert flight.barometers


def test_what_counts_at_the_end_is_what_was_said_while_the_link_was_open(monkeypatch: pytest.MonkeyPatch) -> None:
    """A TCP port that is closed is silent."""

    class Says:
        vehicles = ("1:1",)

        def __init__(self, *_: object) -> None:
            self.said = LiveVerdict("consistent", "so it is", 1.0, "1:1", age_s=0.5, was_consistent=True)

        def read(self, _: str, *, silent: bool) -> LiveVerdict:
            return replace(self.said, silent=silent)

        def __enter__(self) -> Says:
            return self

        def __exit__(self, *_: object) -> None: ...

        def receive(self, _: object) -> None: ...

        def close(self) -> None: ...

    monkeypatch.setattr(watch, "RunningVerdict", Says)
    with listener() as server:

        def send() -> None:
            with server.accept()[0] as peer:
                peer.sendall(b"".join(link_frames(50)))
                peer.recv(1)  # until it is closed

        words = ["watch", f"tcp:127.0.0.1:{server.getsockname()[1]}", "--no-record", "--listen-only"]
        with meanwhile(send):
            assert main([*words, "--duration", "0.5", "--fail-on", "insufficient"]) == 0


@pytest.mark.slow
def test_it_waits_for_the_vehicle_and_fails_when_none_comes(capsys: pytest.CaptureFixture[str]) -> None:
    silent = f"udpin:127.0.0.1:{free_port()}"
    assert main(["watch", silent, "--no-record", "--duration", "0.5"]) == 2
    assert main(["watch", silent, "--no-record", "--wait", "0.5"]) == 2
    said, told = capsys.readouterr()
    assert told.count("nothing was received") == 2
    for line in lines(said):
        assert (line["status"], line["vehicle"]) == ("", "")
    assert main(["watch", silent, "--no-record", "--announce", "--listen-only"]) == 2
    assert "--announce sends" in capsys.readouterr().err


def line_of(status: str, age_s: float = 0.0) -> dict[str, Any]:
    return {"vehicle": "1:1", "status": status, "age_s": age_s}


@pytest.mark.slow
def test_ground_stations_are_told_of_changes_and_not_of_more(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [100.0]
    monkeypatch.setattr("companion.cli.watch.time.monotonic", lambda: clock[0])
    sent: list[str] = []

    class Recorded:
        class link:  # noqa: N801
            @staticmethod
            def send(request: Any, *, aboard: int) -> None:
                assert aboard == 1, "the vehicle's own system"
                sent.append(request.fields["text"].decode())

    changes = watch._Changes(Recorded, [], announces=True)  # type: ignore[arg-type]
    for t, status in enumerate(
        ["", "starting", "consistent", "imu_suspect", "consistent", "imu_suspect", "consistent", *["consistent"] * 20]
    ):
        clock[0] = 100.0 + t
        changes.take(line_of(status))
    assert sent == ["companion: IMU SUSPECT", "companion: IMU and autopilot agree"], "10 s apart, and what holds then"
    clock[0] += 100.0
    changes.take(line_of("autopilot_suspect", age_s=20.0))
    assert len(sent) == 2, "old data are no news"
    silent = watch._Changes(Recorded, [], announces=False)  # type: ignore[arg-type]
    silent.take(line_of("imu_suspect"))
    assert len(sent) == 2
    assert all(len(text) <= 50 for text in sent)


@pytest.mark.slow
def test_a_command_that_fails_or_hangs_holds_nobody_up(capsys: pytest.CaptureFixture[str]) -> None:
    changes = watch._Changes(None, ["/no/such/command"], announces=False)  # type: ignore[arg-type]
    assert changes.take(line_of("consistent"))
    assert "cannot be run" in capsys.readouterr().err
    hangs = watch._Changes(None, [sys.executable, "-c", "import time; time.sleep(600)"], announces=False)  # type: ignore[arg-type]
    assert hangs.take(line_of("consistent"))
    assert not hangs.take(line_of("consistent"))
    for process in hangs._running:
        process.kill()
        process.wait()


@pytest.mark.slow
def test_a_command_line_that_is_none_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["watch", f"udpin:127.0.0.1:{free_port()}", "--no-record", "--on-change", "notify 'x"]) == 2
    assert "is not a command: No closing quotation" in capsys.readouterr().err


@pytest.mark.slow
def test_what_cannot_be_said_does_not_end_the_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: object) -> None:
        raise ValueError("out of range")

    monkeypatch.setattr(watch, "_line", broken)
    port, path = free_port(), tmp_path / "a.tlog"
    with flying(port):
        assert main(["watch", f"udpin:127.0.0.1:{port}", "-o", str(path), "--duration", "3"]) == 0
    assert "(ValueError: out of range); the recording goes on" in capsys.readouterr().err
    assert path.stat().st_size > 1000


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
    other = "neu\udce4.tlog" if sys.platform == "linux" else "new.tlog"  # of a computer with another encoding
    script = tmp_path / "hear.py"
    script.write_text(f"import sys; open({str(heard)!r}, 'a').write(sys.stdin.read() + chr(10))")
    options = ["--json", "--existing", "--settle", "0.2", "--run", f"{sys.executable} {script}"]
    with started(*COMPANION, "watch-folder", str(folder), *options) as process:
        first = json.loads(next_line(process, process.stdout))
        shutil.copy(log, folder / "QUADROTOR" / other)
        second = json.loads(next_line(process, process.stdout))
        ended(process, signal.SIGINT)
    assert process.returncode == 0
    assert [first["log"], second["log"]] == ["old.tlog", str(Path("QUADROTOR", other.replace("\udce4", "?")))]
    assert {first["status"], second["status"]} == {"insufficient_data"}
    assert [json.loads(line) for line in heard.read_text().splitlines()] == [first, second]


def test_a_folder_that_is_moved_in_is_the_logs_in_it(tmp_path: Path) -> None:
    """What is moved is one change: nobody tells of the files below. A folder is no log, whatever its name."""
    log = (card := tmp_path / "card") / "flights.zip" / "a.tlog"
    log.parent.mkdir(parents=True)
    log.touch()
    changes = [[(1, str(card))], [(2, str(card))], [(2, str(log))], [(1, str(log.parent))], [(3, str(card / "gone"))]]
    came = watch._came(tmp_path, lambda _: changes)
    assert list(came) == [[log], [], [log], [log], []]


def test_a_name_that_cannot_be_told_costs_nothing_and_repeats_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also of what came while another log was judged; and once, for as long as such a file grows."""
    monkeypatch.setattr(watch, "_LOOK_MS", 0)
    quiet = iter([list[tuple[int, str]]()])
    log = tmp_path / "while another is judged.tlog"

    def wake(_: Path) -> Iterator[list[tuple[int, str]]]:
        yield from quiet
        raise RuntimeError("a name is not UTF-8")

    came = watch._came(tmp_path, wake)
    assert next(came) == []
    log.touch()
    monkeypatch.setattr(watch.time, "time", lambda: log.stat().st_ctime + 60.0)
    assert [next(came) for _ in range(4)] == [[log], [], [], []]


def test_a_folder_that_there_is_not(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["watch-folder", str(tmp_path / "none")]) == 2
    assert "there is no folder" in capsys.readouterr().err
