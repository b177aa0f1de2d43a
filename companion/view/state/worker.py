"""Work beside the view thread, for which the end of the process does not wait."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from concurrent.futures import Future, wait
from functools import partial
from typing import Generic, TypeVar

Order = TypeVar("Order")
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


class LatestOnly(Generic[Order, Result]):
    """One thread at a time, one place in the queue: the newest order wins, those in between are never begun."""

    def __init__(self, name: str, work: Callable[[Order], Result]) -> None:
        self._name, self._work = name, work
        self._running: Future[Result] | None = None
        self._waiting: list[Order] = []  # one or none: an order may be None
        self._wanted = True

    @property
    def busy(self) -> bool:
        """Whether a result is still to come."""
        return bool(self._waiting) or (self._running is not None and self._wanted)

    def request(self, order: Order) -> None:
        """Order a piece of work; whatever was ordered before and is not done is no longer wanted."""
        self._waiting = [order]
        self._start_next()

    def forget(self) -> None:
        """What was ordered and is not done is no longer wanted."""
        self._waiting, self._wanted = [], False

    def poll(self) -> Result | None:
        """The newest result if it has just come. An error of the work is raised here."""
        if self._running is None or not self._running.done():
            return None
        result, wanted = self._running.result(), self._wanted
        self._running = None
        superseded = bool(self._waiting) or not wanted
        self._start_next()
        return None if superseded else result

    def close(self) -> None:
        """Drop the waiting work, and give the running one a moment to end; after that it is left alone."""
        self.forget()
        if self._running is not None:
            leave([self._running])

    def _start_next(self) -> None:
        if self._running is None and self._waiting:
            self._running = begin(self._name, partial(self._work, self._waiting.pop()))
            self._wanted = True
