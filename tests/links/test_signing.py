"""Signing against pymavlink's own: what it signs is let in, what we sign it lets in, and nothing else is."""

from __future__ import annotations

import hashlib
import time
from pathlib import Path
from typing import Any

import pymavlink.dialects.v20.ardupilotmega as mavlink
import pytest
from pymavlink import mavutil

from companion.links import Link, Recorder, Session, requests
from companion.mavlink import load_key
from companion.model import InputError
from tests.links.link import link_frames
from tests.links.peers import frames_until, udp_peer
from tests.waiting import wait_for

KEY = bytes(range(32))
EPOCH = 1_420_070_400


class Signer:
    """A vehicle that signs as pymavlink does."""

    def __init__(self, key: bytes = KEY, *, late_s: float = 0.0, link_id: int = 3) -> None:
        self.sender: Any = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.sender.signing.secret_key = key
        self.sender.signing.sign_outgoing = True
        self.sender.signing.link_id = link_id
        self.sender.signing.timestamp = int((time.time() - EPOCH - late_s) * 100_000)

    def heartbeat(self) -> bytes:
        packet = bytes(mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 4, 3).pack(self.sender))
        self.sender.seq = (self.sender.seq + 1) % 256
        return packet


def test_what_pymavlink_signs_is_let_in_and_nothing_else() -> None:
    with Link("udpin:127.0.0.1:0", signing_key=KEY) as link, udp_peer(link.port) as peer:
        signer = Signer()
        good = [signer.heartbeat() for _ in range(5)]
        for packet in good:
            peer.send(packet)
        assert sum(map(len, frames_until(link, 5))) == 5
        for packet in (
            good[2],  # repeated
            Signer(bytes(32)).heartbeat(),  # another key
            Signer(late_s=120.0, link_id=4).heartbeat(),  # an old recording, played by a sender not heard before
            *link_frames(3),  # not signed
            *link_frames(2, version=1),  # cannot be signed
            signer.heartbeat(),
        ):
            peer.send(packet)
        health = link.health

        def counted() -> int:
            link.receive(0.02)
            return health.frames + health.wrongly_signed + health.unsigned

        wait_for(lambda: counted() >= 14)
        assert (health.frames, health.wrongly_signed, health.unsigned) == (6, 3, 5)


def test_what_we_sign_pymavlink_lets_in() -> None:
    with Link("udpin:127.0.0.1:0", signing_key=KEY) as link, udp_peer(link.port) as peer:
        peer.send(Signer().heartbeat())
        frames_until(link, 1)
        for _ in range(3):
            link.send(requests.heartbeat())
        data = peer.heard()
    vehicle: Any = mavlink.MAVLink(None)
    vehicle.signing.secret_key = KEY
    found = vehicle.parse_buffer(data)
    assert [m.get_type() for m in found] == ["HEARTBEAT"] * 3
    assert all(m.get_signed() for m in found)
    other: Any = mavlink.MAVLink(None)
    other.signing.secret_key = bytes(32)
    other.robust_parsing = True
    assert {m.get_type() for m in other.parse_buffer(data)} == {"BAD_DATA"}


def test_what_we_sign_is_no_older_than_what_the_vehicle_signs() -> None:
    """A computer that has started without a clock, on a vehicle that has the time of GPS."""
    vehicle = Signer(late_s=-3600.0)
    with Link("udpin:127.0.0.1:0", signing_key=KEY) as link, udp_peer(link.port) as peer:
        peer.send(vehicle.heartbeat())
        frames_until(link, 1)
        link.send(requests.heartbeat())
        assert [m.get_type() for m in vehicle.sender.parse_buffer(peer.heard())] == ["HEARTBEAT"]


def test_the_recording_holds_what_was_let_in_with_its_signatures(tmp_path: Path) -> None:
    path = tmp_path / "a.tlog"
    with Link("udpin:127.0.0.1:0", signing_key=KEY) as link, udp_peer(link.port) as peer, Recorder(path) as recorder:
        session, signer = Session(link, recorder=recorder), Signer()
        for packet in (signer.heartbeat(), next(link_frames(1)), signer.heartbeat()):
            peer.send(packet)
        wait_for(lambda: session.step(0.02) is not None and recorder.size_bytes > 50)
        report = session.report()
        assert (report.frames, report.rejected) == (2, 1)
    log: Any = mavutil.mavlink_connection(str(path))
    messages = [log.recv_msg(), log.recv_msg(), log.recv_msg()]
    log.close()
    assert [m.get_header().incompat_flags for m in messages[:2]] == [1, 1]
    assert messages[2] is None


@pytest.mark.parametrize(("key", "why"), [(None, "not signed"), (bytes(32), "signed with another key")])
def test_a_link_without_one_good_signature_says_so_and_stays(key: bytes | None, why: str) -> None:
    with Link("udpin:127.0.0.1:0", signing_key=KEY, patience_s=0.1) as link, udp_peer(link.port) as peer:
        signer = Signer(key or KEY)

        def said() -> bool:
            peer.send(signer.heartbeat() if key else next(link_frames(1)))
            assert not len(link.receive(0.02))
            return why in link.problem

        wait_for(said)


def test_a_key_is_digits_or_a_passphrase(tmp_path: Path) -> None:
    path = tmp_path / "key"
    path.write_text(KEY.hex() + "\n")
    assert load_key(path) == KEY
    path.write_text("correct horse\n")
    assert load_key(path) == hashlib.sha256(b"correct horse").digest()
    path.write_text("\n")
    with pytest.raises(InputError, match="is empty: a signing key is 64 hexadecimal digits"):
        load_key(path)
    with pytest.raises(InputError, match="cannot be read"):
        load_key(tmp_path / "none")
