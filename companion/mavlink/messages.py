"""The messages of one type as columns, gathered from frames."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.mavlink.dialect import Dialect, MessageLayout
from companion.mavlink.frames import Frames
from companion.mavlink.headers import Bytes, Index, gather

LATEST_STAMP = 1 << 52  # µs: the year 2112. A larger stamp is damage
_BLOCK_BYTES = 1 << 20
_A_FEW = 16  # rows that are gone through one by one


@dataclass(frozen=True, slots=True, eq=False)
class Messages:
    """All frames of one message type, in file order. Values are exactly those on the wire: no scaling, no SI."""

    layout: MessageLayout
    offset: Index  # (N,) position of the frame in the file: the order across message types
    log_time: npt.NDArray[np.float64]  # (N,) s UNIX, exact to the µs; NaN where the log has no believable stamp
    sysid: Bytes  # (N,) uint8
    compid: Bytes  # (N,) uint8
    seq: Bytes  # (N,) uint8
    crc: npt.NDArray[np.uint16]  # (N,) as on the wire: equal crc, seq and sender means a byte-identical frame
    rows: npt.NDArray[np.void]  # (N,) of layout.dtype; empty if this type was not requested
    sender_s: npt.NDArray[np.float64] | None = None  # (N,) s, the sender's own clock, where it has been read already

    @property
    def name(self) -> str:
        return self.layout.name

    def __len__(self) -> int:
        return len(self.offset)

    def __getitem__(self, field: str) -> npt.NDArray[Any]:
        """The column of a field, (N,) or (N, K) for arrays, in the wire's type: a view, not a copy.

        Raises KeyError if the message has no such field or the rows were not read.
        """
        if field not in self.layout.fields:
            raise KeyError(f"{self.name} has no field {field!r}; it has {', '.join(self.layout.fields)}")
        if len(self.rows) != len(self):
            raise KeyError(f"the fields of {self.name} were not read: add it to `names`")
        column: npt.NDArray[Any] = self.rows[field]
        return column

    @property
    def t(self) -> npt.NDArray[np.float64]:
        """The time of each by the sender's clock, (N,) s: of its sample, where told. Raises KeyError where not read."""
        if self.sender_s is None:
            raise KeyError(f"the times of {self.name} were not read")
        return self.sender_s

    def senders(self) -> dict[tuple[int, int], int]:
        """How many were sent by each (sysid, compid), in order of those."""
        if not len(self) or ((self.sysid == self.sysid[0]).all() and (self.compid == self.compid[0]).all()):
            return {(int(self.sysid[0]), int(self.compid[0])): len(self)} if len(self) else {}
        counts = np.bincount(self.sysid.astype(np.uint16) << 8 | self.compid)
        return {(key >> 8, key & 255): int(counts[key]) for key in np.flatnonzero(counts).tolist()}

    def sent_by(self, sysid: int, compid: int) -> Messages:
        """Those of one sender."""
        return self.select((self.sysid == sysid) & (self.compid == compid))

    def select(self, index: npt.NDArray[np.bool_] | npt.NDArray[np.integer[Any]] | slice) -> Messages:
        """Those of a mask, an index or a slice."""
        if isinstance(index, np.ndarray) and index.dtype == np.bool_:
            if index.all():
                return self  # most logs have one sender of each type
            index = np.flatnonzero(index)
        columns = {name: getattr(self, name)[index] for name in _HEADER}
        if len(self.rows) == len(self):
            columns["rows"] = as_bytes(self.rows)[index].view(self.layout.dtype)
        if self.sender_s is not None:
            columns["sender_s"] = self.sender_s[index]
        return replace(self, **columns)

    def columns(self, *names: str) -> npt.NDArray[np.float64]:
        """Fields side by side, (N, len(names))."""
        return np.stack([self[name] for name in names], axis=1, dtype=np.float64, casting="unsafe")


class Growing:
    """The messages of one type as they come, in arrays with room for more. with_rows: whether those are gathered.

    What has been given out shares its memory with what is here, and never changes. Memory that is never written is
    never used, so that where it is known how many will come nothing is copied a second time.
    """

    def __init__(self, layout: MessageLayout, *, with_rows: bool) -> None:
        self.layout = layout
        self._columns: dict[str, npt.NDArray[Any]] = {name: np.empty(0, kind) for name, kind in _HEADER.items()}
        if with_rows:
            self._columns["rows"] = np.empty((0, layout.max_length), np.uint8)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def add(self, frames: Frames, index: Index, times: npt.NDArray[np.float64], share: float = 0.0) -> None:
        """Take those of an index; times: (N,) s of all frames. share: of what will come, 0 where it is not known."""
        begin, end = self._count, self._count + len(index)
        if end > len(self._columns["offset"]):
            expected = end / share * _MARGIN if share > 0 else 0.0
            room = int(max(_LEAST_ROOM, 2 * end if end > expected else expected))
            for name, old in self._columns.items():
                self._columns[name] = np.empty((room, *old.shape[1:]), old.dtype)
                self._columns[name][:begin] = old[:begin]
        for name in _HEADER:
            values = times if name == "log_time" else getattr(frames, name)
            # "clip", for every index is one: NumPy then writes in place.
            np.take(values, index, out=self._columns[name][begin:end], mode="clip")
        if "rows" in self._columns:
            _gather_rows(frames, index, self._columns["rows"][begin:end])
        self._count = end

    def messages(self) -> Messages:
        """All that have come, and were kept."""
        columns = {name: column[: self._count] for name, column in self._columns.items()}
        rows = columns.pop("rows", None)
        kind = self.layout.dtype
        return Messages(self.layout, **columns, rows=np.empty(0, kind) if rows is None else rows.view(kind)[:, 0])

    def keep(self, index: npt.NDArray[np.bool_] | Index) -> None:
        """Forget all but those of a mask or an index."""
        self._columns = {name: column[: self._count][index] for name, column in self._columns.items()}
        self._count = len(self._columns["offset"])


_HEADER: dict[str, npt.DTypeLike] = {
    "offset": np.int64, "log_time": np.float64, "sysid": np.uint8, "compid": np.uint8, "seq": np.uint8,
    "crc": np.uint16,
}  # fmt: skip
_MARGIN, _LEAST_ROOM = 1.05, 64  # of the messages that are expected, and messages


class Collected:
    """Frames as they come, by message type in order of appearance. names: whose rows are gathered (None: of all)."""

    def __init__(self, dialect: Dialect, names: Collection[str] | None) -> None:
        self.types: dict[str, Growing] = {}
        self._dialect = dialect
        self._names = names

    def add(self, frames: Frames, share: float = 0.0) -> npt.NDArray[np.float64]:
        """Take over what `frames` hold; their bytes are not kept. Returns when each was logged, (N,) s UNIX or NaN.

        share: of what will come, 0 where it is not known.
        """
        times = log_time(frames.stamp)
        for layout, index in _grouped(frames, self._dialect):
            if layout.name not in self.types:
                with_rows = self._names is None or layout.name in self._names
                self.types[layout.name] = Growing(layout, with_rows=with_rows)
            self.types[layout.name].add(frames, index, times, share)
        return times

    def messages(self) -> dict[str, Messages]:
        """Everything by message name."""
        return {name: one.messages() for name, one in self.types.items()}


def as_bytes(rows: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """Rows as plain items of bytes: NumPy copies those whole, but structured ones field by field, ten times slower."""
    return rows.view(np.dtype((np.void, rows.dtype.itemsize)))


def together(receipts: Sequence[tuple[Frames, float]]) -> Frames:
    """Frames that were received one after the other as one, stamped with when each was: pairs with s UNIX, one or more.

    What is made of frames costs by the call: of those of a twentieth of a second less than half.
    """
    if len(receipts) == 1:
        frames, received = receipts[0]
        return replace(frames, stamp=np.full(len(frames), round(received * 1e6), np.uint64))
    pieces = [frames for frames, _ in receipts]
    shift = np.cumsum([0, *(len(piece.data) for piece in pieces[:-1])])
    columns = {
        one.name: np.concatenate([getattr(piece, one.name) for piece in pieces])
        for one in fields(Frames)
        if one.name not in ("start", "payload", "stamp")
    }
    return Frames(
        **columns,
        start=np.concatenate([piece.start + by for piece, by in zip(pieces, shift, strict=True)]),
        payload=np.concatenate([piece.payload + by for piece, by in zip(pieces, shift, strict=True)]),
        stamp=np.repeat(np.array([round(t * 1e6) for _, t in receipts], np.uint64), [len(p) for p in pieces]),
    )


def split_messages(frames: Frames, dialect: Dialect, names: Collection[str] | None = None) -> dict[str, Messages]:
    """Frames as columns per message type. `names`: the types whose rows are gathered (None: all)."""
    times = log_time(frames.stamp)
    known: dict[str, npt.NDArray[Any]] = {n: times if n == "log_time" else getattr(frames, n) for n in _HEADER}
    by_name = {}
    for layout, index in _grouped(frames, dialect):
        columns = {name: column[index] for name, column in known.items()}
        needed = names is None or layout.name in names
        rows = np.empty((len(index) if needed else 0, layout.max_length), np.uint8)
        if needed:
            _gather_rows(frames, index, rows)
        by_name[layout.name] = Messages(layout, **columns, rows=rows.view(layout.dtype)[:, 0])
    return by_name


def _grouped(frames: Frames, dialect: Dialect) -> Iterator[tuple[MessageLayout, Index]]:
    """Each message type among the frames, and the indices of its frames in stream order; ids that are known alone."""
    if len(frames) == 0:
        return
    number = frames.id
    if int(number.max()) < 1 << 16:
        number = number.astype(np.uint16)  # NumPy sorts 16-bit integers by radix
    order = np.argsort(number, kind="stable")
    ordered = number[order]
    for index in np.split(order, np.flatnonzero(ordered[1:] != ordered[:-1]) + 1):
        layout = dialect.by_id.get(int(number[index[0]]))
        if layout is not None:
            yield layout, index


def _gather_rows(frames: Frames, index: Index, rows: Bytes) -> None:
    """Write payloads of `frames[index]`, all of one type, into rows (K, longest payload of the type).

    Zeros that MAVLink 2 trimmed off, and extension fields that MAVLink 1 lacks, are zero; bytes that a newer dialect
    added behind are dropped.
    """
    width = rows.shape[1]
    step = max(_BLOCK_BYTES // width, 1)
    for begin in range(0, len(index), step):
        block = index[begin : begin + step]
        sent = frames.length[block]
        raw = gather(frames.data, frames.payload[block], width)
        _clear_behind(raw, sent)
        rows[begin : begin + step] = raw


def _clear_behind(raw: Bytes, sent: Bytes) -> None:
    """Zero what lies behind each payload in its row: its CRC and the next frame.

    Length by length, for there are few: a mask of all bytes would take three times as long. Of a link row by row.
    """
    width = raw.shape[1]
    if len(raw) <= _A_FEW:
        for row, length in zip(raw, sent.tolist(), strict=True):
            row[length:] = 0
        return
    short = np.flatnonzero(sent < width)
    lengths = sent[short]
    for length in np.flatnonzero(np.bincount(lengths, minlength=1)).tolist():
        raw[short[lengths == length], length:] = 0


def log_time(stamp: npt.NDArray[np.uint64]) -> npt.NDArray[np.float64]:
    """Stamps in µs as seconds; NaN where there is none or where it cannot be a time."""
    return np.where(stamp < LATEST_STAMP, stamp / 1e6, np.nan)
