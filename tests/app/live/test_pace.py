"""Looks are frequent and cheap, judgements seldom and dear."""

from __future__ import annotations

import time
from typing import cast

import pytest

from companion.app.live import Judge, Pace
from companion.verdict import Alarm, LiveVerdict, State


class Judged:
    """In place of a judge: counts what it is asked."""

    def __init__(self) -> None:
        self.newest, self.news, self.most_s = 0.0, False, 90.0
        self.says: State = "consistent"
        self.looks, self.judged = list[float](), list[float]()
        self.last = LiveVerdict("consistent", "", 0.0)

    def is_urgent(self) -> bool:
        self.looks.append(self.newest)
        return self.news

    def judge(self) -> LiveVerdict:
        self.judged.append(self.newest)
        self.last = LiveVerdict(self.says, "", self.newest)
        return self.last


def run(judge: Judged, pace: Pace, begin: float, end: float, *, hears: bool = True) -> None:
    for step in range(round(begin * 20), round(end * 20)):
        judge.newest = step / 20 if hears else judge.newest
        pace.step(step / 20)


def test_it_is_judged_in_turn_and_looked_at_between() -> None:
    judge = Judged()
    pace = Pace(cast("Judge", judge))
    run(judge, pace, 1.0, 15.0)
    assert judge.judged == [1.0, 4.0, 7.0, 10.0, 13.0]
    assert 3 <= sum(4.0 < t < 6.01 for t in judge.looks) <= 4, "more than once a second"


def test_what_has_just_begun_is_judged_at_once() -> None:
    judge = Judged()
    pace = Pace(cast("Judge", judge))
    run(judge, pace, 1.0, 2.0)
    judge.news = True
    run(judge, pace, 2.0, 2.5)
    assert judge.judged[0] == 1.0
    assert 2.0 <= judge.judged[1] <= 2.45


def test_a_verdict_that_has_changed_is_looked_into_at_once() -> None:
    judge = Judged()
    pace = Pace(cast("Judge", judge))
    run(judge, pace, 1.0, 2.0)
    judge.says = "insufficient_data"
    run(judge, pace, 2.0, 10.0)
    assert judge.judged[:2] == [1.0, 4.0]
    assert judge.judged[4] < 4.6
    assert judge.judged[5] >= judge.judged[4] + 2.9, "it is the same as before"
    judge.says = "consistent"
    run(judge, pace, 10.0, 14.0)
    judge.says = "imu_suspect"
    run(judge, pace, 14.0, 20.0)
    first, second, third = [t for t in judge.judged if t >= 14.0][:3]
    assert second < first + 0.2
    assert third >= second + 2.9, "who is suspect is known"


def test_what_stays_new_costs_no_more_than_so_much_between_two_turns() -> None:
    class Slow(Judged):
        def judge(self) -> LiveVerdict:
            until = time.process_time() + 0.05
            while time.process_time() < until:
                """Busy."""
            return super().judge()

    judge = Slow()
    judge.news = True
    pace = Pace(cast("Judge", judge))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("companion.app.live.judge._CALLED_S", 0.14)
        run(judge, pace, 1.0, 4.0)
        assert len(judge.judged) == 3, "in turn, and until it has cost so much"
        run(judge, pace, 4.0, 6.4)
    assert len(judge.judged) == 6


def test_nothing_is_judged_or_looked_at_twice() -> None:
    judge = Judged()
    pace = Pace(cast("Judge", judge))
    run(judge, pace, 1.0, 2.0)
    judged, looks = len(judge.judged), len(judge.looks)
    run(judge, pace, 2.0, 20.0, hears=False)
    assert len(judge.looks) - looks <= 1
    assert len(judge.judged) - judged == 1, "what came after the last judgement"
    pace.at_once()
    run(judge, pace, 20.0, 21.0, hears=False)
    assert len(judge.judged) - judged == 2


def test_a_defect_of_the_analysis_is_said_and_does_not_end_it() -> None:
    class Broken(Judged):
        def judge(self) -> LiveVerdict:
            raise ZeroDivisionError("division by zero")

    judge = Broken()
    judge.newest = 1.0
    said = Pace(cast("Judge", judge)).step(1.0)
    assert said is not None
    assert said.text == "no verdict (ZeroDivisionError: division by zero)"
    assert said.so_far == ("", "nothing is known yet")


def test_a_defect_of_the_analysis_takes_back_no_alarm() -> None:
    class Breaks(Judged):
        def judge(self) -> LiveVerdict:
            if self.newest > 1.0:
                raise ZeroDivisionError
            self.last = LiveVerdict("imu_suspect", "a bias", 1.0, alarms=(Alarm("imu_suspect", "a bias", 1.0, 1.0),))
            return self.last

    judge = Breaks()
    pace = Pace(cast("Judge", judge))
    run(judge, pace, 1.0, 5.0)
    judge.newest = 9.0
    said = pace.step(9.0)
    assert said is not None
    assert (said.status, said.newest, said.so_far[0]) == ("", 0.0, "imu_suspect")


def test_where_judging_takes_long_the_next_begins_sooner_and_less_is_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    took = 0.2
    clock = iter(range(1_000_000))
    judge = Judged()
    pace = Pace(cast("Judge", judge))
    monkeypatch.setattr("companion.app.live.judge.time.monotonic", lambda: next(clock) * took)  # asked twice for each
    run(judge, pace, 1.0, 5.9)
    assert judge.judged == [1.0, 4.0]
    assert judge.most_s == 90.0
    took = 2.0  # on a busy computer: 2.6 s until the next
    run(judge, pace, 6.0, 12.9)
    assert judge.judged[2:] == [7.0, 9.6, 12.2]
    assert judge.most_s == 90.0
    took = 5.0
    run(judge, pace, 13.0, 20.0)
    assert judge.most_s == 40.0, "never less than while nobody is suspect"


def test_where_one_look_took_much_the_next_ones_are_long_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """The onset of what took so much must not be lost for it."""
    busy, clock = [6.0], iter(range(1_000_000))
    judge = Judged()
    pace = Pace(cast("Judge", judge))
    monkeypatch.setattr("companion.app.live.judge.time.process_time", lambda: next(clock) * busy[0])  # twice for each
    run(judge, pace, 1.0, 2.0)
    assert judge.most_s == 24.0, "the newest come first"
    busy[0] = 0.5
    run(judge, pace, 14.0, 15.0)
    assert judge.most_s == pytest.approx(33.6)


@pytest.mark.parametrize("now", [0.0, 0.1, 1234.567, 98765.4321])
def test_what_ends_just_in_time_is_in_time_whatever_the_clock_says(now: float, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter(range(1_000_000))
    judge = Judged()
    judge.most_s = 40.0
    pace = Pace(cast("Judge", judge))
    monkeypatch.setattr("companion.app.live.judge.time.monotonic", lambda: next(clock) * 0.7)
    for later in range(3):
        judge.newest = now + 10.0 * later + 1.0
        pace.step(now + 10.0 * later)
    assert judge.most_s > 50.0
