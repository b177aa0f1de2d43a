"""The module in MAVProxy itself, started by the test, with a simulated vehicle whose IMU freezes."""

from __future__ import annotations

import os
import socket
import sys
import threading
from pathlib import Path

import pytest

from companion.simulate import Faults, SimulatedVehicle, fly
from tests.processes import started
from tests.recordings import ROOT
from tests.simulated import bursts, free_port
from tests.waiting import LIMIT_S

pytest.importorskip("MAVProxy", reason="no MAVProxy here: pip install MAVProxy")
pytestmark = pytest.mark.slow

STREAMS = {"RAW_IMU": 50.0, "ATTITUDE": 25.0, "LOCAL_POSITION_NED": 10.0, "GPS_RAW_INT": 5.0}
MAVPROXY = Path(sys.executable).with_name("mavproxy.py")


def lines_until(stream: object, wanted: str) -> list[str]:
    """What MAVProxy prints up to a line with some words."""
    seen: list[str] = []
    for line in stream:  # type: ignore[attr-defined]
        seen.append(line.rstrip())
        if wanted in line:
            return seen
    raise AssertionError(f"MAVProxy ended without {wanted!r}: {seen}")


def test_mavproxy_shows_the_verdict_of_its_own_stream(tmp_path: Path) -> None:
    """A healthy flight, then a frozen IMU: it is announced on the console."""
    port = free_port()
    vehicle = SimulatedVehicle(fly(60.0, faults=Faults(imu_stuck=35.0)), streams=STREAMS)
    command = [
        sys.executable, "-u", str(MAVPROXY), f"--master=tcp:127.0.0.1:{port}", f"--state-basedir={tmp_path}",
        "--non-interactive", "--default-modules=", "--streamrate=-1", "--heartbeat=0", "--force-connected",
        "--cmd=module load companion; companion status",
    ]  # fmt: skip
    how = {"cwd": tmp_path, "env": {**os.environ, "PYTHONPATH": str(ROOT), "HOME": str(tmp_path), "MAVLINK20": "1"}}
    with socket.create_server(("127.0.0.1", port)) as listener, started(*command, **how) as process:
        guard = threading.Timer(LIMIT_S, process.kill)
        guard.start()
        link, _ = listener.accept()
        with link:
            for t, packets in bursts(vehicle, 55.0):
                if t > 10.0:  # in cruise: a hard take-off is another story
                    link.sendall(packets)  # waits for MAVProxy, which reads more slowly than this is made
            seen = lines_until(process.stdout, "IMU SUSPECT")
        guard.cancel()
    assert "reads the same" in seen[-1]
    assert not [line for line in seen if "Traceback" in line or "Failed" in line]
