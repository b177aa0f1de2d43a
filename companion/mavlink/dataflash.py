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
from companion.mavlink.crc import Bytes, Index, gather
from companion.mavlink.logfile import is_compressed, log_format, read_chunks, read_head

_HEAD_1, _HEAD_2 = 0xA3, 0x95
_HEADER_BYTES = 3
_FMT = 128
_SCAN_BYTES = 2 << 20

_KINDS: dict[str, Any] = {
    "a": ("<i2", (32,)), "b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8", "Q": "<u8",
    "f": "<f4", "d": "<f8", "g": "<f2", "n": "S4", "N": "S16", "Z": "S64", "M": "u1",
    "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4",
}  # fmt: skip
# Formats in hundredths, or ten-millionths of a degree: divided, not multiplied, which is the more exact (DFReader).
_DIVISORS = {"c": 100.0, "C": 100.0, "e": 100.0, "E": 100.0, "L": 1e7}


@dataclass(frozen=True, slots=True, eq=False)
class RecordLayout:
    """How one type of record lies in this log."""

    type: int  # the byte behind A3 95
    name: str  # "IMU"
    length: int  # bytes, the header of 3 with it
    dtype: np.dtype[np.void]  # packed, little endian, of the body
    divisors: Mapping[str, float]  # field -> 100 or 1e7 where the format says so; absent: none
    units: Mapping[str, str]  # field -> label of the log's UNIT record ("s", "rad/s", "m/s/s"); absent: none
    multipliers: Mapping[str, float]  # field -> what makes a value one in that unit (TimeUS: 1e-6); absent: 1
    instance_field: str | None  # the column that says which of several sensors or cores ("I", "C"); None: only one

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the columns, in order."""
        return self.dtype.names or ()


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
        rows = self.rows[index] if len(self.rows) == len(self) else self.rows
        return Records(self.layout, self.offset[index], rows)


@dataclass(frozen=True, slots=True, eq=False)
class DataflashLog:
    """An on-board log in memory, as columns per type of record."""

    path: Path
    size_bytes: int
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
    if is_compressed(path):
        data = np.frombuffer(b"".join(read_chunks(path)), np.uint8)
    else:
        data = np.memmap(path, np.uint8, mode="r")
    heads = _heads(data)
    formats = _formats(data, heads)
    starts, types = _records(data, heads, formats)
    if len(starts) == 0:
        raise InputError(f"{path} begins like a DataFlash log, but has no whole record in it: copy it again.")
    layouts, undecoded = _layouts(data, formats, starts, types)
    found: dict[str, Records] = {}
    order = np.argsort(types, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(types[order])) + 1)
    for index in sorted(groups, key=lambda group: int(group[0])):
        layout = layouts.get(int(types[index[0]]))
        if layout is None:
            continue
        wanted = names is None or layout.name in names
        key = layout.name if layout.name not in found else f"{layout.name}#{layout.type}"
        rows = _rows(data, starts[index], layout) if wanted else np.empty(0, layout.dtype)
        found[key] = Records(layout, starts[index], rows)
    lengths = np.bincount(types, minlength=256) @ _lengths(formats)
    return DataflashLog(
        path=path,
        size_bytes=path.stat().st_size,
        frames=len(starts),
        skipped_bytes=len(data) - int(lengths),
        undecoded=MappingProxyType({name: int((types == number).sum()) for number, name in undecoded.items()}),
        messages=MappingProxyType(found),
    )


@dataclass(frozen=True, slots=True)
class _Format:
    """What an FMT record declares."""

    type: int
    length: int
    name: str
    format: str
    columns: tuple[str, ...]


_FMT_BODY = np.dtype([("type", "u1"), ("length", "u1"), ("name", "S4"), ("format", "S16"), ("columns", "S64")])
_FMT_LENGTH = _HEADER_BYTES + _FMT_BODY.itemsize


def _heads(data: Bytes) -> Index:
    """Every position of A3 95 that a type byte follows. Looked for in pieces that stay in cache."""
    found = []
    for begin in range(0, len(data) - 2, _SCAN_BYTES):
        end = min(begin + _SCAN_BYTES, len(data) - 2)
        found.append(np.flatnonzero((data[begin:end] == _HEAD_1) & (data[begin + 1 : end + 1] == _HEAD_2)) + begin)
    return np.concatenate([np.empty(0, np.int64), *found])


def _formats(data: Bytes, heads: Index) -> dict[int, _Format]:
    """The declarations in the log, by type."""
    starts = heads[data[heads + 2] == _FMT]
    starts = starts[starts + _FMT_LENGTH <= len(data)]
    known = {_FMT: _Format(_FMT, _FMT_LENGTH, "FMT", "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"))}
    bodies = gather(data, starts + _HEADER_BYTES, _FMT_BODY.itemsize)
    for body in sorted(np.unique(bodies, axis=0, return_index=True)[1].tolist()):
        row = bodies[body].view(_FMT_BODY)[0]
        name, letters, columns = (_text(row[field]) for field in ("name", "format", "columns"))
        # Amid damage it may be no declaration: names are printable, and no record is shorter than its head.
        if name.isalnum() and letters.isascii() and int(row["length"]) >= _HEADER_BYTES:
            fields = tuple(columns.split(",")) if columns else ()
            known.setdefault(int(row["type"]), _Format(int(row["type"]), int(row["length"]), name, letters, fields))
    return known


def _text(value: Any) -> str:
    return bytes(value).partition(b"\0")[0].decode("ascii", errors="replace")


def _lengths(formats: Mapping[int, _Format]) -> Index:
    """(256,) bytes of a record by type, 0 where there is no such type."""
    lengths = np.zeros(256, np.int64)
    for number, declared in formats.items():
        lengths[number] = declared.length
    return lengths


def _records(data: Bytes, heads: Index, formats: Mapping[int, _Format]) -> tuple[Index, Bytes]:
    """Where the records begin, and their types."""
    types = np.asarray(data[heads + 2])
    length = _lengths(formats)[types]
    known = (length > 0) & (heads + length <= len(data))
    starts, types, length = heads[known], types[known], length[known]
    if len(starts) == 0:
        return starts, types
    ends = starts + length
    following = np.searchsorted(heads, ends)
    has_next = (ends == len(data)) | (heads[np.minimum(following, len(heads) - 1)] == ends)
    # The record before damage has no successor, but begins where its predecessor ends.
    reached = np.searchsorted(starts, ends[has_next])
    reached = reached[reached < len(starts)]
    taken = has_next.copy()
    taken[reached[np.isin(starts[reached], ends[has_next])]] = True
    taken[0] |= starts[0] == 0
    starts, types, ends = starts[taken], types[taken], ends[taken]
    if bool((starts[1:] < ends[:-1]).any()):  # A3 95 inside a body that happened to fit
        keep, position = [], 0
        for index, (start, end) in enumerate(zip(starts.tolist(), ends.tolist(), strict=True)):
            if start >= position:
                keep.append(index)
                position = end
        starts, types = starts[keep], types[keep]
    return starts, types


def _rows(data: Bytes, starts: Index, layout: RecordLayout) -> npt.NDArray[np.void]:
    return gather(data, starts + _HEADER_BYTES, layout.dtype.itemsize).view(layout.dtype).reshape(len(starts))


def _layouts(
    data: Bytes, formats: Mapping[int, _Format], starts: Index, types: Bytes
) -> tuple[dict[int, RecordLayout], dict[int, str]]:
    """Layouts of the declared types, with units; and the names of those that cannot be decoded."""
    plain = {number: _layout(declared, {}, {}, "", "") for number, declared in formats.items()}
    by_name = {declared.name: number for number, declared in formats.items()}

    def rows(name: str) -> npt.NDArray[np.void] | None:
        layout = plain.get(by_name.get(name, -1))
        return None if layout is None else _rows(data, starts[types == layout.type], layout)

    labels: dict[str, str] = {}
    factors: dict[str, float] = {}
    described: dict[int, tuple[str, str]] = {}
    if (units := rows("UNIT")) is not None:
        labels = {chr(row["Id"]): _text(row["Label"]) for row in units}
    if (factor_rows := rows("MULT")) is not None:
        # Written as doubles, but they were single precision before: 7 digits are what they mean (DFReader).
        factors = {chr(row["Id"]): float(f"{row['Mult']:.7g}") for row in factor_rows}
    if (pairs := rows("FMTU")) is not None:
        described = {int(row["FmtType"]): (_text(row["UnitIds"]), _text(row["MultIds"])) for row in pairs}
    layouts = {}
    for number, declared in formats.items():
        layout = _layout(declared, labels, factors, *described.get(number, ("", "")))
        if layout is not None:
            layouts[number] = layout
    present = set(np.unique(types).tolist())
    return layouts, {n: f.name for n, f in formats.items() if n in present and n not in layouts}


def _layout(
    declared: _Format, labels: Mapping[str, str], factors: Mapping[str, float], unit_ids: str, mult_ids: str
) -> RecordLayout | None:
    """A declaration as a layout; None if it contradicts itself or has a format that we do not know."""
    unique = len(set(declared.columns)) == len(declared.columns) == len(declared.format)
    if not unique or any(letter not in _KINDS for letter in declared.format):
        return None
    dtype = np.dtype([
        (field, *kind) if isinstance(kind := _KINDS[letter], tuple) else (field, kind)
        for field, letter in zip(declared.columns, declared.format, strict=True)
    ])  # fmt: skip
    if dtype.itemsize != declared.length - _HEADER_BYTES:
        return None
    divisors = {f: _DIVISORS[c] for f, c in zip(declared.columns, declared.format, strict=True) if c in _DIVISORS}
    units = {f: labels[i] for f, i in zip(declared.columns, unit_ids, strict=False) if labels.get(i)}
    multipliers = {
        field: factors[i]
        for field, i in zip(declared.columns, mult_ids, strict=False)
        # 0 stands for "none"; where the format divides already, MULT repeats the same factor.
        if factors.get(i) and field not in divisors
    }
    instance = declared.columns[unit_ids.index("#")] if "#" in unit_ids[: len(declared.columns)] else None
    return RecordLayout(
        type=declared.type,
        name=declared.name,
        length=declared.length,
        dtype=dtype,
        divisors=MappingProxyType(divisors),
        units=MappingProxyType(units),
        multipliers=MappingProxyType(multipliers),
        instance_field=instance,
    )
