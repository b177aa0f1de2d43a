"""Small PX4 ULogs of given topics, for what no recording has: old firmware, FIFOs, damage.

Format: https://docs.px4.io/main/en/dev_log/ulog_file_format.html.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

_TYPES = {
    "uint64": "uint64_t", "int64": "int64_t", "uint32": "uint32_t", "int32": "int32_t", "uint16": "uint16_t",
    "int16": "int16_t", "uint8": "uint8_t", "int8": "int8_t", "float32": "float", "float64": "double", "bool": "bool",
}  # fmt: skip

Fields = Mapping[str, npt.NDArray[Any]]
"""Field → (N,) or for an array (N, k); a field `timestamp` in µs as uint64 among them."""


def ulog(
    topics: Mapping[str, Fields], parameters: Mapping[str, float] | None = None, version: tuple[int, int] = (1, 16)
) -> bytes:
    """A log of topics by name ("sensor_gps", its second instance "sensor_gps:1"), of a PX4 of this version."""
    release = version[0] << 24 | version[1] << 16
    log = head()
    log += message(b"B", bytes(40))
    log += message(b"I", key("uint32_t ver_sw_release") + struct.pack("<I", release))
    for name, value in (parameters or {}).items():
        whole = isinstance(value, int)
        log += message(
            b"P", key(f"{'int32_t' if whole else 'float'} {name}") + struct.pack("<i" if whole else "<f", value)
        )
    formats = {name.partition(":")[0]: fields for name, fields in topics.items()}
    for name, fields in formats.items():
        declared = "".join(f"{_declared(field, values)};" for field, values in fields.items())
        log += message(b"F", f"{name}:{declared}".encode())
    for number, name in enumerate(topics):
        topic, _, instance = name.partition(":")
        log += message(b"A", struct.pack("<BH", int(instance or 0), number) + topic.encode())
    for number, fields in enumerate(topics.values()):
        for row in _rows(fields):
            log += message(b"D", struct.pack("<H", number) + row)
    return log


def head(begun_us: int = 0) -> bytes:
    """What a log begins with."""
    return b"ULog\x01\x12\x35\x01" + struct.pack("<Q", begun_us)


def message(kind: bytes, body: bytes) -> bytes:
    """A message of a type, as it stands in a log."""
    return struct.pack("<H", len(body)) + kind + body


def key(name: str) -> bytes:
    """The type and name of a setting, with their length."""
    return bytes([len(name)]) + name.encode()


def _declared(field: str, values: npt.NDArray[Any]) -> str:
    size = "" if values.ndim == 1 else f"[{values.shape[1]}]"
    return f"{_TYPES[values.dtype.name]}{size} {field}"


def _rows(fields: Fields) -> list[bytes]:
    layout = np.dtype([(name, values.dtype, values.shape[1:]) for name, values in fields.items()])
    rows = np.empty(len(next(iter(fields.values()))), layout)
    for name, values in fields.items():
        rows[name] = values
    return [row.tobytes() for row in rows]
