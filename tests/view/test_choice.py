"""The worker: the newest request wins, and an error in words is an outcome."""

from __future__ import annotations

import threading
import time

import pytest

from companion.errors import DataError
from companion.tracks import Flight
from companion.view.choice import Outcome, Recomputer, ReplayChoice
from companion.view.moment import Footage, Reckoning
from tests.view.circles import recompute


def wait_for(worker: Recomputer) -> Outcome:
    """The next outcome that is still wanted."""
    until = time.monotonic() + 10
    while time.monotonic() < until:
        outcome = worker.poll()
        if outcome is not None:
            return outcome
        time.sleep(0.005)
    raise AssertionError("no outcome in 10 s")


def test_the_newest_request_wins_and_those_between_are_never_begun(flight: Flight) -> None:
    gate, begun = threading.Event(), list[str]()

    def slow(flight: Flight, choice: ReplayChoice) -> Reckoning:
        begun.append(choice.method)
        gate.wait(10)
        return recompute(flight, choice)

    worker = Recomputer(slow)
    try:
        worker.request(flight, ReplayChoice(method="euler"))
        worker.request(flight, ReplayChoice(method="midpoint"))
        worker.request(flight, ReplayChoice(method="rk4"))
        gate.set()
        outcome = wait_for(worker)
        assert (outcome.choice.method, begun) == ("rk4", ["euler", "rk4"])
        assert isinstance(outcome.result, Footage)
        assert not worker.busy
    finally:
        gate.set()
        worker.close()


def test_what_cannot_be_reckoned_is_an_outcome_and_a_bug_is_raised(flight: Flight) -> None:
    def fail(_: Flight, choice: ReplayChoice) -> Reckoning:
        raise DataError("no attitude") if choice.method == "euler" else KeyError("bug")

    worker = Recomputer(fail)
    try:
        worker.request(flight, ReplayChoice(method="euler"))
        assert str(wait_for(worker).result) == "no attitude"
        worker.request(flight, ReplayChoice(method="rk4"))
        with pytest.raises(KeyError, match="bug"):
            wait_for(worker)
    finally:
        worker.close()
