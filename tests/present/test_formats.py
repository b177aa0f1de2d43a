"""Numbers are as wide as their columns, and as exact as three digits allow."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from companion.present import clause, fixed, length, percent, plus_minus, short, significant

SIZES = st.floats(5e-4, 99_999.0)


@given(SIZES)
def test_a_short_number_has_five_characters_and_three_digits(value: float) -> None:
    assert len(short(value)) <= 5
    assert short(value) == fixed(value)
    assert math.isclose(float(short(value)), value, rel_tol=0.0051, abs_tol=0.00051)
    assert short(-value) == f"-{short(value)}"


@given(st.floats(1e-9, 1e9))
def test_what_is_significant_is_within_half_a_digit(value: float) -> None:
    assert math.isclose(float(significant(value)), value, rel_tol=0.051)


def test_what_is_not_there_is_a_dash() -> None:
    assert [short(None), short(math.nan), short(math.inf), percent(None)] == ["–"] * 4


def test_a_number_has_no_finer_decimals_than_its_error() -> None:
    pairs = ((8.1409, 0.0224), (13.7, 0.39), (0.042, 1.22), (137.2, 15.4), (0.0, 0.0), (3.0, math.inf))
    shown = ["8.14 ± 0.02", "13.7 ± 0.4", "0.0 ± 1.2", "137 ± 15", "0.000 ± 0.000", "3.00 ± inf"]
    assert [plus_minus(*pair) for pair in pairs] == shown


def test_a_length_is_told_as_people_say_it() -> None:
    assert [length(x) for x in (1.234, 12.34, 123.4, 1234.0)] == ["1.23 m", "12.3 m", "123 m", "1.23 km"]


def test_the_sentence_does_not_say_the_status_again() -> None:
    assert clause("Suspect the IMU: stuck at 12 s.") == "stuck at 12 s."
    assert clause("IMU and autopilot agree.") == "IMU and autopilot agree."


@given(st.floats(99.0, 101.0))
def test_no_number_ends_in_its_point(value: float) -> None:
    assert not significant(value).endswith(".")
