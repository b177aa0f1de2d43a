"""The bands under the slider of time: what lasted how long, and where it is drawn."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.model import Event, Flight
from companion.present import palette
from companion.view import DisplayTrajectory, ReplayChoice, display_trajectory
from companion.view.panels.strip import Bands, Span, bands, markup, outside
from companion.view.state.moments import ErrorCurve
from tests.view.circles import BOOT, dead_reckon, make_flight


def drawn(shown: Bands, low: float, high: float) -> str:
    """The strip without an error."""
    nothing = ErrorCurve("attitude", *np.zeros((3, 0)))
    return markup(shown, low, high, nothing, palette.IMU, None)


def display_of(flight: Flight) -> DisplayTrajectory:
    return display_trajectory(dead_reckon(flight, ReplayChoice()))


def test_a_mode_lasts_until_the_next_and_arming_until_disarming() -> None:
    reported = (
        Event(BOOT + 5.0, "mode", "GUIDED"),
        Event(BOOT + 10.0, "armed", "armed"),
        Event(BOOT + 20.0, "mode", "LAND"),
        Event(BOOT + 40.0, "disarmed", "disarmed"),
    )
    flight = replace(make_flight(), events=reported)
    display = display_of(flight)
    found = bands(flight, display)
    assert [(s.start_s, s.end_s, s.label) for s in found.modes] == [
        (BOOT + 5.0, BOOT + 20.0, "GUIDED"),
        (BOOT + 20.0, display.end, "LAND"),
    ]
    assert [(s.start_s, s.end_s) for s in found.armed] == [(BOOT + 10.0, BOOT + 40.0)]
    assert found.altitude is not None


def test_what_was_armed_before_the_log_began_is_armed_from_its_start() -> None:
    flight = replace(make_flight(), events=(Event(BOOT + 30.0, "disarmed", "disarmed"),))
    display = display_of(flight)
    assert [(s.start_s, s.end_s) for s in bands(flight, display).armed] == [(display.start, BOOT + 30.0)]


@given(st.lists(st.tuples(st.floats(-50, 150), st.floats(0, 80)), max_size=20))
def test_nothing_is_drawn_beside_the_band(spans: list[tuple[float, float]]) -> None:
    found = tuple(Span(start, start + length, "x", "error") for start, length in spans)
    html = drawn(Bands(modes=found, armed=found, findings=found), 0.0, 100.0)
    places = re.findall(r"left:(-?[\d.]+)%;width:max\((-?[\d.]+)%", html)
    assert all(0 <= float(left) <= 100 and 0 <= float(left) + float(width) <= 100.01 for left, width in places)


@pytest.mark.parametrize(
    ("spans", "words"),
    [
        ([(10, 20)], ""),
        ([(-9, -5)], "1 finding lies outside the replay: 1 before it begins."),
        (
            [(-9, -5), (-9, 50), (101, 120), (105, 110)],
            "3 findings lie outside the replay: 1 before it begins, 2 after it ends.",
        ),
    ],
)
def test_findings_that_the_replay_does_not_reach_are_told(spans: list[tuple[float, float]], words: str) -> None:
    assert outside([Span(a, b, "", "error") for a, b in spans], 0.0, 100.0) == words


def test_names_are_text() -> None:
    evil = "<img src=x onerror=alert(1)>"
    html = drawn(Bands(modes=(Span(0.0, 100.0, evil),)), 0.0, 100.0)
    assert "<img" not in html
    assert "&lt;img" in html


def test_the_hill_is_highest_where_the_vehicle_was() -> None:
    flight = make_flight()
    display = display_of(flight)
    altitude = bands(flight, display).altitude
    assert altitude is not None
    up = -display.replay.position_ref[:, 2]
    assert altitude[0][altitude[1].argmax()] == pytest.approx(display.replay.t[up.argmax()], abs=1.0)
    assert altitude[1].max() == pytest.approx(up.max(), abs=0.05)
    hill = drawn(Bands(altitude=altitude), display.start, display.end)
    assert f">{up.max():.1f} m<" in hill
    points = re.findall(r"([\d.]+),([\d.]+)", hill)[1:-1]
    top = min(points, key=lambda point: float(point[1]))
    assert float(top[0]) == pytest.approx(100 * (display.replay.t[up.argmax()] - display.start) / 60.0, abs=2.0)
