"""What a process takes of the computer: threads of BLAS, and memory that it needs no longer."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable
from functools import cache, wraps
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def one_blas_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function have one thread of BLAS while it runs.

    The matrices of an estimate are small: a second thread waits at full load, and where the other cores have work of
    their own everything takes several times as long. What the caller has set in OPENBLAS_NUM_THREADS holds.
    """

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        if "OPENBLAS_NUM_THREADS" in os.environ:
            return function(*args, **kwargs)
        from threadpoolctl import threadpool_limits  # noqa: PLC0415  (the command line never needs it)

        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited


def give_back() -> None:
    """Give what was freed back to the operating system: glibc keeps it. Some milliseconds; elsewhere nothing is done.

    Source: malloc_trim(3).
    """
    if (trim := _trim()) is not None:
        trim(0)


@cache
def _trim() -> Any:
    if sys.platform != "linux":
        return None
    return getattr(ctypes.CDLL(None), "malloc_trim", None)  # musl has none
