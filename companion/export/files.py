"""Tables → files: CSV and Parquet, one a table; JSON, all in one."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from companion.export.table import Column, Format, Table, harmless


def write_csv(folder: Path, tables: Mapping[str, Table]) -> list[Path]:
    """NAME.csv for each table: a line of column names, numbers in full (they read back as the same float64).

    A number that does not exist is an empty cell. Text that a spreadsheet would take for a formula gets an apostrophe.
    """
    paths = []
    for name, table in tables.items():
        path = folder / f"{name}.csv"
        with path.open("w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(column.name for column in table)
            rows.writerows(zip(*(_cells(column) for column in table), strict=True))
        paths.append(path)
    return paths


def write_parquet(folder: Path, tables: Mapping[str, Table]) -> list[Path]:
    """NAME.parquet for each table, units and frames in the metadata of its columns. Needs pyarrow: see Table.arrow."""
    arrow = {name: table.arrow() for name, table in tables.items()}
    from pyarrow import parquet  # noqa: PLC0415  (an extra: the line above raises if it is absent)

    paths = []
    for name, table in arrow.items():
        parquet.write_table(table, folder / f"{name}.parquet", compression="zstd")
        paths.append(folder / f"{name}.parquet")
    return paths


def write_json(path: Path, analysis: Mapping[str, Any], tables: Mapping[str, Table]) -> list[Path]:
    """The document of `companion analyze --json` with one key more, `tracks`: each table with its columns."""
    tracks = {
        name: {
            **({"about": dict(table.about)} if table.about else {}),
            "columns": {c.name: {"unit": c.unit, "frame": c.frame, "values": c.values.tolist()} for c in table},
        }
        for name, table in tables.items()
    }
    path.write_bytes(msgspec.json.encode({**analysis, "tracks": tracks}))
    return [path]


def _cells(column: Column) -> list[Any]:
    values: list[Any] = column.values.tolist()
    if column.values.dtype.kind == "f":
        return ["" if np.isnan(value) else value for value in values]
    if column.values.dtype.kind == "U":
        return list(map(harmless, values))
    return values


FORMATS = (
    Format("csv", "a file for each track", lambda path, c: write_csv(path, c.tables), write_csv, is_folder=True),
    Format(
        "parquet",
        "the same, with units and frames",
        lambda path, c: write_parquet(path, c.tables),
        write_parquet,
        is_folder=True,
    ),
    Format("json", "everything", lambda path, c: write_json(path, c.document(), c.tables)),
)
