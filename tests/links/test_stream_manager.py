"""Requests for message intervals against a simulated vehicle, in simulated time: no socket, no waiting."""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.links import Choice, StreamManager, Target
from companion.links.request_table import RequestState, desired_from, fit, load
from companion.links.requests import set_interval
from companion.links.restoration import OriginalRatesFile
from companion.mavlink import Decoder, Packer, load_dialect, split_messages
from companion.simulate import Faults, SimulatedVehicle, fly
from companion.telemetry import NEEDED
from tests.links.peers import deaf

pytestmark = pytest.mark.slow

DIALECT = load_dialect()
WANTED = desired_from("ARDUPILOTMEGA")
ABSENT = ("GPS2_RAW", "SCALED_IMU3", "ATTITUDE_TARGET")  # the simulated vehicle has no such sensors
COMING = WANTED | dict.fromkeys(ABSENT, 0.0)
STEP_S = 0.1  # between two looks at the link
resting = functools.cache(functools.partial(fly, motion="rest"))


class Conversation:
    """A vehicle and who asks it, step by step."""

    def __init__(
        self,
        seconds: float = 120.0,
        wanted: dict[str, float] | None = None,
        *,
        vehicle: SimulatedVehicle | None = None,
        begin: float = 0.0,
        earlier: OriginalRatesFile | None = None,
        **manners: Any,
    ) -> None:
        self.vehicle = vehicle or SimulatedVehicle(resting(seconds), **manners)
        ardupilot = manners.get("autopilot") != "px4"
        self.rates = StreamManager(
            Target(1, 1), wanted or WANTED, DIALECT, own_sysid=240, ardupilot=ardupilot, earlier=earlier
        )
        self.sent: Counter[str] = Counter()
        self.t = begin
        self._packer = Packer(240, 191)
        self._decoder = Decoder(DIALECT, stamped=False)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.t += STEP_S
            data = b"".join(packet for _, packet in self.vehicle.advance(self.t))
            self.rates.receive(split_messages(self._decoder.push(data), DIALECT), self.t)
            if request := self.rates.next_request(self.t):
                self.sent[request.name] += 1
                self.vehicle.receive(self._packer.pack(request.name, request.fields))

    def leave(self) -> None:
        for request in self.rates.restore().requests():
            self.vehicle.receive(self._packer.pack(request.name, request.fields))
        self.run(2 * STEP_S)

    def received(self) -> dict[str, float]:
        return {message.name: message.received_hz for message in self.rates.stream_requests}

    def reported(self) -> str:
        return "\n".join(self.rates.reported)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[" * 5000,
        "{",
        "[]",
        "[1]",
        '{"RAW_IMU": 7}',
        '{"RAW_IMU": {"a": 1}}',
        '{"RAW_IMU": {"found_us": "x", "found_hz": 4.0, "asked_us": 10000}}',
        '{"RAW_IMU": {"found_us": null, "found_hz": NaN, "asked_us": 10000}}',
        '{"RAW_IMU": {"found_us": null, "found_hz": 4.0, "asked_us": null}}',
        '{"RAW_IMU": {"found_us": ' + "9" * 300 + ', "found_hz": 4.0, "asked_us": 10000}}',
    ],
)
def test_what_a_damaged_file_says_of_before_is_not_believed(tmp_path: Path, text: str) -> None:
    path = tmp_path / "link.json"
    path.write_text(text)
    assert OriginalRatesFile(path).known == {}


def test_a_vehicle_that_sends_nothing_is_asked_and_then_left_as_it_was() -> None:
    talk = Conversation(streams={"ATTITUDE": 4.0})
    talk.run(25.0)
    assert talk.received() == pytest.approx(COMING, rel=0.05), "of a look or window one more or less"
    assert talk.reported() == (
        "the vehicle does not send GPS2_RAW, SCALED_IMU3, ATTITUDE_TARGET: it has no such sensor, or its firmware no "
        "such message"
    )
    twice = 2 * len(WANTED) + len(ABSENT)  # the interval asked and set; what is absent is asked for again
    assert talk.sent == {"COMMAND_LONG": twice + 1, "PARAM_REQUEST_READ": 19}  # 3 known parameters, 4 unknown 4 times
    talk.leave()
    assert {name: talk.vehicle.interval_us(name) for name in WANTED} == dict.fromkeys(WANTED, -1) | {
        "ATTITUDE": 250_000
    }


def test_a_third_of_the_packets_lost_is_not_being_turned_down() -> None:
    talk = Conversation(faults=Faults(drop=0.3), seed=4)
    talk.run(40.0)
    # over 5 s, 5 messages a second or more: of fewer chance is too large a part
    often = {name: 0.7 * hz for name, hz in COMING.items() if hz >= 5}
    assert {name: talk.received()[name] for name in often} == pytest.approx(often, rel=0.25)
    assert "again" not in talk.reported()


