"""What is worked out beside the view: the reckoning that was asked for, then what the analysis says of it.

The end of the process does not wait for it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future, wait
from dataclasses import dataclass
from functools import partial
from typing import Generic, TypeVar

from companion.model import CompanionError, Flight
from companion.view.state.choice import Examine, Recompute, ReplayChoice
from companion.view.state.insight import Insight
from companion.view.state.sample import Footage, footage

Order = TypeVar("Order")
Result = TypeVar("Result")

_LEAVING_S = 0.5


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
    wait(list(running), _LEAVING_S)


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


PATIENCE_S = 1.0  # of work before it is spoken of


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """A request and what became of it: footage, or the reason why there is none."""

    flight: Flight
    choice: ReplayChoice
    result: Footage | CompanionError


@dataclass(frozen=True, slots=True, eq=False)
class Opinion:
    """What the analysis says of an outcome's footage, or the reason why it says nothing."""

    film: Footage
    result: Insight | CompanionError


class Work:
    """Two workers, so that the next reckoning need not wait for the analysis of the one before.

    Of each only the newest order counts. An error other than CompanionError is a bug, and is raised by `poll`.
    """

    def __init__(self, recompute: Recompute, examine: Examine) -> None:
        self._reckoner: LatestOnly[tuple[Flight, ReplayChoice], Outcome] = LatestOnly(
            "reckon", lambda order: attempt(recompute, *order)
        )
        self._examiner: LatestOnly[Outcome, Opinion | None] = LatestOnly("examine", lambda done: opinion(examine, done))
        self._asked = 0.0

    def reckon(self, flight: Flight, choice: ReplayChoice) -> None:
        """Order a reckoning. What is being examined is no longer wanted."""
        self._asked = time.monotonic()
        self._examiner.forget()
        self._reckoner.request((flight, choice))

    def examine(self, done: Outcome) -> None:
        """Order the analysis of what has been reckoned."""
        self._asked = time.monotonic()
        self._examiner.request(done)

    def poll(self) -> Outcome | Opinion | None:
        """What has just been done and is still wanted."""
        return self._reckoner.poll() or self._examiner.poll()

    def progress(self) -> str:
        """What goes on, in words, when it takes long."""
        seconds = time.monotonic() - self._asked
        if seconds < PATIENCE_S:
            return ""
        if self._reckoner.busy:
            return f"Recomputing for {seconds:.0f} s. Changing a setting restarts it."
        return f"The analysis has worked for {seconds:.0f} s." if self._examiner.busy else ""

    def close(self) -> None:
        """Drop what waits; what is being done has a moment to end."""
        self._reckoner.close()
        self._examiner.close()


def attempt(recompute: Recompute, flight: Flight, choice: ReplayChoice) -> Outcome:
    """Reckon `choice`: its footage, or the error that says why not."""
    return Outcome(flight, choice, _or_error(lambda: footage(recompute(flight, choice))))


def opinion(examine: Examine, done: Outcome) -> Opinion | None:
    """Examine what has been reckoned; None when that has failed."""
    film = done.result
    if isinstance(film, CompanionError):
        return None
    return Opinion(film, _or_error(lambda: examine(done.flight, done.choice, film)))


Answer = TypeVar("Answer")


def _or_error(work: Callable[[], Answer]) -> Answer | CompanionError:
    try:
        return work()
    except CompanionError as error:
        return error
