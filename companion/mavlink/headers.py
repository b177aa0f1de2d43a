"""What looks like a MAVLink frame: by its magic byte and CRC anywhere, or one after another on a link without damage.

Frame formats, and the CRC (CRC-16/MCRF4XX: polynomial 0x1021 reflected (0x8408), start 0xFFFF, no final inversion, over
everything after the magic byte and then over CRC_EXTRA): https://mavlink.io/en/guide/serialization.html
"""

from __future__ import annotations

import binascii
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from companion.mavlink.dialect import Dialect

Bytes = npt.NDArray[np.uint8]
Index = npt.NDArray[np.int64]

_START = 0xFFFF
_BLOCK_BYTES = 1 << 19  # gathered at a time: the rows and their transpose stay in cache, and memory is bounded
_BUCKET = 8  # pairs of bytes by which frames that are gathered together may differ in length

_SLACK = 2 * _BUCKET
"""Bytes that must follow the last range given to `_frame_crc`."""


def _advance(state: npt.NDArray[np.uint16], zero_bits: int) -> npt.NDArray[np.uint16]:
    """The CRC register after so many zero bits."""
    for _ in range(zero_bits):
        state = np.where(state & 1, (state >> 1) ^ 0x8408, state >> 1).astype(np.uint16)
    return state


_ONE_BYTE = _advance(np.arange(256, dtype=np.uint16), 8)
_TWO_BYTES = _advance(np.arange(65536, dtype=np.uint16), 16)  # 128 KiB: it lives in the second-level cache
_MAKES_A_CRC = np.zeros(65536, bool)  # which differences of two CRCs one last byte can make
_MAKES_A_CRC[_ONE_BYTE] = True
_MIRRORED = np.packbits(np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1, bitorder="little")).tobytes()


def crc_of(covered: bytes) -> int:
    """The CRC of one frame (`_frame_crc` is for thousands): of all behind its magic byte, and of its CRC_EXTRA.

    CRC-16/MCRF4XX is CRC-16/CCITT of mirrored bytes, itself mirrored.
    """
    mirrored = binascii.crc_hqx(covered.translate(_MIRRORED), 0xFFFF)
    return _MIRRORED[mirrored & 0xFF] << 8 | _MIRRORED[mirrored >> 8]


