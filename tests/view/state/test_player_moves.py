"""The controls of time, as a user presses them."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.view.state.player import Player

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
