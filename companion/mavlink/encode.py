"""Messages to MAVLink frames: one to its bytes, as a link sends it, or many as columns, as a log holds them.

With MAVLink 2 signing: https://mavlink.io/en/guide/message_signing.html
"""

from __future__ import annotations

import hashlib
import hmac
import importlib
import re
import struct
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.mavlink.crc import SLACK, Bytes, Index, crc_of, frame_crc
from companion.mavlink.dialect import DEFAULT_DIALECT, MessageLayout, load_dialect
from companion.mavlink.frames import Frames
from companion.mavlink.headers import HEADER_2, SIGNATURE_BYTES, SIGNED
from companion.mavlink.messages import Messages
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
        self._blank: dict[str, dict[str, Any]] = {}

    def pack(self, name: str, fields: Mapping[str, Value], *, version: int = 2) -> bytes:
        """A frame of message `name` ("RAW_IMU"), fields in wire units; those not named are zero.

        version: of MAVLink; 1 for firmware that knows no other.

        Raises KeyError for a message or field that the dialect does not have, struct.error for a value out of range.
        """
        kind = getattr(self._module, f"MAVLink_{name.lower()}_message", None)
        if kind is None:
            raise KeyError(f"the dialect has no message {name!r}")
        blank = self._blank.setdefault(name, _zeros(kind))
        if unknown := fields.keys() - blank.keys():
            raise KeyError(f"{name} has no field {', '.join(sorted(unknown))}; it has {', '.join(blank)}")
        if self._sender.signing.sign_outgoing:
            version = 2
            self._sender.signing.timestamp = max(self._sender.signing.timestamp, now_ticks())
        frame: bytes = bytes(kind(**(blank | dict(fields))).pack(self._sender, force_mavlink1=version == 1))
        self._sender.seq = (self._sender.seq + 1) % 256
        return frame

    def frame(self, layout: MessageLayout, payload: bytes) -> bytes:
        """An unsigned MAVLink 2 frame about a payload that is laid out already."""
        sent = payload.rstrip(b"\0") or b"\0"
        sender = self._sender
        who = sender.seq, sender.srcSystem, sender.srcComponent
        body = _FIELDS.pack(len(sent), 0, 0, *who, layout.id & 0xFFFF, layout.id >> 16) + sent
        sender.seq = (sender.seq + 1) % 256
        return b"\xfd" + body + crc_of(body + bytes((layout.crc_extra,))).to_bytes(2, "little")


def _zeros(kind: Any) -> dict[str, Any]:
    """Every field of a message class with the value zero."""
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    return {
        name: b"" if type_ == "char" else [0] * lengths[name] if lengths[name] else 0
        for name, type_ in zip(kind.fieldnames, kind.fieldtypes, strict=True)
    }


_STAMP, _HEADER, _CRC = 8, 10, 2


def make_messages(
    layout: MessageLayout,
    log_time: npt.NDArray[np.float64],
    fields: Mapping[str, Any],
    *,
    sysid: int = 1,
    compid: int = 1,
) -> Messages:
    """Messages that were not read but made: `log_time` (N,) s UNIX, `fields` name -> (N,) or scalar, in wire units.

    Values are converted as NumPy assigns them (floats to integers truncate, as autopilots do); fields not named are
    zero. `crc` is zero, `offset` counts and `seq` too: `encode(..., renumber=True)` makes them right.
    Raises KeyError for a field that the message does not have.
    """
    count = len(log_time)
    rows = np.zeros(count, layout.dtype)
    for name, values in fields.items():
        if name not in layout.fields:
            raise KeyError(f"{layout.name} has no field {name!r}; it has {', '.join(layout.fields)}")
        rows[name] = values
    return Messages(
        layout=layout,
        offset=np.arange(count, dtype=np.int64),
        log_time=np.asarray(log_time, np.float64),
        sysid=np.full(count, sysid, np.uint8),
        compid=np.full(count, compid, np.uint8),
        seq=np.arange(count).astype(np.uint8),
        crc=np.zeros(count, np.uint16),
        rows=rows,
    )