def test_what_is_too_fast_for_the_loop_is_lowered_and_said() -> None:
    talk = Conversation(wanted={"RAW_IMU": 500.0})
    talk.run(10.0)
    assert talk.received()["RAW_IMU"] == pytest.approx(333.0, rel=0.03), "the fastest of a loop of 400 Hz"
    assert "500 Hz is refused, 333 Hz arrive" in talk.reported()


def test_firmware_that_denies_intervals_is_asked_for_its_streams() -> None:
    talk = Conversation(faults=Faults(denied=frozenset("*")), wanted={"ATTITUDE": 20.0, "HIGHRES_IMU": 20.0})
    talk.run(15.0)
    assert talk.received()["ATTITUDE"] == pytest.approx(20.0, rel=0.05)
    assert "ATTITUDE: the vehicle refuses it; asking for its stream instead" in talk.reported()
    assert "HIGHRES_IMU: the vehicle refuses it; given up" in talk.reported()
    assert talk.sent["REQUEST_DATA_STREAM"] == 1
    talk.leave()
    assert talk.vehicle.interval_us("ATTITUDE") == -1


def test_a_message_that_is_promised_and_never_comes_is_given_up() -> None:
    talk = Conversation(faults=Faults(never=frozenset({"HIGHRES_IMU"})), wanted={"HIGHRES_IMU": 50.0})
    talk.run(80.0)
    assert talk.reported().count("asking again") == 4
    assert talk.reported().endswith("HIGHRES_IMU: 0.0 of 50 Hz arrive: it has no source; given up")
    requests = talk.sent["COMMAND_LONG"]
    talk.run(20.0)
    assert talk.sent["COMMAND_LONG"] == requests, "no fight"


def test_a_position_that_comes_late_has_a_source() -> None:
    """ArduPilot sends none before its EKF has an origin, which takes 40 s and a GPS."""
    talk = Conversation(faults=Faults(never=frozenset({"LOCAL_POSITION_NED"})), wanted={"LOCAL_POSITION_NED": 20.0})
    talk.run(80.0)
    assert talk.reported().endswith("the autopilot's estimate has no position yet (GPS?); given up")


def test_who_turns_it_down_once_is_asked_again_who_insists_wins() -> None:
    talk = Conversation(faults=Faults(turned_down=(12.0,)))
    talk.run(30.0)
    assert "RAW_IMU: " in talk.reported()
    assert "asking again" in talk.reported()
    often = {name: hz for name, hz in COMING.items() if hz != 1.0}  # 2 Hz are more than 1, and left alone
    assert {name: talk.received()[name] for name in often} == pytest.approx(often, rel=0.03)
    stubborn = Conversation(faults=Faults(turned_down=tuple(range(10, 120))), wanted={"RAW_IMU": 100.0})
    stubborn.run(90.0)
    assert stubborn.reported().count("asking again") == 4
    assert "another program is probably overriding the rate" in stubborn.reported()
    assert stubborn.sent["COMMAND_LONG"] < 12


def test_what_was_given_up_and_comes_again_is_watched_again() -> None:
    """A long download of parameters: every stream at a quarter, and back when it is over."""
    rates = StreamManager(Target(1, 1), {"RAW_IMU": 100.0}, DIALECT, own_sysid=240)
    packer, decoder = Packer(1, 1), Decoder(DIALECT, stamped=False)

    def arrive(begin: float, end: float, hz: float) -> None:
        for i in range(round((end - begin) * 5)):
            now = begin + 0.2 * i
            packets = b"".join(packer.pack("RAW_IMU", {}) for _ in range(round(hz / 5)))
            if (request := rates.next_request(now)) is not None and request.fields.get("command") == 511:
                packets += packer.pack("COMMAND_ACK", {"command": 511, "target_system": 240})
            rates.receive(split_messages(decoder.push(packets), DIALECT), now)

    arrive(0.0, 80.0, 25.0)
    assert rates.reported[-1].endswith("given up")
    arrive(80.0, 100.0, 100.0)
    assert rates.reported[-1].endswith("Hz arrive again")


def test_not_now_is_no_refusal() -> None:
    rates = StreamManager(Target(1, 1), {"RAW_IMU": 100.0}, DIALECT, own_sysid=240)
    receive = hearing(rates)
    receive(0.0, "MESSAGE_INTERVAL", message_id=27, interval_us=-1)
    assert rates.next_request(0.1) is not None
    receive(0.2, "COMMAND_ACK", command=511, result=1, target_system=240)
    receive(1.0, "HEARTBEAT", autopilot=3)
    assert rates.reported == []
    again = rates.next_request(1.3)
    assert again is not None
    assert again.fields["command"] == 511


