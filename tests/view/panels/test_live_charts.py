"""What is expected of the errors on the live charts."""

from __future__ import annotations

import numpy as np

from companion.analysis import LiveVerdict
from companion.view.panels.chart_pages import expected_over
from companion.view.state.live import Curves
from companion.view.state.trajectory import Errors


def test_the_band_grows_since_the_anchor_and_begins_again_with_the_next() -> None:
    t = np.linspace(-10.0, 0.0, 101)
    age = np.where(t < -4.0, t + 14.0, t + 4.0)  # an anchor at -14 s and one at -4 s
    nothing = np.zeros(101)
    errors = Errors(t, nothing, nothing, nothing, nothing)
    curves = Curves(errors, errors, age, np.ones(101, np.bool_), has_position=True)
    expected = ((2.0, 0.1, 0.2, 0.3), (10.0, 0.9, 1.0, 8.3))
    band = expected_over(curves, LiveVerdict("", "", expected=expected))
    assert band is not None
    for one, first in zip((band.attitude_deg, band.velocity_mps, band.position_m), (0.3, 0.4, 2.3), strict=True):
        np.testing.assert_allclose([one[0], one[-1]], first)
        assert one[59] > 2.0 * one[61], "a new anchor"
    assert expected_over(curves, LiveVerdict("", "")) is None
