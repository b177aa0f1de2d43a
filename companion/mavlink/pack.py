"""One message to the bytes of one frame: what a link and a simulated vehicle send."""

from __future__ import annotations

import binascii
import importlib
import struct
from collections.abc import Mapping
from typing import Any

from companion.mavlink.dialect import DEFAULT_DIALECT, MessageLayout, load_dialect
from companion.mavlink.signing import now_ticks

Value = int | float | bytes

_HEADER = struct.Struct("<BBBBBBHB")  # after the magic byte; the id has three bytes
_MIRRORED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


class Packer:
    """Packs the messages of one sender and counts their sequence.

    signing_key: 32 bytes; frames are signed with it, which only MAVLink 2 can be.
    """

    def __init__(
        self, sysid: int, compid: int, *, dialect: str = DEFAULT_DIALECT, signing_key: bytes | None = None
    ) -> None:
        load_dialect(dialect)  # says which dialects there are
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
        body = (
            _HEADER.pack(
                len(sent), 0, 0, sender.seq, sender.srcSystem, sender.srcComponent, layout.id & 0xFFFF, layout.id >> 16
            )
            + sent
        )
        sender.seq = (sender.seq + 1) % 256
        return b"\xfd" + body + _crc(body + bytes((layout.crc_extra,))).to_bytes(2, "little")


def _crc(data: bytes) -> int:
    """CRC-16/MCRF4XX, the mirror image of the CRC-16 in the standard library: every byte and the result reversed."""
    mirrored = binascii.crc_hqx(data.translate(_MIRRORED), 0xFFFF)
    return _MIRRORED[mirrored & 0xFF] << 8 | _MIRRORED[mirrored >> 8]


def _zeros(kind: Any) -> dict[str, Any]:
    """Every field of a message class with the value zero."""
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    return {
        name: b"" if type_ == "char" else [0] * lengths[name] if lengths[name] else 0
        for name, type_ in zip(kind.fieldnames, kind.fieldtypes, strict=True)
    }
