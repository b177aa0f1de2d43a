"""By which IMU the lanes of an estimator are judged; one thread of BLAS, whoever calls; memory is given back."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info

import companion as c
from companion.app.examination import give_back, lanes_of, one_blas_thread
from companion.app.settings import Settings
from companion.model import EstimatorLane, ImuTrack, rows
from tests.flights import LIVELY, flown


@pytest.mark.slow
@pytest.mark.parametrize(("every", "source"), [(1, "SCALED_IMU2"), (25, "RAW_IMU")], ids=["fast", "at 2 Hz"])
def test_an_imu_that_is_too_slow_carries_no_estimate_though_the_other_is_at_fault(every: int, source: str) -> None:
    flight = flown()
    imu = flight.imu()
    late = (imu.t > 35.0)[:, None] * [0.0, 1.0, 0.0]
    first: ImuTrack = replace(imu, accel=imu.accel + late)
    second = rows(replace(imu, source="SCALED_IMU2", instance=1), slice(None, None, every))
    t, q = imu.t[::5], LIVELY.q_ned_frd[::5]
    lanes = tuple(
        EstimatorLane(t, q, LIVELY.velocity[::5], LIVELY.position[::5], f"EKF2 instance {i}", i, f"instance {i}", i)
        for i in (0, 1)
    )
    _, best = lanes_of(replace(flight, imus={"RAW_IMU": first, "SCALED_IMU2": second}, lanes=lanes), Settings())
    assert best.imu.source == source


def _threads() -> set[int]:
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_a_function_has_one_thread_of_blas_and_the_caller_its_own_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    before = _threads()
    assert one_blas_thread(_threads)() == {1}
    assert _threads() == before


def test_what_the_caller_has_set_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    assert one_blas_thread(_threads)() == _threads()


def test_the_public_functions_that_solve_are_limited() -> None:
    for function in (c.smooth, c.examine):
        assert function.__wrapped__.__name__ == function.__name__  # type: ignore[union-attr]


@pytest.mark.skipif(sys.platform != "linux", reason="other allocators give it back themselves")
def test_what_was_freed_is_no_longer_resident() -> None:
    def resident() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096

    many = [np.ones(2000) for _ in range(4000)]  # 16 kB each: too small for glibc to give them back one by one
    last = np.ones(2000)  # what is in use above them
    held = resident()
    many.clear()
    give_back()
    assert held - resident() > 40_000_000
    assert last.sum() == 2000.0
