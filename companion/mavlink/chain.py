"""What a link without damage sends: whole frames of known ids, one behind the other."""

from __future__ import annotations

import binascii

import numpy as np

from companion.mavlink.dialect import Dialect
from companion.mavlink.headers import (
    CRC_BYTES,
    HEADER_1,
    HEADER_2,
    MAGIC_1,
    MAGIC_2,
    SIGNATURE_BYTES,
    SIGNED,
    Headers,
)

MOST = 4096
"""Bytes that are followed frame by frame: as arrays they would take longer."""

_MIRRORED = np.packbits(np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1, bitorder="little")).tobytes()


def crc_of(covered: bytes) -> int:
    """The CRC of one frame (`frame_crc` is for thousands): of all behind its magic byte, and of its CRC_EXTRA.

    CRC-16/MCRF4XX is CRC-16/CCITT of mirrored bytes, itself mirrored.
    """
    mirrored = binascii.crc_hqx(covered.translate(_MIRRORED), 0xFFFF)
    return _MIRRORED[mirrored & 0xFF] << 8 | _MIRRORED[mirrored >> 8]


def chain_of(data: bytes, first: int, dialect: Dialect) -> Headers | None:
    """The frames that follow one another from `data[first:]` on, of which the end may cut off the last.

    None where there is anything else: what that is, is not decided here.
    """
    rows: list[tuple[int, int, int, int, int]] = []
    at, size = first, len(data)
    while at < size:
        magic, head = data[at], data[at : at + HEADER_2]
        if magic not in (MAGIC_1, MAGIC_2):
            return None
        needed = HEADER_1 if magic == MAGIC_1 else HEADER_2
        if len(head) < needed:
            break
        length = head[1]
        if magic == MAGIC_1:
            number, tail = head[5], CRC_BYTES
            conforms = bool(dialect.conforms_1[number << 8 | length])
        else:
            number, tail = int.from_bytes(head[7:10], "little"), CRC_BYTES + SIGNATURE_BYTES * head[2]
            conforms = head[2] <= SIGNED and number in dialect.by_id
        if not conforms:
            return None
        payload = at + needed
        crc, end = payload + length, payload + length + tail
        if end > size:
            break
        covered = data[at + 1 : crc] + bytes((int(dialect.crc_extra[number]),))
        if crc_of(covered) != data[crc] | data[crc + 1] << 8:
            return None
        rows.append((at, payload, length, end, number))
        at = end
    return Headers(*np.array(rows, np.int64).reshape(-1, 5).T.copy())
