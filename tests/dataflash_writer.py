"""Writes small on-board logs of ArduPilot, for what no recording beside the project has."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping
from pathlib import Path

_LETTERS = {
    "a": "64s",
    "b": "b", "B": "B", "c": "h", "C": "H", "d": "d", "e": "i", "E": "I", "f": "f", "h": "h", "H": "H", "i": "i",
    "I": "I", "L": "i", "M": "B", "n": "4s", "N": "16s", "Q": "Q", "Z": "64s",
}  # fmt: skip
_FMT = ("BBnNZ", "Type,Length,Name,Format,Columns")


def write_dataflash(
    path: Path, types: Mapping[str, tuple[str, str]], rows: Iterable[tuple[str, tuple[object, ...]]]
) -> Path:
    """A .bin with the declarations of `types` (name → format letters, columns), and then the rows: name, raw values."""
    numbers = {"FMT": 128} | {name: number for number, name in enumerate(types, 1)}
    packed = {
        name: "<" + "".join(_LETTERS[c] for c in letters) for name, (letters, _) in ({"FMT": _FMT} | {**types}).items()
    }
    data = bytearray()

    def add(name: str, values: tuple[object, ...]) -> None:
        values = tuple(value.encode() if isinstance(value, str) else value for value in values)
        data.extend(bytes([0xA3, 0x95, numbers[name]]) + struct.pack(packed[name], *values))

    for name, (letters, columns) in ({"FMT": _FMT} | {**types}).items():
        add("FMT", (numbers[name], 3 + struct.calcsize(packed[name]), name, letters, columns))
    for name, values in rows:
        add(name, values)
    path.write_bytes(data)
    return path
