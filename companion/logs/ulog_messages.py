"""The messages of a ULog but for its data: definitions, settings, texts and marks, each as what it says.

A message is its size (uint16), its type (a letter) and a body of that size.
Source: https://docs.px4.io/main/en/dev_log/ulog_file_format.html

Also here: what a ULog declares of its topics: the fields of each message, as a packed structure.

A format is `name:type field;type[8] field;...`, and a type may be another format: eight lines can stand for 200^8
fields, so sizes are known before a structure is made. PX4 leaves out the padding at the end of a message; what lies
between fields is a field of its own.
Source: https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

from __future__ import annotations

import re
import string
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

MOST_BYTES = 65_535
"""Of a message: its size has 16 bits."""

_KINDS: Mapping[str, np.dtype[Any]] = {name: np.dtype(code) for name, code in {
    "int8_t": "<b", "uint8_t": "<B", "int16_t": "<h", "uint16_t": "<H", "int32_t": "<i", "uint32_t": "<I",
    "int64_t": "<q", "uint64_t": "<Q", "float": "<f", "double": "<d", "bool": "<b", "char": "<b",
}.items()}  # fmt: skip
"""Of the basic types. A bool is a byte: damage makes others than 0 and 1."""

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


class Formats:
    """The definitions of a log so far. Of two of one name the first holds."""

    def __init__(self) -> None:
        self._fields: dict[str, tuple[Field, ...]] = {}
        self._bytes = {name: kind.itemsize for name, kind in _KINDS.items()}
        self._dtypes: dict[str, np.dtype[Any]] = dict(_KINDS)

    def add(self, name: str, fields: tuple[Field, ...]) -> None:
        self._fields.setdefault(name, fields)

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
            shortest += self._bytes[kind] * max(count, 1)
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
            size = self._bytes.get(kind) or self._size(kind, depth + 1)
            if size == 0:
                return 0
            total += size * max(count, 1)
        self._bytes[name] = min(total, MOST_BYTES + 1)
        return self._bytes[name]


def placed(dtype: np.dtype[Any], field: str) -> tuple[np.dtype[Any], int] | None:
    """Kind and place of a basic field of a structure, as PX4's tools write it: `x`, `q[0]`, `esc[1].rpm`; or None."""
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


Value = int | float | str | bytes
"""Bytes for an array, for a type that is none, and for a value that has not the size of its type."""


class Flags(NamedTuple):
    """B: what a reader has to know, first in the file."""

    incompatible: bytes  # (8,)
    appended: tuple[int, ...]  # where data begins that was added later, as after a crash


class Format(NamedTuple):
    """F: the fields of a type."""

    name: str
    fields: tuple[Field, ...]


class Subscription(NamedTuple):
    """A: from here on, data of this number are of a topic."""

    number: int
    topic: str
    instance: int


class Unsubscription(NamedTuple):
    """R: from here on, they are no more."""

    number: int


class Info(NamedTuple):
    """I: what the log says of the vehicle."""

    name: str
    value: Value


class Parameter(NamedTuple):
    """P: a value that was set."""

    name: str
    value: Value


class LoggedText(NamedTuple):
    """L, and with a tag C."""

    stamp: int  # µs, boot clock
    level: int  # 0 emergency to 7 debug
    text: str


class Dropout(NamedTuple):
    """O: what was lost because the logger could not keep up."""

    duration_ms: int


class Unread(NamedTuple):
    """M: infos of which there may be several. Q: values by default. S: a mark by which a reader finds its way again."""


Message = Flags | Format | Subscription | Unsubscription | Info | Parameter | LoggedText | Dropout | Unread

DATA = ord("D")
SYNC = bytes.fromhex("2F731320250CBB12")

_KEY = re.compile(rb"(\w+)(\[\d*\])? ([!-~]+)")
_LEVELS = range(ord("0"), ord("8"))
_LEAST_KEY = 4  # its length, and "a b"
_MOST_NAME = 255


