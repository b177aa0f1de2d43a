"""What is worked out beside the view. The end of the process does not wait for it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future, wait
from functools import partial
from typing import Any, TypeVar

from companion.model import CompanionError

Result = TypeVar("Result")

_LEAVING_S = 0.5


def begin(name: str, work: Callable[[], Result]) -> Future[Result]:
    """Begin it in a thread of its own: a daemon, for the threads of a ThreadPoolExecutor outlive Ctrl-C by their work.

    What it raises is raised where the result is taken.
    """
    done: Future[Result] = Future()

    def run() -> None:
        try:
            done.set_result(work())
        except BaseException as error:  # noqa: BLE001 - raised by `result` in the view thread
            done.set_exception(error)

    threading.Thread(target=run, name=f"companion-{name}", daemon=True).start()
    return done


def leave(running: Iterable[Future[Any]]) -> None:
    """Give it a moment to end: an hour's analysis that nobody waits for any more is left alone."""
    wait(list(running), _LEAVING_S)


def attempt(work: Callable[[], Result]) -> Result | CompanionError:
    """What it gives, or the error that says why it cannot."""
    try:
        return work()
    except CompanionError as error:
        return error


class Worker:
    """One thread at a time, one place in the queue: the newest order wins, those in between are never begun.

    An error other than CompanionError is a bug, and is raised by `poll`.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._running: Future[Callable[[], object]] | None = None
        self._waiting: Callable[[], Callable[[], object]] | None = None
        self._current, self._since = True, 0.0

    @property
    def busy_s(self) -> float:
        """s since the newest order while its result is still to come, else 0."""
        busy = self._waiting is not None or (self._running is not None and self._current)
        return time.monotonic() - self._since if busy else 0.0

    def request(self, work: Callable[[], Result], then: Callable[[Result | CompanionError], object]) -> None:
        """Order a piece of work; whatever was ordered before and is not done is cancelled.

        then: called by `poll` with the result, or with the error that says why there is none.
        """
        self._waiting, self._since = lambda: partial(then, attempt(work)), time.monotonic()
        self._start_next()

    def forget(self) -> None:
        """What was ordered and is not done is cancelled."""
        self._waiting, self._current = None, False

    def poll(self) -> None:
        """Hand over the newest result if it has just come. An error of the work is raised here."""
        if self._running is None or not self._running.done():
            return
        deliver = self._running.result()
        current = self._current and self._waiting is None
        self._running = None
        self._start_next()
        if current:
            deliver()

    def close(self) -> None:
        """Drop the waiting work, and give the running one a moment to end; after that it is left alone."""
        self.forget()
        if self._running is not None:
            leave([self._running])

    def _start_next(self) -> None:
        if self._running is None and self._waiting is not None:
            self._running = begin(self._name, self._waiting)
            self._waiting, self._current = None, True
