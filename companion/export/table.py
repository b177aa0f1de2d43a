"""A table of named columns, each with its unit and frame; as files: CSV and Parquet, one a table; JSON, all in one.

And what a format is that writes such tables.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import numpy.typing as npt

from companion.comparison import Replay
from companion.installation import missing
from companion.model import Array, Flight
from companion.strapdown import quaternion
from companion.verdict import Assessment

if TYPE_CHECKING:
    import pyarrow as pa

Values = npt.NDArray[Any]


UNITS = {
    "s": "s", "m": "m", "mps": "m/s", "mps2": "m/s²", "rad": "rad", "rad2": "rad²", "radps": "rad/s", "deg": "°",
    "pa": "Pa", "degc": "°C", "tesla": "T", "v": "V", "a": "A", "m2": "m²", "m2ps2": "m²/s²",
}  # fmt: skip
"""The end of a column's name → its unit."""


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """One column."""

    name: str  # ends in its unit
    values: Values  # (N,) float64, int64 or str; NaN where a number does not exist
    frame: str = ""  # FRD, NED, "FRD → NED", or what a time counts from

    @property
    def unit(self) -> str:
        """s, rad/s, m/s², ...; "" for names and for numbers without one."""
        return UNITS.get(self.name.rsplit("_", 1)[-1], "")


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Columns of one length. `table["t_s"]` is an array."""

    name: str
    columns: tuple[Column, ...]
    about: Mapping[str, str] = field(default_factory=dict)  # source message, sensor, method, ... in words

    def __post_init__(self) -> None:
        lengths = {column.name: len(column.values) for column in self.columns}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"the columns of {self.name} differ in length: {lengths}")

    def __len__(self) -> int:
        return len(self.columns[0].values)

    def __iter__(self) -> Iterator[Column]:
        return iter(self.columns)

    def __getitem__(self, name: str) -> Values:
        """The values of a column. Raises KeyError with the names that there are."""
        for column in self.columns:
            if column.name == name:
                return column.values
        raise KeyError(f"{self.name} has no column {name!r}; it has {', '.join(c.name for c in self.columns)}")

    def arrow(self) -> pa.Table:
        """As an Arrow table: units and frames in the metadata of each field, `about` in that of the schema.

        A number that does not exist is null. Raises InputError when pyarrow is not installed.
        """
        try:
            import pyarrow as pa  # noqa: PLC0415  (an extra: needed for this alone)
        except ImportError:
            raise missing("export", "Arrow and Parquet need pyarrow") from None
        # from_pandas: NaN is null
        arrays = [pa.array(_safe(column.values), from_pandas=True) for column in self.columns]
        fields = [
            pa.field(column.name, array.type, metadata=_stated(unit=column.unit, frame=column.frame))
            for column, array in zip(self.columns, arrays, strict=True)
        ]
        return pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=_stated(table=self.name, **self.about)))


def listed(table: Table) -> dict[str, Any]:
    """What a table has, without its values."""
    columns = [_head(column) for column in table]
    return {"name": table.name, "rows": len(table), "about": dict(table.about), "columns": columns}


def thinned(table: Table, span: tuple[float | None, float | None], most: int) -> dict[str, Any]:
    """The values between two times of the boot clock, s; of rows that last, those that reach into it.

    Of more than `most` rows so many, evenly; each column has the least and the greatest of all.
    """
    inside = np.ones(len(table), bool)
    stamps = [column.values for column in table if column.name == "t_s"]
    if stamps := stamps or [column.values for column in table if column.name.endswith("_t_s")]:  # from, to
        begin, end = span
        inside = ~(stamps[-1] < (-np.inf if begin is None else begin)) & (stamps[0] <= (np.inf if end is None else end))
    rows = np.flatnonzero(inside)
    shown = rows[np.unique(np.linspace(0, len(rows) - 1, most).round().astype(np.intp))] if len(rows) > most else rows
    columns = [{**_head(c), **_ends(c.values[rows]), "values": c.values[shown].tolist()} for c in table]
    return {"table": table.name, "rows": len(rows), "columns": columns}


def _head(column: Column) -> dict[str, str]:
    return {"name": column.name, "unit": column.unit, "frame": column.frame}


def _ends(values: Values) -> dict[str, Any]:
    known = values[np.isfinite(values)] if values.dtype.kind in "fiu" else values[:0]
    return {"least": known.min() if len(known) else None, "greatest": known.max() if len(known) else None}


def harmless(text: str) -> str:
    """The text, with an apostrophe before a spreadsheet's formula: texts of a vehicle are untrusted."""
    return f"'{text}" if text.startswith(("=", "+", "-", "@", "\t", "\r")) else text


