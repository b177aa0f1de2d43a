"""What is worked out beside the view: the reckoning that was asked for, then what the analysis says of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from companion.model import CompanionError, Flight
from companion.view.state.choice import Examine, Recompute, ReplayChoice
from companion.view.state.insight import Insight
from companion.view.state.sample import Footage, footage
from companion.view.state.worker import LatestOnly

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
            return f"Reckoning for {seconds:.0f} s. Another choice takes its place."
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
