"""`companion record` as its users run it: its own process, a simulated vehicle on the other end of a real socket."""

from __future__ import annotations

import contextlib
import io
import os
import re
import signal
import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil

import companion as c
from companion.cli import live, main
from companion.cli.senders import faults_of
from companion.links import parse_address
from companion.links.requests import ALLOWED_MESSAGES
from companion.simulate import PARAMETERS, Faults
from tests.links.link import link_frames
from tests.links.peers import deaf, listener
from tests.processes import COMPANION, Process, ended, started
from tests.simulated import flying, free_port
from tests.waiting import LIMIT_S, meanwhile, wait_for

pytestmark = pytest.mark.slow

NAMES = ("RAW_IMU", "HIGHRES_IMU", "ATTITUDE", "LOCAL_POSITION_NED")


@contextlib.contextmanager
def recording(port: int, *options: str, folder: Path) -> Iterator[Process]:
    """The command in a process of its own."""
    with started(*COMPANION, "record", f"udpin:127.0.0.1:{port}", *options, cwd=folder) as process:
        yield process


def size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def pymavlink_counts(path: Path) -> dict[str, int]:
    """What pymavlink finds in a recording."""
    log: Any = mavutil.mavlink_connection(str(path))
    counts: dict[str, int] = {}
    while (message := log.recv_msg()) is not None:
        counts[message.get_type()] = counts.get(message.get_type(), 0) + 1
    log.close()
    return counts


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_with_the_recording_whole_and_the_vehicle_as_it_was(tmp_path: Path, end: int) -> None:
    port = free_port()
    with (
        flying(port, streams={"ATTITUDE": 4.0, "ATTITUDE_QUATERNION": 4.0}) as vehicle,
        recording(port, "-o", "a.tlog", folder=tmp_path) as process,
    ):
        wait_for(lambda: vehicle.sent["PARAM_VALUE"] == len(PARAMETERS))
        before = size(tmp_path / "a.tlog")
        wait_for(lambda: size(tmp_path / "a.tlog") > before + 20_000)
        said, told = ended(process, end)
        assert process.returncode == 0
        assert {name: vehicle.interval_us(name) for name in NAMES} == dict.fromkeys(NAMES, -1) | {"ATTITUDE": 250_000}
        assert set(vehicle.received) <= ALLOWED_MESSAGES
    assert "vehicle 1:1 (ARDUPILOTMEGA) is heard" in told
    assert re.fullmatch(r"a\.tlog: [\d,]+ bytes, [\d,]+ frames\n", said)
    (flight,) = c.open_log(tmp_path / "a.tlog")
    counts = pymavlink_counts(tmp_path / "a.tlog")
    for name in NAMES:
        assert counts[name] == flight.messages[name].count
    imu = flight.imu("RAW_IMU")
    assert imu.rate_hz == pytest.approx(100.0)
    assert (flight.messages["RAW_IMU"].longest_gap_s or 9) < 0.015, "not a sample lost"
    assert flight.parameters.keys() >= {"AHRS_TRIM_X", "AHRS_TRIM_Y"}


def test_a_killed_recording_holds_all_but_the_last_second(tmp_path: Path) -> None:
    port = free_port()
    with flying(port) as vehicle, recording(port, "-o", "a.tlog", folder=tmp_path) as process:
        wait_for(lambda: size(tmp_path / "a.tlog") > 20_000)
        process.kill()
        sent = vehicle.sent["RAW_IMU"]
        process.wait(5.0)
    (flight,) = c.open_log(tmp_path / "a.tlog")
    assert len(flight.imu("RAW_IMU")) >= sent - 100


