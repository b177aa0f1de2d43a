"""A session on a real socket: whom it takes for a vehicle, and what it says."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from companion.links import Choice, Link, Recorder, Session
from companion.links.request_table import desired_from
from companion.logs import read_tlog
from companion.mavlink import Packer
from tests.links.link import link_frames, unknown_frame
from tests.links.peers import deaf, udp_peer
from tests.simulated import flying
from tests.waiting import wait_for


def heartbeat(sysid: int, *, kind: int, autopilot: int = 3, compid: int = 1) -> bytes:
    return Packer(sysid, compid).pack("HEARTBEAT", {"type": kind, "autopilot": autopilot, "mavlink_version": 3})


def receive(session: Session, frames: int) -> None:
    """Step until so many frames have been received since the session began."""

    def heard() -> bool:
        session.step(0.02)
        return session.link.health.frames >= frames

    wait_for(heard, f"{frames} frames")


def test_ground_stations_gimbals_and_companions_are_no_vehicles() -> None:
    with Link("udpin:127.0.0.1:0") as link, udp_peer(link.port) as peer:
        session = Session(link)
        for beat in (heartbeat(255, kind=6), heartbeat(1, kind=26, compid=154), heartbeat(1, kind=18, compid=191)):
            peer.send(beat)
        receive(session, 3)
        assert session.vehicles == {}
        assert set(link.health.sent) == {"HEARTBEAT"}
        peer.send(heartbeat(7, kind=2))
        receive(session, 4)
        assert [str(target) for target in session.vehicles] == ["7:1"]
        assert session.reported == ["vehicle 7:1 (ARDUPILOTMEGA) is heard"]
        assert link.health.sent["COMMAND_LONG"] > 0


@pytest.mark.parametrize(("sysid", "compid"), [(0, 1), (1, 0)])
def test_nothing_is_asked_of_who_speaks_as_everybody(sysid: int, compid: int) -> None:
    with Link("udpin:127.0.0.1:0") as link, udp_peer(link.port) as peer:
        session = Session(link)
        peer.send(heartbeat(sysid, kind=2, compid=compid))
        receive(session, 1)
        assert session.requested == {}
        assert set(link.health.sent) == {"HEARTBEAT"}


def test_a_chosen_vehicle_is_waited_for() -> None:
    with Link("udpin:127.0.0.1:0") as link, udp_peer(link.port) as peer:
        session = Session(link, choice=Choice(vehicle="2:1"))
        peer.send(heartbeat(1, kind=2))
        receive(session, 1)
        assert session.rates is None
        peer.send(heartbeat(2, kind=2))
        receive(session, 2)
        assert session.rates is not None
        assert str(session.rates.target) == "2:1"


def test_a_crowd_that_is_made_up_does_not_fill_the_memory() -> None:
    with Link("udpin:127.0.0.1:0", listen_only=True) as link, udp_peer(link.port) as peer:
        session = Session(link)
        for sysid in range(1, 121):
            peer.send(heartbeat(sysid, kind=2))
        receive(session, 120)
        assert len(session.vehicles) == 64
        assert sum("64 vehicles are heard, and more" in sentence for sentence in session.reported) == 1


def test_frames_are_handed_on_to_each_listener_with_the_time_of_their_arrival() -> None:
    taken: list[tuple[int, float]] = []
    beside: list[int] = []
    with Link("udpin:127.0.0.1:0") as link, udp_peer(link.port) as peer:
        session = Session(link)
        session.listen(lambda frames, received: taken.append((len(frames), received)))
        session.listen(lambda frames, _: beside.append(len(frames)))
        for _ in range(5):
            peer.send(heartbeat(1, kind=2))
        receive(session, 5)
    assert sum(count for count, _ in taken) == sum(beside) == 5
    assert np.ptp([received - time.time() for _, received in taken]) < 5.0


def test_a_vehicle_without_an_imu_is_told_of() -> None:
    with Link("udpin:127.0.0.1:0", listen_only=True) as link, udp_peer(link.port) as peer:
        session = Session(link, patience_s=0.2)

        def told() -> int:
            peer.send(heartbeat(1, kind=2))
            session.step(0.02)
            return sum(
                "sends no IMU message (--listen-only asks for none)" in sentence for sentence in session.reported
            )

        wait_for(told)
        assert [told() for _ in range(5)] == [1] * 5


def test_loss_is_counted_for_the_vehicle_and_not_for_whom_it_forwards() -> None:
    """Of a camera or of a second vehicle an autopilot passes on the heartbeats alone."""
    with Link("udpin:127.0.0.1:0", listen_only=True) as link, udp_peer(link.port) as peer:
        session, own = Session(link), Packer(1, 1)
        camera, other = Packer(1, 100), Packer(2, 1)
        packets = [own.pack("HEARTBEAT", {"type": 2, "autopilot": 3, "mavlink_version": 3}) for _ in range(20)]
        for packer, kind in ((camera, 30), (other, 2)):
            all_of_it = [
                packer.pack("HEARTBEAT", {"type": kind, "autopilot": 8 if kind == 30 else 3}) for _ in range(60)
            ]
            packets += all_of_it[::10]
        del packets[5]
        for packet in packets:
            peer.send(packet)
        receive(session, len(packets))
        report = session.report()
    assert report.lost_by == {"1:1": pytest.approx(0.05)}


def test_a_vehicle_that_signs_is_said_to_want_a_key() -> None:
    with Link("udpin:127.0.0.1:0") as link, udp_peer(link.port) as peer:
        session, packer = Session(link, patience_s=0.2), Packer(1, 1, signing_key=bytes(range(32)))

        def told() -> int:
            peer.send(packer.pack("HEARTBEAT", {"type": 2, "autopilot": 3, "mavlink_version": 3}))
            session.step(0.02)
            return sum("signs its messages, and obeys only requests that are signed" in s for s in session.reported)

        wait_for(told)
        assert not any("raise the stream rate" in sentence for sentence in session.reported)


def test_frames_of_unknown_ids_are_recorded_and_are_no_loss(tmp_path: Path) -> None:
    """PX4 1.16 sends 8, 380, 411 and 436."""
    path = tmp_path / "a.tlog"
    frames = [*link_frames(100)]
    for index in range(1, 100, 3):
        frames[index] = unknown_frame(60_411, bytes([index]), index)
    frames[0] = heartbeat(1, kind=2)
    with Link("udpin:127.0.0.1:0", listen_only=True) as link, udp_peer(link.port) as peer, Recorder(path) as recorder:
        session = Session(link, recorder=recorder)
        for frame in frames:
            peer.send(frame)
        receive(session, 100)
        assert link.health.lost[1, 1] == 0
    stream, at = path.read_bytes(), 0
    for frame in frames:
        assert stream[at + 8 : at + 8 + len(frame)] == frame
        at += 8 + len(frame)
    assert read_tlog(path).unknown_frames == {60_411: 33}


def test_what_was_found_outlives_a_session_that_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    with Link("udpin:127.0.0.1:0") as link, flying(link.port, streams={"RAW_IMU": 4.0}) as vehicle:
        killed = Session(link, remember=True)
        wait_for(lambda: killed.step(0.02) is not None and vehicle.interval_us("RAW_IMU") == 10_000)
        (file,) = tmp_path.rglob("*.json")
        assert "127.0.0.1" in file.name
        nxt = Session(link, remember=True)
        wait_for(lambda: nxt.step(0.02) is not None and nxt.rates is not None and nxt.rates.settled)
        assert any("an earlier companion on this link" in sentence for sentence in nxt.reported)
        begin = time.monotonic()
        assert nxt.leave()
        assert time.monotonic() - begin < 2.0
        wait_for(lambda: vehicle.interval_us("RAW_IMU") == 250_000)
        assert not file.exists()


def test_every_vehicle_can_be_asked_and_each_is_left_as_it_was() -> None:
    with Link("udpin:127.0.0.1:0") as link:
        session = Session(link, choice=Choice(vehicle="all"))
        with flying(link.port, sysid=1) as one, flying(link.port, sysid=2) as two:
            both = (one, two)

            def agreed() -> bool:
                session.step(0.02)
                return all(v.interval_us("RAW_IMU") == 10_000 and v.interval_us("ATTITUDE") > 0 for v in both)

            wait_for(agreed)
            names = {arriving.name for arriving in session.report().arriving}
            assert {"1:1 RAW_IMU", "2:1 RAW_IMU"} <= names
            session.leave()
            wait_for(lambda: [vehicle.interval_us("RAW_IMU") for vehicle in both] == [-1, -1])


@pytest.mark.parametrize("listen_only", [False, True])
@pytest.mark.parametrize("sequence", [30, 200])
def test_a_reboot_is_no_loss(sequence: int, *, listen_only: bool) -> None:
    """The sequence begins anew, which looks like 56 frames missing or like old ones that come late."""
    with Link("udpin:127.0.0.1:0", listen_only=listen_only) as link, udp_peer(link.port) as peer:
        session, sent = Session(link), 0
        for boot_s in (100.0, 0.1):
            packer = Packer(1, 1)
            packets = [packer.pack("HEARTBEAT", {"type": 2, "autopilot": 3, "mavlink_version": 3})]
            clock = (round(1000 * boot_s) + i for i in range(sequence))
            packets += [packer.pack("ATTITUDE", {"time_boot_ms": now}) for now in clock]
            del packets[5:8]  # three are lost
            for packet in packets:
                peer.send(packet)
            sent += len(packets)
            receive(session, sent)
            time.sleep(0.3)  # the second boot began 0.1 s before its first message, and so after the first's last
        peer.send(packer.pack("HEARTBEAT", {"type": 2, "autopilot": 3, "mavlink_version": 3}))
        receive(session, sent + 1)
        assert link.health.lost[1, 1] in (3, 6)


def test_intervals_are_given_back_when_the_first_requests_are_lost() -> None:
    """While a ground station's answers pass by, which are none to ours."""
    with Link("udpin:127.0.0.1:0") as link:
        session = Session(link)
        with flying(link.port) as vehicle:
            wait_for(lambda: session.step(0.02) is not None and vehicle.interval_us("GLOBAL_POSITION_INT") > 0)
            receive, begin, sent = vehicle.receive, time.monotonic(), link.health.sent["COMMAND_LONG"]

            def lossy(data: bytes) -> None:
                if time.monotonic() - begin > 0.5:
                    receive(data)
                for _ in range(6):
                    vehicle._send("COMMAND_ACK", command=511, target_system=255)

            vehicle.receive = lossy  # type: ignore[method-assign]
            session.leave()
            asked = len(desired_from("ARDUPILOTMEGA"))
            assert link.health.sent["COMMAND_LONG"] - sent <= 4 * 2 * asked, "then it leaves all the same"
            wait_for(lambda: {vehicle.interval_us(name) for name in ("RAW_IMU", "HIGHRES_IMU", "ATTITUDE")} == {-1})


