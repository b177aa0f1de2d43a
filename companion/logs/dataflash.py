"""Read ArduPilot's on-board logs (DataFlash, .bin) as columns, by the layouts and units that each log carries itself.

A record is A3 95, a type byte and a body. Type 128 (FMT) declares the length, name, format letters and columns of a
type; FMTU gives for each column the letter of a unit and of a multiplier, which UNIT and MULT spell out; the unit "#"
marks the column that tells several sensors apart. There is no checksum: a record is taken if another begins exactly
behind it, or if it begins exactly behind such a one. One that stands alone amid damage is not: a false IMU sample costs
more than a lost one.
Source: ArduPilot `libraries/AP_Logger/LogStructure.h`, `README.md`, and pymavlink's `DFReader`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.logs.logfile import MOST_BYTES, Contents, LogFile, Mapped, log_format, read_head
from companion.mavlink import Bytes, Index, as_bytes, first_come, gather
from companion.model import InputError

HEADER_BYTES = 3
FMT = 128

_KINDS: dict[str, Any] = {
    "a": ("<i2", (32,)), "b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8", "Q": "<u8",
    "f": "<f4", "d": "<f8", "g": "<f2", "n": "S4", "N": "S16", "Z": "S64", "M": "u1",
    "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4",
}  # fmt: skip
_IN_TEXT: dict[str, Any] = {letter: "<f8" if letter in "fdgcCeEL" else kind for letter, kind in _KINDS.items()}
"""The same where the values are written out: hundredths are decimal numbers then."""

_INSTANCES = ("Instance", "I", "C", "IMU")  # a sensor, a core of the EKF: what ArduPilot calls those columns
_CLOCKS = {"TimeUS": 1e-6, "TimeMS": 1e-3, "T": 1e-3}
"""Columns with the time since boot → s."""

# Formats in hundredths, or ten-millionths of a degree: divided, not multiplied, which is the more exact (DFReader).
_DIVISORS = {"c": 100.0, "C": 100.0, "e": 100.0, "E": 100.0, "L": 1e7}


@dataclass(frozen=True, slots=True, eq=False)
class RecordLayout:
    """How one type of record lies in this log."""

    type: int  # the byte behind A3 95
    name: str  # "IMU"
    dtype: np.dtype[np.void]  # packed, little endian, of the body, behind the header of 3 bytes
    divisors: Mapping[str, float]  # field -> 100 or 1e7 where the format says so; absent: none
    units: Mapping[str, str]  # field -> label of the log's UNIT record ("s", "rad/s", "m/s/s"); absent: none
    multipliers: Mapping[str, float]  # field -> what makes a value one in that unit (TimeUS: 1e-6); absent: 1
    instance_field: str | None  # the column that says which of several sensors or cores ("I", "C"); None: only one
    clock: str  # the column with the time since boot: "TimeUS", in logs before 2015 "TimeMS"; "" without one

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the columns, in order."""
        return self.dtype.names or ()

    def kind(self, field: str) -> str:
        """What a column holds, as NumPy calls it: "i", "u", "f" or "S"; "V" for an array, "" without such a column."""
        return self.dtype[field].kind if field in self.fields else ""

    def has_numbers(self, *fields: str) -> bool:
        """Whether there are such columns, each with a number in every record."""
        return all(self.kind(field) in tuple("iuf") for field in fields)


@dataclass(frozen=True, slots=True)
class Declaration:
    """What an FMT record declares."""

    type: int
    length: int
    name: str
    format: str
    columns: tuple[str, ...]


_FMT_BODY = np.dtype([("type", "u1"), ("length", "u1"), ("name", "S4"), ("format", "S16"), ("columns", "S64")])
_FMT_LENGTH = HEADER_BYTES + _FMT_BODY.itemsize
_ALPHANUMERIC = np.array([chr(i).isalnum() and i < 128 for i in range(256)])
_FMT_BLOCK = 1 << 16  # heads looked at together


def declarations(data: Bytes, starts: Index) -> dict[int, Declaration]:
    """The declarations in the log, by type; starts: where an FMT record may begin."""
    starts = starts[starts + _FMT_LENGTH <= len(data)]
    known = {FMT: Declaration(FMT, _FMT_LENGTH, "FMT", "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"))}
    needed = np.ones(256, np.bool_)  # types without a declaration so far: a log that is full of them takes no longer
    needed[FMT] = False
    for begin in range(0, len(starts), _FMT_BLOCK):
        block = starts[begin : begin + _FMT_BLOCK]
        block = block[needed[data[block + HEADER_BYTES]]]
        rows = _gather_rows(data, block, _FMT_BODY)
        rows = rows[_may_declare(rows)]
        for index in sorted(np.unique(rows["type"], return_index=True)[1].tolist()):
            row = rows[index]
            name, letters, columns = (_text(row[field]) for field in ("name", "format", "columns"))
            fields = tuple(columns.split(",")) if columns else ()
            known[int(row["type"])] = Declaration(int(row["type"]), int(row["length"]), name, letters, fields)
            needed[int(row["type"])] = False
    return known


