"""Read ArduPilot's on-board logs written out as text (.log), as MAVProxy and Mission Planner do, into the same columns.

A line is the name of a record and its values, parted by commas. The FMT lines declare the columns as in a .bin; the
values are those that the formats stand for: what is in hundredths in a .bin is a decimal number here, and the 32
numbers of an array stand in brackets, parted by spaces. Source: ArduPilot `libraries/AP_Logger/AP_Logger_Backend.cpp`,
pymavlink's `DFReader_text`, and for the arrays Mission Planner's `ExtLibs/Utilities/BinaryLog.cs`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.logs.dataflash import (
    NO_ROWS,
    NO_UNITS,
    DataflashLog,
    Declaration,
    RecordLayout,
    Records,
    defined_units,
    record_layout,
)
from companion.logs.logfile import MOST_BYTES, Contents
from companion.model import InputError

Lines = dict[str, tuple[list[bytes], list[int]]]
"""Name → its lines, without the name, and where each begins in the file."""

_FMT = "FMT"
_FMT_FIELDS = 5
_MOST_TYPES, _MOST_COLUMNS = 256, 64  # a .bin has at most 256 and 16; what a file says of itself needs a bound
_LONGEST_NUMBER = 48  # characters: all that is printed of a double has 24


def read_dataflash_text(
    path: str | Path,
    *,
    names: Collection[str] | None = None,
    progress: Callable[[int], None] | None = None,
    most_bytes: int = MOST_BYTES,
) -> DataflashLog:
    """Read an on-board log that was written out as text: see `read_dataflash`, whose columns it gives.

    Lines whose values are not those that were declared are left out and counted as skipped.
    Raises InputError if the file cannot be opened or declares nothing.
    """
    path = Path(path)
    contents = Contents(path, most_bytes)
    data = contents.read(progress)
    declared = _declarations(_lines(data, {_FMT})[0].get(_FMT, ([], []))[0])
    lines, skipped = _lines(data, declared.keys())
    if not declared:
        raise InputError(f"{path} begins like a DataFlash log in text, but declares no record: copy it again.")

    def rows_of(name: str) -> npt.NDArray[np.void]:
        layout = record_layout(declared[name], NO_UNITS, text=True) if name in lines else None
        return NO_ROWS if layout is None else _records(layout, *lines[name], needed=True)[0].rows

    units = defined_units(rows_of)
    messages: dict[str, Records] = {}
    undecoded: dict[str, int] = {}
    count = 0
    for name, (rows, offsets) in lines.items():
        layout = record_layout(declared[name], units, text=True)
        if layout is None:
            undecoded[name] = len(rows)
            continue
        records, left_out = _records(layout, rows, offsets, needed=names is None or name in names)
        count, skipped = count + len(records), skipped + left_out
        if len(records):
            messages[name] = records
    return DataflashLog(
        **contents.facts,
        frames=count,
        skipped_bytes=skipped,
        undecoded=MappingProxyType(undecoded),
        messages=MappingProxyType(messages),
    )


def _lines(data: bytes, names: Collection[str]) -> tuple[Lines, int]:
    """The lines of these names, and the bytes of those of others but FMT."""
    lines: Lines = {}
    others = at = 0
    while at < len(data):  # line by line: a file of nothing but their ends would be a list of a hundred times its size
        end = data.find(b"\n", at)
        end = len(data) if end < 0 else end
        head, comma, values = data[at:end].partition(b",")
        name = head.strip().decode("ascii", "replace") if comma else ""
        if name in names:
            rows, offsets = lines.setdefault(name, ([], []))
            rows.append(values)
            offsets.append(at)
        elif name != _FMT:
            others += len(values)
        at = end + 1
    return lines, others


def _declarations(rows: Sequence[bytes]) -> dict[str, Declaration]:
    """By name; of several the first, as in a .bin. No more of them, and of columns, than a log can have."""
    declared: dict[str, Declaration] = {}
    for row in rows:
        parts = [part.strip().decode("ascii", "replace") for part in row.split(b",", _FMT_FIELDS - 1)]
        if len(parts) < _FMT_FIELDS - 1 or not (_is_byte(parts[0]) and _is_byte(parts[1]) and parts[2].isalnum()):
            continue
        if len(parts[3]) > _MOST_COLUMNS or len(declared) == _MOST_TYPES:
            continue
        columns = tuple(part.strip() for part in parts[4].split(",")) if len(parts) == _FMT_FIELDS else ()
        if parts[2] != _FMT:  # whose own columns some logs leave out
            declared.setdefault(parts[2], Declaration(int(parts[0]), int(parts[1]), parts[2], parts[3], columns))
    return declared


def _is_byte(text: str) -> bool:
    return text.isdecimal() and len(text) <= 3


def _number(text: bytes) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _records(layout: RecordLayout, lines: list[bytes], starts: list[int], *, needed: bool) -> tuple[Records, int]:
    """The lines of one type as rows, and the bytes of those left out. Not `needed`: their times alone.

    starts: where each line begins in the file. What the last value of a line has commas in stays together.
    """
    count = len(layout.fields)
    parts = [[part.strip() for part in line.split(b",", count - 1)] for line in lines]
    whole = [len(row) == count for row in parts]
    fields = layout.fields if needed else tuple(name for name in (layout.clock,) if name)
    places = [layout.fields.index(name) for name in fields]
    texts = [[row[place] for row, good in zip(parts, whole, strict=True) if good] for place in places]
    del parts
    good = np.array(whole, np.bool_)
    offsets, size = (np.array(one, np.int64)[good] for one in (starts, [len(line) for line in lines]))
    columns: dict[str, npt.NDArray[Any]] = {}
    sound = np.ones(len(offsets), np.bool_)
    for name, text in zip(fields, texts, strict=True):
        columns[name], fits = _column(text, layout.dtype[name])
        sound &= fits
    dtype = np.dtype([(name, values.dtype, values.shape[1:]) for name, values in columns.items()])
    rows = np.empty(len(offsets), dtype)
    for name, values in columns.items():
        rows[name] = values
    if needed and columns:  # a mode may be a name: its column is text then
        layout = replace(layout, dtype=dtype)
    return Records(layout, offsets[sound], rows[sound]), sum(map(len, lines)) - int(size[sound].sum())


def _column(texts: list[bytes], kind: np.dtype[Any]) -> tuple[npt.NDArray[Any], npt.NDArray[np.bool_]]:
    """The values (N,) of a column, or (N, K) of arrays, and which of them are what was declared."""
    if kind.subdtype is not None:
        return _arrays(texts, *kind.subdtype)
    whole = np.ones(len(texts), np.bool_)
    if kind.kind == "S":
        return np.array(texts, kind) if texts else np.empty(0, kind), whole
    try:
        if max(map(len, texts), default=0) > _LONGEST_NUMBER:  # an array of texts has the longest one's width
            raise ValueError("one is no number")
        values = np.array(texts).astype(np.float64) if texts else np.empty(0)
    except ValueError:
        values, whole = _one_by_one(texts)
        if kind == np.uint8 and not whole.any():
            return np.array(texts, "S16"), ~whole
    if kind.kind == "f":
        return values, whole
    limits = np.iinfo(kind)
    whole = whole & (values >= limits.min) & (values < limits.max + 1)  # which a double is too, of 64 bits
    return np.where(whole, values, 0.0).astype(kind), whole


def _arrays(
    texts: list[bytes], kind: np.dtype[Any], shape: tuple[int, ...]
) -> tuple[npt.NDArray[Any], npt.NDArray[np.bool_]]:
    """Whole numbers in brackets."""
    values, good = np.zeros((len(texts), *shape), kind), np.zeros(len(texts), np.bool_)
    for i, text in enumerate(texts):
        parts = text.strip(b"[] ").split()
        if len(parts) == shape[0] and max(map(len, parts)) <= _LONGEST_NUMBER:
            row, whole = _column(parts, kind)
            if whole.all():
                values[i], good[i] = row, True
    return values, good


def _one_by_one(texts: list[bytes]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    numbers = [_number(text) for text in texts]
    good = np.array([number is not None for number in numbers], np.bool_)
    return np.array([number or 0.0 for number in numbers]), good