def test_what_is_not_confirmed_is_said_and_left_to_the_next_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Answers that come too late (through MAVProxy), a cable that is pulled, a vehicle out of reach."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    with Link("udpin:127.0.0.1:0") as link, flying(link.port, streams={"RAW_IMU": 4.0}) as vehicle:
        receive = vehicle.receive

        def settled(session: Session) -> bool:
            session.step(0.02)
            return session.rates is not None and session.rates.settled and vehicle.interval_us("RAW_IMU") == 10_000

        first = Session(link, remember=True)
        wait_for(lambda: settled(first))
        vehicle.receive = deaf  # type: ignore[method-assign]
        begin = time.monotonic()
        assert not first.leave()
        assert time.monotonic() - begin < 2.0
        assert vehicle.interval_us("RAW_IMU") == 10_000
        (file,) = tmp_path.rglob("*.json")
        (said,) = (sentence for sentence in first.reported if "has not confirmed" in sentence)
        assert "RAW_IMU" in said
        assert str(file) in said
        vehicle.receive = receive  # type: ignore[method-assign]
        second = Session(link, remember=True)
        wait_for(lambda: settled(second))
        assert any("has not restored all message intervals of vehicle 1:1" in sentence for sentence in second.reported)
        assert second.leave()
        assert vehicle.interval_us("RAW_IMU") == 250_000
        assert not file.exists()


