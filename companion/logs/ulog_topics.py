"""The topics of a ULog: what a number means at a place of the log, and the rows of each topic as they are read."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.logs.ulog_messages import Formats, Subscription, TopicLayout, placed
from companion.mavlink import Bytes, Index, as_bytes, gather

HEADER_BYTES = 5  # of data: size, type and number
_NUMBERS = 1 << 16
_STAMP_BYTES = 8
_LEAST_ROOM, _MARGIN = 16, 1.05  # rows, and of those that are expected
_STAMPS_ALONE = np.dtype([("timestamp", "<u8")])


@dataclass(frozen=True, slots=True, eq=False)
class UlogTopic:
    """All messages of one instance of a topic, in file order: field → column (N,), a view into the rows.

    The elements of arrays and the fields of parts are fields by the names that PX4's tools give them: `q[0]`,
    `esc[1].rpm`.
    """

    name: str
    instance: int
    rows: npt.NDArray[np.void]  # (N,) structured as declared; the time alone if this topic was not requested
    declared: np.dtype[Any]  # the whole structure

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def fields_read(self) -> bool:
        """Whether the topic was requested."""
        return self.rows.dtype == self.declared

    def __getitem__(self, field: str) -> npt.NDArray[Any]:
        """Raises KeyError if the topic has no such field, LookupError if it was not read."""
        column = self.get(field)
        if column is None:
            raise KeyError(f"{self.name} has no field {field!r}")
        return column

    def get(self, field: str) -> npt.NDArray[Any] | None:
        """None if the topic has no such field. Raises LookupError if it was not read."""
        place = self._place(field)
        if place is None:
            return None
        kind, offset = place
        if not len(self.rows):
            return np.empty(0, kind)
        return np.ndarray(self.rows.shape, kind, self.rows.view(np.uint8).data, offset, self.rows.strides)

    def __contains__(self, field: str) -> bool:
        """Raises LookupError if there is such a field that was not read."""
        return self._place(field) is not None

    def _place(self, field: str) -> tuple[np.dtype[Any], int] | None:
        place = placed(self.rows.dtype, field)
        if place is None and not self.fields_read and placed(self.declared, field) is not None:
            raise LookupError(f"the fields of {self.name} were not read: add it to `names`")
        return place

    def seconds(self, field: str = "timestamp") -> npt.NDArray[np.float64]:
        """A time field, µs of the boot clock, in s: (N,)."""
        return np.asarray(self[field], np.float64) * 1e-6

    def columns(self, *fields: str) -> npt.NDArray[np.float64]:
        """Fields side by side, (N, len(fields)), NaN for a field that is not there or not finite."""
        values = np.full((len(self), len(fields)), np.nan)
        with np.errstate(invalid="ignore"):  # damage makes NaNs that signal
            for i, field in enumerate(fields):
                column = self.get(field)
                if column is not None:
                    values[:, i] = column
        values[~np.isfinite(values)] = np.nan
        return values

    def column(self, field: str) -> npt.NDArray[np.float64]:
        """One field, (N,), NaN where it is not there or not finite."""
        return np.asarray(self.columns(field)[:, 0])

    def array(self, field: str, places: Iterable[int] = range(3)) -> npt.NDArray[np.float64]:
        """Elements of an array, (N, len(places)), as `columns`."""
        return self.columns(*(f"{field}[{place}]" for place in places))

    def flag(self, field: str) -> npt.NDArray[np.bool_]:
        """A field of truth values, (N,); true where there is none."""
        return np.asarray(self[field], np.bool_) if field in self else np.ones(len(self), np.bool_)

    def ids(self, field: str) -> npt.NDArray[np.int64]:
        """Ids of the sensor behind each row, (N,); 0 where there is no such field."""
        return np.asarray(self[field]).astype(np.int64) if field in self else np.zeros(len(self), np.int64)

    def select(self, index: npt.NDArray[np.bool_] | npt.NDArray[np.integer[Any]] | slice) -> UlogTopic:
        """The messages of a mask, an index or a slice."""
        return UlogTopic(
            self.name, self.instance, as_bytes(self.rows)[index].view(self.rows.dtype), declared=self.declared
        )


class _Collected:
    """The messages of one topic so far. requested: their rows; else their times alone, where they have such.

    Room is made for as many as there will be if the file goes on as it began; memory that is never written is never
    used.
    """

    def __init__(self, layout: TopicLayout, instance: int, *, needed: bool) -> None:
        self.layout = layout
        self.instance = instance
        self.needed = needed or layout.stamp is None
        self.count = 0
        self._rows: Bytes = np.empty((0, layout.shortest if self.needed else _STAMP_BYTES), np.uint8)

    def add(self, rows: Bytes, share: float) -> None:
        """share: how much of the file has been read, 0 to 1."""
        begin, self.count = self.count, self.count + len(rows)
        if self.count > len(self._rows):
            room = max(_LEAST_ROOM, int(self.count / share * _MARGIN))
            grown = np.empty((room, self._rows.shape[1]), np.uint8)
            grown[:begin] = self._rows[:begin]
            self._rows = grown
        self._rows[begin : self.count] = rows

    def topic(self, formats: Formats) -> UlogTopic | None:
        """None where its declaration contradicts itself."""
        declared = formats.dtype(self.layout.name)
        if declared is None:
            return None
        rows = self._rows[: self.count].view(declared if self.needed else _STAMPS_ALONE)[:, 0]
        return UlogTopic(self.layout.name, self.instance, rows, declared)


class Collector:
    """The data of a log so far. `shortest` and `longest` say how many bytes follow a message's header, by its number:
    none that can be for a number without a topic.
    """

    def __init__(self, names: Collection[str] | None) -> None:
        """names: the topics whose fields are requested (None: all)."""
        self.formats = Formats()
        self.shortest = np.full(_NUMBERS, _NUMBERS - 1, np.uint16)
        self.longest = np.zeros(_NUMBERS, np.uint16)
        self.place = np.zeros(_NUMBERS, np.uint16)  # number → index of the topic
        self.undeclared: dict[int, str] = {}  # number → topic whose declaration is missing or damaged
        self.latest = 0  # µs, the latest time so far
        self._names = names
        self._all: list[_Collected] = []
        self._index: dict[tuple[str, int], int] = {}

    def subscribe(self, to: Subscription) -> bool:
        """Whether the number meant another topic before."""
        layout = self.formats.layout(to.topic)
        if layout is None or len(self._all) == _NUMBERS - 1:
            self.undeclared[to.number] = to.topic
            return self.unsubscribe(to.number)
        key = to.topic, to.instance
        if key not in self._index:
            self._index[key] = len(self._all)
            needed = self._names is None or to.topic in self._names
            self._all.append(_Collected(layout, to.instance, needed=needed))
        replaced = self.longest[to.number] > 0 and self.place[to.number] != self._index[key]
        self.place[to.number] = self._index[key]
        self.shortest[to.number], self.longest[to.number] = 2 + layout.shortest, 2 + layout.longest
        return bool(replaced)

    def unsubscribe(self, number: int) -> bool:
        """Whether the number meant a topic before."""
        meant = self.longest[number] > 0
        self.shortest[number], self.longest[number] = _NUMBERS - 1, 0
        return bool(meant)

    def collect(self, data: Bytes, starts: Index, index: npt.NDArray[np.uint16]) -> npt.NDArray[np.uint64]:
        """Take the messages that begin at starts (N,), each of the topic of an index (N,).

        Returns the latest time, µs, of each and all before it: (N,).
        """
        stamps = self._stamps(data, starts, index)
        share = int(starts[-1]) / len(data)
        order = np.argsort(index, kind="stable")
        ordered = index[order]
        for group in np.split(order, np.flatnonzero(ordered[1:] != ordered[:-1]) + 1):
            one = self._all[int(index[group[0]])]
            if one.needed:
                one.add(gather(data, starts[group] + HEADER_BYTES, one.layout.shortest), share)
            else:
                one.add(stamps[group].view(np.uint8).reshape(-1, _STAMP_BYTES), share)
        latest = np.maximum(np.maximum.accumulate(stamps), np.uint64(self.latest))
        self.latest = int(latest[-1])
        return latest

    def _stamps(self, data: Bytes, starts: Index, index: npt.NDArray[np.uint16]) -> npt.NDArray[np.uint64]:
        """µs (N,), 0 for a topic without times."""
        stamps_at = [-1 if one.layout.stamp is None else one.layout.stamp for one in self._all]
        places = np.array(stamps_at, np.int64)[index]
        timed = places >= 0
        if timed.all():
            return gather(data, starts + (HEADER_BYTES + places), _STAMP_BYTES).view("<u8")[:, 0]
        stamps = np.zeros(len(starts), np.uint64)
        at = (starts + (HEADER_BYTES + places))[timed]
        stamps[timed] = gather(data, at, _STAMP_BYTES).view("<u8").reshape(len(at))
        return stamps

    def topics(self) -> tuple[tuple[UlogTopic, ...], dict[str, int]]:
        """Those with messages, by name and instance; and how many of each could not be decoded."""
        topics: list[UlogTopic] = []
        undecoded: dict[str, int] = {}
        for one in sorted(self._all, key=lambda one: (one.layout.name, one.instance)):
            if one.count and (topic := one.topic(self.formats)) is not None:
                topics.append(topic)
            elif one.count:
                undecoded[one.layout.name] = undecoded.get(one.layout.name, 0) + one.count
        return tuple(topics), undecoded