def test_what_a_killed_recording_left_behind_is_given_back_by_the_next(tmp_path: Path) -> None:
    port = free_port()
    with flying(port, streams={"RAW_IMU": 4.0}) as vehicle:
        with recording(port, "-o", "a.tlog", folder=tmp_path) as process:
            wait_for(lambda: vehicle.interval_us("RAW_IMU") == 10_000)
            process.kill()
            process.wait(LIMIT_S)
        assert vehicle.interval_us("RAW_IMU") == 10_000
        with recording(port, "-o", "b.tlog", folder=tmp_path) as process:
            wait_for(lambda: size(tmp_path / "b.tlog") > 20_000)
            _, told = ended(process, signal.SIGTERM)
        assert process.returncode == 0
        assert "an earlier companion on this link has not restored all message intervals of vehicle 1:1" in told
        wait_for(lambda: vehicle.interval_us("RAW_IMU") == 250_000)


@pytest.mark.parametrize("command", ["record", "watch", "view"])
def test_what_could_not_be_restored_is_said_with_an_exit_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    port = free_port()
    options = {"view": ("--port", str(free_port()))}.get(command, ())
    words = (command, f"udpin:127.0.0.1:{port}", "-o", "a.tlog", *options)
    with flying(port) as vehicle, started(*COMPANION, *words, cwd=tmp_path) as process:
        wait_for(lambda: vehicle.interval_us("RAW_IMU") == 10_000 and size(tmp_path / "a.tlog") > 20_000)
        vehicle.receive = deaf  # type: ignore[method-assign]
        _, told = ended(process, signal.SIGINT)
    (kept,) = (tmp_path / "state").rglob("*.json")
    assert process.returncode == 2
    assert re.search(r"vehicle 1:1 has not confirmed that .*RAW_IMU.* sent as before: the next run on this link", told)
    assert str(kept) in told
    assert "RAW_IMU" in kept.read_text()


def test_listening_only_sends_nothing_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    port = free_port()
    with flying(port, streams={"RAW_IMU": 50.0, "ATTITUDE": 50.0}) as vehicle:
        monkeypatch.chdir(tmp_path)
        assert main(["record", f"udpin:127.0.0.1:{port}", "--listen-only", "--duration", "1.5"]) == 0
        assert vehicle.received == {}
    (path,) = tmp_path.glob("????-??-?? ??-??-??.tlog")
    (flight,) = c.open_log(path)
    assert len(flight.imu("RAW_IMU")) > 50


def test_a_bad_link_and_a_reboot_are_survived(tmp_path: Path) -> None:
    port = free_port()
    path = tmp_path / "a.tlog"
    faults = Faults(drop=0.3, duplicate=0.1, reorder=0.1, garbage=0.1)
    with (
        flying(port, since=20.0, faults=faults, seed=3) as vehicle,
        recording(port, "-o", "a.tlog", folder=tmp_path) as process,
    ):
        for boot in (1, 2):
            wait_for(lambda: vehicle.interval_us("RAW_IMU") == 10_000 and vehicle.interval_us("ATTITUDE") > 0)
            before = vehicle.sent["ATTITUDE"]
            wait_for(lambda before=before: vehicle.sent["ATTITUDE"] > before + 100)  # type: ignore[misc]
            if boot == 1:
                vehicle.reboot()
                wait_for(lambda: vehicle.boots == 2)  # its intervals are gone, and may be asked for again at once
        _, told = ended(process, signal.SIGTERM)
        assert set(vehicle.received) <= ALLOWED_MESSAGES
    assert "asking again" in told
    assert "Traceback" not in told
    first, second = c.open_log(path)
    assert (first.boot, second.boot) == (1, 2)
    for flight in (first, second):
        assert len(flight.imu("RAW_IMU")) > 100
    assert pymavlink_counts(path)["RAW_IMU"] >= len(first.imu("RAW_IMU")) + len(second.imu("RAW_IMU"))


