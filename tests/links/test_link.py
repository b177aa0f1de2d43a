"""Links against real sockets and pseudo-terminals: what arrives, what leaves, and what happens when the peer goes."""

from __future__ import annotations

import contextlib
import os
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pymavlink.dialects.v20.ardupilotmega as mavlink
import pytest

from companion.links import (
    Address,
    ForbiddenMessageError,
    Link,
    Request,
    Target,
    is_link,
    open_port,
    parse_address,
    play,
    requests,
    transports,
)
from companion.mavlink import load_dialect
from companion.model import InputError
from tests.links.link import link_frames, stamped
from tests.links.peers import frames_until, ids, listener, serial_cable, udp_peer
from tests.simulated import free_port
from tests.waiting import LIMIT_S, wait_for

TARGET = Target(1, 1)
EVERY_REQUEST = [
    requests.heartbeat(),
    requests.get_interval(TARGET, 27),
    requests.set_interval(TARGET, 27, 10_000),
    requests.request_message(TARGET, 148),
    requests.request_stream(TARGET, 1, 50),
    requests.read_parameter(TARGET, "AHRS_TRIM_X"),
    requests.timesync(5),
]


def decoded(data: bytes) -> list[Any]:
    """Messages by pymavlink."""
    parser: Any = mavlink.MAVLink(None)
    return parser.parse_buffer(data) or []


@pytest.fixture
def udp() -> Iterator[Link]:
    with Link("udpin:127.0.0.1:0") as link:
        yield link


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("udpin:0.0.0.0:14550", Address("udpin", "0.0.0.0", 14550)),
        ("udp:127.0.0.1:14550", Address("udpin", "127.0.0.1", 14550)),
        ("udpin:14550", Address("udpin", "0.0.0.0", 14550)),
        ("udpout:host.example:14551", Address("udpout", "host.example", 14551)),
        ("tcp:127.0.0.1:5760", Address("tcp", "127.0.0.1", 5760)),
        ("tcp:[::1]:5760", Address("tcp", "::1", 5760)),
        ("tcpin::5770", Address("tcpin", "0.0.0.0", 5770)),
        ("/dev/ttyACM0", Address("serial", device="/dev/ttyACM0", baud=115200)),
        (
            "/dev/serial/by-id/usb-A:1-if00:57600",
            Address("serial", device="/dev/serial/by-id/usb-A:1-if00", baud=57600),
        ),
        ("COM3:921600", Address("serial", device="COM3", baud=921600)),
    ],
)
def test_an_address_says_where_a_link_goes(text: str, address: Address) -> None:
    assert parse_address(text) == address
    assert is_link(text)


@pytest.mark.parametrize("text", ["/dev/cu.usbmodem14101", "/dev/rfcomm0", "udpin", "tcpclient:host:1", "com7"])
def test_what_is_meant_as_a_link_is_told_from_a_file(text: str) -> None:
    assert is_link(text)


@pytest.mark.parametrize(
    "text", ["udp_test.tlog", "COM3.bin", "com2_flight.ulg", "/dev/stdin", "/dev/fd/63", "tcp.tlog"]
)
def test_a_file_named_as_a_link_begins_is_a_file(text: str) -> None:
    assert not is_link(text)


@pytest.mark.parametrize(
    "text", ["", "udpin", "http://x", "tcp:host", "udpin:1.2.3.4:99999", "flight.tlog", "udpout:h:0", "/dev/ttyS0:0"]
)
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="not a link: use|no port |no baud rate"):
        parse_address(text)


def test_what_is_sent_arrives_whole_over_udp(udp: Link) -> None:
    packets = list(link_frames(700))
    with udp_peer(udp.port) as peer:
        for packet in packets:
            peer.send(packet)
        found = frames_until(udp, 700)
    seen = np.concatenate([frames.seq for frames in found])
    np.testing.assert_array_equal(seen, np.arange(700) % 256)
    assert udp.health.bytes == sum(map(len, packets))
    assert udp.health.lost == {(1, 1): 0}
    assert udp.problem == ""


def test_a_loss_of_a_third_is_counted_and_survived(udp: Link) -> None:
    packets = list(link_frames(600))
    kept = [packet for i, packet in enumerate(packets) if i % 3]
    with udp_peer(udp.port) as peer:
        for i, packet in enumerate(kept):
            peer.send(b"\xfd\x09garbage" + packet if i % 10 == 0 else packet)
        frames_until(udp, 400)
    assert udp.health.lost == {(1, 1): 199}  # of the 200, the first was before anything was heard


