"""Find every MAVLink frame with a right CRC in a stream of bytes, damaged or not.

What is accepted, in terms that do not depend on how the stream is cut into chunks:

1. *conforming* frames: known id, understood flags, a length the layout allows (MAVLink 1), CRC right. Where two
   overlap, the one that begins first;
2. *odd* frames: MAVLink 1 frames of any other length with a right CRC, lying wholly in a gap between those of 1.
   A gap that is exactly one time stamp is not searched.

A conforming header is so rare by chance (1 in 50,000 bytes of noise for MAVLink 1, far less for 2) that all of them are
looked at in one go, as arrays, instead of following the chain of lengths frame by frame; damage then costs nothing
extra, because nothing has to get back into step. Only gaps are walked along the chain, to name unknown ids.

Frame formats: https://mavlink.io/en/guide/serialization.html
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from companion.mavlink.crc import Bytes, Index, frame_crc, gather
from companion.mavlink.dialect import Dialect

STAMP_BYTES = 8  # a tlog has big-endian µs since 1970 before each frame
NO_STAMP = np.iinfo(np.uint64).max

_MAGIC_1, _MAGIC_2 = 0xFE, 0xFD
_HEADER_1, _HEADER_2 = 6, 10
_CRC_BYTES, _SIGNATURE_BYTES = 2, 13
_SIGNED = 0x01  # the only incompatibility flag there is; a frame with any other must not be read
_LONGEST = _HEADER_2 + 255 + _CRC_BYTES + _SIGNATURE_BYTES


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Frames with a right CRC, in stream order. All arrays have shape (N,)."""

    data: Bytes  # (M,) the bytes they lie in; at least 255 bytes follow the start of the last payload
    start: Index  # where the magic byte is in `data`
    payload: Index  # where the payload begins in `data`
    size: Index  # bytes from the magic byte to the end of CRC or signature
    length: Bytes  # bytes of payload as sent, trailing zeros trimmed by MAVLink 2
    offset: Index  # position of the magic byte in the whole stream
    stamp: npt.NDArray[np.uint64]  # the 8 bytes before the frame, µs; NO_STAMP where there are none
    id: Index
    sysid: Bytes
    compid: Bytes
    seq: Bytes
    crc: npt.NDArray[np.uint16]  # as on the wire

    def __len__(self) -> int:
        return len(self.start)


@dataclass(slots=True)
class Damage:
    """What a decoder has met besides valid frames, so far."""

    bad_crc_frames: int = 0  # conforming headers of known ids whose CRC is wrong
    skipped_bytes: int = 0  # bytes that belong to no valid frame, no stamp and no proven unknown frame
    unknown_frames: Counter[int] = field(default_factory=Counter)  # id -> frames, proven by the chain of lengths


@dataclass(frozen=True, slots=True, eq=False)
class _Headers:
    """What look like headers, sorted by start."""

    start: Index
    payload: Index
    length: Index
    end: Index
    id: Index

    def __getitem__(self, index: npt.NDArray[np.bool_] | Index) -> _Headers:
        return _Headers(self.start[index], self.payload[index], self.length[index], self.end[index], self.id[index])

    def __len__(self) -> int:
        return len(self.start)


