"""The CRC of MAVLink frames, for thousands of frames at once.

CRC-16/MCRF4XX: polynomial 0x1021 reflected (0x8408), start 0xFFFF, no final inversion, over everything after the magic
byte and then over CRC_EXTRA. Source: https://mavlink.io/en/guide/serialization.html#checksum
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Bytes = npt.NDArray[np.uint8]
Index = npt.NDArray[np.int64]

_START = 0xFFFF
_BLOCK_BYTES = 1 << 20  # gathered at a time: both the rows and their transpose stay in cache, and memory is bounded


def _advance(state: npt.NDArray[np.uint16], zero_bits: int) -> npt.NDArray[np.uint16]:
    """The CRC register after so many zero bits."""
    for _ in range(zero_bits):
        state = np.where(state & 1, (state >> 1) ^ 0x8408, state >> 1).astype(np.uint16)
    return state


_ONE_BYTE = _advance(np.arange(256, dtype=np.uint16), 8)
_TWO_BYTES = _advance(np.arange(65536, dtype=np.uint16), 16)  # 128 KiB: it lives in the second-level cache


def frame_crc(data: Bytes, first: Index, count: Index, extra: Bytes) -> npt.NDArray[np.uint16]:
    """CRC of `data[first[i] : first[i] + count[i]]` followed by `extra[i]`, for every i.

    `data` (M,) uint8, must reach one byte past the last range; `first`, `count`, `extra` (N,). Returns (N,) uint16.
    Ranges may overlap. Time is linear in the sum of `count`, memory bounded but for the result.
    """
    out = np.empty(len(first), np.uint16)
    # Frames with as many whole pairs of bytes go together: then each step is one table look-up for all of them.
    pairs = (count >> 1).astype(np.uint8 if not len(count) or int(count.max()) < 512 else np.int64)
    order = np.argsort(pairs, kind="stable")
    edges = np.flatnonzero(np.diff(pairs[order], prepend=-1, append=-1))
    for low, high in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        width = int(pairs[order[low]])
        step = max(_BLOCK_BYTES // (2 * width + 1), 1)
        for begin in range(low, high, step):
            group = order[begin : min(begin + step, high)]
            out[group] = _crc_of_group(data, first[group], width, (count[group] & 1).astype(bool), extra[group])
    return out


def _crc_of_group(
    data: Bytes, first: Index, width: int, odd: npt.NDArray[np.bool_], extra: Bytes
) -> npt.NDArray[np.uint16]:
    """CRC of frames that all have `width` pairs of bytes, `odd` ones a single byte more."""
    rows = gather(data, first, 2 * width).view("<u2")
    state = np.full(len(first), _START, np.uint16)
    # Transposed, so that each column of pairs lies contiguous in memory.
    for column in np.ascontiguousarray(rows.T):
        state = _TWO_BYTES[state ^ column]
    last = data[first + 2 * width]
    with_byte = _TWO_BYTES[state ^ (last | (extra.astype(np.uint16) << 8))]
    without = (state >> 8) ^ _ONE_BYTE[(state & 0xFF) ^ extra]
    crc: npt.NDArray[np.uint16] = np.where(odd, with_byte, without)
    return crc


def gather(data: Bytes, start: Index, size: int) -> Bytes:
    """Copy `data[start[i] : start[i] + size]` into row i: (N, size) uint8.

    Through a view of overlapping void items (stride 1): each row is one memory copy, and no index matrix is made.
    """
    if size == 0 or len(start) == 0:
        return np.empty((len(start), size), np.uint8)
    windows = np.ndarray((len(data) - size + 1,), np.dtype((np.void, size)), data.data, strides=(1,))
    return windows[start].view(np.uint8).reshape(len(start), size)
