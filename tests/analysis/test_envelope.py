"""The expected error over a replay."""

from __future__ import annotations

import numpy as np
import pytest

import companion as c
from companion.analysis import GENERIC, assess, expected_since_anchor, replay
from tests.recordings import BUNDLED

FLIGHT = c.open_log(BUNDLED / "copter-demo-100hz.tlog")[0]
FOUND = assess(FLIGHT, GENERIC)


def test_it_begins_at_each_anchor_and_grows() -> None:
    shown = replay(FLIGHT, reanchor_s=10.0)
    envelope = expected_since_anchor(FOUND, shown)
    assert envelope
    t, attitude, _, position = envelope
    assert (np.diff(t) > 0).all()
    assert position[np.searchsorted(t, shown.anchors[3])] == position.min()
    before = np.searchsorted(t, shown.anchors[3]) - 1
    expected = FOUND.expected[3]
    assert expected
    assert position[before] == pytest.approx(expected.position_m, rel=0.02)
    assert attitude[before] == pytest.approx(expected.attitude_deg, rel=0.02)


def test_a_free_run_goes_beyond_what_was_assessed() -> None:
    assert expected_since_anchor(FOUND, replay(FLIGHT, reanchor_s=None)) is None
