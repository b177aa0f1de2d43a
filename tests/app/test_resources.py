"""One thread of BLAS, whoever calls; what was freed is given back."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info

import companion as c
from companion.app.examination import give_back, one_blas_thread


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
