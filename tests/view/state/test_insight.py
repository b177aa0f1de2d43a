"""The stretch of a replay that ends farthest apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.view import ReplayChoice
from companion.view.scene.paths import worst_words
from companion.view.state.trajectory import Worst, worst_stretch
from tests.view.circles import BOOT, dead_reckon, make_flight

REPLAY = dead_reckon(make_flight(), ReplayChoice())


def test_it_begins_at_the_anchor_before_and_ends_farthest_apart() -> None:
    apart = np.linalg.norm(REPLAY.position_error, axis=1)
    found = worst_stretch(REPLAY)
    assert found is not None
    assert found.apart_m == pytest.approx(apart.max())
    assert found.end_s == REPLAY.t[np.argmax(apart)]
    assert found.start_s in REPLAY.anchors
    assert not ((REPLAY.anchors > found.start_s) & (REPLAY.anchors < found.end_s)).any()


def test_where_the_autopilot_is_not_known_nobody_is_apart() -> None:
    worst = worst_stretch(REPLAY)
    assert worst is not None
    silent = replace(REPLAY, reference_valid=np.abs(REPLAY.t - worst.end_s) > 1.0)
    other = worst_stretch(silent)
    assert other is not None
    assert abs(other.end_s - worst.end_s) > 1.0
    assert worst_stretch(replace(REPLAY, has_position=False)) is None


def test_its_name_has_time_and_distance() -> None:
    assert worst_words(Worst(BOOT, 26.2, 142.3)) == "26 s: 142 m apart"
