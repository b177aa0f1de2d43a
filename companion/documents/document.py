"""The head of every document, the conversion of results to plain JSON values, and what is in a log.

The documents of `companion info --json` and `companion series --json`. docs/json.md describes each key, and a test
holds them: keys are added, never renamed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from companion.analysis import inventory, phases
from companion.app.recording import Recording, Source
from companion.model import Flight, SensorInUse

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


def info_document(recording: Recording) -> Document:
    """What is in a log."""
    return document(
        recording.source,
        [_flight(flight) for flight in recording.flights],
        others=[of(other, "sysid", "compid", "reason") for other in recording.bystanders],
        crowd=recording.unread_senders,
        unknown_frames={str(number): count for number, count in recording.source.unknown_frames.items()},
    )


def _flight(flight: Flight) -> Document:
    return {
        **flight_head(flight),
        "start_s": flight.start,
        "duration_s": flight.duration,
        "default_imu": flight.default_imu,
        "reference": reference(flight),
        "notes": flight.notes,
        "phases": [
            {"kind": part.kind, "start_s": part.start, "end_s": part.end, "reason": part.reason}
            for part in phases(flight)
        ],
        "sensors": inventory(flight),
        "imu_in_use": None if flight.imu_in_use is None else _in_use(flight.imu_in_use),
        "aiding_in_use": {kind: _in_use(used) for kind, used in flight.aiding_in_use.items()},
        "resets": [{"t_s": reset.t, **of(reset, "kind", "text", "core")} for reset in flight.resets],
        "parameter_changes": [{"t_s": one.t, **of(one, "name", "value")} for one in flight.parameter_changes],
        "messages": flight.messages,
    }


def reference(flight: Flight) -> Document:
    """The messages that the autopilot's state is taken from."""
    tracks = {"attitude": flight.attitude, "position": flight.position}
    return {name: track.source if track else None for name, track in tracks.items()}


def _in_use(used: SensorInUse) -> list[Document]:
    return [{"t_s": t, "instance": i} for t, i in used.changes]


def series_document(
    source: Source, flight: Flight, tables: Sequence[Document], series: Document | None = None
) -> Document:
    """tables: what the flight has, as `companion.export` lists them; series: the values of the one that was chosen."""
    return document(source, [{**flight_head(flight), "tables": tables, "series": series}])