class Decoder:
    """Bytes in, frames out; keeps an incomplete tail of at most a few hundred bytes for the next push.

    The result does not depend on how the stream is cut into pushes. `stamped`: a tlog, with a time stamp before each
    frame; otherwise the plain stream of a link.
    """

    def __init__(self, dialect: Dialect, *, stamped: bool) -> None:
        self.dialect = dialect
        self.damage = Damage()
        self.stamped = stamped
        self._stamp = STAMP_BYTES if stamped else 0
        self._carry = np.empty(0, np.uint8)
        self._base = 0  # stream position of the first byte carried over
        self._scan = 0  # stream position where the search continues
        self._last_end = 0  # ... where the last accepted frame ended
        self._chain = self._stamp  # ... where the chain of lengths expects the next frame; -1: the chain is broken
        self._pending: Counter[int] = Counter()  # unknown frames on the chain since the last accepted one...
        self._pending_bytes = 0  # ... with their stamps
        self._bad_end = 0  # end of the last frame counted as bad
        self._bad_open = (np.empty(0, np.int64), np.empty(0, np.int64))  # begin and end of bad ones that may be stamps

    def push(self, chunk: bytes | bytearray | memoryview | Bytes) -> Frames:
        """The frames that the bytes so far decide upon and that no earlier push gave."""
        return self._decode(np.frombuffer(chunk, np.uint8), final=False)

    def finish(self) -> Frames:
        """The frames left at the end of the stream; then `damage` is complete. Nothing can be pushed any more."""
        return self._decode(np.empty(0, np.uint8), final=True)

    def _decode(self, chunk: Bytes, *, final: bool) -> Frames:
        size = len(self._carry) + len(chunk)
        data = np.zeros(size + _LONGEST, np.uint8)  # zeros behind, so that every gather may reach beyond the end
        data[: len(self._carry)] = self._carry
        data[len(self._carry) : size] = chunk
        base = self._base

        conforming, odd, cut = _find_headers(data, self._scan - base, size, self.dialect)
        complete = conforming.end <= size
        if not final:
            cut = np.concatenate((cut, conforming.start[~complete]))
        conforming = conforming[complete]
        right = _crc_is_right(data, conforming, self.dialect)
        frames = _without_overlap(conforming[right])
        decided = size if final else _first_uncovered(cut, frames, size)
        frames = frames[frames.start < decided]

        # Odd frames in the gaps (rare: old or strange senders, and noise).
        previous, following = _gap_edges(self._last_end - base, frames, decided)
        gap = np.searchsorted(frames.start, odd.start, side="right")
        searched = (odd.start >= previous[gap]) & (odd.start < decided)
        searched &= (following[gap] - previous[gap] != self._stamp) | (gap == len(frames))
        searched &= (odd.end <= following[gap]) | (gap == len(frames))
        odd, open_end = odd[searched], (gap == len(frames))[searched]
        if len(odd):
            whole = odd.end <= size
            if not final:
                decided = min([decided, *odd.start[open_end & ~whole].tolist()])
            odd, open_end = odd[whole], open_end[whole]
            valid = _crc_is_right(data, odd, self.dialect)
            odd, open_end = odd[valid], open_end[valid]
            if not final:
                last = odd[open_end]
                for begin, end in zip(last.start.tolist()[::-1], last.end.tolist()[::-1], strict=True):
                    decided = begin if end > decided else decided
            odd = odd[odd.end <= decided]
            frames = _without_overlap(_merge(frames, odd))
            frames = frames[frames.start < decided]

        self._count_bad(conforming[~right & (conforming.start < decided)], frames, decided, final=final)
        self._walk_gaps(data, frames, decided)
        result = self._frames(data, frames)

        if len(frames):
            self._last_end = base + int(frames.end[-1])
        if final:
            self._end_of_stream(base + size)
        keep = max(decided - STAMP_BYTES, 0)
        self._carry, self._base, self._scan = data[keep:size].copy(), base + keep, base + decided
        return result

    def _frames(self, data: Bytes, frames: _Headers) -> Frames:
        """Read what else the headers say."""
        start, payload = frames.start, frames.payload
        first = payload - start == _HEADER_1
        # Sequence, system and component follow one another in both versions.
        sender = gather(data, np.where(first, start + 2, start + 4), 3)
        stamp = np.full(len(start), NO_STAMP, np.uint64)
        if self._stamp:
            before = np.concatenate((np.full(1, self._last_end - self._base), frames.end[:-1]))[: len(start)]
            has_stamp = start - before >= STAMP_BYTES
            stamp[has_stamp] = gather(data, start[has_stamp] - STAMP_BYTES, STAMP_BYTES).view(">u8")[:, 0]
        return Frames(
            data=data,
            start=start,
            payload=payload,
            size=frames.end - start,
            length=frames.length.astype(np.uint8),
            offset=start + self._base,
            stamp=stamp,
            id=frames.id,
            sysid=sender[:, 1].copy(),
            compid=sender[:, 2].copy(),
            seq=sender[:, 0].copy(),
            crc=_wire_crc(data, frames),
        )

    def _count_bad(self, bad: _Headers, frames: _Headers, decided: int, *, final: bool) -> None:
        """Count wrong CRCs between the accepted frames, once each; what begins in a stamp is no frame."""
        starts = np.concatenate((self._bad_open[0] - self._base, bad.start))
        ends = np.concatenate((self._bad_open[1] - self._base, bad.end))
        previous, following = _gap_edges(self._last_end - self._base, frames, decided)
        index = np.searchsorted(frames.start, starts, side="right")
        counted = (starts >= previous[index]) & (starts < following[index] - self._stamp)
        # The next frame may begin right behind what is decided: whether these lie in its stamp shows later.
        still_open = (index == len(frames)) & ~counted & (starts >= previous[-1])
        if final:
            counted |= still_open
        self._bad_open = (starts[still_open] + self._base, ends[still_open] + self._base)
        pairs = zip((starts[counted] + self._base).tolist(), (ends[counted] + self._base).tolist(), strict=True)
        for start, end in pairs:
            if start >= self._bad_end:
                self.damage.bad_crc_frames += 1
                self._bad_end = end

    def _walk_gaps(self, data: Bytes, frames: _Headers, decided: int) -> None:
        """Explain the bytes between frames: unknown ids where the chain of lengths fits exactly, else skipped."""
        previous, following = _gap_edges(self._last_end - self._base, frames, decided)
        wide = np.flatnonzero(following[:-1] - previous[:-1] != self._stamp)
        # A gap that began in an earlier push has its chain begun already.
        if len(frames) and (len(wide) == 0 or wide[0] != 0):
            self._restart_chain(0)
        for gap in wide.tolist():
            begin, end = int(previous[gap]) + self._base, int(following[gap]) + self._base
            if gap:
                self._restart_chain(begin)
            self._follow_chain(data, end)
            self._close_gap(begin, end, proven=self._chain == end)
        if len(frames):
            self._restart_chain(self._base + int(frames.end[-1]))
        self._follow_chain(data, self._base + decided)

    def _restart_chain(self, end_of_frame: int) -> None:
        self._chain = end_of_frame + self._stamp
        self._pending = Counter()
        self._pending_bytes = 0

    def _follow_chain(self, data: Bytes, limit: int) -> None:
        while 0 <= self._chain < limit:
            at = self._chain - self._base
            head = data[at : at + _HEADER_2].tobytes()
            if head[0] == _MAGIC_2 and head[2] in (0, _SIGNED):
                size = _HEADER_2 + head[1] + _CRC_BYTES + _SIGNATURE_BYTES * head[2]
                number = int.from_bytes(head[7:10], "little")
            elif head[0] == _MAGIC_1:
                size = _HEADER_1 + head[1] + _CRC_BYTES
                number = head[5]
            else:
                self._chain = -1
                return
            if number not in self.dialect.by_id:
                self._pending[number] += 1
                self._pending_bytes += size + self._stamp
            self._chain += size + self._stamp

    def _close_gap(self, begin: int, end: int, *, proven: bool) -> None:
        skipped = max(end - begin - self._stamp, 0)
        if proven:
            self.damage.unknown_frames += self._pending
            skipped -= self._pending_bytes
        self.damage.skipped_bytes += skipped

    def _end_of_stream(self, size: int) -> None:
        # As if one more frame, with its stamp, followed the end.
        self._close_gap(self._last_end, size + self._stamp, proven=self._chain == size + self._stamp)
        self._last_end = size
        self._chain = -1


