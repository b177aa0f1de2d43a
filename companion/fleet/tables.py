"""The rows as Arrow tables; the unit of a column is at the end of its name and in its metadata."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from companion.export import harmless
from companion.fleet.rows import Row, Rows
from companion.present import QUANTITIES, STATISTICS

if TYPE_CHECKING:
    import pyarrow as pa

_KEY = {"log": "string", "vehicle": "string", "boot": "int"}
_OBSERVED = {
    f"{name}_{axis}{part}": kind
    for name, unit in (("gyro_bias", "radps"), ("accel_bias", "mps2"), ("mounting", "rad"))
    for axis in "xyz"
    for part, kind in ((f"_{unit}", "float"), (f"_sigma_{unit}", "float"), ("_observable", "bool"))
}
_SPREAD = {quantity.column(statistic): "float" for quantity in QUANTITIES for statistic in (*STATISTICS, "expected")}

COLUMNS: Mapping[str, Mapping[str, str]] = {
    "flights": {
        **_KEY,
        "date_s": "date", "duration_s": "float", "autopilot": "string", "type": "string", "firmware": "string",
        "board": "string", "imu": "string", "rate_hz": "float", "gyro_ids": "ids", "accel_ids": "ids",
        "figures": "string", "status": "string", "summary": "string", "drift_ratio": "float", "error": "string",
        "report": "string", "report_error": "string", "format": "string", "size_bytes": "int", "sha256": "string",
    },
    "drift": {
        **_KEY,
        "imu": "string", "horizon_s": "float", "windows": "int", "windows_left_out": "int", **_SPREAD,
        **{f"{quantity.name}_inside": "float" for quantity in QUANTITIES},
    },
    "findings": {
        **_KEY,
        "kind": "string", "side": "string", "severity": "string", "start_s": "float", "end_s": "float",
        "evidence": "string", "advice": "string",
    },
    "calibration": {
        **_KEY,
        "date_s": "date", "board": "string", "imu": "string", "gyro_id": "int", "accel_id": "int",
        "temperature_degc": "float", "windows": "int", **_OBSERVED,
        "time_offset_s": "float", "time_offset_sigma_s": "float", "time_offset_observable": "bool",
    },
}  # fmt: skip
"""Table → column → kind. docs/fleet.md describes them."""

_UNITS = {
    "_s": "s", "_deg": "deg", "_m": "m", "_mps": "m/s", "_mps2": "m/s²", "_rad": "rad", "_radps": "rad/s",
    "_degc": "°C", "_hz": "Hz", "_bytes": "B",
}  # fmt: skip


def arrow_tables(rows: Rows) -> dict[str, pa.Table]:
    """All of them by name. Raises ValueError or pyarrow's errors for a row that no table can have."""
    return {name: arrow_table(name, getattr(rows, name)) for name in COLUMNS}


def arrow_table(name: str, rows: Sequence[Row]) -> pa.Table:
    """One of the tables of COLUMNS; what a row lacks is null."""
    import pyarrow as pa  # noqa: PLC0415  (an extra)

    kinds = {
        "string": pa.string(),
        "int": pa.int64(),
        "float": pa.float64(),
        "bool": pa.bool_(),
        "date": pa.timestamp("us", tz="UTC"),
        "ids": pa.map_(pa.string(), pa.int64()),
    }
    fields, columns = [], []
    for column, kind in COLUMNS[name].items():
        values = [row.get(column) for row in rows]
        if kind == "string":
            values = [None if v is None else harmless(v) for v in values]
        elif kind == "date":
            values = [None if v is None else round(v * 1e6) for v in values]
        elif kind == "ids":
            values = [None if v is None else list(v.items()) for v in values]
        name_of = column.removesuffix("_s") if kind == "date" else column
        unit = next((unit for ending, unit in _UNITS.items() if name_of.endswith(ending)), None)
        fields.append(pa.field(name_of, kinds[kind], metadata={"unit": unit} if unit else None))
        columns.append(pa.array(values, kinds[kind]))
    return pa.Table.from_arrays(columns, schema=pa.schema(fields))