def parsed_message(kind: int, body: bytes) -> Message | None:
    """What a message that is no data says; None where it is of no known type, or its body none of that type."""
    one = MESSAGE_TYPES.get(kind)
    if one is None or not one.least <= len(body) <= one.most or body[0] not in one.first:
        return None
    return one.parse(body)


def _format(body: bytes) -> Format | None:
    name, _, declared = _text(body).partition(":")
    if not declared or not NAME.fullmatch(name):
        return None
    fields = [_FIELD.fullmatch(field) for field in declared.rstrip(";").split(";")]
    kept = tuple((match[1], int(match[2] or 0), match[3]) for match in fields if match and match[2] != "0")
    return Format(name, kept) if len(kept) == len(fields) else None


def _subscription(body: bytes) -> Subscription | None:
    instance, number = struct.unpack_from("<BH", body)
    topic = _text(body[3:])
    return Subscription(number, topic, instance) if NAME.fullmatch(topic) else None


def _named(body: bytes, *, of: type[Info] | type[Parameter]) -> Info | Parameter | None:
    pair = _key_and_value(body)
    return None if pair is None else of(*pair)


def _unread(body: bytes) -> Unread | None:
    return None if _key_and_value(body[1:]) is None else Unread()


def _logged(body: bytes, *, begin: int) -> LoggedText:
    """begin: of its time, behind the level and the tag."""
    stamp = int.from_bytes(body[begin : begin + 8], "little")
    return LoggedText(stamp, body[0] - ord("0"), _text(body[begin + 8 :]))


class MessageType(NamedTuple):
    """What the body of a message can be, and how it is read."""

    least: int  # bytes
    most: int
    parse: Callable[[bytes], Message | None]  # None for what the body of no such message can be
    first: Sequence[int] = range(256)  # what it can begin with


MESSAGE_TYPES: Mapping[int, MessageType] = {
    ord(letter): one
    for letter, one in {
        "B": MessageType(
            40, 255, lambda body: Flags(body[8:16], tuple(at for at in struct.unpack_from("<3Q", body, 16) if at))
        ),
        "F": MessageType(6, MOST_BYTES, _format, b"/-_0123456789" + string.ascii_letters.encode()),
        "A": MessageType(4, 3 + _MOST_NAME, _subscription),
        "R": MessageType(2, 2, lambda body: Unsubscription(int.from_bytes(body, "little"))),
        "I": MessageType(_LEAST_KEY, MOST_BYTES, partial(_named, of=Info)),
        "M": MessageType(1 + _LEAST_KEY, MOST_BYTES, _unread, b"\0\1"),
        "P": MessageType(_LEAST_KEY, 1024, partial(_named, of=Parameter)),
        "Q": MessageType(1 + _LEAST_KEY, 1024, _unread, range(1, 256)),
        "L": MessageType(9, MOST_BYTES, partial(_logged, begin=1), _LEVELS),
        "C": MessageType(11, MOST_BYTES, partial(_logged, begin=3), _LEVELS),
        "O": MessageType(2, 2, lambda body: Dropout(int.from_bytes(body, "little"))),
        "S": MessageType(8, 8, lambda body: Unread() if body == SYNC else None, SYNC[:1]),
        "D": MessageType(2, MOST_BYTES, lambda _: None),  # of topics: see `Collector`
    }.items()
}


def _key_and_value(body: bytes) -> tuple[str, Value] | None:
    """The length of the key, "type name", and the value."""
    end = 1 + body[0] if body else 1
    match = _KEY.fullmatch(body, 1, end) if end <= len(body) else None
    if match is None:
        return None
    kind, array, name = match.groups()
    return name.decode(), _value(kind.decode(), array is not None, body[end:])


def _value(kind: str, array: bool, raw: bytes) -> Value:
    if array:
        return _text(raw) if kind == "char" else raw
    one = _KINDS.get(kind)
    if one is None or one.itemsize != len(raw):
        return raw
    value: int | float = np.frombuffer(raw, one).item()
    return value


def _text(raw: bytes) -> str:
    return raw.decode("utf-8", "replace")