def test_after_a_reboot_everything_is_asked_again() -> None:
    talk = Conversation(faults=Faults(reboot=(20.0,)))
    talk.run(40.0)
    assert "vehicle 1:1 sends nothing of what was agreed any more: asking again" in talk.reported()
    assert "vehicle 1:1 has rebooted: asking again" in talk.reported()
    assert talk.received() == pytest.approx(COMING, rel=0.03)


def test_after_a_silence_everything_is_asked_again() -> None:
    talk = Conversation(faults=Faults(silence=((15.0, 25.0),), reboot=(16.0,)))
    talk.run(24.0)
    assert set(talk.received().values()) == {0.0}
    asked = talk.sent.total()
    talk.run(16.0)
    assert "back after 10 s" in talk.reported()
    assert talk.sent.total() > asked
    assert talk.received() == pytest.approx(COMING, rel=0.03)


def test_px4_is_asked_for_its_independent_imu() -> None:
    wanted = desired_from("PX4")
    assert next(iter(wanted)) == "SCALED_IMU"
    assert {"HIGHRES_IMU", "ESTIMATOR_STATUS", "ODOMETRY"} <= wanted.keys()
    assert not {"RAW_IMU", "EKF_STATUS_REPORT"} & wanted.keys()
    talk = Conversation(wanted=wanted, autopilot="px4")
    talk.run(12.0)
    absent = dict.fromkeys((*ABSENT, "SCALED_IMU2"), 0.0)
    assert talk.received() == pytest.approx(wanted | absent, rel=0.03)


def test_answers_to_others_are_not_taken_for_ours() -> None:
    rates = StreamManager(Target(1, 1), {"RAW_IMU": 100.0}, DIALECT, own_sysid=240)
    receive = hearing(rates)
    receive(0.0, "HEARTBEAT", autopilot=3)
    assert rates.next_request(0.0) is not None
    receive(0.1, "MESSAGE_INTERVAL", message_id=27, interval_us=-1)
    assert rates.next_request(0.2) is not None
    receive(0.3, "COMMAND_ACK", command=511, result=2, target_system=255)
    assert not rates.settled
    receive(0.4, "COMMAND_ACK", command=511, result=0, target_system=240)
    assert rates.settled


def test_two_vehicles_with_one_id_are_told_of_and_not_asked_for_ever() -> None:
    rates = StreamManager(Target(1, 1), {"RAW_IMU": 100.0}, DIALECT, own_sysid=240)
    packer, decoder, sent = Packer(1, 1), Decoder(DIALECT, stamped=False), 0
    for i in range(2000):
        packet = packer.pack("ATTITUDE", {"time_boot_ms": 1000 * (100 if i % 2 else 500) + 10 * i})
        rates.receive(split_messages(decoder.push(packet), DIALECT), 0.01 * i)
        sent += rates.next_request(0.01 * i) is not None
    assert sum("two clocks speak as vehicle 1:1" in sentence for sentence in rates.reported) == 1
    assert len(rates.reported) < 8
    assert sent < 40


@pytest.mark.parametrize("autopilot", ["ARDUPILOTMEGA", "PX4", "GENERIC"])
@pytest.mark.parametrize("baud", [9600, 19200, 57600, 115200, 230400])
def test_a_slow_line_is_not_asked_for_more_than_it_carries(autopilot: str, baud: int) -> None:
    wanted = desired_from(autopilot)
    fitting, warning = fit(wanted, DIALECT, baud / 10)
    assert load(fitting, DIALECT) <= 0.7 * baud / 10 + 1e-6
    assert (fitting == wanted) == (warning == "")
    assert list(fitting) == [name for name in wanted if name in fitting], "the most important is asked for first"
    assert fit(wanted, DIALECT, None) == (wanted, "")


def test_what_a_slow_line_goes_without_first() -> None:
    """57600 baud: one message for each IMU, and the first IMU gets what the others can spare."""
    fitting, warning = fit(WANTED, DIALECT, 5760.0)
    assert "HIGHRES_IMU" not in fitting
    assert fitting["RAW_IMU"] > 65.0
    assert {"GPS_RAW_INT", "SCALED_PRESSURE", "SCALED_IMU2", "EKF_STATUS_REPORT", "VIBRATION"} <= fitting.keys()
    assert "left out: SYS_STATUS, GPS2_RAW, SCALED_IMU3, ATTITUDE_TARGET, HIGHRES_IMU" in warning
    assert "ATTITUDE 10 of 50 Hz" in warning
    faster, warning = fit(WANTED, DIALECT, 23_040.0)
    assert {name for name in WANTED if faster.get(name) != WANTED[name]} == {"HIGHRES_IMU"}
    assert "lowered: HIGHRES_IMU" in warning


@pytest.mark.parametrize("autopilot", ["ARDUPILOTMEGA", "PX4", "GENERIC"])
def test_ardupilot_keeps_ten_intervals_for_a_link(autopilot: str) -> None:
    """A further one would silently become the nearest of them; streams of a ground station take some too."""
    for imu_hz in (50.0, 100.0, 200.0, 333.0):
        for line in (None, 5760.0, 11_520.0):
            wanted, _ = fit(desired_from(autopilot, Choice(imu_hz=imu_hz)), DIALECT, line)
            assert len({int(1000 / hz) for hz in wanted.values()}) <= 8