def test_late_packets_and_copies_are_no_losses(udp: Link) -> None:
    packets = list(link_frames(600))
    order = [1 if i == 0 else 0 if i == 1 else i for i in range(600)]
    for i in range(10, 590, 7):
        order[i], order[i + 1] = order[i + 1], order[i]
    with udp_peer(udp.port) as peer:
        for i in order:
            if i % 50 != 5:  # 12 are lost
                peer.send(packets[i])
                if i % 9 == 0:
                    peer.send(packets[i])
        wait_for(lambda: udp.receive(0.05) is not None and udp.health.frames >= 588 + 66)
    assert udp.health.lost[1, 1] == pytest.approx(12, abs=1)


def test_of_a_crowd_only_those_who_say_the_most_are_counted(udp: Link) -> None:
    vehicle = list(link_frames(800))
    with udp_peer(udp.port) as peer:
        for i, packet in enumerate(vehicle):
            if i != 200:
                peer.send(packet)
            made_up = mavlink.MAVLink(None, srcSystem=2 + i % 250, srcComponent=1 + i // 250)
            peer.send(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3).pack(made_up))
            if i % 100 == 99:  # no more at once than a socket holds
                frames_until(udp, 199 if i == 299 else 200)
    assert len(udp.health.received) == len(udp.health.lost) <= 512
    assert udp.health.received[1, 1] == 799
    assert udp.health.lost[1, 1] == 1


def test_two_vehicles_on_one_link_are_counted_apart(udp: Link) -> None:
    with udp_peer(udp.port) as one, udp_peer(udp.port) as two:
        for i in range(50):
            for peer, system in ((one, 1), (two, 2)):
                sender = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
                sender.seq = i
                peer.send(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3).pack(sender))
        found = frames_until(udp, 100)
        assert sorted({int(s) for frames in found for s in frames.sysid}) == [1, 2]
        assert udp.health.lost == {(1, 1): 0, (2, 1): 0}
        udp.send(requests.heartbeat())
        assert decoded(one.heard())
        assert decoded(two.heard()), "both are answered"


def test_everything_allowed_arrives_as_meant(udp: Link) -> None:
    with udp_peer(udp.port) as peer:
        peer.send(next(link_frames(1)))
        frames_until(udp, 1)
        for request in EVERY_REQUEST:
            udp.send(request)
        heard = decoded(peer.heard())
    assert [m.get_type() for m in heard] == [request.name for request in EVERY_REQUEST]
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in heard} == {(240, 191)}
    assert (heard[0].type, heard[0].autopilot) == (mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID)
    assert [m.command for m in heard if m.get_type() == "COMMAND_LONG"] == [510, 511, 512]
    assert (heard[2].param1, heard[2].param2, heard[2].param3) == (27, 10_000, 0)
    assert udp.health.sent == {"HEARTBEAT": 1, "COMMAND_LONG": 3} | dict.fromkeys(
        ["REQUEST_DATA_STREAM", "PARAM_REQUEST_READ", "TIMESYNC"], 1
    )


@pytest.mark.parametrize("name", ["PARAM_SET", "SET_MODE", "RC_CHANNELS_OVERRIDE", "COMMAND_INT", "MISSION_ITEM_INT"])
def test_nothing_else_can_be_sent(name: str) -> None:
    with pytest.raises(ForbiddenMessageError, match=f"never sends {name}"):
        Request(name, {})


@pytest.mark.parametrize("command", [400, 176, 246, 410, 0])
def test_no_other_command_can_be_sent(command: int) -> None:
    with pytest.raises(ForbiddenMessageError, match=f"never sends MAV_CMD {command}"):
        Request("COMMAND_LONG", {"target_system": 1, "command": command})
    with pytest.raises(ForbiddenMessageError):
        Request("COMMAND_LONG", {"target_system": 1})


@pytest.mark.parametrize(("rate_hz", "start_stop"), [(0, 0), (1, 1), (50, 1)])
def test_a_stream_of_no_rate_is_stopped(udp: Link, rate_hz: int, start_stop: int) -> None:
    """MAVLink common: start_stop is 1 to start sending, 0 to stop sending."""
    with udp_peer(udp.port) as peer:
        peer.send(next(link_frames(1)))
        frames_until(udp, 1)
        udp.send(requests.request_stream(TARGET, 6, rate_hz))
        (heard,) = decoded(peer.heard())
    assert (heard.req_stream_id, heard.req_message_rate, heard.start_stop) == (6, rate_hz, start_stop)