def _find_headers(data: Bytes, low: int, size: int, dialect: Dialect) -> tuple[_Headers, _Headers, Index]:
    """Conforming headers and odd ones in `data[low:size]`, and where a header may begin that is cut off by the end."""
    # 0xFD + 3 and 0xFE + 3 wrap around to 0 and 1: one comparison finds both magic bytes.
    magic = np.flatnonzero((data[low:size] + np.uint8(3)) < 2) + low
    first = data[magic] == _MAGIC_1
    cut = magic[magic + np.where(first, _HEADER_1, _HEADER_2) > size]
    unknown = len(dialect.crc_extra) - 1

    start = magic[~first & (magic + _HEADER_2 <= size)]
    start = start[(data[start + 2] & ~np.uint8(_SIGNED)) == 0]
    number = (gather(data, start + 6, 4).view("<u4")[:, 0] >> 8).astype(np.int64)
    number = np.minimum(number, unknown)
    known = dialect.crc_extra[number] >= 0
    start, number = start[known], number[known]
    length = data[start + 1].astype(np.int64)
    payload = start + _HEADER_2
    end = payload + length + _CRC_BYTES + np.where(data[start + 2] & _SIGNED, _SIGNATURE_BYTES, 0)
    second = _Headers(start, payload, length, end, number)

    start = magic[first & (magic + _HEADER_1 <= size)]
    number = np.minimum(data[start + 5].astype(np.int64), unknown)
    known = dialect.crc_extra[number] >= 0
    start, number = start[known], number[known]
    length = data[start + 1].astype(np.int64)
    payload = start + _HEADER_1
    version_1 = _Headers(start, payload, length, payload + length + _CRC_BYTES, number)
    fits = (length >= dialect.min_length[number]) & (length <= dialect.max_length[number])
    return _merge(second, version_1[fits]), version_1[~fits], cut


