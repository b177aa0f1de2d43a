"""A worker for whom only the newest order counts, so that the picture keeps moving while it works."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Generic, TypeVar

from companion.view.background import begin, leave

Order = TypeVar("Order")
Result = TypeVar("Result")


class Newest(Generic[Order, Result]):
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