def test_words_for_people_are_sent_only_where_that_was_asked_for(udp: Link) -> None:
    words = requests.announce("IMU SUSPECT " * 20, alarm=True)
    with udp_peer(udp.port) as peer:
        peer.send(next(link_frames(1)))
        frames_until(udp, 1)
        with pytest.raises(ForbiddenMessageError, match="only where it was asked to announce"):
            udp.send(words)
        assert peer.heard_late() == b""
        udp.announces = True
        udp.send(words)
        (heard,) = decoded(peer.heard())
    assert (heard.get_type(), heard.severity) == ("STATUSTEXT", mavlink.MAV_SEVERITY_WARNING)
    assert (heard.get_srcSystem(), heard.get_srcComponent()) == (240, 191)
    assert heard.text.startswith("companion: IMU SUSPECT")
    assert len(heard.text) == 50


def test_words_for_people_come_from_the_vehicle_s_own_system_and_nothing_else_does(udp: Link) -> None:
    """QGroundControl shows no other's: messages of a system that is no vehicle of its are dropped."""
    udp.announces = True
    with udp_peer(udp.port) as peer:
        peer.send(next(link_frames(1)))
        frames_until(udp, 1)
        for _ in range(2):
            udp.send(requests.announce("IMU SUSPECT", alarm=True), aboard=7)
        first, second = decoded(peer.heard())
        with pytest.raises(ForbiddenMessageError, match="as itself"):
            udp.send(requests.heartbeat(), aboard=7)
        assert peer.heard_late() == b""
    assert (first.get_srcSystem(), first.get_srcComponent()) == (7, 191)
    assert (second.get_seq() - first.get_seq()) % 256 == 1


def test_a_listener_sends_nothing() -> None:
    with Link("udpin:127.0.0.1:0", listen_only=True) as link, udp_peer(link.port) as peer:
        peer.send(next(link_frames(1)))
        frames_until(link, 1)
        for request in EVERY_REQUEST:
            link.send(request)
        assert peer.heard_late() == b""
        assert link.health.sent == {}
    with pytest.raises(InputError, match="unless it speaks first"):
        Link("udpout:127.0.0.1:14550", listen_only=True)


def test_who_speaks_mavlink_1_is_answered_so(udp: Link) -> None:
    with udp_peer(udp.port) as peer:
        peer.send(next(link_frames(1, version=1)))
        frames_until(udp, 1)
        udp.send(requests.set_interval(TARGET, 27, 10_000))
        assert peer.heard()[0] == 0xFE
        peer.send(next(link_frames(1, version=2)))
        frames_until(udp, 1)
        udp.send(requests.heartbeat())
        assert peer.heard()[0] == 0xFD


def test_who_begins_with_mavlink_1_hears_that_we_speak_2(udp: Link) -> None:
    """ArduPilot (SERIALn_PROTOCOL 2) and PX4 (MAV_PROTO_VER 0) change over when they hear 2, not before."""
    with udp_peer(udp.port) as peer:
        peer.send(next(link_frames(1, version=1)))
        frames_until(udp, 1)
        udp.send(requests.heartbeat())
        heard = decoded(peer.heard())
        assert [message.get_type() for message in heard] == ["HEARTBEAT", "HEARTBEAT"]
        assert [message.get_msgbuf()[0] for message in heard] == [0xFE, 0xFD]


def test_a_host_name_of_both_kinds_is_the_address_that_vehicles_use(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [
        (socket.AF_INET6, socket.SOCK_DGRAM, 17, "", ("::1", 0, 0, 0)),
        (socket.AF_INET, socket.SOCK_DGRAM, 17, "", ("127.0.0.1", 0)),
    ]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: found)
    with Link("udpin:localhost:0") as link, udp_peer(link.port) as peer:
        peer.send(next(link_frames(1)))
        frames_until(link, 1)


def test_udpout_speaks_first_and_hears_the_answer() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", 0))
        server.settimeout(LIMIT_S)
        with Link(f"udpout:127.0.0.1:{server.getsockname()[1]}") as link:
            link.send(requests.heartbeat())
            data, peer = server.recvfrom(1000)
            assert [m.get_type() for m in decoded(data)] == ["HEARTBEAT"]
            server.sendto(next(link_frames(1)), peer)
            frames_until(link, 1)


def test_a_partner_that_never_answers_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """PX4's port has one partner: who comes second gets nothing."""
    monkeypatch.setattr("companion.links.transports._ANSWERS_S", 0.05)
    with Link(f"udpout:127.0.0.1:{free_port()}") as link:
        assert link.problem == "nobody has sent anything yet"
        link.send(requests.heartbeat())
        wait_for(lambda: "another partner" in link.problem)


