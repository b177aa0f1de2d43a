"""Waiting for facts: what a test waits for has happened, or it fails and says what has not."""

from __future__ import annotations

import contextlib
import inspect
import threading
import time
from collections.abc import Callable, Iterator

LIMIT_S = 180.0
"""How long anything is waited for: far more than it takes on a busy machine, and green tests never wait it out."""


def wait_for(happened: Callable[[], object], what: str = "", *, look_s: float = 0.03) -> None:
    """Fails unless something becomes true: `what`, or else what the source says. It looks each `look_s`."""
    end = time.monotonic() + LIMIT_S
    while not happened():
        if time.monotonic() > end:
            raise AssertionError(f"not within {LIMIT_S:g} s: {what or inspect.getsource(happened).strip()}")
        time.sleep(look_s)


@contextlib.contextmanager
def meanwhile(work: Callable[[], object]) -> Iterator[None]:
    """What is done in another thread at the same time, and waited for."""
    thread = threading.Thread(target=work)
    thread.start()
    yield
    thread.join()
