"""The head of every document, the conversion of results to plain JSON values, and what is in a log.

The documents of `companion info --json` and `companion series --json`. docs/json.md describes each key, and a test
holds them: keys are added, never renamed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Protocol

import msgspec
import numpy as np
import numpy.typing as npt

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


class Column(Protocol):
    """A column of `companion.export`."""

    @property
    def name(self) -> str: ...
    @property
    def values(self) -> npt.NDArray[Any]: ...
    @property
    def unit(self) -> str: ...
    @property
    def frame(self) -> str: ...


class Table(Protocol):
    """A table of `companion.export`."""

    @property
    def name(self) -> str: ...
    @property
    def about(self) -> Mapping[str, str]: ...
    def __iter__(self) -> Iterator[Column]: ...
    def __len__(self) -> int: ...


def series_document(
    source: Source,
    flight: Flight,
    tables: Mapping[str, Table],
    chosen: Table | None,
    span: tuple[float | None, float | None] = (None, None),
    most: int = 500,
) -> Document:
    """tables: all that the flight has, which are listed where none of them is chosen.

    chosen: whose values are written, between two times of the boot clock, s.

    Of more than `most` rows so many are written, evenly; each column has the least and the greatest of all.
    """
    listed = [
        {"name": one.name, "rows": len(one), "about": dict(one.about), "columns": [_head(column) for column in one]}
        for one in (tables.values() if chosen is None else ())
    ]
    series = None if chosen is None else _series(chosen, span, most)
    return document(source, [{**flight_head(flight), "tables": listed, "series": series}])


def _series(table: Table, span: tuple[float | None, float | None], most: int) -> Document:
    columns = list(table)
    inside = np.ones(len(table), bool)
    if (t := next((column.values for column in columns if column.name == "t_s"), None)) is not None:
        begin, end = span
        inside = (t >= (-np.inf if begin is None else begin)) & (t <= (np.inf if end is None else end))
    rows = np.flatnonzero(inside)
    shown = rows[np.unique(np.linspace(0, len(rows) - 1, most).round().astype(np.intp))] if len(rows) > most else rows
    return plain({
        "table": table.name,
        "rows": len(rows),
        "columns": [{**_head(c), **_ends(c.values[rows]), "values": c.values[shown].tolist()} for c in columns],
    })  # fmt: skip


def _head(column: Column) -> Document:
    return {"name": column.name, "unit": column.unit, "frame": column.frame}


def _ends(values: npt.NDArray[Any]) -> Document:
    known = values[np.isfinite(values)] if values.dtype.kind in "fiu" else values[:0]
    return {"least": known.min() if len(known) else None, "greatest": known.max() if len(known) else None}