def csv_cell(value: float | str) -> float | str:
    """A value as CSV has it: empty for a number that does not exist."""
    return harmless(value) if isinstance(value, str) else "" if math.isnan(value) else value


def _safe(values: Values) -> Values:
    return np.array(list(map(harmless, values.tolist()))) if values.dtype.kind == "U" and len(values) else values


def vectors(name: str, unit: str, values: npt.ArrayLike, frame: str) -> tuple[Column, ...]:
    """The three columns of vectors (N, 3): x, y, z in FRD, north, east, down in NED. unit: of UNITS."""
    axes = ("north", "east", "down") if frame == "NED" else ("x", "y", "z")
    return _split(name, [f"_{axis}_{unit}" for axis in axes], values, frame)


def quaternions(name: str, values: npt.ArrayLike) -> tuple[Column, ...]:
    """The four columns of attitudes (N, 4), wxyz, from FRD to NED."""
    return _split(name, ["_w", "_x", "_y", "_z"], values, "FRD → NED")


def euler_angles(name: str, values: npt.ArrayLike) -> tuple[Column, ...]:
    """The three columns of roll, pitch and yaw, as ATTITUDE has them, of attitudes (N, 4), wxyz, FRD to NED.

    For plots and spreadsheets: yaw jumps at ±π, and with the nose straight up or down roll and yaw mean nothing alone.
    """
    angles = quaternion.to_euler(np.asarray(values, np.float64))
    return _split(name, ["roll_rad", "pitch_rad", "yaw_rad"], angles, "z-y-x, FRD → NED")


def _split(name: str, ends: Sequence[str], values: npt.ArrayLike, frame: str) -> tuple[Column, ...]:
    columns = zip(ends, np.asarray(values, np.float64).T, strict=True)
    return tuple(Column(f"{name}{end}", column, frame) for end, column in columns)


def records(
    flight: Flight,
    name: str,
    of: Sequence[object],
    source: Mapping[str, str],
    attributes: Mapping[str, type | tuple[type, str]],
    when: Mapping[str, str] = MappingProxyType({"t": ""}),
) -> Table:
    """One row for each of some objects.

    attributes: name of one → type of its column, and its frame; when: of one that is a time → prefix of its columns.
    """

    def values(attribute: str, kind: type) -> Values:
        plain = [getattr(one, attribute) for one in of]
        return np.array([np.nan if value is None else value for value in plain], kind)

    columns = [column for key, prefix in when.items() for column in times(flight, values(key, float), prefix=prefix)]
    for attribute, kind in attributes.items():
        of_type, frame = kind if isinstance(kind, tuple) else (kind, "")
        columns.append(Column(attribute, values(attribute, of_type), frame))
    return Table(name, tuple(columns), source)


def _stated(**about: str) -> dict[str, str]:
    return {key: value for key, value in about.items() if value}


BOOT_CLOCK = "seconds of the vehicle's boot clock"


def table_name(message: str) -> str:
    """The name of an IMU's table: raw_imu, imu_0 for IMU[0]."""
    return re.sub(r"[^a-z0-9]+", "_", message.lower()).strip("_")


def series_name(key: str) -> str:
    """The name of a series' table: gps, gps_gps2_raw; of another estimator's attitude other_attitude."""
    return table_name(f"other_{key}" if key.partition(":")[0] == "attitude" else key)


def times(flight: Flight, t: Array, *, prefix: str = "") -> tuple[Column, Column]:
    unix = np.full(len(t), np.nan) if flight.epoch is None else flight.epoch.unix_s + t
    source = f"since 1970, UTC, by {flight.epoch.source}" if flight.epoch else "since 1970, UTC: not known"
    return Column(f"{prefix}t_s", t, BOOT_CLOCK), Column(f"{prefix}unix_s", unix, source)


@dataclass(frozen=True, slots=True)
class Contents:
    """What there is to be written of a flight."""

    flight: Flight
    assessment: Assessment
    shown: Replay
    tables: Mapping[str, Table]
    document: Callable[[], dict[str, Any]]  # that of `companion analyze --json`, made when it is needed


@dataclass(frozen=True, slots=True)
class Format:
    """One format. `bare` writes the tables of a log that cannot be examined; None where that would be nothing."""

    name: str
    what: str
    write: Callable[[Path, Contents], list[Path]]
    bare: Callable[[Path, Mapping[str, Table]], list[Path]] | None = None
    is_folder: bool = False


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
            columns = (map(csv_cell, column.values.tolist()) for column in table)
            rows.writerows(zip(*columns, strict=True))
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