def _may_declare(rows: npt.NDArray[np.void]) -> npt.NDArray[np.bool_]:
    """Which bodies (N,) declare a type. Amid damage some do not: names are printable, and no record is shorter than
    its head.
    """
    name, letters = (
        np.ascontiguousarray(rows[field]).view(np.uint8).reshape(len(rows), _FMT_BODY[field].itemsize)
        for field in ("name", "format")
    )
    named = _ALPHANUMERIC[name] | (np.cumsum(name == 0, axis=1) > 0)  # behind a NUL anything may stand
    plain = (letters < 128) | (np.cumsum(letters == 0, axis=1) > 0)
    return np.asarray(
        _ALPHANUMERIC[name[:, 0]] & named.all(axis=1) & plain.all(axis=1) & (rows["length"] >= HEADER_BYTES)
    )


def _text(value: Any) -> str:
    return bytes(value).partition(b"\0")[0].decode("ascii", errors="replace")


def _record_lengths(formats: Mapping[int, Declaration]) -> Index:
    """(256,) bytes of a record by type, 0 where there is no such type."""
    lengths = np.zeros(256, np.int64)
    lengths[list(formats)] = [declared.length for declared in formats.values()]
    return lengths


def _gather_rows(data: Bytes, starts: Index, dtype: np.dtype[np.void]) -> npt.NDArray[np.void]:
    """The bodies of the records that begin at `starts` (N,), as rows (N,) of dtype."""
    return gather(data, starts + HEADER_BYTES, dtype.itemsize).view(dtype).reshape(len(starts))


def _record_layouts(
    data: Bytes, formats: Mapping[int, Declaration], starts: Index, types: Bytes
) -> tuple[dict[int, RecordLayout], dict[int, str]]:
    """Layouts of the declared types, with units; and the names of those that cannot be decoded."""
    by_name = {declared.name: declared for declared in formats.values()}

    def rows(name: str) -> npt.NDArray[np.void]:
        layout = record_layout(by_name[name], NO_UNITS) if name in by_name else None
        return NO_ROWS if layout is None else _gather_rows(data, starts[types == layout.type], layout.dtype)

    units = defined_units(rows)
    layouts = {n: layout for n, one in formats.items() if (layout := record_layout(one, units)) is not None}
    present = set(np.unique(types).tolist())
    return layouts, {n: f.name for n, f in formats.items() if n in present and n not in layouts}


@dataclass(frozen=True, slots=True)
class Units:
    """What a log says of units."""

    labels: Mapping[str, str]  # letter → "rad/s"
    factors: Mapping[str, float]  # letter → what makes a value one in its unit
    letters: Mapping[int, tuple[str, str]]  # type → the letters of its columns' units, and of their factors


NO_UNITS = Units({}, {}, {})
NO_ROWS = np.empty(0, np.dtype([]))


def defined_units(rows: Callable[[str], npt.NDArray[np.void]]) -> Units:
    """What UNIT, MULT and FMTU say; rows: those of a type, `NO_ROWS` where there is none."""

    def columns(name: str, **kinds: str) -> Iterator[tuple[Any, ...]]:
        """These columns of each row; none where damage made others of them."""
        of_type = rows(name)
        known = {field: of_type.dtype[field].kind for field in of_type.dtype.names or ()}
        if all(known.get(field, "") in tuple(kind) for field, kind in kinds.items()):
            yield from zip(*(of_type[field].tolist() for field in kinds), strict=True)

    return Units(
        {chr(number % 256): _text(label) for number, label in columns("UNIT", Id="iu", Label="S")},
        # Written as doubles, but they were single precision before: 7 digits are what they mean (DFReader).
        {chr(number % 256): float(f"{factor:.7g}") for number, factor in columns("MULT", Id="iu", Mult="f")},
        {
            number: (_text(units), _text(factors))
            for number, units, factors in columns("FMTU", FmtType="iu", UnitIds="S", MultIds="S")
        },
    )


