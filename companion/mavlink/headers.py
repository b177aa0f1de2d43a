"""What looks like a MAVLink frame: headers found by their magic bytes, and which of them have a right CRC.

Frame formats: https://mavlink.io/en/guide/serialization.html
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from companion.mavlink.crc import Bytes, Index, frame_crc, gather
from companion.mavlink.dialect import Dialect

MAGIC_1, MAGIC_2 = 0xFE, 0xFD
HEADER_1, HEADER_2 = 6, 10
CRC_BYTES, SIGNATURE_BYTES = 2, 13
SIGNED = 0x01  # the only incompatibility flag there is; a frame with any other must not be read
LONGEST = HEADER_2 + 255 + CRC_BYTES + SIGNATURE_BYTES


@dataclass(frozen=True, slots=True, eq=False)
class Headers:
    """What look like headers, sorted by start."""

    start: Index
    payload: Index
    length: Index
    end: Index
    id: Index

    def __getitem__(self, index: npt.NDArray[np.bool_] | Index) -> Headers:
        return Headers(self.start[index], self.payload[index], self.length[index], self.end[index], self.id[index])

    def __len__(self) -> int:
        return len(self.start)


def find_headers(data: Bytes, low: int, size: int, dialect: Dialect) -> tuple[Headers, Headers, Index]:
    """Conforming headers and odd ones in `data[low:size]`, and where a header may begin that is cut off by the end."""
    # 0xFD + 3 and 0xFE + 3 wrap around to 0 and 1: one comparison finds both magic bytes.
    magic = np.flatnonzero((data[low:size] + np.uint8(3)) < 2) + low
    first = data[magic] == MAGIC_1
    cut = magic[magic + np.where(first, HEADER_1, HEADER_2) > size]
    unknown = len(dialect.crc_extra) - 1

    start = magic[~first & (magic + HEADER_2 <= size)]
    start = start[(data[start + 2] & ~np.uint8(SIGNED)) == 0]
    number = (gather(data, start + 6, 4).view("<u4")[:, 0] >> 8).astype(np.int64)
    number = np.minimum(number, unknown)
    known = dialect.crc_extra[number] >= 0
    start, number = start[known], number[known]
    length = data[start + 1].astype(np.int64)
    payload = start + HEADER_2
    end = payload + length + CRC_BYTES + np.where(data[start + 2] & SIGNED, SIGNATURE_BYTES, 0)
    second = Headers(start, payload, length, end, number)

    start = magic[first & (magic + HEADER_1 <= size)]
    number = np.minimum(data[start + 5].astype(np.int64), unknown)
    known = dialect.crc_extra[number] >= 0
    start, number = start[known], number[known]
    length = data[start + 1].astype(np.int64)
    payload = start + HEADER_1
    version_1 = Headers(start, payload, length, payload + length + CRC_BYTES, number)
    fits = (length >= dialect.min_length[number]) & (length <= dialect.max_length[number])
    return merge(second, version_1[fits]), version_1[~fits], cut


def wire_crc(data: Bytes, headers: Headers) -> npt.NDArray[np.uint16]:
    at = headers.payload + headers.length
    crc: npt.NDArray[np.uint16] = data[at] | (data[at + 1].astype(np.uint16) << 8)
    return crc


def crc_is_right(data: Bytes, headers: Headers, dialect: Dialect) -> npt.NDArray[np.bool_]:
    first = headers.start + 1
    extra = dialect.crc_extra[headers.id].astype(np.uint8)
    crc = frame_crc(data, first, headers.payload - first + headers.length, extra)
    return np.asarray(crc == wire_crc(data, headers))


def merge(left: Headers, right: Headers) -> Headers:
    if len(right) == 0:
        return left
    both = Headers(
        np.concatenate((left.start, right.start)),
        np.concatenate((left.payload, right.payload)),
        np.concatenate((left.length, right.length)),
        np.concatenate((left.end, right.end)),
        np.concatenate((left.id, right.id)),
    )
    return both[np.argsort(both.start, kind="stable")]


def without_overlap(headers: Headers) -> Headers:
    """Drop each that begins inside an earlier one: frames are sometimes carried in the payload of a frame."""
    if bool((headers.start[1:] >= headers.end[:-1]).all()):
        return headers
    keep, reached = [], 0
    for index, (start, end) in enumerate(zip(headers.start.tolist(), headers.end.tolist(), strict=True)):
        if start >= reached:
            keep.append(index)
            reached = end
    return headers[np.array(keep, np.int64)]
