"""`companion series --json` (docs/json.md): a table of a flight over time, or which tables there are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from companion.app.recording import Source
from companion.documents.document import Document, document, flight_head, plain
from companion.model import Flight


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