def test_what_the_dialect_lacks_is_not_asked_for() -> None:
    fitting, _ = fit(WANTED, load_dialect("common"), None)
    assert set(WANTED) - set(fitting) == {"EKF_STATUS_REPORT"}


def test_all_that_the_analysis_reads_of_a_healthy_vehicle_is_asked_for() -> None:
    """Its aiding sensors: GPS, compass (in the IMU's messages), barometer, IMUs, vibration, the estimator's state."""
    for autopilot, own in (("ARDUPILOTMEGA", "EKF_STATUS_REPORT"), ("PX4", "ESTIMATOR_STATUS")):
        wanted = desired_from(autopilot)
        needed = {"GPS_RAW_INT", "GPS2_RAW", "SCALED_IMU2", "SCALED_IMU3", "SCALED_PRESSURE", "VIBRATION", own}
        assert needed <= wanted.keys()
        assert wanted.keys() <= NEEDED


def test_a_lost_answer_never_makes_a_stream_slower() -> None:
    """Asked for 5 Hz where somebody has 50, of a vehicle that never says so."""
    rates = StreamManager(Target(1, 1), {"GPS_RAW_INT": 5.0, "ATTITUDE": 50.0}, DIALECT, own_sysid=240)
    receive, sent = hearing(rates), []
    for i in range(600):
        receive(0.02 * i, "GPS_RAW_INT", time_usec=20_000 * i)
        if i % 5 == 0:
            receive(0.02 * i, "ATTITUDE", time_boot_ms=20 * i)
        if (request := rates.next_request(0.02 * i + 0.01)) is not None:
            sent.append((request.fields.get("command"), request.fields.get("param1")))
        if sent and sent[-1] == (511, 30.0):
            receive(0.02 * i, "COMMAND_ACK", command=511, target_system=240)
    assert (511, 24.0) not in sent
    assert (511, 30.0) in sent
    assert sent.count((510, 30.0)) > 4, "what comes has an interval, which is to be given back"
    assert restoring(rates) == {"ATTITUDE": 100_000}, "as it came"


def test_after_a_kill_the_vehicle_gets_back_what_it_had_before_both(tmp_path: Path) -> None:
    path = tmp_path / "state" / "link 1_1.json"
    wanted = {"RAW_IMU": 100.0, "GPS_RAW_INT": 5.0, "HIGHRES_IMU": 100.0}
    killed = Conversation(wanted=wanted, streams={"RAW_IMU": 4.0}, earlier=OriginalRatesFile(path))
    killed.run(8.0)
    assert killed.vehicle.interval_us("RAW_IMU") == 10_000
    assert path.exists()
    for left in ({"RAW_IMU": 50.0, "GPS_RAW_INT": 5.0}, wanted):  # this one wants less, and is killed too; then leaves
        earlier = OriginalRatesFile(path)
        assert earlier.known
        nxt = Conversation(wanted=left, vehicle=killed.vehicle, begin=killed.t, earlier=earlier)
        nxt.run(8.0)
        killed = nxt
    killed.leave()
    found = {name: killed.vehicle.interval_us(name) for name in wanted}
    assert found == {"RAW_IMU": 250_000, "GPS_RAW_INT": -1, "HIGHRES_IMU": -1}
    assert path.exists()
    assert killed.rates.restore().end() == ""
    assert not path.exists()


def test_px4_is_never_told_to_stop_what_it_sends_without_a_limit() -> None:
    """Of which it states -1: sent back, that would stop the GPS of whoever else listens on this port."""
    streams = {"GPS_RAW_INT": 8.0, "ATTITUDE": 30.0, "LOCAL_POSITION_NED": 4.0}
    unlimited = {"GPS_RAW_INT", "ATTITUDE"}
    wanted = {"SCALED_IMU": 100.0, "GPS_RAW_INT": 5.0, "ATTITUDE": 50.0, "LOCAL_POSITION_NED": 20.0}
    talk = Conversation(autopilot="px4", streams=streams, unlimited=unlimited, wanted=wanted)
    before = {name: talk.vehicle.interval_us(name) for name in wanted}
    assert before == {"SCALED_IMU": 0, "GPS_RAW_INT": -1, "ATTITUDE": -1, "LOCAL_POSITION_NED": 250_000}
    talk.run(12.0)
    assert talk.received() == pytest.approx(wanted, rel=0.05)
    talk.leave()
    assert {name: talk.vehicle.interval_us(name) for name in wanted} == before
    assert talk.rates.restore().complete


