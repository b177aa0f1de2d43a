"""`companion record` as its users run it: its own process, a simulated vehicle on the other end of a real socket."""

from __future__ import annotations

import contextlib
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil

import companion as c
from companion.cli import main
from companion.mavlink.requests import ALLOWED_MESSAGES
from companion.simulate import Faults
from tests.mavlink.peers import wait_for
from tests.simulated import flying, free_port

NAMES = ("RAW_IMU", "HIGHRES_IMU", "ATTITUDE", "LOCAL_POSITION_NED")


@contextlib.contextmanager
def recording(port: int, *options: str, folder: Path) -> Iterator[subprocess.Popen[str]]:
    """The command in a process of its own."""
    words = [sys.executable, "-m", "companion", "record", f"udpin:127.0.0.1:{port}", *options]
    with subprocess.Popen(words, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


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
        wait_for(lambda: size(tmp_path / "a.tlog") > 20_000, 10.0)
        begin = time.monotonic()
        process.send_signal(end)
        said, told = process.communicate(timeout=5.0)
        assert time.monotonic() - begin < 2.0
        assert process.returncode == 0
        assert {name: vehicle.interval_us(name) for name in NAMES} == dict.fromkeys(NAMES, -1) | {"ATTITUDE": 250_000}
        assert set(vehicle.heard) <= ALLOWED_MESSAGES
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
        wait_for(lambda: size(tmp_path / "a.tlog") > 20_000, 10.0)
        process.kill()
        sent = vehicle.sent["RAW_IMU"]
        process.wait(5.0)
    (flight,) = c.open_log(tmp_path / "a.tlog")
    assert len(flight.imu("RAW_IMU")) >= sent - 100


def test_listening_only_sends_nothing_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    port = free_port()
    with flying(port, streams={"RAW_IMU": 50.0, "ATTITUDE": 50.0}) as vehicle:
        monkeypatch.chdir(tmp_path)
        assert main(["record", f"udpin:127.0.0.1:{port}", "--listen-only", "--duration", "1.5"]) == 0
        assert vehicle.heard == {}
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
            wait_for(lambda: vehicle.interval_us("RAW_IMU") == 10_000 and vehicle.interval_us("ATTITUDE") > 0, 20.0)
            before = vehicle.sent["ATTITUDE"]
            wait_for(lambda before=before: vehicle.sent["ATTITUDE"] > before + 100)  # type: ignore[misc]
            if boot == 1:
                vehicle.reboot()
                wait_for(lambda: vehicle.interval_us("RAW_IMU") == -1)
        process.terminate()
        _, told = process.communicate(timeout=5.0)
        assert set(vehicle.heard) <= ALLOWED_MESSAGES
    assert "asking again" in told
    assert "Traceback" not in told
    first, second = c.open_log(path)
    assert (first.boot, second.boot) == (1, 2)
    for flight in (first, second):
        assert len(flight.imu("RAW_IMU")) > 100
    assert pymavlink_counts(path)["RAW_IMU"] >= len(first.imu("RAW_IMU")) + len(second.imu("RAW_IMU"))


def test_a_full_disk_is_said_once_and_ends_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    port = free_port()
    with flying(port, streams={"ATTITUDE": 50.0}):
        assert main(["record", f"udpin:127.0.0.1:{port}", "-o", "/dev/full", "--duration", "1"]) == 0
    told = capsys.readouterr().err
    assert told.count("the disk is full") == 1
    assert Path("/dev/full").is_char_device(), "and is still there"


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
    assert main(["record", f"udpin:127.0.0.1:{free_port()}", "-o", str(path), "--duration", "0.3"]) == 0
    assert "nothing was received" in capsys.readouterr().err
    assert not path.exists()


def test_what_cannot_be_done_is_said_with_exit_code_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    port = free_port()
    there = tmp_path / "there.tlog"
    there.write_bytes(b"a flight")
    cases = {
        "is no link": ["nonsense"],
        "exists already": [f"udpin:127.0.0.1:{port}", "-o", str(there)],
        "nothing answers": [f"tcp:127.0.0.1:{port}"],
        "there is no device": ["/dev/ttyNOT0"],
        "between 1 and 1000 Hz": [f"udpin:127.0.0.1:{port}", "--rate", "0"],
        "--vehicle foo is none": [f"udpin:127.0.0.1:{port}", "--vehicle", "foo", "--duration", "0.1"],
        "positive number of seconds": [f"udpin:127.0.0.1:{port}", "--duration", "-1"],
        "cannot be written": [f"udpin:127.0.0.1:{port}", "-o", str(tmp_path / "no" / "a.tlog")],
        "speaks first": [f"udpout:127.0.0.1:{port}", "--listen-only"],
    }
    for reason, words in cases.items():
        assert main(["record", *words]) == 2
        assert reason in capsys.readouterr().err
    assert there.read_bytes() == b"a flight"


def test_simulate_writes_a_flight_that_analyze_reads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(tmp_path / "a.tlog")
    assert main(["simulate", "-o", path, "--duration", "30", "--fault", "imu-bias@15", "--fault", "reboot@20"]) == 0
    assert main(["analyze", path, "--horizons", "2"]) == 0
    assert main(["simulate"]) == 2
    assert main(["simulate", "-o", path, "--fault", "rain"]) == 2
    assert "there is no fault 'rain'" in capsys.readouterr().err
    for words, reason in {
        ("--fault", "reboot@nan"): "no time in seconds",
        ("--fault", "reboot@-3"): "no time in seconds",
        ("--sysid", "300"): "between 1 and 255",
    }.items():
        assert main(["simulate", "-o", path, "--duration", "1", *words]) == 2
        assert reason in capsys.readouterr().err