@contextlib.contextmanager
def files_end_at(size: int) -> Iterator[None]:
    """A disk that takes no more than so many bytes of a file, in the middle of a frame."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_ends_it_with_what_is_safe_and_an_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    port = free_port()
    log = tmp_path / "a.tlog"
    with flying(port) as vehicle:
        with files_end_at(20_011):
            assert main(["record", f"udpin:127.0.0.1:{port}", "-o", str(log), "--duration", "60"]) == 2
        wait_for(lambda: vehicle.interval_us("RAW_IMU") == -1)  # the vehicle is left as it was
    said, told = capsys.readouterr()
    counts = pymavlink_counts(log)
    assert told.count("the recording ends here") == 1
    found = re.search(r"Safe in it: ([\d,]+) frames \(([\d,]+) bytes\)", told)
    assert found
    frames, size = (int(number.replace(",", "")) for number in found.groups())
    assert size == log.stat().st_size, "no part of a frame is left at the end"
    assert sum(counts.values()) == frames
    assert said == f"{log}: {size:,} bytes, {frames:,} frames\n"


def test_a_deleted_recording_is_said_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    port = free_port()
    log = tmp_path / "a.tlog"

    def delete() -> None:
        wait_for(lambda: size(log) > 5000)
        log.unlink()

    with meanwhile(delete), flying(port):
        assert main(["record", f"udpin:127.0.0.1:{port}", "-o", str(log), "--duration", "60"]) == 2
    said, told = capsys.readouterr()
    assert re.search(r"has been deleted: the recording ends here, and its [\d,]+ frames are lost", told)
    assert said.endswith(": 0 bytes, 0 frames\n")


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no terminals that hang up")
def test_a_closed_terminal_ends_nothing(tmp_path: Path) -> None:
    """Its window is closed: SIGHUP comes, and neither stdout nor stderr takes a word any more."""
    port = free_port()
    log = tmp_path / "a.tlog"
    with (
        flying(port, streams={"ATTITUDE": 4.0}) as vehicle,
        recording(port, "-o", "a.tlog", folder=tmp_path) as process,
    ):
        wait_for(lambda: size(log) > 5000)
        assert process.stdout
        assert process.stderr
        process.stdout.close()
        process.stderr.close()
        process.send_signal(signal.SIGHUP)
        before = size(log)
        vehicle.reboot()  # which it wants to say
        wait_for(lambda: size(log) > before + 20_000)
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=LIMIT_S) == 0
        wait_for(lambda: vehicle.interval_us("RAW_IMU") == -1)  # the vehicle is left as it was
    assert len(c.open_log(log)) >= 1


def full_pipe() -> tuple[int, int]:
    """Both ends of a pipe that takes nothing more."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with contextlib.suppress(BlockingIOError):
        while os.write(writing, b"x" * 4096):
            pass
    os.set_blocking(writing, True)
    return reading, writing


