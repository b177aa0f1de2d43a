"""Wrong time stamps leave a flight as it would be without them; what autopilots do to their clocks stays."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import companion as c
from companion.model import Array
from companion.telemetry.clock import ON_BOARD, ON_LINK, Course, off_course
from tests.tlogs import EPOCH, Writer

COURSES = [ON_BOARD, ON_LINK]
regular = st.builds(
    lambda n, hz, start: start + np.arange(n) / hz, st.integers(7, 60), st.floats(1, 400), st.just(50.0)
)


@given(steps=st.lists(st.floats(0, 1e3), min_size=7, max_size=60), course=st.sampled_from(COURSES))
def test_times_that_only_rise_stay_whatever_gaps_they_have(steps: list[float], course: Course) -> None:
    steps[:3], steps[-2:] = [0.1] * 3, [0.1] * 2
    assert not off_course({"ATTITUDE": np.cumsum(steps)}, course)


@given(t=regular, data=st.data(), course=st.sampled_from(COURSES))
def test_one_time_anywhere_that_is_far_off_is_found_and_nothing_else(
    t: Array, data: st.DataObject, course: Course
) -> None:
    at = data.draw(st.integers(0, len(t) - 1))
    wrong = t.copy()
    wrong[at] = t[-1] + data.draw(st.floats(601, 1e16))
    found = off_course({"RAW_IMU": wrong, "ATTITUDE": t}, course)
    assert found.keys() == {"RAW_IMU"}
    assert np.flatnonzero(found["RAW_IMU"]).tolist() == [at]


@given(t=regular, data=st.data())
def test_one_flipped_bit_never_makes_a_flight_longer_than_a_silence(t: Array, data: st.DataObject) -> None:
    stamps = (t * 1e6).astype(np.uint64)
    stamps[data.draw(st.integers(0, len(t) - 1))] ^= np.uint64(1) << np.uint64(data.draw(st.integers(0, 63)))
    read = stamps.astype(np.float64) * 1e-6
    found = off_course({"IMU": read}, ON_BOARD)
    kept = read[~found["IMU"]] if found else read
    assert kept.max() <= t[-1] + ON_BOARD.after_s + 1


@given(first=regular, second=regular)
def test_a_reboot_stays(first: Array, second: Array) -> None:
    """A log of a link has the boots one behind the other; an on-board log is of one."""
    assert not off_course({"ATTITUDE": np.concatenate([first + 500.0, second])}, ON_LINK)


def test_packets_that_come_late_and_twice_stay() -> None:
    t = np.repeat(np.arange(200) / 10, 3)
    late = t + 0.0
    late[5::7] -= 8.0
    assert not off_course({"ATTITUDE": np.abs(late)}, ON_LINK)


def test_of_a_stream_with_few_samples_the_others_tell_where_the_flight_was() -> None:
    imu = 50 + np.arange(1000) / 50
    assert not off_course({"IMU": imu, "EV": np.array([55.0]), "MSG": np.array([75.0, 80.0])}, ON_BOARD)
    assert off_course({"IMU": imu, "EV": np.array([1e9])}, ON_BOARD).keys() == {"EV"}
    assert not off_course({"IMU": imu, "test_motor": np.array([0.0])}, ON_BOARD), "said before the log was begun"


@pytest.mark.parametrize("place", ["first", "in between", "last"])
@pytest.mark.parametrize("stamp", [2**32 - 1, 2**31, 3_000_000])
def test_an_attitude_at_a_wrong_time_is_left_out_and_counted(tmp_path: Path, place: str, stamp: int) -> None:
    def flown(name: str, *, wrong: bool) -> c.Flight:
        log = Writer(tmp_path / name)
        for i in range(451):
            log.raw_imu(i / 10, 20 + i / 10)
            if wrong and i == {"first": 0, "in between": 200, "last": 450}[place]:
                log.attitude(i / 10, stamp / 1e3)
            else:
                log.attitude(i / 10, 20 + i / 10)
        return c.open_log(log.close())[0]

    whole, damaged = flown("whole.tlog", wrong=False), flown("damaged.tlog", wrong=True)
    assert damaged.duration == pytest.approx(whole.duration, abs=0.11)
    assert damaged.attitude
    assert len(damaged.attitude) == 450
    assert any(note.startswith("ATTITUDE: 1 of 451 left out: their time stamps leave") for note in damaged.notes)
    assert not any("time stamps leave" in note for note in whole.notes)


def test_an_imu_sample_at_a_wrong_time_is_left_out_and_the_log_can_be_analysed(tmp_path: Path) -> None:
    log = Writer(tmp_path / "flight.tlog")
    for i in range(1001):
        log.raw_imu(i / 50, 20 + i / 50 if i != 500 else 2.0**43)
        log.attitude(i / 50, 20 + i / 50)
        log.local_position(i / 50, 20 + i / 50)
    flight = c.open_log(log.close())[0]
    assert len(flight.imu("RAW_IMU")) == 1000
    assert flight.duration == pytest.approx(20)
    assert c.examine(flight)


def test_clocks_that_step_back_again_and_again_are_cut_without_an_error(tmp_path: Path) -> None:
    """Each step was looked for in what the one behind it had left."""
    log = Writer(tmp_path / "flight.tlog")
    boot = 20.0
    for i in range(400):
        boot += 0.1 - (1.2 if i % 40 == 39 else 0.0)
        log.attitude(i / 10, boot)
        log.raw_imu(i / 10, boot)
    flight = c.open_log(log.close())[0]
    assert flight.attitude
    assert (np.diff(flight.attitude.t) > 0).all()


@pytest.mark.parametrize(
    ("value", "kind", "known"),
    [
        (float("nan"), 9, False), (float("inf"), 9, False), (1.2e19, 6, False), (-1.0, 1, False), (4e4, 4, False),
        (1.2e19, 9, True), (2753028.0, 6, True), (255.0, 1, True), (-1.0, 6, True), (0.5, 9, True),
    ],
)  # fmt: skip
def test_a_parameter_that_its_type_cannot_have_is_unknown(tmp_path: Path, value: float, kind: int, known: bool) -> None:
    log = Writer(tmp_path / "flight.tlog")
    log.send(
        0, "param_value", param_id=b"WPNAV_SPEED", param_value=value, param_type=kind, param_count=1, param_index=0
    )
    log.rest(8.0)
    flight = c.open_log(log.close())[0]
    assert ("WPNAV_SPEED" in flight.parameters) == known
    assert c.examine(flight)


def test_the_stamps_of_the_log_itself_may_be_wrong(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    log = Writer(path)
    log.rest(10.0)
    data = bytearray(log.close().read_bytes())
    data[:8] = struct.pack(">Q", 2**63 + int(EPOCH * 1e6))
    path.write_bytes(data)
    assert c.open_log(path)[0].duration == pytest.approx(10)


@pytest.mark.parametrize("period_s", [2.0, 20.0])
def test_of_a_slow_stream_a_few_periods_are_no_disorder(period_s: float) -> None:
    """Two periods back is a packet that comes late; five are a wrong time."""
    for periods, apart in ((2.2, False), (5.2, True)):
        t = period_s * np.arange(60.0)
        t[30] -= periods * period_s
        assert ("SLOW" in off_course({"SLOW": t}, ON_BOARD)) is apart


@pytest.mark.parametrize(("before_s", "apart"), [(300.0, False), (550.0, False), (700.0, True)])
def test_a_radio_may_hand_out_first_what_it_had_kept_for_ten_minutes(before_s: float, apart: bool) -> None:
    flight = 1000.0 + 0.1 * np.arange(500.0)
    late = np.concatenate([[flight[0] - before_s], flight])
    assert ("LATE" in off_course({"LATE": late, "OTHER": flight}, ON_LINK)) is apart
