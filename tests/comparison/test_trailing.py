"""Windows that end at every sample."""

from __future__ import annotations

import numpy as np
import pytest

import companion as c
from companion.comparison import compare, errors, trailing, windows
from tests.recordings import BUNDLED

COMPARISON = compare(c.open_log(BUNDLED / "copter-demo-100hz.tlog")[0])


def test_every_window_of_the_drift_table_is_among_them() -> None:
    table, every = windows(COMPARISON, 5.0), trailing(COMPARISON, 5.0)
    place = np.searchsorted(every.end, table.end)
    np.testing.assert_array_equal(every.start[place], table.start)
    np.testing.assert_array_equal(errors(COMPARISON, every).position[place], errors(COMPARISON, table).position)
    assert len(every.end) + sum(every.excluded.values()) == (COMPARISON.track.t >= COMPARISON.track.t[0] + 5.0).sum()


def test_a_horizon_is_a_length_of_time() -> None:
    assert len(trailing(COMPARISON, 1e6).end) == 0
    for horizon in (0.0, -1.0, np.nan):
        with pytest.raises(c.SettingsError, match="positive seconds"):
            trailing(COMPARISON, horizon)
