"""The benchmark of the stages of `analyze`: it knows every stage, and its long flights are one flight."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest

from benchmarks.analyze import ORDER, PACKAGE, PIECE_S, STAGES, Measured, write_piece
from companion.app.recording import open_log
from tests.recordings import BUNDLED, ROOT

pytestmark = pytest.mark.slow


def test_every_stage_is_of_files_that_exist() -> None:
    assert set(STAGES) == set(ORDER)
    missing = [part for parts in STAGES.values() for part in parts if not (PACKAGE / part).exists()]
    assert not missing


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read from /proc")
def test_all_time_and_memory_of_an_analysis_are_of_some_stage() -> None:
    script, log = ROOT / "benchmarks" / "analyze.py", BUNDLED / "copter-demo-100hz.tlog"
    command = [sys.executable, str(script), "--measure", str(log)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    printed = subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout
    found = msgspec.json.decode(printed, type=Measured)
    assert set(found.cpu_s) >= {"read", "smooth", "evidence", "drift"}
    assert set(found.cpu_s) <= set(ORDER)
    assert found.total_s > 0.1
    assert max(found.peak_mb.values()) > found.imported_mb > 10
    assert (found.samples, found.status) == (10_121, "consistent")


def test_pieces_are_one_flight(tmp_path: Path) -> None:
    path, seconds = tmp_path / "flight.tlog", 80.0
    write_piece(0, seconds, path)
    write_piece(1, seconds, path)
    (flight,) = open_log(path)
    assert flight.duration == pytest.approx(PIECE_S + seconds, abs=1.0)
    gaps = np.diff(flight.imu("RAW_IMU").t)
    assert np.count_nonzero(gaps > 0.011) == 1, "that between the pieces, of which each is shorter here"
    armed = [event for event in flight.events if "armed" in event.kind]
    assert len(armed) <= 1
