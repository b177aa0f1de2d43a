"""Messages to MAVLink frames, as a link sends them, with MAVLink 2 signing:
https://mavlink.io/en/guide/message_signing.html
"""

from __future__ import annotations

import hashlib
import hmac
import importlib
import re
import struct
import time
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.mavlink.dialect import DEFAULT_DIALECT, MessageLayout, load_dialect
from companion.mavlink.frames import Frames
from companion.mavlink.headers import HEADER_2, SIGNATURE_BYTES, SIGNED, crc_of
from companion.model import InputError

Value = int | float | bytes

_FIELDS = struct.Struct("<BBBBBBHB")  # after the magic byte; the id has three bytes


class Packer:
    """Packs the messages of one sender and counts their sequence.

    signing_key: 32 bytes; frames are signed with it, which only MAVLink 2 can be.
    """

    def __init__(
        self, sysid: int, compid: int, *, dialect: str = DEFAULT_DIALECT, signing_key: bytes | None = None
    ) -> None:
        load_dialect(dialect)  # raises for an unknown one
        self._module: Any = importlib.import_module(f"pymavlink.dialects.v20.{dialect}")
        self._sender: Any = self._module.MAVLink(None, srcSystem=sysid, srcComponent=compid)
        if signing_key is not None:
            self._sender.signing.secret_key = signing_key
            self._sender.signing.sign_outgoing = True
            self._sender.signing.timestamp = now_ticks()

    def pack(self, name: str, fields: Mapping[str, Value], *, version: int = 2) -> bytes:
        """A frame of message `name` ("RAW_IMU"), fields in wire units; those not named are zero.

        version: of MAVLink; 1 for firmware that knows no other.

        Raises KeyError for a message or field that the dialect does not have, struct.error for a value out of range.
        """
        kind = getattr(self._module, f"MAVLink_{name.lower()}_message", None)
        if kind is None:
            raise KeyError(f"the dialect has no message {name!r}")
        blank = _zeros(kind)
        if unknown := fields.keys() - blank.keys():
            raise KeyError(f"{name} has no field {', '.join(sorted(unknown))}; it has {', '.join(blank)}")
        if self._sender.signing.sign_outgoing:
            version = 2
            self._sender.signing.timestamp = max(self._sender.signing.timestamp, now_ticks())
        frame: bytes = bytes(kind(**(blank | dict(fields))).pack(self._sender, force_mavlink1=version == 1))
        self._sender.seq = (self._sender.seq + 1) % 256
        return frame

    def sign_after(self, ticks: int) -> None:
        """Sign later than that whatever the clock says: a receiver drops what is a minute behind."""
        self._sender.signing.timestamp = max(self._sender.signing.timestamp, ticks)

    def frame(self, layout: MessageLayout, payload: bytes) -> bytes:
        """An unsigned MAVLink 2 frame about a payload that is laid out already."""
        sent = payload.rstrip(b"\0") or b"\0"
        sender = self._sender
        who = sender.seq, sender.srcSystem, sender.srcComponent
        body = _FIELDS.pack(len(sent), 0, 0, *who, layout.id & 0xFFFF, layout.id >> 16) + sent
        sender.seq = (sender.seq + 1) % 256
        return b"\xfd" + body + crc_of(body + bytes((layout.crc_extra,))).to_bytes(2, "little")


@cache
def _zeros(kind: Any) -> dict[str, Any]:
    """Every field of a message class with the value zero."""
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    return {
        name: b"" if type_ == "char" else [0] * lengths[name] if lengths[name] else 0
        for name, type_ in zip(kind.fieldnames, kind.fieldtypes, strict=True)
    }


_EPOCH = 1_420_070_400  # s UNIX: signing's clock counts 10 µs from 1 January 2015
_TICKS_S = 100_000
_STALE = 60 * _TICKS_S  # a new sender may be a minute behind


def load_key(path: str | Path) -> bytes:
    """The 32 bytes of a key: 64 hexadecimal digits, or else a passphrase, of which SHA-256 is the key.

    A passphrase as MAVProxy's `signing setup` and QGroundControl take it. Raises InputError for a file that cannot be
    read or is empty.
    """
    try:
        text = Path(path).read_bytes().strip()
    except OSError as error:
        raise InputError(f"{path}: the signing key cannot be read ({error.strerror}).") from None
    if not text:
        raise InputError(f"{path} is empty: a signing key is 64 hexadecimal digits, or a passphrase.")
    return bytes.fromhex(text.decode()) if re.fullmatch(rb"[0-9a-fA-F]{64}", text) else hashlib.sha256(text).digest()


def now_ticks() -> int:
    """The time as signatures carry it."""
    return int((time.time() - _EPOCH) * _TICKS_S)


def is_signed(frames: Frames) -> npt.NDArray[np.bool_]:
    """Which frames carry a signature, right or not: (N,)."""
    second = frames.payload - frames.start == HEADER_2
    return np.asarray(second & (frames.data[frames.start + 2] & SIGNED != 0))


class Verifier:
    """Passes frames that are signed with the key, and newer than those that their sender signed before."""

    def __init__(self, key: bytes) -> None:
        self.unsigned = 0  # frames dropped because they carry no signature
        self.wrong = 0  # ... because it is not of our key, or is repeated
        self.newest = 0  # time of the newest signature that is right
        self._key = key
        self._last: dict[tuple[int, int, int], int] = {}  # link id and sender → time of the last signature

    def check(self, frames: Frames) -> Frames:
        """Those that pass."""
        good = is_signed(frames)
        self.unsigned += int((~good).sum())
        for i in np.flatnonzero(good).tolist():
            good[i] = self._is_right(frames, i)
        return frames if good.all() else frames.select(good)

    def _is_right(self, frames: Frames, i: int) -> bool:
        start, end = int(frames.start[i]), int(frames.start[i] + frames.size[i])
        signature = frames.data[end - SIGNATURE_BYTES : end].tobytes()
        signed = frames.data[start : end - 6].tobytes()
        right = hashlib.sha256(self._key + signed).digest()[:6]
        ticks = int.from_bytes(signature[1:7], "little")
        sender = (signature[0], int(frames.sysid[i]), int(frames.compid[i]))
        oldest = self._last.get(sender, now_ticks() - _STALE)
        if not hmac.compare_digest(right, signature[7:]) or ticks <= oldest:
            self.wrong += 1
            return False
        self._last[sender] = ticks
        self.newest = max(self.newest, ticks)
        return True
