"""What a live page keeps of its past: the newest rows, in order, in a memory that does not grow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.comparison import FreeState, Replay
from companion.model import NavState
from companion.view import ReplayChoice
from companion.view.state.live import History, free_run, present
from companion.view.state.trajectory import Errors
from tests.view.circles import dead_reckon, make_flight

WHOLE: Replay = dead_reckon(make_flight(), ReplayChoice())


def until(t: float) -> Replay:
    """The replay as it was at t s of the boot clock."""
    end = int(np.searchsorted(WHOLE.t, t, side="right"))
    columns = {name: getattr(WHOLE, name)[:end] for name in _COLUMNS}
    return replace(WHOLE, **columns, anchors=WHOLE.anchors[t >= WHOLE.anchors])


_COLUMNS = (
    "t", "q_imu", "velocity_imu", "position_imu", "q_ref", "velocity_ref", "position_ref", "attitude_error",
    "velocity_error", "position_error", "reference_valid",
)  # fmt: skip


def free_at(replay: Replay) -> FreeState:
    state = NavState(float(replay.t[-1]), replay.q_ref[-1], replay.velocity_ref[-1], replay.position_ref[-1] + 3.0)
    return FreeState(float(WHOLE.t[0]), state, np.radians([3.0, 4.0, -2.0]), np.array([0.0, 3.0, 4.0]), np.zeros(3))


def test_the_newest_rows_are_kept_in_order() -> None:
    history = History(10.0, 10.0)
    t0 = float(WHOLE.t[0])
    for t in t0 + np.arange(1.0, 30.0, 0.05):
        replay = until(t)
        history.add(replay, free_at(replay))
    assert len(history) == 100
    past = history.past()
    t = past.display.replay.t
    assert t[-1] == 0.0
    assert t[0] == pytest.approx(-9.9, abs=0.2)
    assert (np.diff(t) > 0.08).all()
    assert past.end == pytest.approx(t0 + 29.9, abs=0.1)
    then = past.display.at(-5.0)
    i = int(np.searchsorted(WHOLE.t, past.end - 5.0))
    np.testing.assert_allclose(then.position_ref, WHOLE.position_ref[i], atol=0.2)
    assert then.since_anchor_s == pytest.approx(past.end - 5.0 - WHOLE.anchors[WHOLE.anchors < past.end - 5.0][-1])
    assert past.free[-1] == pytest.approx([5.0, -2.0, 5.0, 0.0])
    curves, errors = history.curves(), past.display.errors
    for column in Errors.__slots__:
        np.testing.assert_allclose(getattr(curves.errors, column), getattr(errors, column), atol=1e-9)
    for i, column in enumerate(Errors.__slots__[1:]):
        np.testing.assert_array_equal(getattr(curves.free, column), past.free[:, i])
    assert curves.age[-1] == pytest.approx(past.end - WHOLE.anchors[WHOLE.anchors <= past.end][-1], abs=1e-6)
    np.testing.assert_array_equal(curves.known, past.display.replay.reference_valid)
    history.clear()
    assert len(history) == 0


def test_a_silence_is_a_gap_in_the_charts() -> None:
    history = History(60.0, 10.0)
    t0 = float(WHOLE.t[0])
    for t in [*np.arange(1.0, 5.0, 0.1), *np.arange(12.0, 15.0, 0.1)]:
        history.add(until(t0 + t), None)
    past = history.past()
    valid = past.display.replay.reference_valid
    gap = np.flatnonzero(np.diff(past.display.replay.t) > 1.0)
    assert len(gap) == 1
    assert not valid[gap[0]]
    assert not valid[gap[0] + 1]
    assert valid.sum() == len(valid) - 2
    assert np.isnan(past.free).all()


def test_the_present_is_the_last_sample() -> None:
    now = present(WHOLE)
    assert now.end == WHOLE.t[-1]
    np.testing.assert_allclose(now.at(now.end).position_imu, WHOLE.position_imu[-1])
    assert free_run(free_at(WHOLE), 0.0).errors[0] == pytest.approx(5.0)
