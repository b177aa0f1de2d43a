"""The head of every document, and the conversion of results to plain JSON values.

docs/json.md describes each key, and a test holds them: keys are added, never renamed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from companion.app.recording import Source
from companion.model import Flight

Document = dict[str, Any]
"""Keys as they are printed. Values are plain (numbers, text, lists, dictionaries, None)."""

SCHEMA = 2


def document(source: Source, flights: list[Document], **more: Any) -> Document:
    """A document about flights of one log; more: keys of its own."""
    log = of(source, "size_bytes", "frames", "bad_crc_frames", "skipped_bytes", "content_bytes", "trouble")
    path = str(source.path).encode("utf-8", "replace").decode()  # a name need not be UTF-8, JSON has to be
    return plain({"schema": SCHEMA, "log": {"path": path, **log}, "flights": flights, **more})


def of(one: object, *names: str) -> Document:
    """Some attributes of an object under their own names."""
    return {name: getattr(one, name) for name in names}


def flight_head(flight: Flight) -> Document:
    """Which flight it is."""
    return {"vehicle": flight.vehicle, "boot": flight.boot}


def plain(document: Document) -> Document:
    """The same of plain values: dataclasses become dictionaries with their fields as keys, arrays become lists."""
    builtins: Document = msgspec.to_builtins(document, enc_hook=_plain)
    return builtins


def encode(document: Document) -> str:
    """Indented JSON text. Non-finite numbers become null."""
    return msgspec.json.format(msgspec.json.encode(document), indent=2).decode()


def _plain(value: object) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, Sequence):  # what a flight works out when it is first looked at
        return list(value)
    raise TypeError(f"a document has no {type(value).__name__}")
