"""Read PX4's on-board logs (ULog, .ulg) as columns, by the definitions that each log carries itself.

There is no checksum, and each message says alone where the next begins. Nearly all are data, and of those the size,
the type and the number must fit one another: five bytes that no other place has by chance. So places that look like
data are looked for in the whole file, and one is taken if another begins exactly behind it. From the end of such a run
to the next, the messages are followed one by one. Where that does not lead to the next run the file is damaged, and the
search goes on for two messages, one behind the other, whose content fits their type.
Source: https://docs.px4.io/main/en/dev_log/ulog_file_format.html, and PX4 `src/modules/logger`.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from companion.logs.logfile import MOST_BYTES, Contents, LogFile, Mapped, log_format, read_head
from companion.logs.ulog_messages import (
    DATA,
    MESSAGE_TYPES,
    Dropout,
    Flags,
    Format,
    Info,
    LoggedText,
    Message,
    Parameter,
    Subscription,
    Unsubscription,
    Value,
    parsed_message,
)
from companion.logs.ulog_topics import HEADER_BYTES, Collector, UlogTopic
from companion.mavlink import Bytes, Index, first_come, gather
from companion.model import InputError

_HEADER = struct.Struct("<HB")
_NUMBER = struct.Struct("<H")
_FIRST_BYTES, _MOST_BYTES = 1 << 14, 1 << 20  # of a block: topics that begin late are then few, and it stays in cache
_FIRST_STEP, _MOST_STEP = 1 << 8, 1 << 18  # of the search for where the messages go on
_DATA_HEADER = np.dtype([("size", "<u2"), ("type", "u1"), ("number", "<u2")])
_FORMAT, _SEMICOLON = ord("F"), ord(";")
_LEAST, _MOST = np.full(256, 65_535, np.int64), np.zeros(256, np.int64)
_FIRST = np.ones((256, 256), np.bool_)  # type, first byte of the body → whether that can be
for _type, _can in MESSAGE_TYPES.items():
    _LEAST[_type], _MOST[_type] = _can.least, _can.most
    _FIRST[_type] = np.isin(np.arange(256), list(_can.first))


_DEFINING = (Format, Subscription, Unsubscription)  # tuples: of a union isinstance() takes three times as long
_AFTER_DEFINITIONS = (Subscription, LoggedText)


class _Scan:
    """Goes through a file, hands its data to the collector, and keeps what else it says."""

    def __init__(self, data: Bytes, collector: Collector) -> None:
        # The latest time of all data before it, µs, None for what stands before all data; and what it says.
        self.other_messages: list[tuple[int | None, Message]] = []
        self.messages = 0  # that were taken, of all types
        self.undeclared: dict[int, int] = {}  # number → data of no topic that is known
        self.unknown = 0  # messages of other types, or whose content is damaged, between two that fit
        self.skipped_bytes = 0  # that belong to no message
        self.cut_bytes = 0  # of a message that is not all there
        self._data = data
        self._view = data.data
        self._collector = collector
        self._begun = False  # all is said that stands before the data
        self._single: list[tuple[int, int]] = []  # data come across one by one: (start, index of topic)
        self._awaiting: list[tuple[int, Message]] = []  # (start, what was said), until the data before it is collected
        self._replaced = False  # a number has become one of another topic

    def read(self, begin: int, limit: int, done: Callable[[int, int], None]) -> None:
        """Take what stands in [begin, limit), all of which was written at once. done: gets what has been read."""
        settled, size = begin, _FIRST_BYTES
        while begin < limit:
            end = min(begin + size, limit)
            starts, ends, index = self._runs(settled, begin, end, limit)
            if len(starts):
                settled = self._between(settled, starts, ends, index, limit)
                after, size = max(end, settled), min(2 * size, _MOST_BYTES)
            else:  # there may be numbers that are not known yet
                settled = self._follow(settled, limit, limit, to_run=True)
                self._collect(np.empty(0, np.int64), np.empty(0, np.uint16))
                after, size = settled, _FIRST_BYTES
            if self._replaced:
                self._replaced = False
                after, size = settled, _FIRST_BYTES
            done(begin, after)
            begin = after
        self._follow(settled, limit, limit)
        self._collect(np.empty(0, np.int64), np.empty(0, np.uint16))

    def _between(self, settled: int, starts: Index, ends: Index, index: npt.NDArray[np.uint16], limit: int) -> int:
        """Take the data at starts (N,), and what stands before and between them. Returns up to where all is taken."""
        edges = np.append(settled, ends[:-1])
        for i in np.flatnonzero(starts != edges).tolist():
            self._follow(int(edges[i]), int(starts[i]), limit)
            if self._replaced:  # what is behind was looked for by numbers that no longer hold
                self._collect(starts[:i], index[:i])
                return int(starts[i])
        self._collect(starts, index)
        return int(ends[-1])

    def _collect(self, starts: Index, index: npt.NDArray[np.uint16]) -> None:
        """Take the data at starts (N,), those that were come across one by one, and what was said in between."""
        if self._single:
            places, indices = zip(*self._single, strict=True)
            starts, index = np.append(starts, places), np.append(index, np.array(indices, np.uint16))
            order = np.argsort(starts, kind="stable")
            starts, index = starts[order], index[order]
        before = self._collector.latest
        if len(starts):
            latest = np.append(np.uint64(before), self._collector.collect(self._data, starts, index))
        else:
            latest = np.array([before], np.uint64)
        for at, message in self._awaiting:
            self.other_messages.append((int(latest[np.searchsorted(starts, at)]), message))
        self.messages += len(starts) + len(self._awaiting)
        self._single, self._awaiting = [], []

    def _runs(self, settled: int, begin: int, end: int, limit: int) -> tuple[Index, Index, npt.NDArray[np.uint16]]:
        """Starts and ends (N,) of data that other data follow, and the index of the topic of each."""
        end = min(end, limit - HEADER_BYTES)
        places = np.flatnonzero(self._data[begin + 2 : max(end, begin) + 2] == DATA) + begin
        sizes, numbers, fits = self._data_at(places)
        starts, ends = places[fits], (places + sizes + 3)[fits]
        at_hand = (starts >= settled) & (ends <= limit)
        starts, ends, numbers = starts[at_hand], ends[at_hand], numbers[fits][at_hand]
        followed = np.append(ends[:-1] == starts[1:], ends[-1:] == limit)[: len(starts)]
        apart = np.flatnonzero(~followed)
        apart = apart[ends[apart] <= limit - HEADER_BYTES]
        followed[apart] = self._data_at(ends[apart])[2]
        starts, ends, numbers = starts[followed], ends[followed], numbers[followed]
        keep = first_come(starts, ends)
        return starts[keep], ends[keep], self._collector.place[numbers[keep]]

    def _data_at(self, places: Index) -> tuple[Index, Index, npt.NDArray[np.bool_]]:
        """Size and number (N,) of the data at places (N,), and whether these are of a topic."""
        header = gather(self._data, places, HEADER_BYTES).view(_DATA_HEADER).reshape(len(places))
        size, number = header["size"].astype(np.int64), header["number"].astype(np.int64)
        fits = (size >= self._collector.shortest.take(number)) & (size <= self._collector.longest.take(number))
        return size, number, fits & (header["type"] == DATA)

    def _follow(self, at: int, limit: int, end: int, *, to_run: bool = False) -> int:
        """Take the messages from `at` to `limit`, one by one, whatever is damaged there. Returns where that ended.

        end: of what was written at once: it may cut off a message. to_run: only as far as the next run of data.
        """
        while True:
            at, whole = self._walk(at, limit, to_run=to_run)
            if whole:
                return at
            again = self._again(at + 1, limit)
            if again is None:
                if limit == end and self._is_cut(at, end):
                    self.cut_bytes += end - at
                else:
                    self.skipped_bytes += limit - at
                return limit
            self.skipped_bytes += again - at
            at = again

    def _walk(self, at: int, limit: int, *, to_run: bool) -> tuple[int, bool]:
        """Take the messages from `at` on, each of which begins where the last ends; True if that leads to the limit.

        Returns where it ends, else up to where it can be trusted. A message that says nothing that is known is passed
        over if that leads to one that does. The last one before damage is taken, unless others go on inside it.
        """
        trusted = at
        last: tuple[int, Message | int] | None = None  # it ends at `trusted`, and what follows is not known yet
        passed: list[int] = []
        while at < limit:
            end, message = self._look(at, limit)
            if to_run and isinstance(message, int) and isinstance(self._look(end, limit)[1], int):
                break
            if not end or (message is None and self._view[at + 2] != DATA and self._again(at + 1, end) is not None):
                if last is not None and self._again(last[0] + 1, limit, before=trusted) is not None:
                    return last[0], False
                self._accept(last)
                return trusted, False  # what it would pass over are messages
            if message is None:
                passed.append(at)
            else:
                self._accept(last)
                self._pass_over(passed)
                last, passed, trusted = (at, message), [], end
                if isinstance(message, _DEFINING):  # what follows is read by it
                    self._accept(last)
                    last = None
            at = end
        self._accept(last)
        self._pass_over(passed)
        return at, True

    def _pass_over(self, places: list[int]) -> None:
        self.messages += len(places)
        for at in places:
            size, kind = _HEADER.unpack_from(self._view, at)
            if kind == DATA and size >= 2:
                (number,) = _NUMBER.unpack_from(self._view, at + 3)
                self.undeclared[number] = self.undeclared.get(number, 0) + 1
            else:
                self.unknown += 1

    def _accept(self, one: tuple[int, Message | int] | None) -> None:
        """Take a message, by its start and what it says: of data the index of its topic."""
        if one is None:
            return
        at, message = one
        if isinstance(message, int):
            self._single.append((at, message))
            return
        if isinstance(message, _DEFINING):
            if isinstance(message, Format):
                self._collector.formats.add(message.name, message.fields)
            elif isinstance(message, Subscription):
                self._replaced |= self._collector.subscribe(message)
            else:
                self._replaced |= self._collector.unsubscribe(message.number)
        self._begun = self._begun or isinstance(message, _AFTER_DEFINITIONS)
        if self._begun:
            self._awaiting.append((at, message))
        else:
            self.messages += 1
            self.other_messages.append((None, message))

    def _look(self, at: int, limit: int) -> tuple[int, Message | int | None]:
        """The end of the message at `at`, 0 where there can be none; and what it says, or the index of its topic.

        None for what says nothing that is known.
        """
        if at + 3 > limit:
            return 0, None
        size, kind = _HEADER.unpack_from(self._view, at)
        end = at + 3 + size
        if size == 0 or end > limit:
            return 0, None
        if kind != DATA:
            return end, parsed_message(kind, bytes(self._view[at + 3 : end]))
        if size < 2:
            return end, None
        (number,) = _NUMBER.unpack_from(self._view, at + 3)
        fits = self._collector.shortest[number] <= size <= self._collector.longest[number]
        return end, int(self._collector.place[number]) if fits else None

    def _again(self, begin: int, limit: int, before: int | None = None) -> int | None:
        """Where from `begin` on, and before a place, two messages follow one another, or one leads to `limit`."""
        step, last = _FIRST_STEP, min(limit - 3, limit if before is None else before)
        while begin < last:
            stop = min(begin + step, last)
            for at in self._plausible(begin, stop, limit).tolist():
                end, message = self._look(at, limit)
                if message is not None and (end == limit or self._look(end, limit)[1] is not None):
                    return int(at)
            begin, step = stop, min(2 * step, _MOST_STEP)
        return None

    def _plausible(self, begin: int, end: int, limit: int) -> Index:
        """Places in [begin, end) where a message of a known type may begin, by its size and its first byte."""
        kind = self._data[begin + 2 : end + 2]
        at = np.flatnonzero(_MOST[kind] > 0)
        kind, at = kind[at], at + begin
        size = self._data[at].astype(np.int64) | self._data[at + 1].astype(np.int64) << 8
        fits = (size >= _LEAST[kind]) & (size <= _MOST[kind]) & (at + 3 + size <= limit)
        kind, at, size = kind[fits], at[fits], size[fits]
        fits = _FIRST[kind, self._data[at + 3]] & ((kind != _FORMAT) | (self._data[at + 2 + size] == _SEMICOLON))
        some = np.flatnonzero(kind == DATA)
        fits[some] = self._data_at(at[some])[2]
        return np.asarray(at[fits])

    def _is_cut(self, at: int, end: int) -> bool:
        """Whether the header of a message at `at` says that it goes on behind the end, or is itself not all there."""
        return at + 3 > end or (
            self._view[at + 2] in MESSAGE_TYPES and at + 3 + _HEADER.unpack_from(self._view, at)[0] > end
        )


_HEAD_BYTES = 16  # magic, version and when the log was begun
_APPENDED = 1  # the only incompatible flag that is known
_FLAGS = ord("B")


@dataclass(frozen=True, slots=True, eq=False)
class Ulog(LogFile):
    """An on-board log of PX4 in memory, as columns per topic and instance. Times are µs of the boot clock."""

    begun: int  # when the file says that it was begun
    cut_bytes: int  # of a message at the end that is not all there
    appended: bool  # data was added after the log had ended, as after a crash
    undecoded: Mapping[str, int]  # topic, "" for one of no name → messages whose declaration is missing or damaged
    unknown: int  # messages of a type that is not known, or whose content is damaged
    topics: tuple[UlogTopic, ...]  # by name and instance
    infos: Mapping[str, Value]
    parameters: Mapping[str, Value]  # at the beginning
    parameter_changes: tuple[tuple[int, str, Value], ...]  # (time, name, value)
    texts: tuple[LoggedText, ...]
    dropouts: tuple[tuple[int, float], ...]  # (time, duration in s) of what the logger could not keep up with
    kind: str = "ulog"


def read_ulog(
    path: str | Path,
    *,
    names: Collection[str] | None = None,
    progress: Callable[[int], None] | None = None,
    most_bytes: int = MOST_BYTES,
) -> Ulog:
    """Read an on-board log of PX4, as far as it can be read.

    `names`: the topics whose fields are requested (None: all); of the others only the times are kept. `progress` gets
    the bytes of each part that was looked through.

    Raises InputError if the file cannot be opened, has no data in it, or is of a kind that PX4 marks as incompatible.
    """
    path = Path(path)
    head = read_head(path)
    if log_format(path) != "ulog":
        raise InputError(
            f"{path} is no PX4 ULog: it begins with {head[:8].hex(' ').upper()}, not 55 4C 6F 67. "
            "Name the .ulg file that the autopilot wrote."
        )
    contents = Contents(path, most_bytes)
    mapped = Mapped(contents, progress)
    flags = _flags(path, head)
    collector = Collector(names)
    collector.latest = begun = int.from_bytes(head[8:_HEAD_BYTES], "little")
    scan = _Scan(mapped.data, collector)
    size = len(mapped.data)
    edges = sorted({at for at in flags.appended if _HEAD_BYTES < at < size})
    for begin, end in zip([_HEAD_BYTES, *edges], [*edges, size], strict=True):
        scan.read(begin, end, mapped.looked_through)
    topics, undecoded = collector.topics()
    for number, count in scan.undeclared.items():
        name = collector.undeclared.get(number, "")
        undecoded[name] = undecoded.get(name, 0) + count
    if not topics:
        raise InputError(_no_data(path, collector))
    said = scan.other_messages  # what is said twice holds as it was said last
    set_values = [(t, m.name, m.value) for t, m in said if isinstance(m, Parameter)]
    return Ulog(
        **contents.facts,
        begun=begun,
        frames=scan.messages,
        skipped_bytes=scan.skipped_bytes,
        cut_bytes=scan.cut_bytes,
        appended=bool(edges),
        undecoded=MappingProxyType(undecoded),
        unknown=scan.unknown,
        topics=topics,
        infos=MappingProxyType({m.name: m.value for _, m in said if isinstance(m, Info)}),
        parameters=MappingProxyType({name: value for t, name, value in set_values if t is None}),
        parameter_changes=tuple((t, name, value) for t, name, value in set_values if t is not None),
        texts=tuple(m for _, m in said if isinstance(m, LoggedText)),
        dropouts=tuple((t or 0, m.duration_ms * 1e-3) for t, m in said if isinstance(m, Dropout)),
    )


def _flags(path: Path, head: bytes) -> Flags:
    """The flags, which are the first message where there are any.

    Raises InputError for those that mean that this program cannot understand the rest.
    """
    size = int.from_bytes(head[_HEAD_BYTES : _HEAD_BYTES + 2], "little")
    body = head[_HEAD_BYTES + 3 : _HEAD_BYTES + 3 + size]
    message = parsed_message(_FLAGS, body) if head[_HEAD_BYTES + 2 : _HEAD_BYTES + 3] == b"B" else None
    flags = message if isinstance(message, Flags) else Flags(bytes(8), ())
    if flags.incompatible[0] & ~_APPENDED or any(flags.incompatible[1:]):
        raise InputError(
            f"{path} is a PX4 ULog with the incompatible flags {flags.incompatible.hex(' ').upper()}, of which only 01 "
            "is known: it is of a newer format, or its head is damaged. Copy it again, or update this program."
        )
    return flags if flags.incompatible[0] else Flags(bytes(8), ())


def _no_data(path: Path, collector: Collector) -> str:
    too_large = next(collector.formats.too_large(), None)
    if too_large is not None:
        return (
            f"{path} begins like a PX4 ULog, but declares {too_large!r} with more bytes than a message can have: its "
            "definitions are damaged. Copy it again."
        )
    return (
        f"{path} begins like a PX4 ULog, but no data can be read from it: it was cut off, or its definitions are "
        "damaged. Copy it again."
    )