def encode(messages: Sequence[Messages], *, stamped: bool = True, renumber: bool = False) -> Bytes:
    """All messages as one stream of MAVLink 2 frames, trailing zeros trimmed, each after its time stamp if `stamped`.

    In the order of `offset`, with their `seq`; with `renumber`, in the order of `log_time` and with `seq` counted per
    sender, which is what messages of several types that were made, not read, need. A time that is NaN becomes 0.
    Returns (M,) uint8.
    """
    lead = _STAMP if stamped else 0
    packets = [_sent_length(m) + lead + _HEADER + _CRC for m in messages]
    size = np.concatenate([np.empty(0, np.int64), *packets])
    key = np.concatenate([np.empty(0), *(m.log_time if renumber else m.offset for m in messages)])
    order = np.argsort(key, kind="stable")
    position = np.empty(len(size), np.int64)
    position[order] = np.cumsum(size[order]) - size[order]
    seq = np.concatenate([np.empty(0, np.uint8), *(m.seq for m in messages)])
    if renumber:
        senders = (m.sysid.astype(np.int64) << 8 | m.compid for m in messages)
        seq[order] = _count_per_sender(np.concatenate([np.empty(0, np.int64), *senders])[order])
    out = np.zeros(int(size.sum()), np.uint8)
    begin = 0
    for m, sizes in zip(messages, packets, strict=True):
        end = begin + len(m)
        _write(out, m, position[begin:end], sizes, seq[begin:end], lead)
        begin = end
    return out


def _write(out: Bytes, m: Messages, position: Index, size: Index, seq: Bytes, lead: int) -> None:
    """Lay the packets of one type at their places in `out`, those of equal length together."""
    payloads = _payloads(m)
    stamps = np.nan_to_num(np.round(m.log_time * 1e6)).astype(">u8").view(np.uint8).reshape(len(m), _STAMP)
    for length in np.unique(size).tolist():
        chosen = np.flatnonzero(size == length)
        sent = length - lead - _HEADER - _CRC
        packets = np.zeros((len(chosen), length), np.uint8)
        frame = packets[:, lead:]
        if lead:
            packets[:, :_STAMP] = stamps[chosen]
        frame[:, 0], frame[:, 1] = 0xFD, sent
        frame[:, 4], frame[:, 5], frame[:, 6] = seq[chosen], m.sysid[chosen], m.compid[chosen]
        frame[:, 7:10] = np.frombuffer(m.layout.id.to_bytes(3, "little"), np.uint8)
        frame[:, _HEADER : _HEADER + sent] = payloads[chosen, :sent]
        first = np.arange(len(chosen), dtype=np.int64) * length + lead + 1
        count = np.full(len(chosen), _HEADER - 1 + sent, np.int64)
        extra = np.full(len(chosen), m.layout.crc_extra, np.uint8)
        crc = frame_crc(np.append(packets, np.zeros(SLACK, np.uint8)), first, count, extra)
        frame[:, -2], frame[:, -1] = crc & 0xFF, crc >> 8
        windows = np.ndarray((len(out) - length + 1,), np.dtype((np.void, length)), out.data, strides=(1,))
        windows[position[chosen]] = packets.view(windows.dtype)[:, 0]


def _payloads(m: Messages) -> Bytes:
    """(N, max_length) uint8. Raises KeyError if the rows were not read."""
    m[m.layout.fields[0]]
    return np.ascontiguousarray(m.rows).view(np.uint8).reshape(len(m), m.layout.max_length)


def _sent_length(m: Messages) -> Index:
    """Bytes of each payload without its trailing zeros; MAVLink 2 always sends at least one."""
    filled = _payloads(m)[:, ::-1] != 0
    trailing = np.where(filled.any(axis=1), filled.argmax(axis=1), m.layout.max_length - 1)
    return np.asarray(m.layout.max_length - trailing, np.int64)


def _count_per_sender(sender: Index) -> Bytes:
    """The sequence number of each packet among those of its sender, modulo 256."""
    count = np.empty(len(sender), np.int64)
    for who in np.unique(sender):
        mine = np.flatnonzero(sender == who)
        count[mine] = np.arange(len(mine))
    return count.astype(np.uint8)


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
        self._key = key
        self._last: dict[tuple[int, int, int], int] = {}  # link id and sender → time of the last signature

    def check(self, frames: Frames) -> Frames:
        """Those that pass."""
        good = np.array([self._passes(frames, i) for i in range(len(frames))], dtype=np.bool_)
        return frames if good.all() else frames.select(good)

    def _passes(self, frames: Frames, i: int) -> bool:
        start, end = int(frames.start[i]), int(frames.start[i] + frames.size[i])
        is_second = int(frames.payload[i]) - start == HEADER_2
        if not (is_second and frames.data[start + 2] & SIGNED):
            self.unsigned += 1
            return False
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
        return True