def test_udpout_to_a_closed_port_waits_for_it_to_open() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", 0))
        port = server.getsockname()[1]
    with Link(f"udpout:127.0.0.1:{port}") as link:
        for _ in range(3):
            link.send(requests.heartbeat())
            assert len(link.receive(0.02)) == 0
        assert link.problem


def test_a_connection_with_itself_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """TCP allows it where the system happens to give a client the very port that it looks for."""

    class OfThisPort(socket.socket):
        def connect(self, address: Any) -> None:
            self.bind(address)
            super().connect(address)

    monkeypatch.setattr(socket, "socket", OfThisPort)
    with pytest.raises(InputError, match="nothing answers at .* \\(nobody listens\\)"):
        Link(f"tcp:127.0.0.1:{free_port()}")


def test_a_tcp_peer_may_close_and_come_back() -> None:
    packets = list(link_frames(4))
    with listener() as server:
        port = server.getsockname()[1]
        with Link(f"tcp:127.0.0.1:{port}") as link:
            first, _ = server.accept()
            with first:
                first.sendall(packets[0] + packets[1][:7])  # cut off in mid-frame
                frames_until(link, 1)
            wait_for(lambda: not len(link.receive(0.01)) and "closed" in link.problem)
            link.send(requests.heartbeat())  # nobody is there
            second, _ = accept_while_receiving(server, link)
            with second:
                second.sendall(packets[2] + packets[3])
                frames_until(link, 2)
                assert link.problem == ""
                link.send(requests.heartbeat())
                second.settimeout(LIMIT_S)
                assert decoded(second.recv(1000))


def test_who_takes_each_connection_and_closes_it_is_tried_ever_later() -> None:
    with listener() as server, Link(f"tcp:127.0.0.1:{server.getsockname()[1]}") as link:
        server.setblocking(False)
        taken, until = 0, time.monotonic() + 2.0
        while time.monotonic() < until:
            link.receive(0.01)
            with contextlib.suppress(BlockingIOError):
                server.accept()[0].close()
                taken += 1
    assert 3 <= taken <= 5


def test_a_host_that_comes_back_at_another_address_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    with listener() as first, listener() as second:
        addresses = iter((first, second))
        there = (socket.AF_INET, socket.SOCK_STREAM, 0, "")
        monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: [(*there, next(addresses, second).getsockname())])
        with Link("tcp:vehicle.local:5760") as link:
            first.accept()[0].close()
            first.close()
            accept_while_receiving(second, link)[0].close()


def accept_while_receiving(server: socket.socket, link: Link) -> tuple[socket.socket, Any]:
    server.setblocking(False)
    found: list[tuple[socket.socket, Any]] = []

    def accepted() -> bool:
        link.receive(0.02)
        with contextlib.suppress(BlockingIOError):
            found.append(server.accept())
        return bool(found)

    wait_for(accepted, "the link comes back")
    found[0][0].settimeout(LIMIT_S)
    return found[0]


