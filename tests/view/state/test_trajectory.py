"""What reaches the screen: finite, of unit length, true to the replay; and where both are farthest apart."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.comparison import Replay
from companion.model import DataError, Flight
from companion.view import DisplayTrajectory, ReplayChoice
from companion.view import display_trajectory as display_of
from companion.view.scene.trail import worst_words
from companion.view.state.trajectory import Sample, Worst, with_result, worst_stretch
from tests.view.circles import BOOT, dead_reckon, examine, make_flight


def display_trajectory(replay: Replay) -> DisplayTrajectory:
    return display_of(replay, FLIGHT.imus["RAW_IMU"])


FLIGHT = make_flight()
DISPLAY = display_trajectory(dead_reckon(FLIGHT, ReplayChoice()))


@pytest.fixture
def replay(flight: Flight) -> Replay:
    return dead_reckon(flight, ReplayChoice())


def numbers(sample: Sample) -> list[float]:
    return [float(x) for name in Sample.__slots__ for x in np.ravel(getattr(sample, name))]


def test_at_a_sample_it_is_the_sample(replay: Replay) -> None:
    display = display_trajectory(replay)
    for i in (0, 7, 777, len(replay.t) - 1):
        sample = display.at(float(replay.t[i]))
        np.testing.assert_allclose(sample.position_imu, replay.position_imu[i], atol=1e-9)
        np.testing.assert_allclose(sample.q_ref, replay.q_ref[i], atol=1e-9)
        assert sample.position_m == pytest.approx(float(np.linalg.norm(replay.position_error[i])))
        horizontal, down = replay.attitude_error[i][:2], replay.attitude_error[i][2]
        assert sample.tilt_deg == pytest.approx(np.degrees(np.hypot(*horizontal)))
        assert sample.heading_deg == pytest.approx(np.degrees(down))


def test_the_distance_shown_is_the_distance_drawn(replay: Replay) -> None:
    display = display_trajectory(replay)
    for i in (3, 300, 2000):
        sample = display.at(float(replay.t[i]))
        drawn = np.linalg.norm(sample.position_ref - sample.position_imu)
        assert sample.position_m == pytest.approx(float(drawn), abs=1e-9)


def test_between_samples_it_lies_between_them(replay: Replay) -> None:
    sample = display_trajectory(replay).at(float((replay.t[100] + replay.t[101]) / 2))
    middle = (replay.position_ref[100] + replay.position_ref[101]) / 2
    np.testing.assert_allclose(sample.position_ref, middle, atol=1e-9)


def test_an_anchor_is_a_jump_and_not_a_slide(replay: Replay) -> None:
    display = display_trajectory(replay)
    at = int(display.restarts[1])
    before = display.at(float(replay.t[at]) - 1e-6)
    np.testing.assert_allclose(before.position_imu, replay.position_imu[at - 1], atol=1e-9)
    assert before.since_anchor_s == pytest.approx(10.0, abs=1e-3)
    after = display.at(float(replay.t[at]))
    assert after.position_m == pytest.approx(0.0)
    assert after.since_anchor_s == pytest.approx(0.0)


@given(st.floats(-1e6, 1e6))
def test_any_time_gives_finite_numbers_and_unit_quaternions(t: float) -> None:
    sample = DISPLAY.at(t)
    assert np.isfinite(numbers(sample)).all()
    for q in (sample.q_imu, sample.q_ref):
        assert np.linalg.norm(q) == pytest.approx(1.0)


def test_what_is_not_finite_or_has_no_direction_is_left_out(replay: Replay) -> None:
    position, q, error = replay.position_imu.copy(), replay.q_ref * 3.0, replay.attitude_error.copy()
    position[10, 1], position[11, 0], position[12, 2] = np.nan, np.inf, 1e200
    q[20] = 0.0
    error[30, 0] = -np.inf
    display = display_trajectory(replace(replay, position_imu=position, q_ref=q, attitude_error=error))
    assert len(display.replay.t) == len(replay.t) - 5
    np.testing.assert_allclose(np.linalg.norm(display.replay.q_ref, axis=1), 1.0)
    for i in (9, 10, 11, 12, 20, 30):
        assert np.isfinite(numbers(display.at(float(replay.t[i])))).all()


def test_nothing_finite_is_an_error_in_words(replay: Replay) -> None:
    with pytest.raises(DataError, match="nothing to show"):
        display_trajectory(replace(replay, position_imu=np.full_like(replay.position_imu, np.nan)))


def test_a_single_sample_is_shown(replay: Replay) -> None:
    values = {name: getattr(replay, name) for name in Replay.__slots__ if name != "anchors"}
    columns: dict[str, Any] = {name: value[:1] for name, value in values.items() if isinstance(value, np.ndarray)}
    display = display_trajectory(replace(replay, **columns))
    assert display.at(BOOT + 5).position_ref == pytest.approx(replay.position_ref[0])


def test_what_the_autopilot_did_not_say_is_marked(replay: Replay) -> None:
    known = np.ones(len(replay.t), dtype=np.bool_)
    known[100:200] = False
    display = display_trajectory(replace(replay, reference_valid=known))
    assert [display.at(float(replay.t[i])).known for i in (98, 150, 201)] == [True, False, True]


def test_what_the_analysis_says_comes_later() -> None:
    assert DISPLAY.result is None
    assert not DISPLAY.at(BOOT + 30.0).covariance.any()
    result = examine(FLIGHT, ReplayChoice(), DISPLAY)
    display = with_result(DISPLAY, result)
    assert display.replay is DISPLAY.replay
    before, after = (display.at(t).covariance for t in (BOOT + 19.9, BOOT + 20.1))  # an anchor between
    assert np.trace(before) > 10 * np.trace(after)
    assert (np.linalg.eigvalsh(before) > 0).all()
    assert result.after_horizon(BOOT + 4.9) is None  # no window of 5 s has ended yet
    angle, metres = result.after_horizon(BOOT + 30.0) or (0.0, 0.0)
    assert metres == pytest.approx(np.interp(BOOT + 30.0, result.trailing.t, result.trailing.position_m), rel=0.02)
    assert angle > 0


def test_many_instants_at_once_are_those_instants(replay: Replay) -> None:
    display = display_trajectory(replay)
    times = np.concatenate(
        [np.linspace(display.start - 1, display.end + 1, 40), display.replay.t[display.restarts] - 1e-6]
    )
    for t, sample in zip(times, display.samples(times), strict=True):
        np.testing.assert_array_equal(numbers(sample), numbers(display.at(float(t))))


REPLAY = dead_reckon(make_flight(), ReplayChoice())


def test_it_begins_at_the_anchor_before_and_ends_farthest_apart() -> None:
    apart = np.linalg.norm(REPLAY.position_error, axis=1)
    found = worst_stretch(REPLAY)
    assert found is not None
    assert found.apart_m == pytest.approx(apart.max())
    assert found.end_s == REPLAY.t[np.argmax(apart)]
    assert found.start_s in REPLAY.anchors
    assert not ((REPLAY.anchors > found.start_s) & (REPLAY.anchors < found.end_s)).any()


def test_where_the_autopilot_is_not_known_nobody_is_apart() -> None:
    worst = worst_stretch(REPLAY)
    assert worst is not None
    silent = replace(REPLAY, reference_valid=np.abs(REPLAY.t - worst.end_s) > 1.0)
    other = worst_stretch(silent)
    assert other is not None
    assert abs(other.end_s - worst.end_s) > 1.0
    assert worst_stretch(replace(REPLAY, has_position=False)) is None


def test_its_name_has_time_and_distance() -> None:
    assert worst_words(Worst(BOOT, 26.2, 142.3)) == "26 s: 142 m apart"
