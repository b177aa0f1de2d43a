"""What may not change a verdict: that it changes nothing but what it says, and what is called a flip."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.accuracy.answer import Answer, Side
from benchmarks.accuracy.changes import CHANGES, later, moved, moved_ground, slower_imu, turned, turned_ground
from benchmarks.accuracy.cutting import alone, gps_ned, with_twin
from benchmarks.accuracy.invariance import (
    AS_IT_IS,
    BOARD,
    ON_BOARD,
    STANDARD,
    Row,
    cases,
    flips,
    of_window,
    sized,
    table,
)
from benchmarks.accuracy.labels import Label
from companion.app.recording import read_recording
from companion.estimation import setup
from companion.estimation.earth_field import EarthField
from companion.model import Flight, ImuTrack
from companion.strapdown import quaternion
from tests.recordings import BUNDLED, SHARED


@pytest.fixture(scope="module")
def demo() -> Flight:
    (flight,) = read_recording(BUNDLED / "copter-demo-100hz.tlog").flights
    return flight


def field_of(flight: Flight) -> EarthField | None:
    """By the model of the Earth's field as the estimate looks it up."""
    look_up: Callable[..., EarthField | None] = vars(setup)["field_at"]
    return look_up(flight.origin, flight.epoch)


@pytest.mark.parametrize("angle", [0.5 * np.pi, np.radians(37.0)])
def test_a_turned_flight_turns_back_into_itself_with_its_ground(demo: Flight, angle: float) -> None:
    there = turned(demo, angle)
    back = turned(there, -angle)
    assert demo.attitude
    assert there.attitude
    assert back.attitude
    turn = quaternion.multiply(there.attitude.q_ned_frd, quaternion.conjugate(demo.attitude.q_ned_frd))
    np.testing.assert_allclose(quaternion.log(turn), np.tile([0, 0, angle], (len(turn), 1)), atol=1e-9)
    same = np.abs((back.attitude.q_ned_frd * demo.attitude.q_ned_frd).sum(axis=1))
    np.testing.assert_allclose(same, 1.0, atol=1e-12)
    assert demo.position
    assert there.position
    c, s = np.cos(angle), np.sin(angle)
    expected = demo.position.position @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T
    np.testing.assert_allclose(there.position.position, expected, atol=1e-9)
    before, after = (gps_ned(f.gps[0], f.gps[0], f.position) for f in (demo, there) if f.position)
    np.testing.assert_allclose(
        np.diff(after, axis=0)[:, 0], np.diff(before @ [[c], [-s], [0]], axis=0)[:, 0], atol=1e-3
    )
    assert there.imus == demo.imus
    assert there.compasses == demo.compasses
    here = field_of(demo)
    with turned_ground(angle):
        field = field_of(there)
    assert here
    assert field
    assert field.declination - here.declination == pytest.approx(angle)
    assert np.arctan2(field.ned[1], field.ned[0]) - np.arctan2(here.ned[1], here.ned[0]) == pytest.approx(angle)


def test_a_flight_further_east_keeps_its_distances_and_its_field(demo: Flight) -> None:
    away = moved(demo, 500e3)
    assert away
    assert demo.origin
    assert away.origin
    arc = away.origin.longitude - demo.origin.longitude
    assert 6_371_000.0 * np.cos(demo.origin.latitude) * arc == pytest.approx(500e3)
    before, after = (gps_ned(f.gps[0], f.gps[0], f.position) for f in (demo, away) if f.position)
    np.testing.assert_allclose(after, before, atol=1e-6)
    here = field_of(demo)
    with moved_ground(500e3):
        there = field_of(away)
    assert here
    assert there
    np.testing.assert_allclose(there.ned, here.ned, rtol=1e-9)
    assert moved(replace(demo, origin=None, gps=()), 500e3) is None


def test_every_time_of_a_later_flight_is_later(demo: Flight) -> None:
    after = later(demo, 1000.0)
    assert after.start - demo.start == 1000.0
    assert demo.epoch
    assert after.epoch
    assert after.epoch.unix_s + 1000.0 == demo.epoch.unix_s
    for name in ("imus", "series", "gps", "compasses", "barometers", "events", "texts", "resets", "biases"):
        ours, theirs = (getattr(f, name) for f in (demo, after))
        if isinstance(ours, Mapping):
            ours, theirs = ours.values(), theirs.values()
        for one, other in zip(ours, theirs, strict=True):
            np.testing.assert_allclose(other.t - 1000.0, one.t, atol=1e-9, err_msg=name)
    for name in ("attitude", "position", "truth", "control", "imu_in_use"):
        if (one := getattr(demo, name)) is not None:
            np.testing.assert_allclose(getattr(after, name).t - 1000.0, one.t, atol=1e-9, err_msg=name)


def test_means_over_intervals_become_means_over_longer_ones_and_readings_are_left_out(demo: Flight) -> None:
    rng, t = np.random.default_rng(0), np.asarray(0.0025 * np.arange(4000) + 10.0, np.float64)
    fast = ImuTrack(t, rng.normal(size=(4000, 3)), rng.normal(size=(4000, 3)), "a", interval=np.full(4000, 0.0025))
    points = replace(fast, source="b", instance=1, interval=None)
    flight = replace(demo, imus={"a": fast, "b": points})
    slow = slower_imu(flight, 100.0)
    assert slow
    means, left = slow.imus["a"], slow.imus["b"]
    assert means.rate_hz == pytest.approx(100.0)
    assert means.interval is not None
    assert fast.interval is not None
    np.testing.assert_allclose(
        np.cumsum(means.gyro * means.interval[:, None], axis=0),
        np.cumsum(fast.gyro * fast.interval[:, None], axis=0)[3::4],
    )
    np.testing.assert_allclose(means.t[0], t[:4].mean())
    np.testing.assert_array_equal(left.gyro, points.gyro[::4])
    assert slower_imu(slow, 100.0) is None


