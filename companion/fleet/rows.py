"""Records → the rows of the five tables, dictionaries whose keys are the columns → Arrow tables.

The unit of a column is at the end of its name and in its metadata.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from companion.documents import Document
from companion.export import harmless
from companion.fleet.journal import FlightRecord, LogRecord, printable
from companion.fleet.search import FoundLog
from companion.present import QUANTITIES, STATISTICS

if TYPE_CHECKING:
    import pyarrow as pa

Row = dict[str, Any]

STATUSES = ("consistent", "imu_suspect", "autopilot_suspect", "insufficient_data", "error")
Key = tuple[str, str, int]
"""Log, vehicle, boot."""
_SEVERITIES = ("error", "warning", "info")
_SUSPECT = ("imu_suspect", "autopilot_suspect")


def key_of(row: Row) -> Key:
    """Which flight a row of any table is of."""
    return row["log"], row.get("vehicle", ""), row.get("boot", 0)


def status_of(flight: Row) -> str:
    """One of STATUSES."""
    return str(flight.get("status") or "error")


JUDGED_S = 5.0  # the horizon that verdicts are made at
_XYZ = ("_x", "_y", "_z")
_FITTED = {
    f"{name}{axis}{ending}": (f"{name}_{unit}", statistic, i, kind)
    for name, unit, axes in (
        ("gyro_bias", "radps", _XYZ), ("accel_bias", "mps2", _XYZ), ("mounting", "rad", _XYZ),
        ("time_offset", "s", ("",)),
    )
    for i, axis in enumerate(axes)
    for statistic, ending, kind in (
        ("value", f"_{unit}", "float"), ("sigma", f"_sigma_{unit}", "float"), ("observable", "_observable", "bool")
    )
}  # fmt: skip
"""Column of a fitted parameter → part, statistic and place of it in a calibration's document, and the column's kind."""


@dataclass(frozen=True, slots=True)
class Rows:
    """What is known of all logs, in the order of their paths, vehicles and boots; and the summary of it."""

    flights: tuple[Row, ...]  # one per flight; one for a log without any, with its error
    drift: tuple[Row, ...]  # one per flight and horizon
    findings: tuple[Row, ...]  # one per finding
    calibration: tuple[Row, ...]  # one per flight whose IMU could be calibrated
    preflight: tuple[Row, ...] = ()  # one per check before a flight of a vehicle that stands first

    def count_by_status(self) -> dict[str, int]:
        """Flights of each status, and logs without any as errors; in the order of STATUSES, none that is zero."""
        counts = Counter(map(status_of, self.flights))
        return {status: counts[status] for status in STATUSES if status in counts}

    def by_concern(self) -> list[Row]:
        """Every flight that was examined, the one to look at first foremost.

        By its worst finding, then by how many times the expected error its worst window is off, whatever the verdict.
        """
        ranks: dict[Key, int] = {}
        for row in self.findings:
            key = key_of(row)
            ranks[key] = min(ranks.get(key, len(_SEVERITIES)), _SEVERITIES.index(row["severity"]))
        ratios = self.worst_ratios()

        def rank(row: Row) -> tuple[int, bool, float]:
            key = key_of(row)
            return ranks.get(key, len(_SEVERITIES)), status_of(row) not in _SUSPECT, -ratios.get(key, 0.0)

        return sorted((row for row in self.flights if status_of(row) != "error"), key=rank)

    def worst_ratios(self) -> dict[Key, float]:
        """Flight → its worst window's error over the expected 1σ, of the quantity and horizon where that is largest."""
        worst: dict[Key, float] = {}
        for row in self.drift:
            for quantity in QUANTITIES:
                error, expected = row.get(quantity.column("max")), row.get(quantity.column("expected"))
                if error is not None and expected:
                    worst[key_of(row)] = max(worst.get(key_of(row), 0.0), error / expected)
        return worst

    def errors(self) -> list[Row]:
        """The rows without an analysis."""
        return [row for row in self.flights if status_of(row) == "error"]

    def count_findings(self) -> list[tuple[str, str, int, int]]:
        """(kind, severity, findings, flights) of each kind, those in most flights first."""
        by_kind: dict[tuple[str, str], list[Row]] = {}
        for row in self.findings:
            by_kind.setdefault((row["kind"], row["severity"]), []).append(row)
        counted = [
            (kind, severity, len(of_kind), len(set(map(key_of, of_kind))))
            for (kind, severity), of_kind in by_kind.items()
        ]
        return sorted(counted, key=lambda row: (_SEVERITIES.index(row[1]), -row[3], row[0]))

    def reasons(self, flight: Row) -> list[str]:
        """The kinds of a flight's findings that are more than information, each once."""
        key = key_of(flight)
        of_flight = (row for row in self.findings if row["severity"] != "info" and key_of(row) == key)
        return list(dict.fromkeys(row["kind"] for row in of_flight))


