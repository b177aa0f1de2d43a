"""A link to vehicles: bytes in, frames out by the same decoder as logs; out goes only what `requests` allows."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from companion.links.requests import ANNOUNCEMENT, ForbiddenMessageError, Request
from companion.links.transports import Address, Port, SerialPort, TcpPort, UdpPort, parse_address
from companion.mavlink import (
    DEFAULT_DIALECT,
    HEADER_1,
    Damage,
    Decoder,
    Frames,
    Packer,
    Verifier,
    is_signed,
    load_dialect,
)
from companion.model import InputError

DEFAULT_SYSID, DEFAULT_COMPID = 240, 191
"""Own ids: a system of its own, as MAV_COMP_ID_ONBOARD_COMPUTER. Never 255: ArduPilot takes that for its GCS."""

_GATHER_S = 0.02  # between two readings: one decoding for what arrives in between (SITL sends in bursts)
_NOISE_BYTES = 200
_OPEN = ("udpin", "udpout", "tcpin")  # anybody can send to these: noise of a stranger is not the vehicle's silence
_MOST_SENDERS = 256  # whose frames are counted where twice as many speak: those that said the most
_LATELY_S = 10.0  # over which it is counted what is lost
_REMEMBER_S, _REMEMBERED = 1.0, 60  # how often what is lost is noted, and how many notes are kept


@dataclass(slots=True)
class LinkHealth:
    """What a link has carried so far. Times are `time.monotonic()`."""

    bytes: int = 0
    frames: int = 0
    received: dict[tuple[int, int], int] = field(default_factory=dict)  # (sysid, compid) → frames
    lost: dict[tuple[int, int], int] = field(default_factory=dict)  # ... → frames missing by sequence
    signers: set[tuple[int, int]] = field(default_factory=set)  # ... that sign, where no key is set
    sent: dict[str, int] = field(default_factory=dict)  # message name → how many the companion has sent
    first_byte: float | None = None
    last_frame: float | None = None
    damage: Damage = field(default_factory=Damage)
    unsigned: int = 0  # frames dropped because they carry no signature, where a key is set
    wrongly_signed: int = 0  # ... because theirs is not of our key, or is repeated


class Link:
    """Frames from vehicles, and requests to them. Survives whatever the peer does; see `transports`.

    address: see `parse_address`. listen_only: nothing is ever sent. sysid, compid: who the companion is.
    patience_s: how long bytes without one frame in them are put up with. signing_key: 32 bytes; what is sent is signed
    with it, and what is not is dropped and counted.

    Raises InputError when the link cannot be opened, SettingsError for an unknown dialect.
    """

    def __init__(
        self,
        address: str,
        *,
        dialect: str = DEFAULT_DIALECT,
        listen_only: bool = False,
        sysid: int = DEFAULT_SYSID,
        compid: int = DEFAULT_COMPID,
        patience_s: float = 5.0,
        signing_key: bytes | None = None,
    ) -> None:
        self.address = parse_address(address)
        self.dialect = load_dialect(dialect)
        self.listen_only = listen_only
        self.announces = False  # whether words for people at ground stations may be sent
        self.sysid = sysid
        self.health = LinkHealth()
        if listen_only and self.address.kind == "udpout":
            raise InputError(f"{address} hears nothing unless it speaks first: use udpin: or leave --listen-only away.")
        self._compid, self._signing_key = compid, signing_key
        self._packers: dict[int, Packer] = {}  # system id as which the companion speaks → with a sequence of its own
        self._verifier = Verifier(signing_key) if signing_key is not None else None
        self._decoder = Decoder(self.dialect, stamped=False, unknown=True)
        self.health.damage = self._decoder.damage
        self._modern = False  # whether MAVLink 2 has been received
        self._patience_s = patience_s
        self._read_at = 0.0  # s of `time.monotonic()`, the last time
        self._sequence: dict[tuple[int, int], tuple[int, int]] = {}  # last, and how far it is behind the highest
        self._shares: dict[tuple[int, int], tuple[float, int, int, float]] = {}  # s when, lost, received by then, share
        self._counted: dict[tuple[int, int], deque[tuple[float, int]]] = {}  # s when, and how many were lost by then
        self._port = open_port(self.address)

    @property
    def port(self) -> int:
        """The own port number of a network link, e.g. the one that was found for port 0."""
        return int(self._port.address[1]) if isinstance(self._port, UdpPort | TcpPort) else 0

    @property
    def problem(self) -> str:
        """Why nothing is received at present, in words; "" while frames arrive."""
        if self._port.problem:
            return self._port.problem
        health, now = self.health, time.monotonic()
        if health.last_frame is None and health.wrongly_signed:
            return f"{health.wrongly_signed} frames are signed with another key than ours"
        if health.last_frame is None and health.unsigned:
            return f"{health.unsigned} frames are not signed: the vehicle does not sign, or has no key"
        if health.last_frame is None:
            return f"bytes but no MAVLink: {self._advice}" if health.first_byte is not None else "nothing received yet"
        quiet = now - health.last_frame
        return f"silent for {quiet:.0f} s" if quiet > 2.0 else ""

    def receive(self, timeout_s: float = 0.1, gather_s: float = _GATHER_S) -> Frames:
        """The frames of the next moment: waits for the first byte, `timeout_s` at most, and takes what comes with it.

        gather_s: the least time from one reading to the next, because what is made of frames costs by the call.

        Raises InputError when bytes come and not one frame from a device or a server: a wrong baud rate, no MAVLink.
        """
        data = b""
        if self._port.wait(timeout_s):
            time.sleep(max(self._read_at + gather_s - time.monotonic(), 0.0))
            self._read_at = time.monotonic()
            data = self._port.read()
        health = self.health
        frames = self._decoder.push(data)
        if self._verifier is not None and len(frames):
            frames = self._verifier.check(frames)
            health.unsigned, health.wrongly_signed = self._verifier.unsigned, self._verifier.wrong
        if data:
            now = time.monotonic()
            health.bytes += len(data)
            health.first_byte = health.first_byte if health.first_byte is not None else now
            if len(frames):
                health.frames += len(frames)
                health.last_frame = now
                self._count_lost(frames)
                self._modern = self._modern or bool((frames.payload - frames.start != HEADER_1).any())
                if self._verifier is None:
                    signed = is_signed(frames)
                    health.signers.update(
                        zip(frames.sysid[signed].tolist(), frames.compid[signed].tolist(), strict=True)
                    )
        self._check_speech()
        return frames

    def send(self, request: Request, *, aboard: int | None = None) -> None:
        """Send a request; nothing when the link only listens. As MAVLink 1 to who speaks nothing else.

        aboard: the system id of a vehicle, to speak as a component of it: of words for people alone, which ground
        stations show only of the vehicle's own system (QGroundControl `Vehicle::_mavlinkMessageReceived`, MAVProxy
        `message_is_from_primary_vehicle`).

        A heartbeat goes out as MAVLink 2 too, for ArduPilot and PX4 begin with 1 and change over when they hear 2.
        """
        if self.listen_only:
            return
        if request.name == ANNOUNCEMENT and not self.announces:
            raise ForbiddenMessageError(f"companion sends {ANNOUNCEMENT} only where it was asked to announce")
        if aboard is not None and request.name != ANNOUNCEMENT:
            raise ForbiddenMessageError(f"companion sends {request.name} as itself")
        own = self.sysid if aboard is None else aboard
        if own not in self._packers:
            self._packers[own] = Packer(own, self._compid, dialect=self.dialect.name, signing_key=self._signing_key)
        if self._verifier is not None:
            self._packers[own].sign_after(self._verifier.newest)
        modern = self._modern or not self.health.frames
        for version in (2,) if modern else (1, 2) if request.name == "HEARTBEAT" else (1,):
            self._port.write(self._packers[own].pack(request.name, request.fields, version=version))
        self.health.sent[request.name] = self.health.sent.get(request.name, 0) + 1

    def lost_lately(self, sender: tuple[int, int]) -> float:
        """The share of a sender's frames that was lost in the last ten seconds, 0 to 1."""
        now, lost = time.monotonic(), self.health.lost.get(sender, 0)
        when, lost_then, received_then, share = self._shares.get(sender, (0.0, 0, 0, 0.0))
        if now - when > _LATELY_S:
            missing, came = lost - lost_then, self.health.received.get(sender, 0) - received_then
            share = max(missing, 0) / max(missing + came, 1)
            self._shares[sender] = (now, lost, received_then + came, share)
        return share

    def restarted(self, sender: tuple[int, int], when: float) -> None:
        """A vehicle has rebooted, s of `time.monotonic()`: its sequence began anew, which is no loss."""
        counted = [lost for t, lost in self._counted.pop(sender, ()) if t <= when]
        if sender in self.health.lost:
            before = self.health.lost[sender] = counted[-1] if counted else 0
            if before:
                self._counted[sender] = deque([(when, before)], maxlen=_REMEMBERED)
        self._sequence.pop(sender, None)

    def close(self) -> None:
        """Give the port back."""
        self._port.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _check_speech(self) -> None:
        health = self.health
        if health.frames or health.first_byte is None or health.bytes < _NOISE_BYTES:
            return
        if health.unsigned or health.wrongly_signed:
            return  # it is MAVLink: `problem` says what is wrong with it
        if time.monotonic() - health.first_byte < self._patience_s or self.address.kind in _OPEN:
            return
        raise InputError(f"{self.address}: {health.bytes} bytes and not one MAVLink frame in them; {self._advice}.")

    @property
    def _advice(self) -> str:
        """What to do where bytes come and not one frame."""
        advice = "check that MAVLink is spoken there"
        if self.address.kind == "serial":
            return f"{self.address.baud} baud is probably wrong (57600, 115200, 921600 are usual), or {advice}"
        damage = self.health.damage
        return "try another --dialect" if damage.unknown_frames or damage.bad_crc_frames else advice

    def _count_lost(self, frames: Frames) -> None:
        """Gaps in the sequence of each sender. One that comes late fills its gap; a copy fills none."""
        sender = frames.sysid.astype(np.int64) << 8 | frames.compid
        for who in np.unique(sender).tolist() if (sender != sender[0]).any() else sender[:1].tolist():
            ids = (who >> 8, who & 255)
            seq = frames.seq[sender == who].astype(np.int64)
            before, behind = self._sequence.get(ids, (int(seq[0]) - 1, 0))
            step = (np.diff(seq, prepend=before) + 128) % 256 - 128
            place = np.cumsum(step) - behind  # against the highest so far
            ahead = max(int(place.max()), 0)
            missing = ahead - int((step != 0).sum())
            self.health.lost[ids] = max(self.health.lost.get(ids, 0) + missing, 0)
            self.health.received[ids] = self.health.received.get(ids, 0) + len(seq)
            self._remember_lost(ids)
            self._sequence[ids] = (int(seq[-1]), ahead - int(place[-1]))
        received = self.health.received
        if len(received) > 2 * _MOST_SENDERS:
            for ids in sorted(received, key=received.__getitem__)[:-_MOST_SENDERS]:
                for counts in (received, self.health.lost, self._sequence, self._counted):
                    counts.pop(ids, None)

    def _remember_lost(self, ids: tuple[int, int]) -> None:
        """A reboot is known some seconds after the sequence has begun anew: then the count goes back.

        Of who has lost nothing there is nothing to remember: a sender may make up 65,025 names.
        """
        lost, past = self.health.lost[ids], self._counted.get(ids)
        if past is None:
            if not lost:
                return
            past = self._counted[ids] = deque(maxlen=_REMEMBERED)
        now = time.monotonic()
        if not past or (now - past[-1][0] >= _REMEMBER_S and past[-1][1] != lost):
            past.append((now, lost))


def open_port(address: Address) -> Port:
    """Open the bytes under a link. Raises InputError when that cannot be done: what is wrong and what to do."""
    if address.kind == "serial":
        return SerialPort(address)
    return UdpPort(address) if address.kind in ("udpin", "udpout") else TcpPort(address)