def test_what_arrives_is_not_stopped_whatever_interval_is_stated() -> None:
    """Through a router, or of another autopilot: what another link asked for may arrive on this one."""
    for arriving, restored in ((0, -1), (20, 0)):
        rates = StreamManager(Target(1, 1), {"GPS_RAW_INT": 5.0}, DIALECT, own_sysid=240)
        receive = hearing(rates)
        receive(0.0, "HEARTBEAT", autopilot=3)
        for i in range(arriving):
            receive(0.05 * i, "GPS_RAW_INT", time_usec=50_000 * i)
        receive(1.0, "MESSAGE_INTERVAL", message_id=24, interval_us=-1)
        assert rates.next_request(1.1) is not None
        receive(1.2, "COMMAND_ACK", command=511, result=0, target_system=240)
        assert restoring(rates) == {"GPS_RAW_INT": restored}


def test_each_message_is_confirmed_by_its_own_answer(tmp_path: Path) -> None:
    """An acknowledgement does not say of which: one that comes late, or answers somebody else, confirms nothing."""
    path = tmp_path / "a.json"
    earlier = OriginalRatesFile(path)
    talk = Conversation(wanted={"RAW_IMU": 100.0, "ATTITUDE": 50.0}, streams={"ATTITUDE": 4.0}, earlier=earlier)
    talk.run(8.0)
    restoration, receive = talk.rates.restore(), hearing(talk.rates)
    assert len(restoration.requests()) == 4
    for _ in range(9):
        receive(8.1, "COMMAND_ACK", command=511, result=0, target_system=240)
    assert set(restoration.unconfirmed) == {"RAW_IMU", "ATTITUDE"}
    receive(8.2, "MESSAGE_INTERVAL", message_id=27, interval_us=-1)
    receive(8.2, "MESSAGE_INTERVAL", message_id=30, interval_us=20_000)
    assert restoration.unconfirmed == ("ATTITUDE",), "50 Hz are ours"
    assert restoration.end() == (
        "vehicle 1:1 has not confirmed that ATTITUDE is sent as before: the next run on this link will restore that "
        f"({path})"
    )
    assert OriginalRatesFile(path).known.keys() == {"ATTITUDE"}
    nxt = Conversation(wanted={"RAW_IMU": 100.0}, vehicle=talk.vehicle, begin=talk.t, earlier=OriginalRatesFile(path))
    nxt.run(5.0)
    nxt.leave()
    assert nxt.vehicle.interval_us("ATTITUDE") == 250_000
    assert nxt.rates.restore().end() == ""
    assert not path.exists()


def test_who_never_answers_has_taken_nothing() -> None:
    """A vehicle that is made up, or that wants a signature: nothing of it was changed, and nothing is to be said."""
    rates = StreamManager(Target(1, 1), WANTED, DIALECT, own_sysid=240)
    for i in range(400):
        hearing(rates)(0.1 * i, "HEARTBEAT", autopilot=3)
        rates.next_request(0.1 * i)
    restoration = rates.restore()
    assert restoration.requests()
    assert (restoration.unconfirmed, restoration.end()) == ((), "")