def rows_of(logs: Iterable[tuple[FoundLog, LogRecord]]) -> Rows:
    """The rows of all five tables."""
    flights, drift, findings, calibration, preflight = [], [], [], [], []
    for log, record in sorted(logs, key=lambda pair: pair[0].path):
        name = {"log": printable(log.path)}
        of_log: Row = name | {"sha256": record.sha256, "size_bytes": log.size_bytes, "format": record.format}
        if not record.flights:
            flights.append(of_log | {"error": record.error})
        for flight in record.flights:
            key = name | {"vehicle": str(flight.vehicle), "boot": flight.boot}
            flights.append(of_log | key | _flight(flight))
            preflight += [of_log | key | row for row in _preflight(flight)]
            if flight.analysis is not None:
                drift += [key | row for row in _drift(flight.analysis)]
                findings += [key | finding for finding in flight.analysis["verdict"]["findings"]]
                calibration += [key | row for row in _calibration(flight, flight.analysis)]
    return Rows(tuple(flights), tuple(drift), tuple(findings), tuple(calibration), tuple(preflight))


def _flight(flight: FlightRecord) -> Row:
    own = ("board", "date_s", "duration_s", "gyro_ids", "accel_ids", "error", "report", "report_error")
    row = {name: getattr(flight.vehicle, name) for name in ("autopilot", "type", "firmware")}
    row |= {name: getattr(flight, name) for name in own}
    if (analysis := flight.analysis) is None:
        return row
    imu = analysis["used_imu"]
    return row | {
        "imu": imu,
        "rate_hz": next((one["rate_hz"] for one in analysis["imu"] if one["message"] == imu), None),
        "figures": analysis["figures"] and analysis["figures"]["name"],
        "status": analysis["verdict"]["status"],
        "summary": analysis["verdict"]["summary"],
        "drift_ratio": _drift_ratio(analysis),
    }


def _drift(analysis: Document) -> Iterator[Row]:
    inside = {share["horizon_s"]: share for share in analysis["consistency"]}
    for drift in analysis["drift"]:
        row: Row = {"imu": analysis["used_imu"], "horizon_s": drift["horizon_s"], "windows": drift["windows"]}
        row["windows_left_out"] = sum(drift["excluded"].values())
        shares = inside.get(drift["horizon_s"])
        for quantity in QUANTITIES:
            if (statistic := drift[quantity.attribute]) is not None:
                row |= {quantity.column(key): statistic[key] for key in STATISTICS}
            if (expected := drift["expected"]) is not None:
                row[quantity.column("expected")] = expected[quantity.attribute]
            if shares is not None:
                row[f"{quantity.name}_inside"] = shares[quantity.name]
        yield row


def _calibration(flight: FlightRecord, analysis: Document) -> Iterator[Row]:
    fit, imu = analysis["calibration"], analysis["used_imu"]
    if fit is None or imu is None:
        return
    yield {
        "board": flight.board,
        "date_s": flight.date_s,
        "imu": imu,
        "gyro_id": flight.gyro_ids.get(imu),
        "accel_id": flight.accel_ids.get(imu),
        "temperature_degc": flight.temperatures_degc.get(imu),
        "windows": fit["windows"],
        **{column: fit[part][statistic][i] for column, (part, statistic, i, _) in _FITTED.items()},
    }


def _preflight(flight: FlightRecord) -> Iterator[Row]:
    whose = {name: getattr(flight.vehicle, name) for name in ("autopilot", "type")}
    whose |= {name: getattr(flight, name) for name in ("board", "date_s", "gyros")}
    for one in flight.checks:
        own = ("sensor", "outcome", "size", "sigma", "limit", "unit", "probability", "uncorrected")
        yield whose | {"check": one.name} | {name: getattr(one, name) for name in own}


def _drift_ratio(analysis: Document) -> float | None:
    """Median drift over the expected one, of the quantity where it is largest, at the horizon nearest to 5 s."""
    usable = [row for row in analysis["drift"] if row["expected"] is not None]
    if not usable:
        return None
    row = min(usable, key=lambda row: abs(row["horizon_s"] - JUDGED_S))
    pairs = [(row[q.attribute], row["expected"][q.attribute]) for q in QUANTITIES]
    return max((measured["median"] / allowed for measured, allowed in pairs if measured and allowed), default=None)


_KEY = {"log": "string", "vehicle": "string", "boot": "int"}
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
        "temperature_degc": "float", "windows": "int", **{column: kind for column, (*_, kind) in _FITTED.items()},
    },
    "preflight": {
        **_KEY,
        "date_s": "date", "autopilot": "string", "type": "string", "board": "string", "gyros": "string",
        "check": "string", "sensor": "string", "outcome": "string", "size": "float", "sigma": "float",
        "limit": "float", "unit": "string", "probability": "float", "uncorrected": "float", "sha256": "string",
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
