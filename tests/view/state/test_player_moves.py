"""The controls of time, as a user presses them."""

from __future__ import annotations

import pytest

from companion.view import Mark, ReplayChoice
from companion.view.state import events
from companion.view.state.player import Player, move
from companion.view.state.sample import footage
from tests.view.circles import BOOT, RATE, make_flight, recompute

FILM = footage(recompute(make_flight(), ReplayChoice()))  # anchors every 10 s from BOOT on
MARKS = [Mark(BOOT + 3.0, "Arming motors", "arming"), Mark(BOOT + 41.5, "Disarming motors", "arming")]


@pytest.fixture
def player() -> Player:
    return Player(FILM.start, FILM.end)


def after(player: Player, *asked: events.Move) -> float:
    """Seconds since the first sample, when all that was asked has been done."""
    for event in asked:
        move(player, event, FILM, MARKS)
    return player.time - BOOT


NEXT_ANCHOR, ANCHOR_BEFORE = events.Jump("anchor", forward=True), events.Jump("anchor", forward=False)
NEXT_MARK, MARK_BEFORE = events.Jump("mark", forward=True), events.Jump("mark", forward=False)


def test_anchors_and_marks_are_walked_one_by_one(player: Player) -> None:
    assert after(player, NEXT_ANCHOR, NEXT_ANCHOR) == pytest.approx(20.0)
    assert after(player, ANCHOR_BEFORE) == pytest.approx(10.0)
    assert after(player, NEXT_MARK) == pytest.approx(41.5)
    assert after(player, NEXT_MARK) == pytest.approx(41.5)  # there is none after it
    assert after(player, MARK_BEFORE) == pytest.approx(3.0)
    assert after(player, events.JumpToMark(1)) == pytest.approx(41.5)
    assert after(player, events.JumpToMark(-1), events.JumpToMark(99)) == pytest.approx(41.5)


def test_a_frame_is_a_sample_and_pauses(player: Player) -> None:
    after(player, events.Toggle())
    assert after(player, events.Seek(BOOT + 5.0), events.StepSample(1)) == pytest.approx(5.0 + 1 / RATE)
    assert not player.playing
    assert after(player, events.StepSample(-1), events.StepSample(-1)) == pytest.approx(5.0 - 1 / RATE)


def test_a_part_bounds_every_jump(player: Player) -> None:
    after(player, events.Seek(BOOT + 15.0), events.SetPart("from"), events.Seek(BOOT + 35.0), events.SetPart("to"))
    assert (player.start, player.end) == pytest.approx((BOOT + 15.0, BOOT + 35.0))
    assert after(player, events.SeekShare(0.5)) == pytest.approx(25.0)
    assert after(player, NEXT_ANCHOR, NEXT_ANCHOR) == pytest.approx(30.0)
    assert after(player, NEXT_MARK) == pytest.approx(30.0)
    assert after(player, events.SetPart("whole"), NEXT_MARK) == pytest.approx(41.5)


def test_speed_direction_and_repeat_are_the_clocks(player: Player) -> None:
    after(player, events.SetSpeed(5.0), events.SetBackwards(True), events.SetLoop(True))
    assert (player.speed, player.backwards, player.loop) == (5.0, True, True)