def test_a_reader_that_reads_nothing_makes_it_wait_for_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A full pipe takes no line; to write one all the same would wait for ever."""
    reading, writing = full_pipe()
    with os.fdopen(writing, "w") as full:
        monkeypatch.setattr(sys, "stderr", full)
        live.say("a line")
        monkeypatch.undo()
    os.close(reading)


@pytest.mark.skipif(sys.platform == "win32", reason="no pipe there can be asked")
def test_a_line_of_which_a_reader_takes_a_part_is_ended_before_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    """One of many alarms is longer than what a pipe with little room takes at once."""
    reading, writing = full_pipe()
    os.read(reading, 4096)
    with os.fdopen(writing, "w") as pipe:
        monkeypatch.setattr(sys, "stdout", pipe)
        live.print_line("a" * 10_000)
        live.print_line("lost, for its reader stands")
        read = os.read(reading, 1 << 20)
        live.print_line("b")
        monkeypatch.undo()
    read += os.read(reading, 1 << 20)
    assert read.lstrip(b"x") == b"a" * 10_000 + b"\nb\n"
    os.close(reading)


def test_a_page_that_fails_leaves_the_recording_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    port = free_port()
    log = tmp_path / "a.tlog"

    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    def end() -> None:
        wait_for(lambda: size(log) > 20_000)
        os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr("companion.view.LiveViewer", broken)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with meanwhile(end), flying(port):
        assert main(["view", f"udpin:127.0.0.1:{port}", "-o", str(log), "--port", str(free_port())]) == 0
    assert "The page has ended. The recording goes on" in capsys.readouterr().err
    assert size(log) > 20_000


@pytest.mark.parametrize("kind", ["pipe", "link", "device"])
def test_it_is_never_written_over_what_is_no_new_file(
    tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.tlog"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "link":
        path.symlink_to(tmp_path / "elsewhere")
    else:
        path = Path("/dev/null")
    assert main(["record", f"udpin:127.0.0.1:{free_port()}", "-o", str(path), "--duration", "1"]) == 2
    assert "never written over anything" in capsys.readouterr().err
    assert not (tmp_path / "elsewhere").exists()


def test_two_vehicles_are_recorded_and_the_chosen_one_is_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    port = free_port()
    path = tmp_path / "a.tlog"
    with flying(port, sysid=1) as one, flying(port, sysid=2) as two:
        assert main(["record", f"udpin:127.0.0.1:{port}", "-o", str(path), "--duration", "3", "--vehicle", "2"]) == 0
        assert (one.sent["RAW_IMU"], two.sent["RAW_IMU"] > 100) == (0, True)
    assert "vehicle 1:1 (ARDUPILOTMEGA) is heard too" in capsys.readouterr().err


def test_where_nothing_comes_nothing_is_left_behind(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.tlog"
    assert main(["record", f"udpin:127.0.0.1:{free_port()}", "-o", str(path), "--duration", "0.3"]) == 2
    assert "nothing was received" in capsys.readouterr().err
    assert not path.exists()


@pytest.mark.parametrize("command", ["record", "view"])
def test_who_waits_in_vain_ends_with_an_exit_code(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    page = ["--port", str(free_port())] if command == "view" else []
    assert main([command, f"udpin:127.0.0.1:{free_port()}", "--wait", "0.3", *page]) == 2
    assert "nothing was received" in capsys.readouterr().err
    assert main([command, f"tcp:127.0.0.1:{free_port()}", "--wait", "0.3", *page]) == 2
    told = capsys.readouterr().err
    assert told.count("nothing answers at") == 2, "once while it waits, and once at the end"
    assert list(tmp_path.glob("*.tlog")) == []


def test_a_vehicle_that_comes_later_is_waited_for(tmp_path: Path) -> None:
    """Its TCP port and its device are not there yet: a service starts before the autopilot does."""
    with listener() as server:
        port = server.getsockname()[1]
    path = tmp_path / "a.tlog"

    def come() -> None:
        wait_for(lambda: "Waiting: nothing answers" in said.getvalue())
        with listener(port) as server, server.accept()[0] as peer:
            peer.sendall(b"".join(link_frames(50)))
            wait_for(lambda: size(path) > 1000)
            os.kill(os.getpid(), signal.SIGTERM)

    said = io.StringIO()
    with meanwhile(come), contextlib.redirect_stderr(said):
        assert main(["record", f"tcp:127.0.0.1:{port}", "-o", str(path), "--wait", "inf"]) == 0
    assert said.getvalue().count("Waiting") == 1


def test_a_port_of_px4_with_one_partner_is_warned_of_before_anything_is_sent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """udpout to PX4's ground station port takes the vehicle from QGroundControl until PX4 starts again."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as px4:
        px4.bind(("127.0.0.1", 0))
        px4.setblocking(False)
        port = px4.getsockname()[1]
        monkeypatch.setattr(live, "_PX4_PORTS", {"QGroundControl": range(port, port + 1)})
        monkeypatch.setattr(live, "_GRACE_S", LIMIT_S)

        def end() -> None:
            wait_for(lambda: "QGroundControl would lose the vehicle" in said.getvalue())
            os.kill(os.getpid(), signal.SIGINT)

        said = io.StringIO()
        with meanwhile(end), contextlib.redirect_stderr(said):
            assert main(["record", f"udpout:127.0.0.1:{port}"]) == 2
        with pytest.raises(BlockingIOError):
            px4.recv(1)
    assert "has been left alone: nothing was sent" in said.getvalue()
    assert live.takes_the_link(parse_address("udpout:127.0.0.1:18570")) == ""  # not a port of this test's PX4
    monkeypatch.undo()
    assert "udpin:0.0.0.0:14540" in live.takes_the_link(parse_address("udpout:127.0.0.1:18570"))
    assert "MAVSDK" in live.takes_the_link(parse_address("udpout:127.0.0.1:14580"))
    for harmless in ("udpin:0.0.0.0:18570", "udpout:127.0.0.1:14551", "tcp:127.0.0.1:18570"):
        assert live.takes_the_link(parse_address(harmless)) == ""


