"""The expected error over a replay."""

from __future__ import annotations

import numpy as np
import pytest

import companion as c
from companion.analysis import expected_by_age, expected_since_anchor, replay
from tests.recordings import BUNDLED

pytestmark = pytest.mark.slow

FLIGHT = c.open_log(BUNDLED / "copter-demo-100hz.tlog")[0]


@pytest.fixture(scope="module")
def found() -> c.Assessment:
    return c.examine(FLIGHT).assessment


def test_it_begins_at_each_anchor_and_grows_to_what_was_assessed(found: c.Assessment) -> None:
    shown = replay(FLIGHT, reanchor_s=10.0)
    expected = expected_since_anchor(found, shown)
    assert expected
    assert (np.diff(expected.t) > 0).all()
    _, _, position = expected.lengths
    at = np.searchsorted(expected.t, shown.anchors)
    assert position[at] == pytest.approx(np.sqrt(6) * 0.1)  # the autopilot's position, there and here
    assert (np.diff(position[at[3] : at[4]]) > 0).all()
    assessed = found.expected[3]  # after 10 s: the median of the same windows
    assert assessed
    assert np.median(position[at[1:] - 1]) == pytest.approx(assessed.position_m, rel=0.02)
    assert (np.linalg.eigvalsh(expected.covariance[:, 6:, 6:]) > 0).all()  # an ellipsoid everywhere


def test_a_free_run_goes_beyond_what_a_linear_budget_can_say(found: c.Assessment) -> None:
    free = replay(FLIGHT, reanchor_s=None)
    assert free.t[-1] - free.t[0] < 120
    assert expected_since_anchor(found, free)
    often = replay(FLIGHT, reanchor_s=0.1)
    assert expected_since_anchor(found, often) is None


def test_by_age_it_is_what_the_drift_table_expects(found: c.Assessment) -> None:
    by_age = expected_by_age(found, (1.0, 10.0, 500.0))
    assert by_age[:, 0].tolist() == [1.0, 10.0], "no window is so long"
    for (age, *sigma), row in zip(by_age.tolist(), (0, 3), strict=True):
        one = found.expected[row]
        assert one
        assert found.drift.rows[row].horizon_s == age
        assert sigma == [one.attitude_deg, one.velocity_mps, one.position_m]
    assert expected_by_age(found, ()).shape == (0, 4)
