"""What is expected of the errors on the live charts."""

from __future__ import annotations

import numpy as np

from companion.view import Judgement
from companion.view.charts.live_charts import expected_lines
from companion.view.state.history import Curves


def test_the_band_grows_since_the_anchor_and_begins_again_with_the_next() -> None:
    t = np.linspace(-10.0, 0.0, 101)
    age = np.where(t < -4.0, t + 14.0, t + 4.0)  # an anchor at -14 s and one at -4 s
    curves = Curves(t, np.zeros((101, 4)), np.zeros((101, 4)), age, np.ones(101, np.bool_), has_position=True)
    expected = ((2.0, 0.1, 0.2, 0.3), (10.0, 0.9, 1.0, 8.3))
    bands = expected_lines(curves, Judgement("", "", expected=expected))
    for (one, three), first in zip(bands, (0.3, 0.4, 2.3), strict=True):
        assert (one.name, three.name) == ("1σ", "3σ")
        np.testing.assert_allclose(three.values, 3.0 * one.values)
        np.testing.assert_allclose([one.values[0], one.values[-1]], first)
        assert one.values[59] > 2.0 * one.values[61], "a new anchor"
    assert expected_lines(curves, Judgement("", "")) == ()
