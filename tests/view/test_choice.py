"""The worker: the newest request wins, and an error in words is an outcome."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from functools import partial

import pytest

from companion.analysis import Integration
from companion.model import DataError, Flight
from companion.view import Footage, Insight, Reckoning, ReplayChoice, Viewer
from companion.view.state.work import Opinion, Outcome, Work
from tests.view.browser_messages import plain_page
from tests.view.browsing import until
from tests.view.circles import examine, recompute
from tests.waiting import LIMIT_S


def wait_for(worker: Work) -> Outcome | Opinion:
    """The next outcome that is still wanted."""
    found: list[Outcome | Opinion] = []

    def come() -> bool:
        outcome = worker.poll()
        if outcome is not None:
            found.append(outcome)
        return bool(found)

    until(come, "an outcome")
    return found[0]


def test_the_newest_request_wins_and_those_between_are_never_begun(flight: Flight) -> None:
    gate, begun = threading.Event(), list[str]()

    def slow(flight: Flight, choice: ReplayChoice) -> Reckoning:
        begun.append(choice.how.method)
        gate.wait(LIMIT_S)
        return recompute(flight, choice)

    worker = Work(slow, examine)
    try:
        worker.reckon(flight, ReplayChoice(how=Integration(method="euler")))
        until(lambda: begun == ["euler"], "the first")
        worker.reckon(flight, ReplayChoice(how=Integration(method="midpoint")))
        worker.reckon(flight, ReplayChoice(how=Integration(method="rk4")))
        gate.set()
        outcome = wait_for(worker)
        assert isinstance(outcome, Outcome)
        assert (outcome.choice.how.method, begun) == ("rk4", ["euler", "rk4"])
        assert isinstance(outcome.result, Footage)
        assert worker.poll() is None
        worker.examine(outcome)
        opinion = wait_for(worker)
        assert isinstance(opinion, Opinion)
        assert opinion.film is outcome.result
        assert isinstance(opinion.result, Insight)
        worker.examine(outcome)
        worker.reckon(flight, ReplayChoice())  # what is being examined is no longer wanted
        assert isinstance(wait_for(worker), Outcome)
        time.sleep(0.5)
        assert worker.poll() is None
    finally:
        gate.set()
        worker.close()


def test_what_cannot_be_reckoned_is_an_outcome_and_a_bug_is_raised(flight: Flight) -> None:
    def fail(_: Flight, choice: ReplayChoice) -> Reckoning:
        raise DataError("no attitude") if choice.how.method == "euler" else KeyError("bug")

    worker = Work(fail, examine)
    try:
        worker.reckon(flight, ReplayChoice(how=Integration(method="euler")))
        assert str(wait_for(worker).result) == "no attitude"
        worker.reckon(flight, ReplayChoice(how=Integration(method="rk4")))
        with pytest.raises(KeyError, match="bug"):
            wait_for(worker)
    finally:
        worker.close()


def test_a_choice_that_is_still_being_reckoned_is_not_forgotten(flight: Flight) -> None:
    asked: list[ReplayChoice] = []

    def slow(flight: Flight, choice: ReplayChoice) -> Reckoning:
        asked.append(choice)
        if choice.how.segments == 4:
            time.sleep(0.5)
        return recompute(flight, choice)

    with Viewer([flight], slow, examine, port=0) as viewer:
        viewer.post(
            partial(viewer.controller.change, lambda choice: replace(choice, how=replace(choice.how, segments=4)))
        )
        viewer.post(partial(viewer.player.seek, 110.0))
        viewer.post(partial(viewer.controller.change, lambda choice: replace(choice, start_s=viewer.player.time)))
        until(lambda: asked[-1].start_s == 110.0, "the start")
        assert asked[-1].how.segments == 4


def test_a_control_changes_nothing_else_that_was_asked_for(flight: Flight) -> None:
    """Until the answer is there the other controls still show what was before."""
    asked: list[ReplayChoice] = []
    answered = threading.Event()

    def slow(flight: Flight, choice: ReplayChoice) -> Reckoning:
        asked.append(choice)
        if choice.start_s is not None:
            answered.wait(LIMIT_S)
        return recompute(flight, choice)

    with Viewer([flight], slow, examine, port=0) as viewer, plain_page(viewer.url) as page:
        page.listen(lambda: any(one.get("props", {}).get("label") == "Segments" for one in page.told))
        viewer.post(partial(viewer.player.seek, 110.0))
        viewer.post(partial(viewer.controller.change, lambda choice: replace(choice, start_s=viewer.player.time)))
        until(lambda: asked[-1].start_s == 110.0, "the start")
        page.choose("Segments", 4)
        page.choose("Integrator", "Euler (simplest)")
        page.choose("Gravity, m/s²", [1.0, 2.0])  # no name at all
        page.choose("Re-anchor", False)
        answered.set()
        until(lambda: asked[-1].reanchor_s is None, "all of it")
        assert (asked[-1].start_s, asked[-1].how.segments, asked[-1].how.method) == (110.0, 4, "euler")
        until(lambda: viewer.player.start == 110.0, "the new interval")


def test_a_choice_that_cannot_be_shown_is_taken_back(flight: Flight) -> None:
    def picky(flight: Flight, choice: ReplayChoice) -> Reckoning:
        if choice.gravity == "normal":
            raise DataError("no place")
        return recompute(flight, choice)

    with Viewer([flight], picky, examine, port=0) as viewer, plain_page(viewer.url) as page:
        page.listen(lambda: any(one.get("props", {}).get("label") == "Segments" for one in page.told))
        page.choose("Gravity, m/s²", "Where it flew (WGS-84)")
        uuid = page.control("Gravity, m/s²")["uuid"]
        told = {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": "9.80665 (standard)"}}
        page.listen(lambda: any("no place" in str(one) for one in page.told))
        said = next(i for i, one in enumerate(page.told) if "no place" in str(one))
        page.listen(lambda: told in page.told[said:])
