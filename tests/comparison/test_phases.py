"""The parts of a flight, from what the vehicle says and how it moves; and of recordings whose story is known."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import companion as c
from companion.comparison.phases import judged_at, phases
from companion.model import (
    Array,
    AttitudeTrack,
    ControlTrack,
    Event,
    Flight,
    PositionTrack,
    Series,
    StatusText,
    Vehicle,
    from_euler,
)
from companion.strapdown import motions
from tests.flights import VEHICLE
from tests.recordings import whole

T = np.arange(0.0, 100.0, 0.02)
UP = (T > 40.0) & (T < 80.0)  # in the air


def story(**changes: Any) -> Flight:
    """Armed at 35 s, in the air from 40 to 80 s, disarmed at 85 s; the boot clock begins at 1000 s."""
    climb = np.zeros((len(T), 3))
    climb[UP, 2] = -10.0
    roll = changes.pop("roll", np.zeros(len(T)))
    rates = np.column_stack([np.gradient(roll, T), 0 * T, 0 * T])
    parts: dict[str, Any] = {
        "vehicle": VEHICLE,
        "boot": 1,
        "start": 1000.0,
        "duration": float(T[-1]),
        "attitude": AttitudeTrack(T + 1000.0, from_euler(roll, 0 * T, changes.pop("heading", 0 * T)), rates),
        "position": PositionTrack(T + 1000.0, climb, 0 * climb),
        "events": (Event(1035.0, "armed", "armed"), Event(1085.0, "disarmed", "disarmed")),
    }
    return Flight(**(parts | changes))


def told(flight: Flight) -> list[tuple[str, float, float]]:
    found = phases(flight)
    assert found[0].start == flight.start
    assert found[-1].end == pytest.approx(flight.start + flight.duration)
    assert all(one.end == other.start for one, other in pairwise(found)), "no gaps"
    return [(one.kind, round(one.start - flight.start, 1), round(one.end - flight.start, 1)) for one in found]


def test_a_flight_of_no_length_has_a_phase() -> None:
    assert told(Flight(VEHICLE, 1, 1000.0, 0.0)) == [("standing", 0.0, 0.0)]


def test_a_flight_from_the_ground_and_back() -> None:
    assert told(story()) == [("standing", 0.0, 40.0), ("flight", 40.0, 80.0), ("landed", 80.0, 100.0)]


def test_an_estimator_is_judged_in_the_air_alone_and_on_a_bench_once_it_has_aligned() -> None:
    flight = story()
    (flown,) = (part for part in phases(flight) if part.kind == "flight")
    t = np.array([flown.start - 1.0, flown.start + 1.0, flown.end - 1.0, flown.end + 1.0])
    assert judged_at(flight, t).tolist() == [False, True, True, False]
    bench = replace(flight, position=None, events=())
    (part,) = phases(bench)
    assert part.kind == "standing"
    assert judged_at(bench, np.array([part.start + 1.0, part.end - 1.0])).tolist() == [False, True]


def test_what_drives_and_stops_is_on_its_way_until_it_is_disarmed() -> None:
    rover = Vehicle(1, 1, "ARDUPILOTMEGA", "GROUND_ROVER")
    assert told(story(vehicle=rover)) == [("standing", 0.0, 40.0), ("flight", 40.0, 85.0), ("landed", 85.0, 100.0)]


@pytest.mark.parametrize(("disarmed", "end"), [(99.5, 99.5), (None, 100.0)], ids=["disarmed in the air", "not at all"])
def test_a_log_that_ends_in_the_air_ends_in_flight_unless_it_was_disarmed(disarmed: float | None, end: float) -> None:
    falling = np.zeros((len(T), 3))
    falling[T > 40.0, 2] = -10.0
    events = [
        Event(1035.0, "armed", "armed"),
        *([] if disarmed is None else [Event(1000.0 + disarmed, "disarmed", "")]),
    ]
    flight = story(position=PositionTrack(T + 1000.0, falling, 0 * falling), events=tuple(events))
    assert told(flight)[1] == ("flight", 40.0, end)


def test_what_the_vehicle_says_of_its_landing_counts() -> None:
    events = (*story().events, Event(1038.0, "event", "took off"), Event(1081.5, "event", "landed"))
    in_order = tuple(sorted(events, key=lambda event: event.t))
    assert told(story(events=in_order))[1] == ("flight", 38.0, 81.5)


def test_a_log_that_never_says_armed_is_told_by_its_motion() -> None:
    roll = np.where(UP, 0.5 * np.sin(T), 0.0)
    kind, start, end = told(story(events=(), roll=roll))[1]
    assert kind == "flight"
    assert (start, end) == pytest.approx((40.0, 80.0), abs=1.0)


def flags(*rows: tuple[float, int]) -> dict[str, Series]:
    t, values = (np.array(column, np.float64) for column in zip(*rows, strict=True))
    return {"estimator": Series(1000.0 + t, values[:, None], ("flags",))}


def test_before_the_estimator_knows_where_it_is_nothing_is_judged() -> None:
    assert told(story(series=flags((0, 0), (5, 167), (20, 831))))[0] == ("aligning", 0.0, 20.0)
    assert told(story(series=flags((0.5, 831), (5, 831))))[0] == ("standing", 0.0, 40.0)
    assert told(story(series=flags((0, 1024), (5, 167))))[0] == ("aligning", 0.0, 5.0), (
        "without a receiver: the attitude"
    )


def test_a_vehicle_that_takes_off_without_a_position_is_flying_all_the_same() -> None:
    assert told(story(series=flags((0, 0), (60, 831))))[:2] == [("aligning", 0.0, 40.0), ("flight", 40.0, 80.0)]


def test_ardupilots_words_while_it_starts() -> None:
    words = [
        (3.0, "AHRS: DCM active"),
        (6.0, "EKF3 IMU0 initialised"),
        (9.0, "EKF3 IMU0 MAG0 initial yaw alignment complete"),
    ]
    texts = tuple(StatusText(1000.0 + t, 6, text) for t, text in words)
    assert told(story(texts=texts))[0] == ("aligning", 0.0, 9.0)
    receiver = (*texts, StatusText(1012.0, 6, "GPS 1: detected u-blox"))
    assert told(story(texts=receiver))[0] == ("aligning", 0.0, 40.0), "it has a receiver and does not use it yet"
    using = (*receiver, StatusText(1021.0, 6, "EKF3 IMU0 is using GPS"))
    assert told(story(texts=using))[0] == ("aligning", 0.0, 21.0)


def test_a_heading_that_turns_at_rest_after_boot_has_not_settled() -> None:
    heading = np.where(T < 15.0, -0.3 * (1 - T / 15.0), 0.0)
    young = story(heading=heading, start=10.0)
    young = replace(
        young, attitude=replace(young.attitude, t=T + 10.0) if young.attitude else None, position=None, events=()
    )
    kind, start, end = told(young)[0]
    assert (kind, start) == ("aligning", 0.0)
    assert end == pytest.approx(15.0 * (1 - np.radians(2.0) / 0.3), abs=0.1)


OVER = np.where(T > 70.0, np.minimum(4.0 * (T - 70.0), 3.0), 0.0)  # rolls over at 4 rad/s and stays there


@pytest.mark.parametrize("kind", ["QUADROTOR", "DECAROTOR", "GENERIC_MULTIROTOR"])
def test_what_rolls_over_and_stays_there_has_lost_control(kind: str) -> None:
    *_, last = phases(story(roll=OVER, vehicle=Vehicle(1, 1, "ARDUPILOTMEGA", kind)))
    assert last.kind == "impact"
    assert last.end == pytest.approx(1000.0 + T[-1])
    assert last.start == pytest.approx(1070.0, abs=0.1), "from where it began to turn"


def test_what_shakes_about_the_limit_is_in_control() -> None:
    """Every second sample beyond the rate of a tumble: thousands of stretches, each followed by a calm one."""
    t = 1000.0 + np.arange(0.0, 120.0, 0.02)
    still, rates = np.zeros((len(t), 3)), np.zeros((len(t), 3))
    rates[::2, 0] = 11.0
    level, cruise = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), still + [5.0, 0.0, 0.0]
    flight = replace(
        story(events=(Event(1000.0, "armed", "armed"),), duration=120.0),
        attitude=AttitudeTrack(t, level, rates),
        position=PositionTrack(t, still, cruise),
    )
    assert [part.kind for part in phases(flight)] == ["flight"]


def test_a_flip_is_no_loss_of_control() -> None:
    flip = np.where(T > 60.0, np.minimum(6.0 * (T - 60.0), 2 * np.pi), 0.0)
    assert "impact" not in [part.kind for part in phases(story(roll=flip))]


@pytest.mark.parametrize("kind", ["SUBMARINE", "FIXED_WING"])
def test_what_may_turn_over_is_lost_only_where_it_was_not_to(kind: str) -> None:
    vehicle = Vehicle(1, 1, "ARDUPILOTMEGA", kind)
    level = ControlTrack(T + 1000.0, from_euler(0 * T, 0 * T, 0 * T))
    wanted = ControlTrack(T + 1000.0, from_euler(OVER, 0 * T, 0 * T))
    assert phases(story(roll=OVER, vehicle=vehicle))[-1].kind == "landed"
    assert phases(story(roll=OVER, vehicle=vehicle, control=wanted))[-1].kind == "landed"
    assert phases(story(roll=OVER, vehicle=vehicle, control=level))[-1].kind == "impact"


@pytest.mark.parametrize(("after_s", "kind"), [(0.5, "flight"), (1.5, "flight"), (4.0, "impact")])
def test_what_is_wanted_otherwise_all_at_once_may_be_followed(after_s: float, kind: str) -> None:
    """A plane that is told to bank to the other side, 90° away, as a link has it: only so much of it has been heard."""
    vehicle = Vehicle(1, 1, "ARDUPILOTMEGA", "FIXED_WING")
    banks = np.where(T > 60.0, np.radians(45.0), -np.radians(45.0))
    wanted = ControlTrack(T + 1000.0, from_euler(banks, 0 * T, 0 * T))
    stays = story(roll=np.full(len(T), -np.radians(45.0)), vehicle=vehicle, control=wanted)
    heard = stays.attitude.t < 1060.0 + after_s if stays.attitude else T > 0.0
    attitude = AttitudeTrack(
        T[heard] + 1000.0, from_euler(banks[0] + 0 * T[heard], 0 * T[heard], 0 * T[heard]), np.zeros((heard.sum(), 3))
    )
    assert phases(replace(stays, attitude=attitude, duration=60.0 + after_s))[-1].kind == kind


@pytest.mark.parametrize(
    ("wanted", "heard_s", "kind"), [(70.0, 1.0, "flight"), (0.0, 1.0, "impact"), (0.0, 0.2, "flight")]
)
def test_a_copter_that_leans_far_because_it_was_told_to_is_in_control(wanted: float, heard_s: float, kind: str) -> None:
    """On a link the last that was heard is always the end: what has only begun may be a flip."""
    leans = np.radians(np.where(T > 60.0, 70.0, 0.0))
    flown = story(
        roll=leans,
        control=ControlTrack(T + 1000.0, from_euler(np.where(T > 60.0, np.radians(wanted), 0.0), 0 * T, 0 * T)),
    )
    track, heard = flown.require_attitude(), 60.0 + heard_s > T
    track = AttitudeTrack(track.t[heard], track.q_ned_frd[heard], 0.0 * track.rates[heard])
    assert phases(replace(flown, attitude=track, duration=60.0 + heard_s))[-1].kind == kind


def test_a_board_that_is_turned_by_hand_has_lost_nothing() -> None:
    assert "impact" not in [part.kind for part in phases(story(roll=OVER, events=()))]


def test_the_vehicle_s_own_word_for_a_crash() -> None:
    crash = (StatusText(1075.0, 2, "Crash: Disarming: AngErr=45>30, Accel=0.7<3.0"),)
    *_, last = phases(story(texts=crash))
    assert (last.kind, last.start, last.reason) == ("impact", 1075.0, crash[0].text)


def test_a_flight_of_which_nothing_is_known_stands() -> None:
    assert told(Flight(VEHICLE, 1, 5.0, 10.0)) == [("standing", 0.0, 10.0)]


# What happened, by the recordings' own notes: kinds in order, and the start of the last of them.
STORIES: dict[str, tuple[list[str], float]] = {
    "sitl/copter-hover-100hz.tlog": (["aligning", "standing", "flight", "landed"], 133.2),
    "sitl/copter-square-100hz.tlog": (["standing", "flight", "landed"], 189.6),
    "sitl/copter-gps-glitch-50hz.tlog": (["standing", "flight", "landed"], 172.3),
    "px4/px4_hover.tlog": (["aligning", "standing", "flight", "landed"], 97.1),
    "real/lacondro__drone_logbook__log_2_2026-6-12-11-51-34.bin": (["standing", "flight", "impact"], 81.6),
    "rflymad/TestCase_1_1000000000.ulg": (["aligning", "standing", "flight", "impact"], 34.2),
    "real/srikanthgoli1__rrc_fault_tolerant_control__10_mm_cut_hover_2.BIN": (["standing", "flight", "landed"], 141.7),
}


@pytest.mark.parametrize("name", STORIES)
def test_recordings_whose_story_is_known(name: str) -> None:
    kinds, last = STORIES[name]
    found = phases(c.open_log(whole(name))[0])
    assert [part.kind for part in found] == kinds
    assert found[-1].start == pytest.approx(last, abs=1.5)


def test_an_even_turn_is_a_flight_and_no_heading_that_turns_at_rest() -> None:
    """Nobody said that it was armed; the gyro reads the turn all the time, and no bias is as large."""
    motion = motions.circle(T, radius=60.0, speed=8.0, bank=0.1)
    flight = Flight(
        vehicle=VEHICLE,
        boot=1,
        start=0.0,
        duration=float(T[-1]),
        imus={"RAW_IMU": replace(motion.imu, source="RAW_IMU")},
        attitude=AttitudeTrack(T, motion.q_ned_frd, motion.gyro),
        position=PositionTrack(T, motion.position, motion.velocity),
    )
    assert [kind for kind, _, _ in told(flight)] == ["flight"]


def test_a_vehicle_that_hovers_is_not_landed_though_it_was_armed_before_the_log_begins() -> None:
    """A piece of a link begins anywhere. Where it came down by half of its heights it has landed."""
    armed = (Event(1000.0, "armed", "armed when the log begins"),)
    height = np.full(len(T), -10.0)
    moving = np.where((T > 20.0) & (T < 50.0), 3.0, 0.0)

    def seen(height: Array, **changes: Any) -> list[tuple[str, float, float]]:
        zero = np.zeros(len(T))
        track = PositionTrack(T + 1000.0, np.column_stack([zero, zero, height]), np.column_stack([moving, zero, zero]))
        return told(story(position=track, **({"events": armed} | changes)))

    assert seen(height)[-1] == ("flight", 20.0, 100.0)
    assert seen(np.where(T < 60.0, height, 0.0))[-1] == ("landed", 60.0, 100.0)
    assert seen(height, events=(*armed, Event(1000.5, "event", "in the air")))[-1] == ("flight", 0.5, 100.0)


def test_who_has_taken_off_flies_until_it_says_otherwise() -> None:
    armed = (Event(1035.0, "armed", "armed"), Event(1040.0, "event", "took off"))
    assert told(story(events=armed))[-1] == ("flight", 40.0, 100.0)
    landed = (*armed, Event(1079.0, "event", "landed"))
    assert told(story(events=landed))[-1] == ("landed", 79.0, 100.0)
