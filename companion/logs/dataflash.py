"""Read ArduPilot's on-board logs (DataFlash, .bin) as columns, by the layouts and units that each log carries itself.

A record is A3 95, a type byte and a body. Type 128 (FMT) declares the length, name, format and columns of a type; FMTU,
UNIT and MULT name the unit and the multiplier of each column. There is no checksum: a record is taken if another begins
exactly behind it, or if it begins exactly behind such a one. One that stands alone amid damage is not: a false IMU
sample costs more than a lost one.
Source: ArduPilot `libraries/AP_Logger/LogStructure.h`, `README.md`, and pymavlink's `DFReader`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.logs import dataflash_layout
from companion.logs.dataflash_layout import FMT, Declaration, RecordLayout, record_lengths
from companion.logs.logfile import MOST_BYTES, Contents, LogFile, Mapped, log_format, read_head
from companion.mavlink import Bytes, Index, as_bytes, first_come
from companion.model import InputError

_HEAD_1, _HEAD_2 = 0xA3, 0x95
_SCAN_BYTES = 2 << 20
_PART_BYTES = 8 << 20  # of the file that are in memory at a time
_BLOCK = 1 << 17  # heads looked at together


@dataclass(frozen=True, slots=True, eq=False)
class Records:
    """All records of one type, in file order."""

    layout: RecordLayout
    offset: Index  # (N,) position of the record in the file: the order across types
    rows: npt.NDArray[np.void]  # (N,) of layout.dtype, as in the file; its time alone if this type was not requested
    sender_s: npt.NDArray[np.float64] | None = None  # (N,) s, the times of records that carry none

    @property
    def name(self) -> str:
        return self.layout.name

    def __len__(self) -> int:
        return len(self.offset)

    def __getitem__(self, field: str) -> npt.NDArray[Any]:
        """A column as pymavlink's DFReader gives it: (N,), the divisor of its format applied (then float64).

        Raises KeyError if the record has no such field or the rows were not read.
        """
        if field not in self.layout.fields:
            raise KeyError(f"{self.name} has no field {field!r}; it has {', '.join(self.layout.fields)}")
        if field not in (self.rows.dtype.names or ()):
            raise KeyError(f"the fields of {self.name} were not read: add it to `names`")
        column: npt.NDArray[Any] = self.rows[field]
        divisor = self.layout.divisors.get(field)
        return column if divisor is None else column / divisor

    def in_unit(self, field: str) -> npt.NDArray[np.float64]:
        """A numeric column in `layout.units[field]`: (N,) float64 (TimeUS in s). Raises KeyError as `[field]`."""
        with np.errstate(invalid="ignore"):  # damage makes NaNs that signal
            return self[field].astype(np.float64) * self.layout.multipliers.get(field, 1.0)

    def columns(self, *fields: str) -> npt.NDArray[np.float64]:
        """Columns side by side, (N, len(fields)). Raises KeyError as `[field]`."""
        return np.column_stack([self[field] for field in fields]).astype(np.float64)

    @property
    def t(self) -> npt.NDArray[np.float64]:
        """When each was written: (N,) s since boot. Raises KeyError for records without a time."""
        return self.in_unit(self.layout.clock) if self.sender_s is None else self.sender_s

    @property
    def instances(self) -> tuple[int, ...]:
        """The sensors or cores that appear; empty where there is only one."""
        if self.layout.instance_field is None:
            return ()
        return tuple(np.unique(self[self.layout.instance_field]).tolist())

    def instance(self, number: int) -> Records:
        """The records of one sensor or core; all, where there is only one."""
        if self.layout.instance_field is None:
            return self
        return self.select(self[self.layout.instance_field] == number)

    def select(self, index: npt.NDArray[np.bool_] | npt.NDArray[np.integer[Any]] | slice) -> Records:
        """Those of a mask, an index or a slice."""
        whole = self.rows.dtype.itemsize > 0
        rows = as_bytes(self.rows)[index].view(self.rows.dtype) if whole else self.rows[index]
        return Records(self.layout, self.offset[index], rows, None if self.sender_s is None else self.sender_s[index])


@dataclass(frozen=True, slots=True, eq=False)
class DataflashLog(LogFile):
    """An on-board log in memory, as columns per type of record."""

    undecoded: Mapping[str, int]  # name -> records whose FMT contradicts itself or uses a format unknown to us
    messages: Mapping[str, Records]  # by name, in order of first appearance
    kind: str = "dataflash"


def read_dataflash(
    path: str | Path,
    *,
    names: Collection[str] | None = None,
    progress: Callable[[int], None] | None = None,
    most_bytes: int = MOST_BYTES,
) -> DataflashLog:
    """Read an on-board log, as far as it can be read.

    `names`: the types whose fields are requested (None: all); of the others only the times are kept. If a log declares
    a type twice, the first declaration holds. `progress` gets the bytes of each part that was looked through.

    Raises InputError if the file cannot be opened or has no such records in it.
    """
    path = Path(path)
    head = read_head(path)
    if log_format(path) != "dataflash":
        raise InputError(
            f"{path} is no ArduPilot DataFlash log: it begins with {head[:8].hex(' ').upper()}, not A3 95. "
            "Name the .bin file that the autopilot wrote."
        )
    contents = Contents(path, most_bytes)
    mapped = Mapped(contents, progress)
    starts, types, formats = _find(mapped)
    if len(starts) == 0:
        raise InputError(f"{path} begins like a DataFlash log, but has no whole record in it: copy it again.")
    layouts, undecoded = dataflash_layout.record_layouts(mapped.data, formats, starts, types)
    order = np.argsort(types, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(types[order])) + 1)
    del order
    messages: dict[str, Records] = {}
    for index in sorted(groups, key=lambda group: int(group[0])):
        layout = layouts.get(int(types[index[0]]))
        if layout is not None:
            key = layout.name if layout.name not in messages else f"{layout.name}#{layout.type}"
            needed = names is None or layout.name in names
            messages[key] = Records(
                layout, starts[index], np.empty(len(index), layout.dtype if needed else _times(layout))
            )
    skipped = len(mapped.data) - int(np.bincount(types, minlength=256) @ record_lengths(formats))
    count, left_out = len(starts), {name: int((types == number).sum()) for number, name in undecoded.items()}
    del starts, groups
    _fill(mapped, messages)
    return DataflashLog(
        path=path,
        size_bytes=contents.size_bytes,
        content_bytes=len(mapped.data),
        trouble=contents.trouble,
        frames=count,
        skipped_bytes=skipped,
        undecoded=MappingProxyType(left_out),
        messages=MappingProxyType(messages),
    )


def _times(layout: RecordLayout) -> np.dtype[np.void]:
    """Of a type that is not requested: its time, which all but a few have as their first field."""
    timed = layout.clock and layout.fields[0] == layout.clock
    return np.dtype([(layout.clock, layout.dtype[layout.clock])] if timed else [])


def _fill(mapped: Mapped, messages: Mapping[str, Records]) -> None:
    """Gather the rows part by part of the file, so that no more than a part of it has to be in memory."""
    for begin in range(0, len(mapped.data), _PART_BYTES):
        end = begin + _PART_BYTES
        for records in messages.values():
            if records.rows.dtype.itemsize:
                part = slice(*np.searchsorted(records.offset, (begin, end)).tolist())
                rows = dataflash_layout.gather_rows(mapped.data, records.offset[part], records.rows.dtype)
                as_bytes(records.rows)[part] = as_bytes(rows)
        mapped.release(begin, end)


def _find(mapped: Mapped) -> tuple[Index, Bytes, dict[int, Declaration]]:
    """Where the records begin, their types, and what the log declares of those."""
    heads, types = _heads(mapped)
    formats = dataflash_layout.declarations(mapped.data, heads[types == FMT])
    taken = _are_records(heads, record_lengths(formats)[types], len(mapped.data))
    starts, types = heads[taken], types[taken]
    keep = first_come(starts, starts + record_lengths(formats)[types])  # A3 95 inside a body sometimes fits
    return (starts, types, formats) if keep.all() else (starts[keep], types[keep], formats)


def _heads(mapped: Mapped) -> tuple[Index, Bytes]:
    """Every position of A3 95 that a type byte follows, and that type. Looked for in pieces that stay in cache."""
    data = mapped.data
    places, types = [np.empty(0, np.int64)], [np.empty(0, np.uint8)]
    for begin in range(0, len(data) - 2, _SCAN_BYTES):
        end = min(begin + _SCAN_BYTES, len(data) - 2)
        place = np.flatnonzero((data[begin:end] == _HEAD_1) & (data[begin + 1 : end + 1] == _HEAD_2)) + begin
        places.append(place)
        types.append(data[place + 2])
        mapped.looked_through(begin, end)
    return np.concatenate(places), np.concatenate(types)


def _are_records(heads: Index, length: Index, size: int) -> npt.NDArray[np.bool_]:
    """Which heads (N,) begin a record: `length` (N,), 0 for none, ends where a head stands, or the file of `size`.

    The record before damage has no such successor: it is one too if it begins where such a record ends.
    """
    taken = np.zeros(len(heads), np.bool_)
    follows = np.zeros(len(heads) + 1, np.bool_)
    for begin in range(0, len(heads), _BLOCK):
        block = slice(begin, begin + _BLOCK)
        ends = heads[block] + length[block]
        after = np.searchsorted(heads, ends)
        has_next = heads[np.minimum(after, len(heads) - 1)] == ends
        known = (length[block] > 0) & (ends <= size)
        taken[block] = known & (has_next | (ends == size))
        follows[after[known & has_next]] = True
    known_ends = (length > 0) & (heads <= size - length)
    taken |= follows[:-1] & known_ends
    if len(heads):
        taken[0] |= bool(heads[0] == 0 and known_ends[0])
    return taken
