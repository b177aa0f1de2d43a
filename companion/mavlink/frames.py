"""Find every MAVLink frame with a right CRC in a stream of bytes, damaged or not.

Accepted frames, whatever way the stream is cut into chunks:

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
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np
import numpy.typing as npt

from companion.mavlink import headers
from companion.mavlink.dialect import Dialect
from companion.mavlink.headers import Bytes, Headers, Index, gather

STAMP_BYTES = 8  # a tlog has big-endian µs since 1970 before each frame
NO_STAMP = np.iinfo(np.uint64).max
_MOST_UNKNOWN = 1024  # ids that are counted where twice as many come: those with the most frames


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

    def select(self, index: npt.NDArray[np.bool_]) -> Frames:
        """Those of a mask."""
        names = (one.name for one in fields(Frames) if one.name != "data")
        return replace(self, **{name: getattr(self, name)[index] for name in names})


@dataclass(slots=True)
class Damage:
    """What a decoder has met besides valid frames, so far."""

    bad_crc_frames: int = 0  # conforming headers of known ids whose CRC is wrong
    skipped_bytes: int = 0  # bytes that belong to no valid frame, no stamp and no proven unknown frame
    unknown_frames: Counter[int] = field(default_factory=Counter)  # id -> frames, proven by the chain of lengths


class Decoder:
    """Bytes in, frames out; keeps an incomplete tail of at most a few hundred bytes for the next push.

    The result does not depend on how the stream is cut into pushes. `stamped`: a tlog, with a time stamp before each
    frame; otherwise the plain stream of a link. unknown: give frames of ids that the dialect lacks too.
    """

    def __init__(self, dialect: Dialect, *, stamped: bool, unknown: bool = False) -> None:
        self.dialect = dialect
        self.damage = Damage()
        self.stamped = stamped
        self._unknown = unknown
        self._met: list[int] = []  # stream positions of the unknown frames on the chain, this push
        self._stamp = STAMP_BYTES if stamped else 0
        self._carry = np.empty(0, np.uint8)
        self._base = 0  # stream position of the first byte carried over
        self._scan = 0  # stream position where the search continues
        self._last_end = 0  # ... where the last accepted frame ended
        self._chain = self._stamp  # ... where the chain of lengths expects the next frame; -1: the chain is broken
        self._pending: Counter[int] = Counter()  # ids of unknown frames on the chain since the last accepted one...
        self._pending_bytes = 0  # ... with their stamps
        self._bad_end = 0  # end of the last frame counted as bad
        self._gap_bad = 0  # wrong CRCs in the present gap, wherever they begin...
        self._chain_bad = 0  # ... and where the chain leads: the others lie inside frames, if the chain holds
        self._bad_open = (np.empty(0, np.int64), np.empty(0, np.int64))  # begin and end of bad ones that may be stamps

    def push(self, chunk: bytes | bytearray | memoryview | Bytes) -> Frames:
        """The frames that the bytes so far decide upon and that no earlier push gave."""
        new = np.frombuffer(chunk, np.uint8)
        chain = self._chain_of(new)
        return self._decode(new, final=False) if chain is None else chain

    def finish(self) -> Frames:
        """The frames left at the end of the stream; then `damage` is complete. Nothing can be pushed any more."""
        return self._decode(np.empty(0, np.uint8), final=True)

    def decode(self, chunks: Iterable[bytes]) -> Iterator[Frames]:
        """The frames of a whole stream."""
        for chunk in chunks:
            yield self.push(chunk)
        yield self.finish()

    def _chain_of(self, chunk: Bytes) -> Frames | None:
        """What `_decode` would give of a few frames without damage, twenty times as fast; None of anything else.

        Nothing lies between them, so there is nothing to search: where two overlap, the one that begins first is meant.
        """
        in_step = self._chain == self._scan == self._last_end
        if self._stamp or not in_step or len(self._carry) + len(chunk) > headers.CHAIN_BYTES:
            return None
        data, size = self._joined(chunk)
        frames = headers.chain_of(data[:size].tobytes(), self._scan - self._base, self.dialect)
        if frames is None:
            return None
        result = self._frames(data, frames)
        if len(frames):
            self._last_end = self._base + int(frames.end[-1])
            self._restart_chain(self._last_end)
        self._keep(data[:size], self._last_end - self._base)
        return result

    def _joined(self, chunk: Bytes) -> tuple[Bytes, int]:
        """What was carried over and the new bytes, how many, and zeros: every gather may reach beyond the end."""
        carried = len(self._carry)
        size = carried + len(chunk)
        data = np.zeros(size + headers.LONGEST, np.uint8)
        data[:carried], data[carried:size] = self._carry, chunk
        return data, size

    def _keep(self, data: Bytes, decided: int) -> None:
        """Carry over what is not decided, and the stamp before it."""
        keep = max(decided - STAMP_BYTES, 0)
        self._carry, self._scan = data[keep:].copy(), self._base + decided
        self._base += keep

    def _decode(self, chunk: Bytes, *, final: bool) -> Frames:
        data, size = self._joined(chunk)
        base = self._base

        low = self._scan - base
        second, others = headers.find_headers_2(data, low, size, self.dialect)
        good, bad, cut = headers.sift(data, second, size, self.dialect)
        # What begins inside a frame of MAVLink 2 loses to it, unless that one loses to what began before it.
        places = headers.places_between(data, low, size, headers.without_overlap(good), self._stamp)
        if places is not None:
            good_1, bad_1, cut_1 = headers.sift_1(data, places, size, self.dialect)
        if places is None or len(good_1):
            places = headers.all_places_1(data, low, size)
            good_1, bad_1, cut_1 = headers.sift_1(data, places, size, self.dialect)
        others = np.concatenate((places, others))
        cut = np.concatenate((headers.cut_headers(data, low, size), cut, cut_1))
        frames = headers.without_overlap(headers.merge(good, good_1))
        decided = size if final else headers.first_uncovered(cut, frames, size)
        frames = frames[: int(np.searchsorted(frames.start, decided))]
        frames, unknown, decided = self._search_gaps(data, others, frames, decided, size, final=final)

        wrong = headers.merge(bad, bad_1)
        wrong = wrong[wrong.start < decided]
        counts = self._count_bad(wrong, frames, decided, final=final)
        self._met.clear()
        self._walk_gaps(data, frames, unknown, decided, counts, frozenset((wrong.start + base).tolist()))
        given = headers.merge(frames, unknown[np.isin(unknown.start + base, self._met)]) if self._unknown else frames
        result = self._frames(data, given)

        if len(frames):
            self._last_end = base + int(frames.end[-1])
        if final:  # as if one more frame, with its stamp, followed the end
            end = base + size
            self._close_gap(self._last_end, end + self._stamp, proven=self._chain == end + self._stamp)
            self._last_end, self._chain = end, -1
        self._keep(data[:size], decided)
        return result

    def _search_gaps(
        self, data: Bytes, others: Index, frames: Headers, decided: int, size: int, *, final: bool
    ) -> tuple[Headers, Headers, int]:
        """Add odd frames in the gaps (rare: old or strange senders, and noise).

        Returns the frames with them, intact frames of unknown ids, and how far everything is decided.
        """
        previous, following = headers.gap_edges(self._last_end - self._base, frames, decided)
        searched = following - previous != self._stamp
        searched[-1] = True  # the last gap is still open
        others = np.sort(others[others >= previous[np.argmax(searched)]])  # none lies before the first gap
        gap = np.searchsorted(frames.start, others, side="right")
        inside = searched[gap] & (others >= previous[gap]) & (others < following[gap])
        odd, unknown = headers.strange_headers(data, others[inside], self.dialect)

        def whole(places: Headers) -> tuple[Headers, int]:
            gap = np.searchsorted(frames.start, places.start, side="right")
            is_open = gap == len(frames)
            inside = places.end <= np.where(is_open, size, following[gap])
            return places[inside], int(places.start[is_open & ~inside].min(initial=size))

        odd, cut_odd = whole(odd)
        unknown, cut_unknown = whole(unknown)
        odd = odd[headers.crc_is_right(data, odd, self.dialect)]
        unknown = unknown[headers.crc_may_be_right(data, unknown)]
        if not final:
            decided = min(decided, cut_odd, cut_unknown)
            for begin, end in zip(odd.start.tolist()[::-1], odd.end.tolist()[::-1], strict=True):
                decided = begin if begin < decided < end else decided
        if len(odd):
            frames = headers.without_overlap(headers.merge(frames, odd[odd.end <= decided]))
        return frames[: int(np.searchsorted(frames.start, decided))], unknown, decided

    def _frames(self, data: Bytes, frames: Headers) -> Frames:
        """Read the other fields of the headers."""
        start, payload = frames.start, frames.payload
        first = payload - start == headers.HEADER_1
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
            crc=headers.wire_crc(data, frames),
        )

    def _count_bad(self, bad: Headers, frames: Headers, decided: int, *, final: bool) -> list[int]:
        """Count wrong CRCs in each gap between the accepted frames, once each; what begins in a stamp is no frame."""
        starts = np.concatenate((self._bad_open[0] - self._base, bad.start))
        ends = np.concatenate((self._bad_open[1] - self._base, bad.end))
        previous, following = headers.gap_edges(self._last_end - self._base, frames, decided)
        index = np.searchsorted(frames.start, starts, side="right")
        counted = (starts >= previous[index]) & (starts < following[index] - self._stamp)
        # The next frame may begin right behind what is decided: whether these lie in its stamp shows later.
        still_open = (index == len(frames)) & ~counted & (starts >= previous[-1])
        if final:
            counted |= still_open
        self._bad_open = (starts[still_open] + self._base, ends[still_open] + self._base)
        counts = [0] * (len(frames) + 1)
        spans = (starts[counted] + self._base, ends[counted] + self._base, index[counted])
        for start, end, gap in zip(*(column.tolist() for column in spans), strict=True):
            if start >= self._bad_end:
                counts[gap] += 1
                self._bad_end = end
        return counts

    def _walk_gaps(
        self, data: Bytes, frames: Headers, unknown: Headers, decided: int, bad: list[int], wrong: frozenset[int]
    ) -> None:
        """Explain the bytes between frames: unknown ids where the chain of lengths fits exactly, else skipped.

        bad: wrong CRCs in each gap; wrong: stream positions of all of them.
        """
        intact = dict(zip((unknown.start + self._base).tolist(), unknown.id.tolist(), strict=True))
        previous, following = headers.gap_edges(self._last_end - self._base, frames, decided)
        wide = np.flatnonzero(following[:-1] - previous[:-1] != self._stamp)
        for gap in wide.tolist():
            begin, end = int(previous[gap]) + self._base, int(following[gap]) + self._base
            if gap:  # the first gap began in an earlier push, and with it its chain
                self._restart_chain(begin)
            self._follow_chain(data, end, intact, wrong)
            self._gap_bad += bad[gap]
            self._close_gap(begin, end, proven=self._chain == end)
        if len(frames):
            self._restart_chain(self._base + int(frames.end[-1]))
        self._follow_chain(data, self._base + decided, intact, wrong)
        self._gap_bad += bad[-1]

    def _restart_chain(self, end_of_frame: int) -> None:
        self._chain = end_of_frame + self._stamp
        self._pending.clear()
        self._pending_bytes = self._gap_bad = self._chain_bad = 0

    def _follow_chain(self, data: Bytes, limit: int, intact: Mapping[int, int], wrong: frozenset[int]) -> None:
        """Go from header to header up to `limit`. `intact`: stream position -> id of intact unknown frames."""
        while 0 <= self._chain < limit:
            at = self._chain - self._base
            magic, length, flags = data[at : at + 3].tolist()
            if magic == headers.MAGIC_2 and flags in (0, headers.SIGNED):
                size = headers.HEADER_2 + length + headers.CRC_BYTES + headers.SIGNATURE_BYTES * flags
            elif magic == headers.MAGIC_1:
                size = headers.HEADER_1 + length + headers.CRC_BYTES
            else:
                self._chain = -1
                return
            if self._chain in intact:
                self._met.append(self._chain)
                self._pending[intact[self._chain]] += 1
                _prune(self._pending)
                self._pending_bytes += size + self._stamp
            self._chain_bad += self._chain in wrong
            self._chain += size + self._stamp

    def _close_gap(self, begin: int, end: int, *, proven: bool) -> None:
        skipped = max(end - begin - self._stamp, 0)
        if proven:
            self.damage.unknown_frames.update(self._pending)
            _prune(self.damage.unknown_frames)
            skipped -= self._pending_bytes
        self.damage.bad_crc_frames += self._chain_bad if proven else self._gap_bad
        self.damage.skipped_bytes += skipped


def _prune(counts: Counter[int]) -> None:
    """A stranger may make up 16 million ids."""
    if len(counts) > 2 * _MOST_UNKNOWN:
        for number, _ in counts.most_common()[_MOST_UNKNOWN:]:
            del counts[number]
