"""The threads of BLAS, in processes that are not ours: notebooks and programs that call the package."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def one_blas_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function have one thread of BLAS while it runs.

    The matrices of an estimate are small: a second thread waits at full load, and where the other cores have work of
    their own everything takes several times as long. What the caller has set in OPENBLAS_NUM_THREADS holds.
    """

    @functools.wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        if "OPENBLAS_NUM_THREADS" in os.environ:
            return function(*args, **kwargs)
        from threadpoolctl import threadpool_limits  # noqa: PLC0415  (the command line never needs it)

        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited
