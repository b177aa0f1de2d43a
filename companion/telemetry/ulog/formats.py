"""What a ULog declares, bounded by what a message can hold, before anything is made of it.

A definition may name another as a field, and that a third: eight lines stand for 200^8 fields. A message of the log has
65,535 bytes at most, and every field at least one.
"""

from __future__ import annotations

import re
from pathlib import Path

from companion.model import InputError

_HEADER_BYTES = 16
_MOST_BYTES = 65_535
_MOST_DEEP = 32
_SIZES = {
    "int8_t": 1, "uint8_t": 1, "bool": 1, "char": 1, "int16_t": 2, "uint16_t": 2, "int32_t": 4, "uint32_t": 4,
    "float": 4, "int64_t": 8, "uint64_t": 8, "double": 8,
}  # fmt: skip
_FIELD = re.compile(r"(\w+)(?:\[(\d{1,9})\])?\s+\w+")


def check_formats(path: Path, contents: bytes) -> None:
    """Raises InputError when a definition is larger than any message can be, or has itself as a part."""
    formats = _formats(contents)
    sizes: dict[str, int] = {}
    for name in formats:
        if _size(name, formats, sizes, 0) > _MOST_BYTES:
            raise InputError(
                f"{path} begins like a PX4 ULog, but declares {name!r} with more bytes than a message can have: its "
                "definitions are damaged. Copy it again."
            )


def _size(name: str, formats: dict[str, str], sizes: dict[str, int], depth: int) -> int:
    """Bytes of a type; more than a message can have for one that is too large, too deep or a part of itself."""
    if name in _SIZES:
        return _SIZES[name]
    if depth > _MOST_DEEP:
        return _MOST_BYTES + 1
    if name not in sizes:
        total = 0
        for kind, count in _FIELD.findall(formats.get(name, "")):
            total += _size(kind, formats, sizes, depth + 1) * int(count or 1)
            if total > _MOST_BYTES:
                break
        sizes[name] = min(total, _MOST_BYTES + 1)
    return sizes[name]


def _formats(contents: bytes) -> dict[str, str]:
    """Name → fields, of the definitions at the head of the file."""
    formats: dict[str, str] = {}
    at = _HEADER_BYTES
    while at + 3 <= len(contents):
        size, kind = int.from_bytes(contents[at : at + 2], "little"), contents[at + 2 : at + 3]
        if kind in (b"A", b"L"):  # the data begins
            break
        if kind == b"F":
            name, _, fields = contents[at + 3 : at + 3 + size].decode("utf-8", "replace").partition(":")
            formats[name] = fields
        at += 3 + size
    return formats
