"""Memory that is no longer needed, given back."""

from __future__ import annotations

import ctypes
import sys
from functools import cache
from typing import Any


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