def test_a_run_that_is_not_heard_leaves_what_an_earlier_one_found_to_the_next(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    killed = Conversation(wanted={"RAW_IMU": 100.0}, streams={"RAW_IMU": 4.0}, earlier=OriginalRatesFile(path))
    killed.run(5.0)
    vehicle, receive = killed.vehicle, killed.vehicle.receive
    vehicle.receive = deaf  # type: ignore[method-assign]
    mute = Conversation(wanted={"RAW_IMU": 100.0}, vehicle=vehicle, begin=killed.t, earlier=OriginalRatesFile(path))
    mute.run(5.0)
    mute.leave()
    assert "has not confirmed that RAW_IMU is sent as before" in mute.rates.restore().end()
    vehicle.receive = receive  # type: ignore[method-assign]
    heard = Conversation(wanted={"RAW_IMU": 100.0}, vehicle=vehicle, begin=mute.t, earlier=OriginalRatesFile(path))
    heard.run(5.0)
    heard.leave()
    assert vehicle.interval_us("RAW_IMU") == 250_000


def test_an_interval_of_ours_is_known_after_a_later_request_was_lost() -> None:
    """A link that loses more and more is asked for less, and then is silent for a while."""
    talk = Conversation(wanted={"RAW_IMU": 100.0}, streams={"RAW_IMU": 4.0})
    talk.run(5.0)
    receive = talk.vehicle.receive
    talk.vehicle.receive = deaf  # type: ignore[method-assign]
    (message,) = talk.rates.stream_requests
    message.requested_hz = 50.0
    message.move(RequestState.ASKING, 0.0)
    talk.run(0.5)
    talk.t += 4.0
    talk.vehicle.advance(talk.t)
    talk.vehicle.receive = receive  # type: ignore[method-assign]
    talk.run(5.0)
    talk.leave()
    assert talk.vehicle.interval_us("RAW_IMU") == 250_000


def test_a_slow_message_whose_interval_is_not_known_comes_again() -> None:
    """Once in 5 s."""
    rates = StreamManager(Target(1, 1), {"HIGHRES_IMU": 100.0}, DIALECT, own_sysid=240)
    receive = hearing(rates)
    for i in range(120):
        receive(0.1 * i, "HEARTBEAT", autopilot=3)
        if i % 50 == 7:
            receive(0.1 * i, "HIGHRES_IMU", time_usec=100_000 * i)
        rates.next_request(0.1 * i)
    assert restoring(rates) == {"HIGHRES_IMU": 1_000_000}


def test_what_is_no_longer_wanted_is_given_back_too(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    killed = Conversation(wanted={"RAW_IMU": 100.0}, streams={"RAW_IMU": 4.0}, earlier=OriginalRatesFile(path))
    killed.run(5.0)
    nxt = Conversation(
        wanted={"ATTITUDE": 50.0}, vehicle=killed.vehicle, begin=killed.t, earlier=OriginalRatesFile(path)
    )
    nxt.run(5.0)
    nxt.leave()
    assert (nxt.vehicle.interval_us("RAW_IMU"), nxt.vehicle.interval_us("ATTITUDE")) == (250_000, -1)


def test_a_vehicle_that_was_set_otherwise_since_keeps_that(tmp_path: Path) -> None:
    """It has rebooted, or a ground station has asked: its interval is not the one that the killed companion set."""
    path = tmp_path / "a.json"
    killed = Conversation(wanted={"RAW_IMU": 100.0}, streams={"RAW_IMU": 4.0}, earlier=OriginalRatesFile(path))
    killed.run(5.0)
    later = Conversation(wanted={"RAW_IMU": 100.0}, streams={"RAW_IMU": 10.0}, earlier=OriginalRatesFile(path))
    later.run(5.0)
    later.leave()
    assert later.vehicle.interval_us("RAW_IMU") == 100_000


def test_where_nothing_can_be_kept_that_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    talk = Conversation(wanted={"RAW_IMU": 100.0}, earlier=OriginalRatesFile(tmp_path / "file" / "a.json"))
    talk.run(8.0)
    assert talk.reported().count("if companion is killed, the vehicle keeps its rates") == 1
    assert talk.received() == pytest.approx({"RAW_IMU": 100.0}, rel=0.03)


def test_a_vehicle_that_signs_and_does_not_answer_is_said_to_do_so() -> None:
    rates = StreamManager(Target(1, 1), WANTED, DIALECT, own_sysid=240)
    rates.signed = True
    for i in range(1000):
        if i % 10 == 0:
            hearing(rates)(0.1 * i, "HEARTBEAT", autopilot=3)
        rates.next_request(0.1 * i)
    signs = [sentence for sentence in rates.reported if "signs its messages and does not answer unsigned" in sentence]
    assert 1 <= len(signs) <= 2
    assert "--signing-key-file" in signs[0]


def test_who_has_it_as_often_already_keeps_it_so() -> None:
    """PX4's onboard link sends ATTITUDE at 100 Hz to whoever flies by it: 50 Hz are enough for us, not for them."""
    talk = Conversation(wanted={"RAW_IMU": 100.0, "ATTITUDE": 50.0}, streams={"ATTITUDE": 100.0})
    talk.run(15.0)
    assert talk.received() == pytest.approx({"RAW_IMU": 100.0, "ATTITUDE": 100.0}, rel=0.03)
    talk.vehicle.reboot()
    talk.run(15.0)
    assert talk.received() == pytest.approx({"RAW_IMU": 100.0, "ATTITUDE": 100.0}, rel=0.03)
    talk.leave()
    assert (talk.vehicle.interval_us("RAW_IMU"), talk.vehicle.interval_us("ATTITUDE")) == (-1, 10_000)


@pytest.mark.parametrize("booted_hz", [4.0, 50.0])
def test_after_a_reboot_its_own_interval_is_what_is_given_back(booted_hz: float) -> None:
    """A ground station had set 10 Hz until the reboot; it boots with another rate, or with the one that we ask for."""
    vehicle = SimulatedVehicle(resting(120.0), streams={"ATTITUDE": booted_hz})
    ask = set_interval(Target(1, 1), DIALECT.by_name["ATTITUDE"].id, 100_000)
    vehicle.receive(Packer(255, 190).pack(ask.name, ask.fields))
    talk = Conversation(wanted={"ATTITUDE": 50.0}, vehicle=vehicle)
    talk.run(20.0)
    vehicle.reboot()
    talk.run(10.0)
    assert talk.received() == pytest.approx({"ATTITUDE": 50.0}, rel=0.03)
    talk.leave()
    assert vehicle.interval_us("ATTITUDE") == 1e6 / booted_hz


def test_when_who_had_it_as_often_leaves_it_is_asked_for_whatever_else_never_comes() -> None:
    talk = Conversation(
        wanted={"RAW_IMU": 100.0, "HIGHRES_IMU": 100.0},
        faults=Faults(turned_down=(21.0,), never=frozenset({"HIGHRES_IMU"})),
        streams={"RAW_IMU": 100.0, "HIGHRES_IMU": 100.0},
    )
    talk.run(31.0)
    assert talk.received()["RAW_IMU"] == pytest.approx(100.0, rel=0.03)
    talk.leave()
    assert talk.vehicle.interval_us("RAW_IMU") == 500_000, "which is what there was when we asked"


def test_an_interval_of_ours_is_never_taken_for_the_one_before_us() -> None:
    """The vehicle did not say at first; after a silence it says what we have set."""
    rates = StreamManager(Target(1, 1), {"RAW_IMU": 100.0}, DIALECT, own_sysid=240)
    receive = hearing(rates)
    receive(0.0, "HEARTBEAT", autopilot=3)
    asked = [rates.next_request(0.1 * i) for i in range(25)]
    assert [r.fields["command"] for r in asked if r] == [510, 510, 511]
    receive(2.5, "COMMAND_ACK", command=511, result=0, target_system=240)
    receive(9.0, "HEARTBEAT", autopilot=3)
    rates.next_request(9.1)
    receive(9.2, "MESSAGE_INTERVAL", message_id=27, interval_us=10_000)
    assert restoring(rates) == {"RAW_IMU": 0}


def test_what_is_in_no_stream_of_ardupilot_is_stopped_where_its_interval_is_not_known() -> None:
    """Asked for the default of such a message ArduPilot FAILS, and goes on sending."""
    rates = StreamManager(Target(1, 1), {"HIGHRES_IMU": 100.0}, DIALECT, own_sysid=240)
    hearing(rates)(0.0, "HEARTBEAT", autopilot=3)
    assert sum(rates.next_request(0.1 * i) is not None for i in range(25)) == 3
    assert restoring(rates) == {"HIGHRES_IMU": -1}


def test_a_message_that_ardupilot_does_not_know_is_not_asked_for_ever_slower() -> None:
    """Each such request makes it tell every ground station "No ap_message for mavlink id (105)"."""
    rates = StreamManager(Target(1, 1), {"HIGHRES_IMU": 100.0}, DIALECT, own_sysid=240)
    receive = hearing(rates)
    receive(0.0, "HEARTBEAT", autopilot=3)
    assert rates.next_request(0.0) is not None
    receive(0.1, "MESSAGE_INTERVAL", message_id=105, interval_us=0)
    assert rates.next_request(0.2) is not None
    receive(0.3, "COMMAND_ACK", command=511, result=2, target_system=240)
    assert rates.settled
    receive(3.0, "HEARTBEAT", autopilot=3)
    assert rates.reported == ["HIGHRES_IMU: the vehicle refuses it; given up"]


def test_a_message_that_is_denied_is_asked_for_more_slowly_down_to_5_hz() -> None:
    rates = StreamManager(Target(1, 1), {"HIGHRES_IMU": 100.0}, DIALECT, own_sysid=240)
    receive = hearing(rates)
    receive(0.0, "HEARTBEAT", autopilot=3)
    assert rates.next_request(0.0) is not None
    receive(0.1, "MESSAGE_INTERVAL", message_id=105, interval_us=-1)
    asked = list[float]()
    for step in range(1, 100):
        if (request := rates.next_request(0.2 * step)) is not None and request.fields.get("command") == 511:
            asked.append(float(request.fields["param2"]))
            receive(0.2 * step + 0.1, "COMMAND_ACK", command=511, result=2, target_system=240)
    assert rates.settled
    assert (asked[0], len(asked)) > (9_999.0, 5)
    assert (np.diff(asked) > 0).all()
    assert 150_000 < asked[-1] <= 200_000


def test_who_turns_it_down_is_asked_again_ever_later() -> None:
    """Another program sets it back to 1 Hz at once: a message a second, whatever is agreed."""
    rates = StreamManager(Target(1, 1), {"HIGHRES_IMU": 100.0}, DIALECT, own_sysid=240)
    receive, asked = hearing(rates), list[float]()
    for step in range(1200):
        now = 0.1 * step
        if step % 10 == 0:
            receive(now, "HEARTBEAT", autopilot=3)
            receive(now, "HIGHRES_IMU", time_usec=100_000 * step)
        request = rates.next_request(now)
        command = request.fields.get("command") if request is not None else None
        if command == 510:
            receive(now, "MESSAGE_INTERVAL", message_id=105, interval_us=1_000_000)
        elif command == 511:
            asked.append(now)
            receive(now, "COMMAND_ACK", command=511, result=0, target_system=240)
    assert rates.settled
    waits = np.diff(asked)
    assert len(waits) == 4
    assert (np.diff(waits)[1:] > 4.0).all(), waits
    assert waits[-1] > 20.0


def test_messages_of_one_stream_do_not_turn_each_other_down() -> None:
    talk = Conversation(faults=Faults(denied=frozenset("*")))
    talk.run(30.0)
    assert talk.received()["LOCAL_POSITION_NED"] == pytest.approx(20.0, rel=0.05)
    assert "overriding" not in talk.reported()
    assert "asking again" not in talk.reported()


def test_a_stream_gets_the_rate_back_that_it_had() -> None:
    """Firmware that answers neither command: what arrived before is what there was."""
    rates = StreamManager(Target(1, 1), {"ATTITUDE": 50.0}, DIALECT, own_sysid=240)
    receive, asked = hearing(rates), []
    for i in range(50):
        receive(0.25 * i, "ATTITUDE", time_boot_ms=250 * i)
        if (request := rates.next_request(0.25 * i + 0.1)) is not None:
            asked.append(request.name)
    assert "REQUEST_DATA_STREAM" in asked
    (restored,) = rates.restore().requests()
    assert restored.name == "REQUEST_DATA_STREAM"
    assert restored.fields["req_message_rate"] in (4, 5)


def test_px4_is_never_asked_for_streams() -> None:
    talk = Conversation(wanted={"ATTITUDE": 20.0}, faults=Faults(denied=frozenset("*")), autopilot="px4")
    talk.run(15.0)
    assert talk.sent["REQUEST_DATA_STREAM"] == 0
    assert "ATTITUDE: the vehicle refuses it; given up" in talk.reported()


@pytest.mark.parametrize(("autopilot", "part"), [("ardupilot", "INS_GYR_ID"), ("px4", "CAL_GYRO0_ID")])
def test_the_part_that_measures_is_asked_for(autopilot: str, part: str) -> None:
    """Or the figures of a recording would be those of any IMU."""
    talk = Conversation(autopilot=autopilot, wanted={"ATTITUDE": 20.0}, parameters={part: 1.0})
    talk.run(20.0)
    assert talk.vehicle.sent["PARAM_VALUE"] == 1


def restoring(rates: StreamManager) -> dict[str, int]:
    """Message → the interval that it is to have again."""
    names = {message.id: name for name, message in DIALECT.by_name.items()}
    sets = [request.fields for request in rates.restore().requests() if request.fields["command"] == 511]
    return {names[int(fields["param1"])]: int(fields["param2"]) for fields in sets}


def hearing(rates: StreamManager) -> Callable[..., None]:
    """Say one message of the vehicle's to it at a time."""
    packer, decoder = Packer(1, 1), Decoder(DIALECT, stamped=False)

    def receive(now: float, name: str, **fields: int) -> None:
        rates.receive(split_messages(decoder.push(packer.pack(name, fields)), DIALECT), now)

    return receive


class ThinConversation(Conversation):
    """Over a link that carries so many bytes a second and drops the rest; nothing is said of that anywhere."""

    def __init__(self, bytes_per_second: float, **manners: Any) -> None:
        super().__init__(200.0, **manners)
        self._carries, self._room = bytes_per_second, 0.0

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.t += STEP_S
            self._room = min(self._room + self._carries * STEP_S, self._carries)
            sent, carried = 0, []
            for _, packet in self.vehicle.advance(self.t):
                sent += 1
                if self._room >= len(packet):
                    self._room -= len(packet)
                    carried.append(packet)
            self.rates.lost_share += 0.02 * (1.0 - len(carried) / max(sent, 1) - self.rates.lost_share)  # over 5 s
            self.rates.receive(split_messages(self._decoder.push(b"".join(carried)), DIALECT), self.t)
            if request := self.rates.next_request(self.t):
                self.vehicle.receive(self._packer.pack(request.name, request.fields))


@pytest.mark.parametrize("manners", [{}, {"autopilot": "px4"}], ids=["ArduPilot", "PX4"])
def test_what_a_thin_link_drops_is_asked_for_less_the_most_important_last(manners: dict[str, str]) -> None:
    wanted = desired_from("PX4" if manners else "ARDUPILOTMEGA")
    talk = ThinConversation(6000.0, wanted=wanted, **manners)
    talk.run(120.0)
    requested = {one.name: one.requested_hz for one in talk.rates.stream_requests}
    assert "Whoever shares the link has the rest" in talk.reported()
    assert load(requested, DIALECT) < 0.7 * load(wanted, DIALECT)
    imu, least = next(iter(wanted)), "HIGHRES_IMU"
    assert requested[imu] / wanted[imu] > 2.0 * requested[least] / wanted[least]


def test_a_link_that_carries_everything_is_left_alone() -> None:
    talk = ThinConversation(1e6)
    talk.run(60.0)
    assert "shares the link" not in talk.reported()
    assert all(one.requested_hz == one.desired_hz for one in talk.rates.stream_requests)
