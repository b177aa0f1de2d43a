"""The workers: the newest request wins, an error in words is an outcome, and nobody waits for what is not needed."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from dataclasses import replace
from functools import partial

import pytest

from companion.model import DataError, Flight
from companion.view import AnalysisResult, DisplayTrajectory, ReplayChoice, Viewer
from companion.view.state.work import Worker
from tests.view.browser_messages import plain_page
from tests.view.browsing import until
from tests.view.circles import examine, recompute
from tests.waiting import LIMIT_S


def test_the_newest_request_wins_and_those_between_are_never_begun() -> None:
    gate, begun, given = threading.Event(), list[str](), list[object]()
    worker = Worker("test")

    def slow(name: str) -> str:
        begun.append(name)
        gate.wait(LIMIT_S)
        return name

    def polled() -> list[object]:
        worker.poll()
        return given

    try:
        worker.request(partial(slow, "first"), given.append)
        until(lambda: begun == ["first"], "the first")
        worker.request(partial(slow, "second"), given.append)
        worker.request(partial(slow, "third"), given.append)
        assert worker.busy_s > 0
        gate.set()
        until(lambda: bool(polled()), "a result")
        assert (given, begun, worker.busy_s) == (["third"], ["first", "third"], 0.0)
        worker.request(partial(slow, "fourth"), given.append)
        worker.forget()  # it is no longer wanted
        worker.request(partial(slow, "fifth"), given.append)
        until(lambda: len(polled()) > 1, "the next result")
        assert given == ["third", "fifth"]
    finally:
        gate.set()
        worker.close()


def test_what_cannot_be_done_is_a_result_and_a_bug_is_raised() -> None:
    def fail(error: Exception) -> None:
        raise error

    given = list[object]()
    worker = Worker("test")

    def polled() -> list[object]:
        worker.poll()
        return given

    try:
        worker.request(partial(fail, DataError("no attitude")), given.append)
        until(lambda: bool(polled()), "why not")
        assert str(given[0]) == "no attitude"
        worker.request(partial(fail, KeyError("bug")), given.append)
        with pytest.raises(KeyError, match="bug"):
            until(lambda: len(polled()) > 1, "never")
    finally:
        worker.close()


def test_a_choice_that_is_still_being_reckoned_is_not_forgotten(flight: Flight) -> None:
    requested: list[ReplayChoice] = []

    def slow(flight: Flight, choice: ReplayChoice) -> DisplayTrajectory:
        requested.append(choice)
        if choice.how.segments == 4:
            time.sleep(0.5)
        return recompute(flight, choice)

    with Viewer([flight], slow, examine, port=0) as viewer:
        viewer.post(
            partial(viewer.controller.change, lambda choice: replace(choice, how=replace(choice.how, segments=4)))
        )
        viewer.post(partial(viewer.player.seek, 110.0))
        viewer.post(partial(viewer.controller.change, lambda choice: replace(choice, start_s=viewer.player.time)))
        until(lambda: requested[-1].start_s == 110.0, "the start")
        assert requested[-1].how.segments == 4


def test_a_control_changes_nothing_else_that_was_asked_for(flight: Flight) -> None:
    """Until the answer is there the other controls still show what was before."""
    requested: list[ReplayChoice] = []
    answered = threading.Event()

    def slow(flight: Flight, choice: ReplayChoice) -> DisplayTrajectory:
        requested.append(choice)
        if choice.start_s is not None:
            answered.wait(LIMIT_S)
        return recompute(flight, choice)

    with Viewer([flight], slow, examine, port=0) as viewer, plain_page(viewer.url) as page:
        page.listen(lambda: any(one.get("props", {}).get("label") == "Segments" for one in page.messages))
        viewer.post(partial(viewer.player.seek, 110.0))
        viewer.post(partial(viewer.controller.change, lambda choice: replace(choice, start_s=viewer.player.time)))
        until(lambda: requested[-1].start_s == 110.0, "the start")
        page.choose("Segments", 4)
        page.choose("Integrator", "Euler (simplest)")
        page.choose("Gravity, m/s²", [1.0, 2.0])  # no name at all
        page.choose("Re-anchor", False)
        answered.set()
        until(lambda: requested[-1].reanchor_s is None, "all of it")
        assert (requested[-1].start_s, requested[-1].how.segments, requested[-1].how.method) == (110.0, 4, "euler")
        until(lambda: viewer.player.start == 110.0, "the new interval")


def test_a_choice_that_cannot_be_shown_is_taken_back(flight: Flight) -> None:
    def picky(flight: Flight, choice: ReplayChoice) -> DisplayTrajectory:
        if choice.gravity == "normal":
            raise DataError("no place")
        return recompute(flight, choice)

    with Viewer([flight], picky, examine, port=0) as viewer, plain_page(viewer.url) as page:
        page.listen(lambda: any(one.get("props", {}).get("label") == "Segments" for one in page.messages))
        page.choose("Gravity, m/s²", "Where it flew (WGS-84)")
        uuid = page.control("Gravity, m/s²")["uuid"]
        sent = {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": "9.80665 (standard)"}}
        page.listen(lambda: any("no place" in str(one) for one in page.messages))
        reported = next(i for i, one in enumerate(page.messages) if "no place" in str(one))
        page.listen(lambda: sent in page.messages[reported:])


def test_a_long_work_holds_up_neither_the_end_nor_the_process() -> None:
    program = """
import time
from companion.view.state.work import Worker
worker = Worker("test")
worker.request(lambda: time.sleep(600.0), print)
worker.request(lambda: time.sleep(601.0), print)
worker.close()
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=LIMIT_S)


def test_a_page_is_left_at_once_while_it_is_analysed(flight: Flight) -> None:
    analysed, over, done = threading.Event(), threading.Event(), threading.Event()

    def endless(flight: Flight, choice: ReplayChoice, display: DisplayTrajectory) -> AnalysisResult:
        analysed.set()
        over.wait(2 * LIMIT_S)
        done.set()
        return examine(flight, choice, display)

    viewer = Viewer([flight], recompute, endless, port=0)
    try:
        assert analysed.wait(LIMIT_S)
        viewer.close()
        assert not done.is_set()
    finally:
        over.set()
