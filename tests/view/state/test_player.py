"""The play clock: laws for any interval, speed and sequence of steps, and the controls as a user presses them."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.view.state.player import FASTEST, SLOWEST, Player


def playing(start: float = 10.0, end: float = 20.0) -> Player:
    player = Player(start, end)
    player.toggle()
    return player


def test_starts_paused_at_the_start() -> None:
    player = Player(10.0, 20.0)
    player.advance(1.0)
    assert (player.time, player.playing, player.speed) == (10.0, False, 1.0)


def test_plays_at_its_speed() -> None:
    player = playing()
    player.speed = 2.0
    player.advance(1.5)
    assert player.time == pytest.approx(13.0)


def test_stops_at_the_end_and_starts_over_when_played_again() -> None:
    player = playing()
    player.advance(60.0)
    assert (player.time, player.playing) == (20.0, False)
    player.toggle()
    assert (player.time, player.playing) == (10.0, True)


def test_looping_goes_round() -> None:
    player = playing()
    player.loop = True
    player.advance(23.0)
    assert player.time == pytest.approx(13.0)
    assert player.playing


def test_an_interval_of_one_instant_can_be_played() -> None:
    player = Player(5.0, 5.0)
    player.loop = True
    player.toggle()
    player.advance(1.0)
    assert (player.time, player.playing) == (5.0, False)


def test_going_somewhere_pauses() -> None:
    player = playing()
    player.go(13.0)
    assert (player.time, player.playing) == (13.0, False)
    player.go(-99.0)
    assert player.time == 10.0


def test_backwards_is_forwards_seen_from_the_other_end() -> None:
    there, back = playing(), playing()
    back.backwards = True
    back.seek(back.end)
    for dt in (0.3, 2.0, 1.1):
        there.advance(dt)
        back.advance(dt)
        assert there.time - there.start == pytest.approx(back.end - back.time)
    back.advance(60.0)
    assert (back.time, back.playing) == (10.0, False)
    back.toggle()
    assert (back.time, back.playing) == (20.0, True)


@pytest.mark.parametrize("backwards", [False, True])
def test_a_step_too_small_to_count_is_not_the_end(backwards: bool) -> None:
    player = playing()
    player.backwards = backwards
    player.seek(player.end if backwards else player.start)
    before = player.time
    player.advance(1e-300)
    assert (player.time, player.playing) == (before, True)


def test_a_part_is_played_and_nothing_else() -> None:
    player = playing()
    player.loop = True
    player.choose_part(16.0, 12.0)  # in either order
    assert (player.part, player.time) == ((12.0, 16.0), 12.0)
    player.advance(5.0)
    assert player.time == pytest.approx(13.0)
    player.seek(19.0)
    assert player.time == 16.0
    player.choose_part(14.0, 14.0)
    assert player.part == player.whole == (10.0, 20.0)


def test_the_part_outlives_a_new_reckoning_of_the_same_flight_and_not_another_flight() -> None:
    player = playing()
    player.choose_part(12.0, 16.0)
    player.load(13.0, 20.0, time=14.0)
    assert (player.start, player.end) == (13.0, 16.0)
    player.load(100.0, 120.0)
    assert player.part == player.whole == (100.0, 120.0)


def test_loading_keeps_the_place_where_it_can() -> None:
    player = playing()
    player.speed = 5.0
    player.load(12.0, 15.0, time=18.0)
    assert (player.time, player.speed, player.playing) == (15.0, 5.0, True)


WHAT = ["advance", "seek", "go", "speed", "toggle", "backwards", "part"]


@given(st.lists(st.tuples(st.sampled_from(WHAT), st.floats()), max_size=30))
def test_whatever_happens_the_time_stays_within_the_interval(steps: list[tuple[str, float]]) -> None:
    player = playing(-3.0, 7.5)
    player.loop = True
    for what, value in steps:
        if what == "speed":
            player.speed = value
        elif what == "backwards":
            player.backwards = value > 0
        elif what == "part":
            player.choose_part(player.time, value)
        elif what == "toggle":
            player.toggle()
        else:
            getattr(player, what)(value)
        assert player.first <= player.start <= player.time <= player.end <= player.last
        assert SLOWEST <= player.speed <= FASTEST


@given(st.lists(st.floats(0.0, 0.5), max_size=20), st.floats(SLOWEST, FASTEST))
def test_time_depends_on_the_sum_of_the_steps_alone(steps: list[float], speed: float) -> None:
    many, once = playing(0.0, 1e4), playing(0.0, 1e4)
    many.speed = once.speed = speed
    for dt in steps:
        many.advance(dt)
    once.advance(math.fsum(steps))
    assert many.time == pytest.approx(once.time, abs=1e-9)


STOPS = np.arange(0.0, 60.0, 10.0)


@pytest.fixture
def player() -> Player:
    """A minute with an anchor every 10 s, two events and 50 samples a second."""
    player = Player(0.0, 60.0)
    player.stops = {"anchor": STOPS, "event": np.array([3.0, 41.5]), "sample": np.arange(0.0, 60.0, 0.02)}
    return player


def test_anchors_and_events_are_walked_one_by_one(player: Player) -> None:
    on, back = partial(player.jump, forward=True), partial(player.jump, forward=False)
    reached = []
    for jump in (partial(on, "anchor"), partial(on, "anchor"), partial(back, "anchor"), *[partial(on, "event")] * 2):
        jump()
        reached.append(player.time)
    assert reached == [10.0, 20.0, 10.0, 41.5, 41.5]  # there is none after the last
    back("event")
    assert player.time == 3.0


@given(st.lists(st.floats(0, 100)), st.floats(0, 100), st.booleans())
def test_a_jump_passes_no_stop(times: list[float], now: float, forward: bool) -> None:
    player = Player(0.0, 100.0)
    player.stops["event"] = np.sort(np.array(times, dtype=np.float64))
    player.seek(now)
    player.jump("event", forward=forward)
    low, high = sorted((now, player.time))
    assert player.time == now or (player.time > now) == forward
    assert all(not low + 1e-6 < t < high for t in times) if forward else all(not low < t < high - 1e-6 for t in times)
    if player.time == now:
        assert not any(t > now + 1e-6 if forward else t < now - 1e-6 for t in times)


def test_a_sample_on_and_back_pauses(player: Player) -> None:
    player.toggle()
    player.seek(5.005)  # between two samples
    player.jump("sample", forward=True)
    assert not player.playing
    assert player.time == pytest.approx(5.02)
    player.seek(5.005)
    player.jump("sample", forward=False)
    assert player.time == pytest.approx(5.0)
    player.jump("sample", forward=False)
    assert player.time == pytest.approx(4.98)


def test_a_part_bounds_every_jump(player: Player) -> None:
    player.seek(15.0)
    player.cut("from")
    player.seek(35.0)
    player.cut("to")
    assert (player.start, player.end) == (15.0, 35.0)
    player.seek_share(0.5)
    assert player.time == 25.0
    for _ in range(2):
        player.jump("anchor", forward=True)
    assert player.time == 30.0
    player.jump("event", forward=True)
    assert player.time == 30.0
    player.cut("whole")
    player.jump("event", forward=True)
    assert player.time == 41.5


def test_what_is_played_ends_where_it_would_have_though_it_is_recomputed() -> None:
    player = Player(0.0, 100.0)
    player.play(10.0, 20.0)
    player.load(0.0, 100.0, player.time)
    player.advance(30.0)
    assert (player.time, player.playing) == (20.0, False)