def test_what_cannot_be_done_is_said_with_exit_code_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    port = free_port()
    there = tmp_path / "there.tlog"
    there.write_bytes(b"a flight")
    cases = {
        "is not a link": ["nonsense"],
        "exists already": [f"udpin:127.0.0.1:{port}", "-o", str(there)],
        "nothing answers": [f"tcp:127.0.0.1:{port}"],
        "there is no device": ["/dev/ttyNOT0"],
        "between 1 and 1000 Hz": [f"udpin:127.0.0.1:{port}", "--rate", "0"],
        "--vehicle foo is none": [f"udpin:127.0.0.1:{port}", "--vehicle", "foo", "--duration", "0.1"],
        "--wait is a positive number": [f"udpin:127.0.0.1:{port}", "--wait", "nan"],
        "--duration is a positive": [f"udpin:127.0.0.1:{port}", "--duration", "-1"],
        "cannot be written": [f"udpin:127.0.0.1:{port}", "-o", str(tmp_path / "no" / "a.tlog")],
        "speaks first": [f"udpout:127.0.0.1:{port}", "--listen-only"],
    }
    for reason, words in cases.items():
        assert main(["record", *words]) == 2
        assert reason in capsys.readouterr().err
    assert there.read_bytes() == b"a flight"


def test_a_simulated_vehicle_reboots_and_falls_silent_as_often_as_it_is_told() -> None:
    faults = faults_of(["reboot@10", "silence@5", "imu-bias@3", "reboot@25", "silence@20"])
    assert faults.reboot == (10.0, 25.0)
    assert faults.silence == ((5.0, 15.0), (20.0, 30.0))
    assert faults.imu_bias is not None


def test_simulate_writes_a_flight_that_analyze_reads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(tmp_path / "a.tlog")
    assert main(["simulate", "-o", path, "--duration", "30", "--fault", "imu-bias@15", "--fault", "reboot@20"]) == 0
    assert main(["analyze", path, "--horizons", "2"]) == 0
    assert main(["simulate"]) == 2
    flown = Path(path).read_bytes()
    assert main(["simulate", "-o", path, "--duration", "1"]) == 2
    assert "--force" in capsys.readouterr().err
    assert Path(path).read_bytes() == flown
    assert main(["simulate", "-o", path, "--force", "--fault", "rain"]) == 2
    assert "there is no fault 'rain'" in capsys.readouterr().err
    for words, reason in {
        ("--fault", "reboot@nan"): "not a time in seconds",
        ("--fault", "reboot@-3"): "not a time in seconds",
        ("--fault", "gps-glitch@700"): "the flight is over at 1 s",
        ("--fault", "imu-bias@0.3", "--fault", "imu-bias@0.9"): "there is one imu-bias in a flight",
        ("--sysid", "300"): "between 1 and 255",
    }.items():
        assert main(["simulate", "-o", path, "--force", "--duration", "1", *words]) == 2
        assert reason in capsys.readouterr().err
