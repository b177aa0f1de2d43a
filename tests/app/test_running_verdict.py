"""The process that judges a link: it hears what arrives, says what it thinks, and nobody waits for it."""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator
from subprocess import PIPE

import pytest

from companion.app.running_verdict import Assignment, RunningVerdict, joined
from companion.app.settings import Settings
from companion.mavlink import Decoder, load_dialect
from companion.simulate import Faults, SimulatedVehicle, fly
from tests.simulated import bursts
from tests.waiting import wait_for

pytestmark = pytest.mark.slow

STREAMS = {
    "RAW_IMU": 100.0, "SCALED_IMU2": 50.0, "ATTITUDE": 50.0, "LOCAL_POSITION_NED": 20.0, "GPS_RAW_INT": 5.0,
    "SCALED_PRESSURE": 10.0, "EKF_STATUS_REPORT": 2.0,
}  # fmt: skip


@pytest.fixture
def verdict() -> Iterator[RunningVerdict]:
    running = RunningVerdict(Assignment(Settings()))
    yield running
    running.close()


def send(verdict: RunningVerdict, vehicle: SimulatedVehicle, until_s: float, decoder: Decoder) -> None:
    """What the vehicle sends up to a time of its flight, as if it all arrived now and in good time."""
    sent = time.time() - until_s
    for t, packets in bursts(vehicle, until_s):
        verdict.receive([(decoder.push(packets), sent + t)])


def test_a_fault_is_told_within_a_few_looks(verdict: RunningVerdict) -> None:
    vehicle = SimulatedVehicle(fly(80.0, faults=Faults(imu_bias=(40.0, 0.05))), streams=STREAMS)
    decoder = Decoder(load_dialect(), stamped=False)
    send(verdict, vehicle, 36.0, decoder)
    wait_for(lambda: verdict.read().status == "consistent", "a verdict on a healthy flight")
    assert verdict.read().age_s < 60.0
    send(verdict, vehicle, 60.0, decoder)
    wait_for(lambda: verdict.read().status == "imu_suspect", "the gyro's bias")
    status, text = verdict.read().so_far
    assert status == "imu_suspect"
    assert "gyro z" in text


def test_what_arrived_together_is_decoded_together() -> None:
    other = Assignment(Settings(), vehicle="2")
    times = [10.0, 10.12, 10.27, 10.33, 10.9, 10.93]
    waiting = deque[tuple[bytes, float] | Assignment]((bytes([i]), t) for i, t in enumerate(times))
    waiting.insert(5, other)
    found = list(joined(waiting))
    assert found == [(b"\0\1\2", 10.27), (b"\3", 10.33), (b"\4", 10.9), other, (b"\5", 10.93)]
    assert not waiting


def test_who_is_killed_or_ends_leaves_no_process(verdict: RunningVerdict) -> None:
    pid = verdict._process.pid
    assert pid is not None
    os.kill(pid, signal.SIGINT)  # Ctrl-C goes to every process of the terminal
    begin = time.monotonic()
    verdict.close()
    assert time.monotonic() - begin < 2.0
    assert verdict._process.poll() is not None
    verdict.receive([])


def test_a_process_whose_reader_was_killed_ends_without_a_word() -> None:
    begin = [sys.executable, "-c", "from companion.app.running_verdict import work; work()"]
    vehicle, decoder = SimulatedVehicle(fly(20.0), streams=STREAMS), Decoder(load_dialect(), stamped=False)
    with subprocess.Popen(begin, stdin=PIPE, stdout=PIPE, stderr=PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        with contextlib.suppress(BrokenPipeError):  # it has ended already
            process.stdin.write(pickle.dumps(Assignment(Settings())))
            for t, packets in bursts(vehicle, 15.0):
                process.stdin.write(pickle.dumps((decoder.push(packets).data.tobytes(), t + 1e9)))
            process.stdin.close()
        assert process.stderr.read() == b""
    assert process.returncode == 0


def test_a_verdict_whose_process_has_died_holds_nobody_up(verdict: RunningVerdict) -> None:
    verdict._process.kill()
    verdict._process.wait()
    vehicle = SimulatedVehicle(fly(20.0), streams=STREAMS)
    send(verdict, vehicle, 15.0, Decoder(load_dialect(), stamped=False))
    wait_for(lambda: "has ended" in verdict.read().text, "that it has")
    assert verdict.read().status == ""
