"""The CRC of MAVLink frames: of thousands at once, and of one.

CRC-16/MCRF4XX: polynomial 0x1021 reflected (0x8408), start 0xFFFF, no final inversion, over everything after the magic
byte and then over CRC_EXTRA. Source: https://mavlink.io/en/guide/serialization.html#checksum
"""

from __future__ import annotations

import binascii
from itertools import pairwise

import numpy as np
import numpy.typing as npt

Bytes = npt.NDArray[np.uint8]
Index = npt.NDArray[np.int64]

_START = 0xFFFF
_BLOCK_BYTES = 1 << 19  # gathered at a time: the rows and their transpose stay in cache, and memory is bounded
_BUCKET = 8  # pairs of bytes by which frames that are gathered together may differ in length

SLACK = 2 * _BUCKET
"""Bytes that must follow the last range given to `frame_crc`."""


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
    """The CRC of one frame (`frame_crc` is for thousands): of all behind its magic byte, and of its CRC_EXTRA.

    CRC-16/MCRF4XX is CRC-16/CCITT of mirrored bytes, itself mirrored.
    """
    mirrored = binascii.crc_hqx(covered.translate(_MIRRORED), 0xFFFF)
    return _MIRRORED[mirrored & 0xFF] << 8 | _MIRRORED[mirrored >> 8]


def frame_crc(data: Bytes, first: Index, count: Index, extra: Bytes) -> npt.NDArray[np.uint16]:
    """CRC of `data[first[i] : first[i] + count[i]]` followed by `extra[i]`, for every i.

    `data` (M,) uint8 with SLACK bytes behind the last range; `first`, `count`, `extra` (N,). Returns (N,) uint16.
    Ranges may overlap. Time is linear in the sum of `count`, memory bounded but for a few bytes per range.
    """
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


def fits_some_extra(data: Bytes, first: Index, count: Index, crc: npt.NDArray[np.uint16]) -> npt.NDArray[np.bool_]:
    """Whether there is a CRC_EXTRA with which `crc` is right: true of any intact frame, of 1 in 256 others.

    Arguments as of `frame_crc`. CRCs are linear, so what a last byte does to one does not depend on the bytes before.
    """
    without = frame_crc(data, first, count, np.zeros(len(first), np.uint8))
    return np.asarray(_MAKES_A_CRC[without ^ crc])


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