def _frame_crc(data: Bytes, headers: Headers, extra: Bytes) -> npt.NDArray[np.uint16]:
    """CRC (N,) of what follows each magic byte, up to the end of the payload, and of its CRC_EXTRA (N,).

    `data` (M,) uint8 with SLACK bytes behind the last payload. Frames may overlap. Time is linear in the sum of their
    lengths, memory bounded but for a few bytes per frame.
    """
    first = headers.start + 1
    count = headers.payload - first + headers.length
    # Sorted by length, so that in each step those that are not yet at their end lie side by side.
    pairs = (count >> 1).astype(np.uint16)
    order = np.argsort(pairs, kind="stable")
    pairs, first, odd, extra = pairs[order], first[order], (count[order] & 1).astype(bool), extra[order]
    state = np.full(len(first), _START, np.uint16)
    buckets = np.flatnonzero(np.diff(pairs // _BUCKET, prepend=-1, append=-1)).tolist()
    for low, high in pairwise(buckets):
        step = max(_BLOCK_BYTES // (2 * int(pairs[high - 1]) + 1), 1)
        for begin in range(low, high, step):
            block = slice(begin, min(begin + step, high))
            _take_pairs(state[block], data, first[block], pairs[block])
    # Then an odd byte together with the extra one, or the extra one alone.
    last = data[first + 2 * pairs.astype(np.int64)]
    with_byte = _TWO_BYTES[state ^ (last | (extra.astype(np.uint16) << 8))]
    without = (state >> 8) ^ _ONE_BYTE[(state & 0xFF) ^ extra]
    crc = np.empty_like(state)
    crc[order] = np.where(odd, with_byte, without)
    return crc


def _take_pairs(state: npt.NDArray[np.uint16], data: Bytes, first: Index, pairs: npt.NDArray[np.uint16]) -> None:
    """Advance each register in `state` by so many pairs of bytes; `pairs` ascends."""
    width = int(pairs[-1])
    # Transposed, so that each column of pairs lies contiguous in memory.
    columns = np.ascontiguousarray(gather(data, first, 2 * width).view("<u2").T)
    unfinished = np.searchsorted(pairs, np.arange(width), side="right").tolist()
    for column, begin in zip(columns, unfinished, strict=True):
        # "clip" because every 16-bit index is in the table: NumPy then looks up without a check, and in place.
        _TWO_BYTES.take(state[begin:] ^ column[begin:], out=state[begin:], mode="clip")


def gather(data: Bytes, start: Index, size: int) -> Bytes:
    """Copy `data[start[i] : start[i] + size]` into row i: (N, size) uint8.

    Through a view of overlapping void items (stride 1): each row is one memory copy, and no index matrix is made.
    """
    if size == 0 or len(start) == 0:
        return np.empty((len(start), size), np.uint8)
    windows = np.ndarray((len(data) - size + 1,), np.dtype((np.void, size)), data.data, strides=(1,))
    return windows[start].view(np.uint8).reshape(len(start), size)


MAGIC_1, MAGIC_2 = 0xFE, 0xFD
HEADER_1, HEADER_2 = 6, 10
CRC_BYTES, SIGNATURE_BYTES = 2, 13
SIGNED = 0x01  # the only incompatibility flag there is; a frame with any other must not be read
_MOST_WIDE = 64  # gaps that are no stamp, in a chunk
LONGEST = HEADER_2 + 255 + CRC_BYTES + SIGNATURE_BYTES


@dataclass(frozen=True, slots=True, eq=False)
class Headers:
    """What look like headers, sorted by start."""

    start: Index
    payload: Index
    length: Index
    end: Index
    id: Index

    def __getitem__(self, index: npt.NDArray[np.bool_] | Index | slice) -> Headers:
        if isinstance(index, np.ndarray) and index.dtype == np.bool_:
            count = int(np.count_nonzero(index))
            # Mostly all of them, or all but those at the end that the end of the data cuts off: nothing is copied then.
            index = slice(count) if index[:count].all() else np.flatnonzero(index)
        return Headers(self.start[index], self.payload[index], self.length[index], self.end[index], self.id[index])

    def __len__(self) -> int:
        return len(self.start)


def find_headers_2(data: Bytes, low: int, size: int, dialect: Dialect) -> tuple[Headers, Index]:
    """Conforming headers of MAVLink 2 in `data[low:size]` (known id, understood flags), and where unknown ids begin.

    They may reach beyond `size`; those whose header itself does are left to `cut_headers`.
    """
    start = np.flatnonzero(data[low : max(size - HEADER_2 + 1, low)] == MAGIC_2) + low
    start = start[data[start + 2] <= SIGNED]
    number = _number_2(data, start)
    known = _is_known(number, dialect)
    others = start[:0]
    if not known.all():
        others, start, number = start[~known], start[known], number[known]
    return _version_2(data, start, number), others


def all_places_1(data: Bytes, low: int, size: int) -> Index:
    """Where a header of MAVLink 1 may begin in `data[low:size]`."""
    return np.flatnonzero(data[low : max(size - HEADER_1 + 1, low)] == MAGIC_1) + low


def places_between(data: Bytes, low: int, size: int, taken: Headers, stamp: int) -> Index | None:
    """Those that do not lie inside frames of MAVLink 2; None where there are so many gaps that all may be looked at.

    A sixth of the bytes of a log without damage are stamps, and the rest is `taken`. stamp: bytes of one.
    """
    stop = max(size - HEADER_1 + 1, low)
    begin = np.concatenate((np.full(1, low), taken.end))
    end = np.concatenate((taken.start, np.full(1, stop)))
    narrow = end - begin == stamp
    wide = np.flatnonzero(~narrow)
    if not stamp or len(wide) > _MOST_WIDE:
        return None
    begin_narrow = begin[narrow]
    hit = np.flatnonzero(gather(data, begin_narrow, stamp).ravel() == MAGIC_1)
    places = [begin_narrow[hit // stamp] + hit % stamp]
    places += [np.flatnonzero(data[a:b] == MAGIC_1) + a for a, b in zip(begin[wide], end[wide], strict=True)]
    return np.sort(np.concatenate(places))


def strange_headers(data: Bytes, start: Index, dialect: Dialect) -> tuple[Headers, Headers]:
    """Of what begins at `start`: MAVLink 1 headers of a known id with a length it cannot have, and unknown ids."""
    is_first = data[start] == MAGIC_1
    start_1 = start[is_first]
    first = _version_1(data, start_1[~_conforms_1(data, start_1, dialect)])
    known = _is_known(first.id, dialect)
    second = start[~is_first]
    return first[known], merge(_version_2(data, second, _number_2(data, second)), first[~known])


def cut_headers(data: Bytes, low: int, size: int) -> Index:
    """Where a header may begin that the end of the data cuts off."""
    tail = np.arange(max(size - HEADER_2 + 1, low), size)
    magic = data[tail]
    cut: Index = tail[(magic == MAGIC_2) | ((magic == MAGIC_1) & (tail > size - HEADER_1))]
    return cut


def _version_1(data: Bytes, start: Index) -> Headers:
    length = data[start + 1].astype(np.int64)
    payload = start + HEADER_1
    return Headers(start, payload, length, payload + length + CRC_BYTES, data[start + 5].astype(np.int64))


def _number_2(data: Bytes, start: Index) -> Index:
    """The message ids of what begins there, if they are headers of MAVLink 2: bytes 7 to 9."""
    return np.asarray((gather(data, start + 6, 4).view("<u4")[:, 0] >> 8).astype(np.int64))


def _version_2(data: Bytes, start: Index, number: Index) -> Headers:
    length = data[start + 1].astype(np.int64)
    payload = start + HEADER_2
    end = payload + length + (CRC_BYTES + SIGNATURE_BYTES * data[start + 2].astype(np.int64))
    return Headers(start, payload, length, end, number)


def _is_known(number: Index, dialect: Dialect) -> npt.NDArray[np.bool_]:
    return np.asarray(dialect.crc_extra[np.minimum(number, len(dialect.crc_extra) - 1)] >= 0)


def _conforms_1(data: Bytes, start: Index, dialect: Dialect) -> npt.NDArray[np.bool_]:
    """Whether what begins there has a known id and a length of its layout, if it is a header of MAVLink 1.

    Most of what begins with the right byte is no header: so little is looked at before that is known.
    """
    return np.asarray(dialect.conforms_1[data[start + 5].astype(np.uint16) << 8 | data[start + 1]])


def wire_crc(data: Bytes, headers: Headers) -> npt.NDArray[np.uint16]:
    at = headers.payload + headers.length
    crc: npt.NDArray[np.uint16] = data[at] | (data[at + 1].astype(np.uint16) << 8)
    return crc


def sift(data: Bytes, headers: Headers, size: int, dialect: Dialect) -> tuple[Headers, Headers, Index]:
    """Frames with a right CRC, those with a wrong one, and where those begin that the end of the data cuts off."""
    complete = headers.end <= size
    whole = headers[complete]
    right = crc_is_right(data, whole, dialect)
    return whole[right], whole[~right], headers.start[~complete]


def sift_1(data: Bytes, places: Index, size: int, dialect: Dialect) -> tuple[Headers, Headers, Index]:
    """The same of the conforming headers of MAVLink 1 at those places: known id, a length of the layout."""
    return sift(data, _version_1(data, places[_conforms_1(data, places, dialect)]), size, dialect)


def crc_is_right(data: Bytes, headers: Headers, dialect: Dialect) -> npt.NDArray[np.bool_]:
    crc = _frame_crc(data, headers, dialect.crc_extra[headers.id].astype(np.uint8))
    return np.asarray(crc == wire_crc(data, headers))


def crc_may_be_right(data: Bytes, headers: Headers) -> npt.NDArray[np.bool_]:
    """For unknown ids, whose CRC_EXTRA is unknown too: whether there is one with which the CRC is right.

    That is true of any intact frame, and of 1 in 256 others. CRCs are linear, so what a last byte does to one does not
    depend on the bytes before.
    """
    without = _frame_crc(data, headers, np.zeros(len(headers), np.uint8))
    return np.asarray(_MAKES_A_CRC[without ^ wire_crc(data, headers)])


def merge(left: Headers, right: Headers) -> Headers:
    if len(left) == 0 or len(right) == 0:
        return left if len(left) else right
    names = (one.name for one in fields(Headers))
    both = Headers(*(np.concatenate((getattr(left, name), getattr(right, name))) for name in names))
    return both[np.argsort(both.start, kind="stable")]


def without_overlap(headers: Headers) -> Headers:
    """Drop each that begins inside an earlier one: frames are sometimes carried in the payload of a frame."""
    keep = first_come(headers.start, headers.end)
    return headers if keep.all() else headers[keep]


def gap_edges(last_end: int, frames: Headers, decided: int) -> tuple[Index, Index]:
    """Begin and end of each gap: before every frame, and after the last."""
    previous = np.concatenate((np.full(1, last_end), frames.end))
    following = np.concatenate((frames.start, np.full(1, decided)))
    return previous, following


def first_uncovered(cut: Index, frames: Headers, size: int) -> int:
    """The first of the unfinished headers that does not lie inside a frame: what begins there or later is undecided."""
    if len(cut) == 0:
        return size
    index = np.searchsorted(frames.start, cut, side="right")
    covered = np.concatenate((np.zeros(1, np.int64), frames.end))[index] > cut
    return int(cut[~covered].min(initial=size))


def first_come(start: Index, end: Index) -> npt.NDArray[np.bool_]:
    """Mask (N,) of the spans `[start, end)`, sorted by start, that do not begin inside an earlier one of the mask."""
    keep = np.ones(len(start), bool)
    if not (start[1:] < end[:-1]).any():
        return keep
    inside = start[1:] < np.maximum.accumulate(end)[:-1]
    involved = np.zeros(len(start), bool)
    involved[1:] |= inside
    involved[:-1] |= inside  # whatever overlaps, and the span before it; the rest is never looked at one by one
    reached = 0
    index = np.flatnonzero(involved)
    for at, begin, stop in zip(index.tolist(), start[index].tolist(), end[index].tolist(), strict=True):
        if begin < reached:
            keep[at] = False
        else:
            reached = stop
    return keep


CHAIN_BYTES = 8192
"""Bytes that are followed frame by frame: as arrays they would take longer."""


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