def crowd(count: int) -> Iterator[bytes]:
    """Heartbeats of so many vehicles that do not exist, the same after 65,024."""
    for number in range(count):
        sysid, compid = 2 + number // 255 % 254, 1 + number % 255
        yield heartbeat(sysid, kind=2, compid=compid)


def test_among_made_up_vehicles_the_one_with_an_imu_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not the first that speaks, and also where more have spoken than are told apart."""
    monkeypatch.setattr("companion.links.session._IMU_WITHIN_S", 0.3)
    with Link("udpin:127.0.0.1:0") as link, udp_peer(link.port) as stranger:
        session = Session(link)
        made_up = crowd(65_024)
        for _ in range(100):
            stranger.send(next(made_up))
        receive(session, 100)
        assert [str(target) for target in session.requested] == ["2:1"]
        with flying(link.port, streams={"RAW_IMU": 4.0}) as vehicle:

            def agreed() -> bool:
                for _ in range(64):  # 3,200 heartbeats a second, where a step takes 20 ms
                    stranger.send(next(made_up))
                session.step(0.02)
                return vehicle.interval_us("RAW_IMU") == 10_000

            wait_for(agreed)
            assert [str(target) for target in session.requested] == ["1:1"]
            assert "vehicle 2:1 sends no IMU message, and 1:1 does: asking that one" in session.reported
            assert len(session.vehicles) <= 65
            assert session.leave(), "of who never was there nothing has to be restored"
            assert vehicle.interval_us("RAW_IMU") == 250_000


def test_a_vehicle_that_is_named_is_found_in_any_crowd() -> None:
    with Link("udpin:127.0.0.1:0", listen_only=True) as link, udp_peer(link.port) as peer:
        session = Session(link, choice=Choice(vehicle="1"))
        for beat in crowd(100):
            peer.send(beat)
        receive(session, 100)
        assert not session.requested
        peer.send(heartbeat(1, kind=2))
        receive(session, 101)
        assert [str(target) for target in session.requested] == ["1:1"]


def test_a_vehicle_whose_imu_comes_is_kept_whoever_else_sends_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.links.session._IMU_WITHIN_S", 0.0)
    with Link("udpin:127.0.0.1:0", listen_only=True) as link, udp_peer(link.port) as peer:
        session, imu = Session(link), ("RAW_IMU", {"time_usec": 1})
        for sysid in (3, 2):
            peer.send(Packer(sysid, 1).pack(*imu))
            peer.send(heartbeat(sysid, kind=2))
            peer.send(Packer(sysid, 1).pack(*imu))
            receive(session, session.link.health.frames + 3)
        assert [str(target) for target in session.requested] == ["3:1"]


def test_what_breaks_beside_the_recording_is_said_once_and_ends_nothing() -> None:
    with Link("udpin:127.0.0.1:0", listen_only=True) as link:
        session = Session(link)
        for _ in range(3):
            session.beside([].pop)
        assert session.reported == [
            "what was heard could not be dealt with (IndexError: pop from empty list); the recording goes on"
        ]
