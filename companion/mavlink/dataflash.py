"""Read ArduPilot's on-board logs (DataFlash, .bin) as columns, by the layouts and units that each log carries itself.

A record is A3 95, a type byte and a body. Type 128 (FMT) declares the length, name, format and columns of a type; FMTU,
UNIT and MULT name the unit and the multiplier of each column. There is no checksum: a record is taken if another begins
exactly behind it, or if it begins exactly behind such a one. One that stands alone amid damage is not: a false IMU
sample costs more than a lost one.
Source: ArduPilot `libraries/AP_Logger/LogStructure.h`, `README.md`, and pymavlink's `DFReader`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.errors import InputError
from companion.mavlink.crc import Bytes, Index
from companion.mavlink.declarations import (
    Declaration,
    RecordLayout,
    declarations,
    gather_records,
    record_layouts,
    record_lengths,
)
from companion.mavlink.logfile import Contents, log_format, read_head
from companion.mavlink.messages import as_bytes
from companion.mavlink.spans import first_come

_HEAD_1, _HEAD_2 = 0xA3, 0x95
_SCAN_BYTES = 2 << 20


@dataclass(frozen=True, slots=True, eq=False)
class Records:
    """All records of one type, in file order."""

    layout: RecordLayout
    offset: Index  # (N,) position of the record in the file: the order across types
    rows: npt.NDArray[np.void]  # (N,) of layout.dtype, as in the file; empty if this type was not asked for

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
        if len(self.rows) != len(self):
            raise KeyError(f"the fields of {self.name} were not read: add it to `names`")
        column: npt.NDArray[Any] = self.rows[field]
        divisor = self.layout.divisors.get(field)
        return column if divisor is None else column / divisor

    def in_unit(self, field: str) -> npt.NDArray[np.float64]:
        """A numeric column in `layout.units[field]`: (N,) float64 (TimeUS in s). Raises KeyError as `[field]`."""
        return self[field].astype(np.float64) * self.layout.multipliers.get(field, 1.0)

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
        rows = as_bytes(self.rows)[index].view(self.layout.dtype) if len(self.rows) == len(self) else self.rows
        return Records(self.layout, self.offset[index], rows)


@dataclass(frozen=True, slots=True, eq=False)
class DataflashLog:
    """An on-board log in memory, as columns per type of record."""

    path: Path
    size_bytes: int  # of the file
    content_bytes: int  # the same, but of what it holds where it is compressed
    trouble: str  # why the rest could not be decompressed; "" when all of it was
    frames: int  # records
    skipped_bytes: int  # that belong to no record: damage, or the filling of the last page
    undecoded: Mapping[str, int]  # name -> records whose FMT contradicts itself or uses a format unknown to us
    messages: Mapping[str, Records]  # by name, in order of first appearance
    kind: str = "dataflash"


def read_dataflash(path: str | Path, *, names: Collection[str] | None = None) -> DataflashLog:
    """Read an on-board log, as far as it can be read.

    `names`: the types whose fields are wanted (None: all); of the others only the offsets are kept. If a log declares a
    type twice, the first declaration holds.

    Raises InputError if the file cannot be opened or has no such records in it.
    """
    path = Path(path)
    head = read_head(path)
    if log_format(path) != "dataflash":
        raise InputError(
            f"{path} is no ArduPilot DataFlash log: it begins with {head[:8].hex(' ').upper()}, not A3 95. "
            "Name the .bin file that the autopilot wrote."
        )
    data: Bytes
    contents = Contents(path)
    data = np.frombuffer(contents.read(), np.uint8) if contents.compression else np.memmap(path, np.uint8, mode="r")
    heads = _heads(data)
    formats = declarations(data, heads)
    starts, types = _records(data, heads, formats)
    if len(starts) == 0:
        raise InputError(f"{path} begins like a DataFlash log, but has no whole record in it: copy it again.")
    layouts, undecoded = record_layouts(data, formats, starts, types)
    found: dict[str, Records] = {}
    order = np.argsort(types, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(types[order])) + 1)
    for index in sorted(groups, key=lambda group: int(group[0])):
        layout = layouts.get(int(types[index[0]]))
        if layout is None:
            continue
        wanted = names is None or layout.name in names
        key = layout.name if layout.name not in found else f"{layout.name}#{layout.type}"
        rows = gather_records(data, starts[index], layout) if wanted else np.empty(0, layout.dtype)
        found[key] = Records(layout, starts[index], rows)
    lengths = np.bincount(types, minlength=256) @ record_lengths(formats)
    return DataflashLog(
        path=path,
        size_bytes=contents.size_bytes,
        content_bytes=len(data),
        trouble=contents.trouble,
        frames=len(starts),
        skipped_bytes=len(data) - int(lengths),
        undecoded=MappingProxyType({name: int((types == number).sum()) for number, name in undecoded.items()}),
        messages=MappingProxyType(found),
    )


def _heads(data: Bytes) -> Index:
    """Every position of A3 95 that a type byte follows. Looked for in pieces that stay in cache."""
    found = []
    for begin in range(0, len(data) - 2, _SCAN_BYTES):
        end = min(begin + _SCAN_BYTES, len(data) - 2)
        found.append(np.flatnonzero((data[begin:end] == _HEAD_1) & (data[begin + 1 : end + 1] == _HEAD_2)) + begin)
    return np.concatenate([np.empty(0, np.int64), *found])


def _records(data: Bytes, heads: Index, formats: Mapping[int, Declaration]) -> tuple[Index, Bytes]:
    """Where the records begin, and their types."""
    types = np.asarray(data[heads + 2])
    length = record_lengths(formats)[types]
    known = (length > 0) & (heads + length <= len(data))
    starts, types, length = heads[known], types[known], length[known]
    if len(starts) == 0:
        return starts, types
    ends = starts + length
    has_next = (ends == len(data)) | _found(ends, heads)
    # The record before damage has no successor, but begins where its predecessor ends.
    taken = has_next | _found(starts, np.sort(ends[has_next], kind="stable"))
    taken[0] |= starts[0] == 0
    starts, types, ends = starts[taken], types[taken], ends[taken]
    keep = first_come(starts, ends)  # A3 95 inside a body sometimes fits
    return starts[keep], types[keep]


def _found(values: Index, among: Index) -> npt.NDArray[np.bool_]:
    """Which of `values` are in `among`, which is sorted. `values` nearly is, which makes this faster than np.isin."""
    among = np.append(among, -1) if len(among) == 0 else among
    at = np.searchsorted(among, values)
    return np.asarray(among[np.minimum(at, len(among) - 1)] == values)