def test_a_twin_reads_the_same_but_for_its_noise(demo: Flight) -> None:
    own, both = demo.imu(), with_twin(alone(demo))
    assert {track.instance for track in both.imus.values()} == {own.instance, own.instance + 1}
    twin = both.imus["TWIN"]
    assert both.imu().source == own.source
    np.testing.assert_allclose((twin.gyro - own.gyro).mean(axis=0), 0.0, atol=1e-3)
    assert (np.std(twin.accel - own.accel, axis=0) >= 0.019).all()


def test_every_change_leaves_a_flight_that_has_not_what_it_changes() -> None:
    (whole,) = read_recording(BUNDLED / "copter-demo-100hz.tlog").flights
    bare = replace(whole, attitude=None, position=None, origin=None, home=None, gps=(), compasses=(), truth=None)
    for name, change in CHANGES.items():
        changed = change.of(bare)
        assert changed is None or changed.attitude is None, name


def said(side: Side, cause: str = "", size: float | None = None, sigma: float | None = None) -> Answer:
    return Answer(side, cause, size=size, sigma=sigma, smallest={"gyro_bias": 0.01})


def test_another_status_or_cause_is_a_flip_and_cannot_tell_is_none() -> None:
    rows = [
        Row("a", AS_IT_IS, said("imu", "gyro_bias", 0.020, 0.001)),
        Row("a", "GPS at 1 Hz", said("imu", "gyro_bias", 0.0215, 0.002)),
        Row("a", "1000 s later", said("imu", "gyro_bias", 0.025, 0.002)),
        Row("a", "turned by 90°", said("imu", "gyro_scale", 0.02, 0.002)),
        Row("a", "turned by 37°", said("cannot_tell")),
        Row("a", BOARD, said("autopilot", "heading")),
        Row("a", "attitude at 1 Hz", None, note="ValueError: broken"),
    ]
    assert [row.change for row in flips(rows)] == ["turned by 90°", BOARD]
    assert [(row.change, good) for row, good in sized(rows)] == [("GPS at 1 Hz", True), ("1000 s later", False)]
    assert flips([replace(rows[0], said=said("cannot_tell")), *rows[1:]]) == []
    shown = table(rows).splitlines()
    assert "| turned by 37° | 1 | 0 (0%) | 1 (100%) |  |  |" in shown
    assert "| attitude at 1 Hz | 0 |  |  |  | 1 |" in shown
    assert "| **all** | 5 | 2 (40%) | 1 (20%) | 1 of 2 | 1 |" in shown


FAULT = Label("a", "imu", cause=("gyro_bias",), onset=100.0, end=160.0, size=0.02)


@pytest.mark.parametrize(
    ("answer", "begin", "expected"),
    [
        (said("imu", "gyro_bias"), 80.0, "right"),
        (said("imu", "gyro_bias"), 20.0, "wrong"),
        (said("autopilot", "heading"), 80.0, "wrong"),
        (said("autopilot", "heading"), 20.0, "wrong"),
        (said("cannot_tell"), 80.0, "cannot tell"),
        (said("none"), 20.0, "right"),
        (said("none"), 80.0, "missed"),
        (replace(said("none"), smallest={"gyro_bias": 0.05}), 80.0, "not shown"),
        (replace(said("none"), smallest={}), 80.0, "not shown"),
        (said("none"), 110.0, "no change"),
        (said("none"), 65.0, "no change"),
        (said("none"), 165.0, "right"),
    ],
)
def test_what_is_said_of_a_window_is_right_or_honest_or_below_its_own_size(
    answer: Answer, begin: float, expected: str
) -> None:
    assert of_window(FAULT, answer, begin, begin + 40.0, off=False) == expected


def test_an_autopilot_that_is_off_beside_the_fault_is_blamed_rightly_and_never_for_it() -> None:
    answer = said("autopilot", "heading")
    assert of_window(FAULT, answer, 165.0, 205.0, off=True) == "right"
    assert of_window(FAULT, answer, 110.0, 150.0, off=True) == "wrong"
    assert of_window(replace_accept(FAULT, "autopilot"), answer, 110.0, 150.0, off=False) == "right"


def replace_accept(label: Label, side: str) -> Label:
    return Label(label.log, label.truth, cause=label.cause, onset=label.onset, end=label.end, accept=(side,))


def test_pairs_of_logs_of_one_flight_are_there() -> None:
    if not SHARED.exists():
        pytest.skip("the recordings are not on this machine")
    for link, board in ON_BOARD.items():
        assert any((SHARED / f"{link}{suffix}").exists() for suffix in ("", ".xz")), link
        assert (SHARED / board).exists(), board
    names = [AS_IT_IS, BOARD]
    assert [len(cases(SHARED / name, names, [])) for name in STANDARD] == [2, 1, 2, 2, 1, 2, 2, 1, 1, 1]
