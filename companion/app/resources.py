"""What a process takes of the computer: threads of BLAS, other processors, and memory that it needs no longer."""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable
from functools import cache, wraps
from multiprocessing.connection import Connection
from pathlib import Path
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


def begun(work: Callable[[], R]) -> Callable[[], R]:
    """Have a copy of this process begin `work` on another processor; what is returned waits for what comes of it.

    Where there is no other processor, or no copy can be made without harm (fork(2): of one thread only), or the copy
    fails, the work is done when it is asked for. What comes of it has to be fit to be pickled.
    """
    if not _may_fork():
        return work
    copies = multiprocessing.get_context("fork")
    receiving, sending = copies.Pipe(duplex=False)
    copy = copies.Process(target=_answer, args=(work, receiving, sending), daemon=True)
    copy.start()
    sending.close()

    def answer() -> R:
        with receiving:
            try:
                result: R = receiving.recv()
            except EOFError:  # whatever it was is seen here, where it can be told
                return work()
        copy.join()
        return result

    return answer


def _may_fork() -> bool:
    threads = Path("/proc/self/task")
    return threads.is_dir() and len(list(threads.iterdir())) == 1 and len(os.sched_getaffinity(0)) > 1


def _answer(work: Callable[[], Any], others: Connection, to: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that was copied ends this one
    others.close()  # or nobody tells when that has gone
    with contextlib.suppress(Exception):
        to.send(work())


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
