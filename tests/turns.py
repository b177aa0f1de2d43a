"""Processes that share the processors take long turns."""

from __future__ import annotations

import ctypes
import os
import platform
import sys

_LONGEST_NS = 100_000_000  # of a turn, that Linux lets a process ask for
_SCHED_SETATTR = {"x86_64": 314, "aarch64": 274}  # most C libraries have no name for it
_RESET_ON_FORK = 1


class _Attributes(ctypes.Structure):
    """linux/sched/types.h, struct sched_attr."""

    _fields_ = (
        ("size", ctypes.c_uint32),
        ("policy", ctypes.c_uint32),
        ("flags", ctypes.c_uint64),
        ("nice", ctypes.c_int32),
        ("priority", ctypes.c_uint32),
        ("runtime", ctypes.c_uint64),
        ("deadline", ctypes.c_uint64),
        ("period", ctypes.c_uint64),
    )


def take_long_turns() -> None:
    """This thread is seldom put off for another that computes; for one that has slept, as before.

    With more processes than processors each would lose what it has in the caches every few milliseconds, which takes a
    tenth of all time. What is started from here is as it always was. Linux before 6.12, and other systems, do not know.
    """
    number = _SCHED_SETATTR.get(platform.machine()) if sys.platform == "linux" else None
    if number is None or os.sched_getscheduler(0) != os.SCHED_OTHER:
        return
    wish = _Attributes(
        size=ctypes.sizeof(_Attributes),
        policy=os.SCHED_OTHER,
        flags=_RESET_ON_FORK,
        nice=os.getpriority(os.PRIO_PROCESS, 0),
        runtime=_LONGEST_NS,
    )
    ctypes.CDLL(None).syscall(number, 0, ctypes.byref(wish), 0)  # refused, nothing is lost but time
