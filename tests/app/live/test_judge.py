"""The verdict now and so far: what a page says of the last seconds, and what it remembers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from companion.app.live import HORIZON_S, Judge, Judges, Judging, new_stream
from companion.comparison import Comparison
from companion.mavlink import DEFAULT_DIALECT
from companion.model import DataError, Flight
from companion.simulate import Faults, SimulatedVehicle, fly
from companion.telemetry import Stream
from companion.verdict import Band, LiveVerdict, Verdict
from tests.simulated import bursts

pytestmark = pytest.mark.slow

STREAMS = {"RAW_IMU": 50.0, "ATTITUDE": 20.0, "LOCAL_POSITION_NED": 10.0, "GPS_RAW_INT": 5.0, "EKF_STATUS_REPORT": 2.0}
GOOD = Verdict("consistent", "all is well", ())
BAD = Verdict("imu_suspect", "gyro z", ())
BAND = ((5.0, 1.0, 2.0, 3.0),)
EPOCH = 1_700_000_000.0


class Said:
    """Verdicts in turn, and the flights that they were asked about."""

    def __init__(self, *verdicts: Verdict) -> None:
        self.verdicts, self.flights = iter(verdicts), list[Flight]()

    def __call__(self, flight: Flight, imu: str | None) -> tuple[Verdict, Band]:
        assert imu is None
        self.flights.append(flight)
        return next(self.verdicts), BAND


def live_verdicts(said: Said, *, every_s: float = 5.0, seconds: float = 60.0) -> Iterator[LiveVerdict]:
    """What is said of a simulated flight, every so many seconds."""
    vehicle = SimulatedVehicle(fly(seconds), streams=STREAMS)
    judge = Judge(said, new_stream(DEFAULT_DIALECT))
    for i in range(1, int(seconds / every_s) + 1):
        for t, packets in bursts(vehicle, i * every_s):
            judge.receive(packets, EPOCH + t)
        yield judge.judge()


def test_it_clears_when_the_fault_is_gone_and_keeps_the_record() -> None:
    said = Said(*[GOOD] * 3, *[BAD] * 2, *[GOOD] * 3, BAD, *[GOOD] * 3)
    found = list(live_verdicts(said))
    assert [live_verdict.status for live_verdict in found[2:6]] == [
        "consistent",
        "imu_suspect",
        "imu_suspect",
        "consistent",
    ]
    assert found[2].so_far == ("consistent", "no alarm so far")
    assert found[2].expected == BAND
    last = found[-1]
    assert last.status == "consistent"
    assert [(alarm.text, round(alarm.last - alarm.first)) for alarm in last.alarms] == [("gyro z", 5), ("gyro z", 0)]
    status, text = last.so_far
    assert status == "imu_suspect"
    assert text.count("gyro z") == 2


def test_an_alarm_that_has_not_cleared_is_one_and_its_onset_stays_in_what_is_judged() -> None:
    """To be unable to tell for a moment clears nobody."""
    unsure = Verdict("insufficient_data", "cannot tell", ())
    said = Said(*[GOOD] * 8, BAD, *[unsure] * 4, BAD, unsure, GOOD, unsure)
    last = list(live_verdicts(said, seconds=85.0))[-1]
    lengths = [round(flight.duration) for flight in said.flights]
    assert lengths[7:15] == [40, 40, 40, 40, 40, 40, 45, 50], "from 20 s before the alarm at 45 s on"
    assert lengths[15:] == [55, 40], "until it has cleared"
    assert [(alarm.text, round(alarm.last - alarm.first)) for alarm in last.alarms] == [("gyro z", 25)]


def test_the_data_behind_it_are_the_last_seconds_and_memory_does_not_grow() -> None:
    said = Said(*[GOOD] * 40)
    last = list(live_verdicts(said, every_s=10.0, seconds=240.0))[-1]
    assert last.newest == pytest.approx(EPOCH + 240.0, abs=0.5)
    spans = [(flight.start, flight.start + flight.duration) for flight in said.flights]
    assert max(end - begin for begin, end in spans) < HORIZON_S + 2.0
    assert spans[-1][1] == pytest.approx(240.0, abs=0.5)
    counts = [len(flight.imu()) for flight in said.flights]
    assert max(counts) <= 50 * HORIZON_S + 60
    latest = said.flights[-1]
    assert latest.gps
    assert "estimator" in latest.series


@pytest.mark.parametrize(
    ("fault", "is_urgent"), [(Faults(), False), (Faults(ekf_reset=(30.0, 10.0)), True)], ids=["healthy", "a reset"]
)
def test_what_has_just_begun_is_noticed(fault: Faults, is_urgent: bool) -> None:
    vehicle = SimulatedVehicle(fly(40.0, faults=fault), streams=STREAMS)
    judge = Judge(Said(), new_stream(DEFAULT_DIALECT))
    assert not judge.is_urgent(), "nothing has come"
    for t, packets in bursts(vehicle, 31.5):
        judge.receive(packets, EPOCH + t)
    assert judge.is_urgent() is is_urgent


@pytest.mark.parametrize("imu", ["RAW_IMU", "SCALED_IMU2"])
def test_a_look_after_a_judgement_sees_what_one_at_everything_does(imu: str, monkeypatch: pytest.MonkeyPatch) -> None:
    vehicle = SimulatedVehicle(fly(60.0), streams={**STREAMS, "SCALED_IMU2": 50.0})
    after, anew = (Judge(lambda *_: (GOOD, BAND), new_stream(DEFAULT_DIALECT), imu=imu) for _ in range(2))
    seen: list[Comparison] = []

    def looked(comparison: Comparison) -> bool:
        seen.append(comparison)
        return False

    monkeypatch.setattr("companion.app.live.judge.newest_stands_out", looked)
    for t, packets in bursts(vehicle, 45.0):
        after.receive(packets, EPOCH + t)
        anew.receive(packets, EPOCH + t)
    after.judge()
    for t, packets in bursts(vehicle, 48.0):
        after.receive(packets, EPOCH + t)
        anew.receive(packets, EPOCH + t)
    with monkeypatch.context() as no_whole_flight:
        no_whole_flight.delattr(Stream, "recent")
        after.is_urgent()
    anew.is_urgent()
    one, other = seen
    assert one.track.source == other.track.source == imu
    assert one.track.t[-1] == other.track.t[-1] > 47.5
    for mine, full in ((one.track, other.track), (one.attitude, other.attitude)):
        assert len(mine.t) == pytest.approx(len(full.t), abs=2)
    assert one.position is not None
    assert other.position is not None
    assert np.array_equal(one.position.velocity[-100:], other.position.velocity[-100:])
    assert np.array_equal(one.track.gyro[-900:], other.track.gyro[-900:])
    assert np.allclose(one.reference.q_ned_frd[-900:], other.reference.q_ned_frd[-900:])


def test_it_is_noticed_in_the_imu_that_was_chosen() -> None:
    fault = Faults(imu_bias=(30.0, 0.2))  # of the first IMU alone
    vehicle = SimulatedVehicle(fly(40.0, faults=fault), streams={**STREAMS, "SCALED_IMU2": 50.0})
    first = Judge(Said(), new_stream(DEFAULT_DIALECT), imu="RAW_IMU")
    second = Judge(Said(), new_stream(DEFAULT_DIALECT), imu="SCALED_IMU2")
    for t, packets in bursts(vehicle, 31.5):
        for judge in (first, second):
            judge.receive(packets, EPOCH + t)
    assert (first.is_urgent(), second.is_urgent()) == (True, False)
    second.imu = None  # the flight's default, which is the first
    assert second.is_urgent()


def test_what_cannot_be_judged_is_said() -> None:
    def no(_flight: Flight, _imu: str | None) -> tuple[Verdict, Band]:
        raise DataError("too short")

    judge = Judge(no, new_stream(DEFAULT_DIALECT))
    assert (judge.judge().status, judge.judge().text) == ("", "no IMU messages received")
    vehicle = SimulatedVehicle(fly(20.0, motion="rest"), streams=STREAMS)
    for t, packets in bursts(vehicle, 15.0):
        judge.receive(packets, EPOCH + t)
    assert (judge.judge().status, judge.judge().text) == ("insufficient_data", "too short")
    assert judge.judge().so_far == ("", "nothing is known yet")


def test_a_vehicle_that_was_chosen_is_judged_alone() -> None:
    said = Said(*[GOOD] * 4)
    judges = {name: Judge(said, new_stream(DEFAULT_DIALECT), vehicle=name) for name in ("2", "1:1", "3")}
    for sysid in (1, 2):
        for t, packets in bursts(SimulatedVehicle(fly(10.0), streams=STREAMS, sysid=sysid), 8.0):
            for judge in judges.values():
                judge.receive(packets, EPOCH + t)
    assert judges["2"].judge().vehicle == "2:1"
    assert judges["1:1"].judge().vehicle == "1:1"
    assert judges["3"].judge().status == ""


def two_vehicles(until: dict[int, float]) -> Iterator[tuple[float, bytes]]:
    """Two that send alike, each until a time."""
    both = [
        (t, packets)
        for sysid, end in until.items()
        for t, packets in bursts(SimulatedVehicle(fly(120.0), streams=STREAMS, sysid=sysid), end)
    ]
    yield from sorted(both, key=lambda one: one[0])


def test_a_vehicle_is_judged_as_long_as_it_is_heard_and_a_change_is_said() -> None:
    judge, said = Judge(Said(*[GOOD] * 40), new_stream(DEFAULT_DIALECT)), list[LiveVerdict]()
    due = 8.0
    for t, packets in two_vehicles({1: 20.0, 2: 100.0}):
        judge.receive(packets, EPOCH + t)
        if t >= due:
            due += 8.0
            said.append(judge.judge())
    vehicles = [one.vehicle for one in said]
    assert vehicles == sorted(vehicles)
    assert (vehicles[0], vehicles[-1]) == ("1:1", "2:1")
    first = next(one for one in said if one.vehicle == "2:1")
    assert first.text == "Vehicle 2:1 is judged from now on: 1:1 is silent. all is well"
    silent = [one for one in said if one.vehicle == "1:1"][-1]
    assert silent.newest < EPOCH + 24.5, "what is said of one that is silent is as old as its data"


def test_every_vehicle_of_a_link_is_judged_by_itself() -> None:
    made = list[Said]()

    def judging() -> Said:
        made.append(Said(*[GOOD] * 40))
        return made[-1]

    judges, said = Judges(judging, new_stream(DEFAULT_DIALECT), vehicle="all"), list[LiveVerdict]()
    for t, packets in two_vehicles({1: 30.0, 2: 30.0}):
        judges.receive(packets, EPOCH + t)
        one = judges.step(t)
        said += [] if one is None else [one]
    assert {one.vehicle for one in said[-2:]} == {"1:1", "2:1"}
    assert len(made) == 2
    assert {str(flight.vehicle) for flight in made[0].flights} == {"1:1"}
    assert {str(flight.vehicle) for flight in made[1].flights} == {"2:1"}


def test_of_two_components_that_send_an_imu_the_one_that_is_asked_for_is_judged() -> None:
    camera = {"RAW_IMU": 10.0}
    flying = [*bursts(SimulatedVehicle(fly(10.0), streams=STREAMS), 8.0)]
    flying += bursts(SimulatedVehicle(fly(10.0), streams=camera, compid=100), 8.0)
    judges = [Judge(Said(*[GOOD] * 2), new_stream(DEFAULT_DIALECT), vehicle=name) for name in ("1", "1:1", "1:100")]
    for t, packets in sorted(flying, key=lambda one: one[0]):
        for judge in judges:
            judge.receive(packets, EPOCH + t)
    assert [judge.judge().vehicle for judge in judges] == ["1:1", "1:1", "1:100"]


def test_an_alarm_of_one_vehicle_is_none_of_the_next() -> None:
    judge, due = Judge(Said(*[BAD] * 40), new_stream(DEFAULT_DIALECT)), 8.0
    for t, packets in two_vehicles({1: 20.0, 2: 119.0}):
        judge.receive(packets, EPOCH + t)
        if t >= due:
            due += 8.0
            last = judge.judge()
    first, second = last.alarms
    assert (last.vehicle, first.text) == ("2:1", "gyro z")
    assert first.last < EPOCH + 24.5 < second.first


def test_a_vehicle_that_comes_back_keeps_its_record() -> None:
    first, said, due = BAD, dict[str, LiveVerdict](), 8.0

    def judging() -> Judging:
        return lambda flight, _: (first if flight.vehicle.sysid == 1 else GOOD, BAND)

    judges = Judges(judging, new_stream(DEFAULT_DIALECT), vehicle="all")
    for t, packets in two_vehicles({1: 12.0, 2: 115.0}):
        judges.receive(packets, EPOCH + t)
        if t >= due:
            due += 8.0
            while (one := judges.step(t)) is not None:
                said[one.vehicle] = one
    assert (said["1:1"].status, said["2:1"].status) == ("imu_suspect", "consistent")
    first = GOOD
    for t, packets in bursts(SimulatedVehicle(fly(10.0), streams=STREAMS), 8.0):
        judges.receive(packets, EPOCH + 116.0 + t)
    for now in (200.0, 210.0, 220.0):
        while (one := judges.step(now)) is not None:
            said[one.vehicle] = one
    assert said["1:1"].status == "consistent"
    assert said["1:1"].so_far[0] == "imu_suspect"


def test_a_vehicle_whose_imu_is_silent_is_said_to_be_no_newer() -> None:
    judge = Judge(Said(*[GOOD] * 4), new_stream(DEFAULT_DIALECT))
    vehicle = SimulatedVehicle(fly(40.0), streams=STREAMS)
    for t, packets in bursts(vehicle, 20.0):
        judge.receive(packets, EPOCH + t)
    before = judge.judge()
    judge.newest = EPOCH + 30.0  # others speak
    assert judge.judge() == before
    old = replace(before, age_s=10.0)
    assert old.now == ("stale", "as of 10 s ago: all is well")
    assert replace(before, silent=True).now[0] == "stale"
    alarm = replace(old, status="imu_suspect")
    assert alarm.now == ("imu_suspect", "as of 10 s ago: all is well"), "nothing has taken it back"
    assert replace(alarm, silent=True).now[0] == "stale"
    assert replace(before, age_s=4.0).now == ("consistent", "all is well")
