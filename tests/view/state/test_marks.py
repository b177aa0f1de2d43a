"""Marks: what the vehicle said becomes ticks on the timeline, and never markup."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import example, given
from hypothesis import strategies as st

from companion.model import Flight, StatusText
from companion.view.panels.strip import strip, time_ticks
from companion.view.state.moments import Mark, marks_of, short
from tests.view.browser_messages import Tags

HOSTILE = [
    "<script>alert(1)</script>",
    "<img src=x onerror=\"document.title='owned'\">",
    '"></div><svg/onload=alert(1)>',
    "' onmouseover='alert(1)",
    "&lt;b&gt; &#x3C;i&#x3E;",
    "**bold** [link](javascript:alert(1))",
    "\x00\x1b[31m\n\r\u202e\u2028",
]


@given(st.text() | st.sampled_from(HOSTILE))
def test_a_label_is_never_markup(label: str) -> None:
    seen = Tags(strip([Mark(5.0, label, "trouble"), Mark(2.0, label, "anchor")], 0.0, 10.0, (1.0, 9.0)))
    assert seen.tags <= {"div", "span"}
    assert seen.attributes <= {"style", "title", "class"}
    assert not set(seen.words) - set(" s0123456789")  # the axis of time


@given(st.text())
def test_a_short_label_is_one_printable_line(label: str) -> None:
    assert 0 < len(short(label)) <= 60
    assert short(label).isprintable()


def test_what_the_vehicle_said_is_sorted_and_told_apart(flight: Flight) -> None:
    reported = [
        (107.0, 6, "Disarming motors"),
        (101.0, 6, "Arming motors"),
        (102.0, 3, "EKF lane switch 1"),
        (103.0, 6, "x"),
    ]
    marks = marks_of(replace(flight, texts=tuple(StatusText(*text) for text in reported)))
    assert [(mark.t, mark.kind) for mark in marks] == [
        (101.0, "arming"),
        (102.0, "trouble"),
        (103.0, "text"),
        (107.0, "arming"),
    ]


def test_marks_outside_are_left_out_and_an_instant_has_no_strip() -> None:
    assert "far" not in strip([Mark(50.0, "far")], 0.0, 10.0)
    assert strip([Mark(5.0, "here")], 5.0, 5.0) == ""


def test_words_are_at_the_pointer() -> None:
    crowd = strip([Mark(5.0 + i / 100, f"event number {i}") for i in range(50)], 0.0, 10.0)
    assert crowd.count("title=") == 50


@given(st.floats(0, 1e6, allow_subnormal=False), st.floats(0.1, 1e5))
@example(335545.0, 0.1)
def test_the_axis_of_time_has_a_few_round_numbers_within(low: float, length: float) -> None:
    ticks = time_ticks(low, low + length)
    assert 1 <= len(ticks) <= 9
    assert all(low <= t <= low + length for t in ticks)