def test_a_tcp_peer_that_vanishes_without_a_farewell_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Power or Wi-Fi lost: only the kernel can tell, and by itself it waits for a quarter of an hour."""
    made: list[socket.socket] = []
    prepare = transports._prepare

    def remembered(end: socket.socket) -> None:
        made.append(end)
        prepare(end)

    monkeypatch.setattr(transports, "_prepare", remembered)
    with listener() as server, Link(f"tcp:127.0.0.1:{server.getsockname()[1]}"):
        assert made[0].getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE) == 1
        assert made[0].getsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE) <= 10
        assert made[0].getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) <= 15_000


def test_tcpin_waits_for_one_peer_after_the_other() -> None:
    with Link("tcpin:127.0.0.1:0") as link:
        assert "nobody" in link.problem
        for _ in range(2):
            with socket.create_connection(("127.0.0.1", link.port), timeout=LIMIT_S) as peer:
                peer.sendall(b"".join(link_frames(5)))
                frames_until(link, 5)
                link.send(requests.heartbeat())
                assert decoded(peer.recv(1000))
        with (
            socket.create_connection(("127.0.0.1", link.port), timeout=LIMIT_S),  # dead, and never says so
            socket.create_connection(("127.0.0.1", link.port), timeout=LIMIT_S) as new,
        ):
            new.sendall(b"".join(link_frames(5)))
            frames_until(link, 5)


def test_a_serial_device_may_be_unplugged_and_plugged_in_again(tmp_path: Path) -> None:
    device = tmp_path / "ttyACM0"
    with serial_cable(device) as cable:
        link = Link(f"{device}:57600")
        os.write(cable, b"".join(link_frames(5)))
        frames_until(link, 5)
        link.send(requests.heartbeat())
        assert [m.get_type() for m in decoded(os.read(cable, 1000))] == ["HEARTBEAT"]
    with link:
        wait_for(lambda: not len(link.receive(0.01)) and "has gone" in link.problem)
        link.send(requests.heartbeat())
        with serial_cable(device) as cable:
            wait_for(lambda: not len(link.receive(0.05)) and "has gone" not in link.problem)
            os.write(cable, b"".join(link_frames(5)))
            frames_until(link, 5)


def test_a_silent_line_is_not_waited_for_longer_than_was_said(tmp_path: Path) -> None:
    with serial_cable(tmp_path / "ttyACM0"), Link(f"{tmp_path}/ttyACM0") as link:
        begin = time.monotonic()
        for _ in range(40):
            link.receive(0.005)
        assert time.monotonic() - begin < 1.0


def test_a_wrong_baud_rate_is_said(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).integers(0, 256, 500, dtype=np.uint8).tobytes()
    with serial_cable(tmp_path / "ttyUSB0") as cable, Link(f"{tmp_path}/ttyUSB0:9600", patience_s=0.2) as link:
        os.write(cable, noise)
        with pytest.raises(
            InputError, match="500 bytes and not one MAVLink frame in them; 9600 baud is probably wrong"
        ):
            frames_until(link, 1)


def test_a_link_that_cannot_be_opened_says_why(tmp_path: Path, udp: Link) -> None:
    with pytest.raises(InputError, match=f"port {udp.port} is taken"):
        Link(f"udpin:127.0.0.1:{udp.port}")
    with listener() as server:
        port = server.getsockname()[1]
        with pytest.raises(InputError, match=f"port {port} is taken"):
            Link(f"tcpin:127.0.0.1:{port}")
    with pytest.raises(InputError, match=f"nothing answers at tcp:127.0.0.1:{port} \\(Connection refused\\)"):
        Link(f"tcp:127.0.0.1:{port}")
    with pytest.raises(InputError, match="use an address of this computer"):
        Link("udpin:192.0.2.1:14550")
    with pytest.raises(InputError, match="host of tcp:no-such-host.invalid:5760 cannot be found"):
        Link("tcp:no-such-host.invalid:5760")
    with pytest.raises(InputError, match="there is no device"):
        Link(f"{tmp_path}/ttyACM9")
    with serial_cable(tmp_path / "ttyACM1"), Link(f"{tmp_path}/ttyACM1"), pytest.raises(InputError, match="is taken"):
        Link(f"{tmp_path}/ttyACM1")


def test_a_silent_link_says_for_how_long(udp: Link) -> None:
    assert "nobody has sent anything yet" in udp.problem
    with udp_peer(udp.port) as peer:
        peer.send(next(link_frames(1)))
        assert ids(frames_until(udp, 1)) == [0]
        assert udp.problem == ""
        assert udp.health.last_frame is not None
        udp.health.last_frame -= 7.0
        assert udp.problem == "silent for 7 s"


def test_a_peer_that_is_no_longer_answered_has_sent_something(udp: Link, monkeypatch: pytest.MonkeyPatch) -> None:
    with udp_peer(udp.port) as peer:
        peer.send(next(link_frames(1)))
        frames_until(udp, 1)
    monkeypatch.setattr(transports, "_PEER_S", 0.0)
    udp.send(requests.heartbeat())
    assert udp.health.last_frame is not None
    udp.health.last_frame -= 40.0
    assert udp.problem == "silent for 40 s"


def test_a_listener_that_has_left_does_not_hold_up_what_is_played(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "a.tlog"
    log.write_bytes(b"".join(stamped(frame, 1_700_000_000_000_000) for frame in link_frames(5)))
    with contextlib.closing(open_port(parse_address("udpin:127.0.0.1:0"))) as port:
        with udp_peer(port.address[1]) as peer:  # type: ignore[attr-defined]
            peer.send(b"\0")
            assert port.wait(LIMIT_S)
            port.read()
        monkeypatch.setattr(transports, "_PEER_S", 0.0)
        until = time.monotonic() + 5.0
        played = play(log, port, load_dialect(), stop=lambda: time.monotonic() > until)
    assert (played.sent.total(), played.unheard) == (0, 5)


def test_noise_of_a_stranger_does_not_end_a_link_that_is_open_to_all() -> None:
    with Link("udpin:127.0.0.1:0", patience_s=0.0) as link, udp_peer(link.port) as peer:
        peer.send(bytes(500))
        wait_for(lambda: not len(link.receive(0.01)) and link.health.bytes >= 500)
        assert "bytes but no MAVLink" in link.problem
        peer.send(b"".join(link_frames(5)))
        frames_until(link, 5)
        assert not link.problem
