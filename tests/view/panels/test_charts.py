"""What the charts draw: nothing that matters is lost, whatever is zoomed to; readings, and what is expected."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from companion.verdict import LiveVerdict
from companion.view import ReplayChoice
from companion.view.panels.chart import DASHED, DOTTED, MOST_POINTS, curves, legend_style
from companion.view.panels.chart_pages import expected_over, reading_drawings
from companion.view.state.live import Curves
from companion.view.state.trajectory import Errors, display_trajectory
from tests.view.circles import dead_reckon, make_flight

T = 100.0 + np.arange(0.0, 60.0, 0.01)
SINE = np.sin(T)


@given(st.integers(0, len(T) - 1))
def test_a_spike_of_one_sample_stays_visible(where: int) -> None:
    spiky = SINE.copy()
    spiky[where] = 5.0
    drawn = curves([(T, spiky), (T, SINE), (T, -SINE)])
    assert drawn.values[0].max() == 5.0
    assert len(drawn.t) <= MOST_POINTS


@given(st.floats(100.0, 160.0), st.floats(0.05, 30.0))
def test_a_part_is_drawn_from_edge_to_edge_and_finer(low: float, length: float) -> None:
    high = min(low + length, T[-1])
    drawn = curves([(T, SINE)], part=(low, high))
    assert drawn.t[0] <= low or drawn.t[0] == T[0]
    assert drawn.t[-1] >= min(high, T[-1])
    assert (np.diff(drawn.t) > 0).all()
    inside = (low <= T) & (high >= T)
    if inside.sum() <= MOST_POINTS - 2:
        assert set(T[inside]) <= set(drawn.t)  # every sample


@given(st.lists(st.tuples(st.integers(0, 5900), st.integers(1, 200)), max_size=30), st.floats(100.0, 160.0))
def test_gaps_are_shaded_where_they_are(gaps: list[tuple[int, int]], now: float) -> None:
    known = np.ones(len(T))
    for begin, length in gaps:
        known[begin : begin + length] = 0.0
    drawn = curves([(T, SINE)], (T, known))
    t, sine, shade = drawn.at(now)
    assert len(t) <= MOST_POINTS + 3
    assert np.isfinite([t, sine, shade]).all()
    assert (np.diff(t) >= 0).all()
    if np.count_nonzero(np.diff(known) < 0) + (known[0] == 0) <= 20:  # else only the longest
        beside = np.interp(T, drawn.t, drawn.gap)
        np.testing.assert_allclose(beside, 1.0 - known, atol=1e-9)


@given(st.floats(100.0, 160.0))
def test_the_line_at_the_instant_reaches_from_edge_to_edge_in_a_gap_too(now: float) -> None:
    known = (T < 120.0).astype(np.float64)
    t, _, shade = curves([(T, SINE)], (T, known)).at(now)
    here = shade[t == now]
    assert here.min() <= 0.0
    assert here.max() >= 1.0


@given(st.integers(0, len(T) - 1), st.integers(0, 599))
def test_lines_of_other_times_keep_their_peaks_too(fine: int, coarse: int) -> None:
    slow = T[::10]
    a, b = np.zeros(len(T)), np.zeros(len(slow))
    a[fine], b[coarse] = 3.0, -4.0
    drawn = curves([(T, a), (slow, b)])
    assert (drawn.values[0].max(), drawn.values[1].min()) == (3.0, -4.0)
    assert len(drawn.t) <= MOST_POINTS
    assert (np.diff(drawn.t) > 0).all()


def test_a_legend_shows_dashes_as_the_lines_have_them() -> None:
    """Rows of uPlot's legend count from 1, and the first is time."""
    style = legend_style([None, DASHED, DOTTED])
    assert style.count("border-style") == 2
    assert "nth-child(3) .u-marker{border-style:dashed" in style
    assert "nth-child(4) .u-marker{border-style:dotted" in style


def test_readings_and_what_they_were_before_correction_are_in_the_same_units() -> None:
    flight = make_flight()
    imu = flight.imu("RAW_IMU")
    turning = replace(imu, gyro=imu.gyro + np.radians([10.0, -20.0, 30.0]))
    corrected = replace(turning, gyro=turning.gyro - np.radians([1.0, 1.0, 1.0]), accel=imu.accel + 0.5)
    display = display_trajectory(dead_reckon(flight, ReplayChoice()), corrected)
    gyro, accel = reading_drawings(display, replace(flight, imus={"RAW_IMU": turning}))
    assert (gyro.unit, accel.unit) == ("deg/s", "m/s²")
    shown = [[(line.dash is None, float(np.median(line.values).round(6))) for line in d.lines] for d in (gyro, accel)]
    assert shown[0] == [(True, 9.0), (True, -21.0), (True, 29.0), (False, 10.0), (False, -20.0), (False, 30.0)]
    assert shown[1] == [(True, 0.5), (True, 0.5), (True, -9.30665), (False, 0.0), (False, 0.0), (False, -9.80665)]


def test_the_band_grows_since_the_anchor_and_begins_again_with_the_next() -> None:
    t = np.linspace(-10.0, 0.0, 101)
    age = np.where(t < -4.0, t + 14.0, t + 4.0)  # an anchor at -14 s and one at -4 s
    nothing = np.zeros(101)
    errors = Errors(t, nothing, nothing, nothing, nothing)
    known = np.ones(101, np.bool_)
    curves = Curves(errors, errors, age, known, known, has_position=True)
    expected = ((2.0, 0.1, 0.2, 0.3), (10.0, 0.9, 1.0, 8.3))
    band = expected_over(curves, LiveVerdict("", "", expected=expected))
    assert band is not None
    for one, first in zip((band.attitude_deg, band.velocity_mps, band.position_m), (0.3, 0.4, 2.3), strict=True):
        np.testing.assert_allclose([one[0], one[-1]], first)
        assert one[59] > 2.0 * one[61], "a new anchor"
    assert expected_over(curves, LiveVerdict("", "")) is None
