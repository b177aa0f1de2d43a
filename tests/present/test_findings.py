"""Findings in groups: none is lost, none is told twice, and what decides stands first."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from companion.present import MOST_LINES, flight_lines, grouped, ranked
from companion.verdict import Cause, Finding, FlightVerdict, Verdict


def finding(kind: str, severity: str, start: float, size: float | None) -> Finding:
    cause = Cause(kind, "autopilot", start, size=size, unit="rad")
    return Finding(kind, "autopilot", severity, start, start + 0.5, f"{kind} at {start:.3f}", "", cause=cause)  # type: ignore[arg-type]


FINDINGS = st.lists(
    st.builds(
        finding,
        st.sampled_from(["heading_jump", "position_jump", "tilt_off", "vibration", "gyro_clipping", "position_lost"]),
        st.sampled_from(["error", "warning", "info"]),
        st.floats(0.0, 1e4),
        st.none() | st.floats(1e-3, 3.0),
    ),
    max_size=60,
)
SERIOUS = ["error", "warning", "info"]


@given(FINDINGS)
def test_every_finding_is_in_one_group(findings: list[Finding]) -> None:
    found = [one for group in grouped(findings) for one in group.findings]
    assert sorted(map(id, found)) == sorted(map(id, findings))
    shown, left = ranked(findings)
    assert len(shown) <= MOST_LINES
    assert sum(len(group.findings) for group in shown) + left == len(findings)


@given(FINDINGS)
def test_the_more_serious_stands_first_and_the_earlier_of_as_serious_ones(findings: list[Finding]) -> None:
    order = [(SERIOUS.index(group.findings[0].severity), group.findings[0].start_s) for group in grouped(findings)]
    assert order == sorted(order)


@given(FINDINGS)
def test_a_group_tells_how_many_the_first_and_the_largest(findings: list[Finding]) -> None:
    for group in grouped(findings):
        sizes = [one.cause.size or 0.0 for one in group.findings if one.cause]
        assert group.worst.cause is not None
        assert (group.worst.cause.size or 0.0) == max(sizes)
        if len(group.findings) > 1:
            first = min(one.start_s for one in group.findings)
            assert str(group).startswith(f"{len(group.findings)} × ")
            assert str(group).endswith(f" at {group.worst.start_s:.1f} s")
            assert (f"first at {first:.1f} s, worst at" in str(group)) is (group.worst is not group.findings[0])
        else:
            assert str(group) == group.findings[0].evidence


@given(FINDINGS, st.permutations(range(5)))
def test_the_order_in_which_they_come_does_not_matter(findings: list[Finding], order: list[int]) -> None:
    some = [replace(one, start_s=float(i)) for i, one in enumerate(findings[:5])]
    assert grouped([some[i] for i in order if i < len(some)]) == grouped(some)


def test_steps_of_the_heading_in_degrees() -> None:
    steps = [finding("heading_jump", "info", 10.0 * i, 0.01 * i) for i in range(1, 34)]
    (group,) = grouped(steps)
    assert str(group) == "33 × heading jump of up to 18.9°, first at 10.0 s, worst at 330.0 s"


def test_a_group_whose_first_is_the_worst_says_the_time_once_and_lasts_to_the_last_one() -> None:
    (group,) = grouped([finding("heading_jump", "info", 2.5, 0.3), finding("heading_jump", "info", 68.7, 0.1)])
    assert str(group) == "2 × heading jump of up to 17.2°, first and worst at 2.5 s"
    assert group.whole == "2.5-69.2 s"


def test_a_sentence_of_several_flights_is_said_once() -> None:
    told = ("Cannot tell: A (1 %).", "Cannot tell: B.", "Cannot tell: A (1 %).", "Cannot tell: B.")
    flights = tuple(FlightVerdict(10.0 * i, 10.0 * i + 5.0, "insufficient_data", one) for i, one in enumerate(told))
    lines = flight_lines(Verdict("insufficient_data", told[0], (), flights=flights))
    assert [label for label, _ in lines] == ["Flight 1", "Flight 2", "Flight 3", "Flight 4"]
    said = [words.split(": ")[1] for _, words in lines]
    assert (said[0], said[2], said[3]) == ("as above", "as above", "as flight 2")
    assert said[1].startswith("B")
