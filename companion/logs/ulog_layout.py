"""What a ULog declares of its topics: the fields of each message, as a packed structure.

A format is `name:type field;type[8] field;...`, and a type may be another format: eight lines can stand for 200^8
fields, so sizes are known before a structure is made. PX4 leaves out the padding at the end of a message; what lies
between fields is a field of its own.
Source: https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

MOST_BYTES = 65_535
"""Of a message: its size has 16 bits."""

CODES: Mapping[str, str] = {
    "int8_t": "<b", "uint8_t": "<B", "int16_t": "<h", "uint16_t": "<H", "int32_t": "<i", "uint32_t": "<I",
    "int64_t": "<q", "uint64_t": "<Q", "float": "<f", "double": "<d", "bool": "<b", "char": "<b",
}  # fmt: skip
"""Basic type → its kind, for `struct` and NumPy alike. A bool is a byte: damage makes others than 0 and 1."""

_KINDS: Mapping[str, np.dtype[Any]] = {name: np.dtype(code) for name, code in CODES.items()}
_MOST_DEEP = 32
NAME = re.compile(r"[\w/-]+", re.ASCII)
_FIELD = re.compile(r"([\w/-]+)(?:\[(\d{1,9})\])? (\w+)", re.ASCII)
_PART = re.compile(r"(\w+)(?:\[(\d{1,5})\])?", re.ASCII)
_STAMP, _PADDING = "timestamp", "_padding"

Field = tuple[str, int, str]
"""Type, elements (0: it is no array) and name."""


@dataclass(frozen=True, slots=True)
class TopicLayout:
    """How a message of a topic lies behind the number of its subscription."""

    name: str  # "vehicle_imu"
    shortest: int  # bytes, without the padding at the end
    longest: int  # and with it
    stamp: int | None  # where its time lies, µs of the boot clock as uint64; None without one


def parsed_format(text: str) -> tuple[str, tuple[Field, ...]] | None:
    """Name and fields of a definition; None where it is none."""
    name, _, declared = text.partition(":")
    if not declared or not NAME.fullmatch(name):
        return None
    fields = [_FIELD.fullmatch(field) for field in declared.rstrip(";").split(";")]
    kept = tuple((match[1], int(match[2] or 0), match[3]) for match in fields if match and match[2] != "0")
    return (name, kept) if len(kept) == len(fields) else None


class Formats:
    """The definitions of a log so far. Of two of one name the first holds."""

    def __init__(self) -> None:
        self._fields: dict[str, tuple[Field, ...]] = {}
        self._bytes = {name: kind.itemsize for name, kind in _KINDS.items()}
        self._dtypes: dict[str, np.dtype[Any]] = dict(_KINDS)

    def add(self, name: str, fields: tuple[Field, ...]) -> None:
        self._fields.setdefault(name, fields)

    def __contains__(self, name: object) -> bool:
        return name in self._fields

    def too_large(self) -> Iterator[str]:
        """Names of those that no message can hold, or that are part of themselves."""
        return (name for name in self._fields if self._size(name, 0) > MOST_BYTES)

    def layout(self, name: str) -> TopicLayout | None:
        """The layout of a topic; None if it is not declared, nor all of its parts, or no message can hold it."""
        longest = self._size(name, 0)
        if name not in self._fields or not 0 < longest <= MOST_BYTES - 2:
            return None
        shortest, stamp = 0, None
        for kind, count, field in self._unpadded(name):
            if (kind, count, field) == ("uint64_t", 0, _STAMP):
                stamp = shortest
            shortest += self._size(kind, 0) * max(count, 1)
        return TopicLayout(name, shortest, longest, stamp)

    def dtype(self, name: str) -> np.dtype[Any] | None:
        """The structure of a topic that has a layout, without the padding at its end; None where two fields have one
        name.
        """
        try:
            return self._structure(self._unpadded(name))
        except ValueError:
            return None

    def _structure(self, fields: tuple[Field, ...]) -> np.dtype[Any]:
        parts: list[Any] = []
        for kind, count, field in fields:
            if kind not in self._dtypes:
                self._dtypes[kind] = self._structure(self._fields[kind])
            parts.append((field, self._dtypes[kind], (count,)) if count else (field, self._dtypes[kind]))
        return np.dtype(parts)

    def _unpadded(self, name: str) -> tuple[Field, ...]:
        fields = self._fields[name]
        while fields and fields[-1][2].startswith(_PADDING):
            fields = fields[:-1]
        return fields

    def _size(self, name: str, depth: int) -> int:
        """Bytes of a type; 0 where a part is not declared, more than a message can have where it is too deep."""
        if name in self._bytes or name not in self._fields:
            return self._bytes.get(name, 0)
        total = MOST_BYTES + 1 if depth > _MOST_DEEP else 0
        for kind, count, _ in self._fields[name]:
            if total > MOST_BYTES:
                break
            size = self._size(kind, depth + 1)
            if size == 0:
                return 0
            total += size * max(count, 1)
        self._bytes[name] = min(total, MOST_BYTES + 1)
        return self._bytes[name]


def flat_names(dtype: np.dtype[Any], prefix: str = "") -> Iterator[str]:
    """Each basic field of a structure as PX4's tools write it: `x`, `q[0]`, `esc[1].rpm`."""
    for name in dtype.names or ():
        kind, shape = dtype[name].base, dtype[name].shape
        for own in [f"{prefix}{name}[{i}]" for i in range(shape[0])] if shape else [f"{prefix}{name}"]:
            yield from [own] if kind.names is None else flat_names(kind, f"{own}.")


def placed(dtype: np.dtype[Any], field: str) -> tuple[np.dtype[Any], int] | None:
    """Kind and place of such a basic field; None where there is none."""
    at = 0
    for part in field.split("."):
        match = _PART.fullmatch(part)
        if match is None or match[1] not in (dtype.fields or {}):
            return None
        kind, offset = dtype.fields[match[1]][:2]  # type: ignore[index]
        if (match[2] is not None) != bool(kind.shape) or (kind.shape and int(match[2]) >= kind.shape[0]):
            return None
        dtype = kind.base
        at += offset + dtype.itemsize * int(match[2] or 0)
    return None if dtype.names else (dtype, at)
