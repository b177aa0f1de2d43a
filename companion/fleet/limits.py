"""The limits of memory and time for one log: a log that exceeds them is an error in its row alone."""

from __future__ import annotations

import contextlib
import ctypes
import threading
from collections.abc import Iterator

from companion.model import InputError

MEMORY_GB = 4.0
TIMEOUT_S = 600.0


class TimeUpError(BaseException):
    """The time of a log is up. No Exception, so that no handler in the analysis catches it."""


@contextlib.contextmanager
def limited(memory_gb: float, timeout_s: float) -> Iterator[None]:
    """Limits inside: MemoryError beyond so much more memory, InputError after so long."""
    with _memory(memory_gb), _time(timeout_s):
        yield


@contextlib.contextmanager
def _memory(gigabytes: float) -> Iterator[None]:
    """Of the data of this process, on Linux; other systems do not count it so."""
    try:
        import resource  # noqa: PLC0415  (not on Windows)

        with open("/proc/self/statm", encoding="ascii") as file:  # noqa: PTH123
            used = int(file.read().split()[5]) * resource.getpagesize()
    except (ImportError, OSError):
        yield
        return
    before = resource.getrlimit(resource.RLIMIT_DATA)
    most = used + round(gigabytes * 1e9)
    allowed = most if before[1] == resource.RLIM_INFINITY else min(most, before[1])
    resource.setrlimit(resource.RLIMIT_DATA, (allowed, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)


@contextlib.contextmanager
def _time(seconds: float) -> Iterator[None]:
    """By an exception in this thread: signals are for the main thread, and a worker's tasks are not in it."""
    lock, over, working = threading.Lock(), [False], threading.get_ident()

    def interrupt() -> None:
        with lock:
            if not over[0]:
                ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(working), ctypes.py_object(TimeUpError))

    timer = threading.Timer(seconds, interrupt)
    timer.daemon = True
    timer.start()
    try:
        yield
    except TimeUpError:
        raise InputError(
            f"it takes longer than the {seconds:g} s that a log is given. Give it more: --timeout S --retry"
        ) from None
    finally:
        with lock:
            over[0] = True
        timer.cancel()