def _wire_crc(data: Bytes, headers: _Headers) -> npt.NDArray[np.uint16]:
    at = headers.payload + headers.length
    crc: npt.NDArray[np.uint16] = data[at] | (data[at + 1].astype(np.uint16) << 8)
    return crc


def _crc_is_right(data: Bytes, headers: _Headers, dialect: Dialect) -> npt.NDArray[np.bool_]:
    first = headers.start + 1
    extra = dialect.crc_extra[headers.id].astype(np.uint8)
    crc = frame_crc(data, first, headers.payload - first + headers.length, extra)
    return np.asarray(crc == _wire_crc(data, headers))


def _merge(left: _Headers, right: _Headers) -> _Headers:
    if len(right) == 0:
        return left
    both = _Headers(
        np.concatenate((left.start, right.start)),
        np.concatenate((left.payload, right.payload)),
        np.concatenate((left.length, right.length)),
        np.concatenate((left.end, right.end)),
        np.concatenate((left.id, right.id)),
    )
    return both[np.argsort(both.start, kind="stable")]


def _without_overlap(headers: _Headers) -> _Headers:
    """Drop each that begins inside an earlier one: frames are sometimes carried in the payload of a frame."""
    if bool((headers.start[1:] >= headers.end[:-1]).all()):
        return headers
    keep, reached = [], 0
    for index, (start, end) in enumerate(zip(headers.start.tolist(), headers.end.tolist(), strict=True)):
        if start >= reached:
            keep.append(index)
            reached = end
    return headers[np.array(keep, np.int64)]


def _gap_edges(last_end: int, frames: _Headers, decided: int) -> tuple[Index, Index]:
    """Begin and end of each gap: before every frame, and after the last."""
    previous = np.concatenate((np.full(1, last_end), frames.end))
    following = np.concatenate((frames.start, np.full(1, decided)))
    return previous, following


def _first_uncovered(cut: Index, frames: _Headers, size: int) -> int:
    """The first of the unfinished headers that does not lie inside a frame: what begins there or later is undecided."""
    if len(cut) == 0:
        return size
    index = np.searchsorted(frames.start, cut, side="right")
    covered = np.concatenate((np.zeros(1, np.int64), frames.end))[index] > cut
    return int(cut[~covered].min(initial=size))
