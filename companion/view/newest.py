"""A worker for whom only the newest order counts, so that the picture keeps moving while it works."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Generic, TypeVar

Order = TypeVar("Order")
Result = TypeVar("Result")

_PATIENCE_S = 0.5


class Newest(Generic[Order, Result]):
    """One thread at a time, one place in the queue: the newest order wins, those in between are never begun.

    The threads are daemons: an hour's analysis that nobody waits for any more does not keep the process alive, as one
    of a ThreadPoolExecutor would.
    """

    def __init__(self, name: str, work: Callable[[Order], Result]) -> None:
        self._name, self._work = f"companion-{name}", work
        self._thread: threading.Thread | None = None
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
        if self._thread is not None:
            self._thread.join(_PATIENCE_S)

    def _start_next(self) -> None:
        if self._running is None and self._waiting:
            self._running, self._wanted = Future(), True
            task = (self._waiting.pop(), self._running)
            self._thread = threading.Thread(target=self._do, args=task, name=self._name, daemon=True)
            self._thread.start()

    def _do(self, order: Order, done: Future[Result]) -> None:
        try:
            done.set_result(self._work(order))
        except BaseException as error:  # noqa: BLE001 - handed to `poll`, which raises it in the view thread
            done.set_exception(error)
