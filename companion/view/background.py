"""Work beside the view thread that the end of the process does not wait for."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from concurrent.futures import Future, wait
from typing import TypeVar

Result = TypeVar("Result")

_PATIENCE_S = 0.5


def begin(name: str, work: Callable[[], Result]) -> Future[Result]:
    """Begin it in a thread of its own: a daemon, for the threads of a ThreadPoolExecutor outlive Ctrl-C by their work.

    What it raises is raised where the result is asked for.
    """
    done: Future[Result] = Future()

    def run() -> None:
        try:
            done.set_result(work())
        except BaseException as error:  # noqa: BLE001 - raised by `result` in the view thread
            done.set_exception(error)

    threading.Thread(target=run, name=f"companion-{name}", daemon=True).start()
    return done


def leave(running: Iterable[Future[Result]]) -> None:
    """Give it a moment to end: an hour's analysis that nobody waits for any more is left alone."""
    wait(list(running), _PATIENCE_S)