def record_layout(declared: Declaration, defined: Units, *, text: bool = False) -> RecordLayout | None:
    """A declaration as a layout; None if it contradicts itself or has a format that we do not know.

    text: of values that are written out.
    """
    kinds = _IN_TEXT if text else _KINDS
    unique = len(set(declared.columns)) == len(declared.columns) == len(declared.format)
    if not unique or "" in declared.columns or any(letter not in kinds for letter in declared.format):
        return None
    dtype = np.dtype([
        (field, *kind) if isinstance(kind := kinds[letter], tuple) else (field, kind)
        for field, letter in zip(declared.columns, declared.format, strict=True)
    ])  # fmt: skip
    if not text and dtype.itemsize != declared.length - HEADER_BYTES:
        return None
    labels, factors = defined.labels, defined.factors
    unit_ids, mult_ids = defined.letters.get(declared.type, ("", ""))
    divisors = {f: _DIVISORS[c] for f, c in zip(declared.columns, declared.format, strict=True) if c in _DIVISORS}
    units = {f: labels[i] for f, i in zip(declared.columns, unit_ids, strict=False) if labels.get(i)}
    multipliers = {
        field: factors[i]
        for field, i in zip(declared.columns, mult_ids, strict=False)
        # 0 stands for "none"; where the format divides already, MULT repeats the same factor.
        if factors.get(i) and field not in divisors
    }
    clock = _clock(dtype)
    if clock:  # whatever FMTU says of it, or does not say: logs before 2018 have none
        units[clock], multipliers[clock] = "s", _CLOCKS[clock]
    if unit_ids:
        instance = next((f for f, i in zip(declared.columns, unit_ids, strict=False) if i == "#"), None)
    else:
        instance = next((f for f in _INSTANCES if f in declared.columns), None)
    if instance is not None and dtype[instance].kind not in "iu":
        instance = None
    return RecordLayout(
        type=declared.type,
        name=declared.name,
        dtype=dtype,
        divisors=MappingProxyType({} if text else divisors),
        units=MappingProxyType(units),
        multipliers=MappingProxyType(multipliers),
        instance_field=instance,
        clock=clock,
    )


def _clock(dtype: np.dtype[np.void]) -> str:
    names = dtype.names or ()
    clock = next((n for n in ("TimeUS", "TimeMS") if n in names and dtype[n].kind in "iu"), "")
    # GPS of old firmware: TimeMS is the receiver's time of the week, and T that of the autopilot.
    return "T" if clock == "TimeMS" and "T" in names and dtype["T"].kind in "iu" else clock


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
    layouts, undecoded = _record_layouts(mapped.data, formats, starts, types)
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
    skipped = len(mapped.data) - int(np.bincount(types, minlength=256) @ _record_lengths(formats))
    count, left_out = len(starts), {name: int((types == number).sum()) for number, name in undecoded.items()}
    del starts, groups
    _fill(mapped, messages)
    return DataflashLog(
        **contents.facts,
        frames=count,
        skipped_bytes=skipped,
        undecoded=MappingProxyType(left_out),
        messages=MappingProxyType(messages),
    )


def _times(layout: RecordLayout) -> np.dtype[np.void]:
    """Of a type that is not requested: its time, which all but a few have as their first field."""
    if not layout.clock:
        return np.dtype([])
    kind, offset = layout.dtype.fields[layout.clock][:2]  # type: ignore[index]
    return np.dtype(
        {"names": [layout.clock], "formats": [kind], "offsets": [offset], "itemsize": offset + kind.itemsize}
    )


def _fill(mapped: Mapped, messages: Mapping[str, Records]) -> None:
    """Gather the rows part by part of the file, so that no more than a part of it has to be in memory."""
    for begin in range(0, len(mapped.data), _PART_BYTES):
        end = begin + _PART_BYTES
        for records in messages.values():
            if records.rows.dtype.itemsize:
                part = slice(*np.searchsorted(records.offset, (begin, end)).tolist())
                rows = _gather_rows(mapped.data, records.offset[part], records.rows.dtype)
                as_bytes(records.rows)[part] = as_bytes(rows)
        mapped.release(begin, end)


def _find(mapped: Mapped) -> tuple[Index, Bytes, dict[int, Declaration]]:
    """Where the records begin, their types, and what the log declares of those."""
    heads, types = _heads(mapped)
    formats = declarations(mapped.data, heads[types == FMT])
    taken = _are_records(heads, _record_lengths(formats)[types], len(mapped.data))
    starts, types = heads[taken], types[taken]
    keep = first_come(starts, starts + _record_lengths(formats)[types])  # A3 95 inside a body sometimes fits
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
