"""A fleet in a few numbers: the summary of terminal and page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from companion.fleet.rows import Row, Rows
from companion.present import QUANTITIES

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


def count_by_status(rows: Rows) -> dict[str, int]:
    """Flights of each status, and logs without any as errors; in the order of STATUSES, none that is zero."""
    counts = Counter(map(status_of, rows.flights))
    return {status: counts[status] for status in STATUSES if status in counts}


def by_concern(rows: Rows) -> list[Row]:
    """Every flight that was examined, the one to look at first foremost: by its worst finding, then by how many times
    the expected error its worst window is off, whatever the verdict.
    """
    ranks: dict[Key, int] = {}
    for row in rows.findings:
        key = key_of(row)
        ranks[key] = min(ranks.get(key, len(_SEVERITIES)), _SEVERITIES.index(row["severity"]))
    ratios = worst_ratios(rows)

    def rank(row: Row) -> tuple[int, bool, float]:
        key = key_of(row)
        return ranks.get(key, len(_SEVERITIES)), status_of(row) not in _SUSPECT, -ratios.get(key, 0.0)

    return sorted((row for row in rows.flights if status_of(row) != "error"), key=rank)


def worst_ratios(rows: Rows) -> dict[Key, float]:
    """Flight → its worst window's error over the expected 1σ, of the quantity and horizon where that is largest."""
    worst: dict[Key, float] = {}
    for row in rows.drift:
        for quantity in QUANTITIES:
            error, expected = row.get(quantity.column("max")), row.get(quantity.column("expected"))
            if error is not None and expected:
                worst[key_of(row)] = max(worst.get(key_of(row), 0.0), error / expected)
    return worst


def errors(rows: Rows) -> list[Row]:
    """The rows without an analysis."""
    return [row for row in rows.flights if status_of(row) == "error"]


def count_findings(rows: Rows) -> list[tuple[str, str, int, int]]:
    """(kind, severity, findings, flights) of each kind, those in most flights first."""
    by_kind: dict[tuple[str, str], list[Row]] = {}
    for row in rows.findings:
        by_kind.setdefault((row["kind"], row["severity"]), []).append(row)
    counted = [
        (kind, severity, len(of_kind), len(set(map(key_of, of_kind)))) for (kind, severity), of_kind in by_kind.items()
    ]
    return sorted(counted, key=lambda row: (_SEVERITIES.index(row[1]), -row[3], row[0]))


def reasons(rows: Rows, flight: Row) -> list[str]:
    """The kinds of a flight's findings that are more than information, each once."""
    key = key_of(flight)
    of_flight = (row for row in rows.findings if row["severity"] != "info" and key_of(row) == key)
    return list(dict.fromkeys(row["kind"] for row in of_flight))


def short_names(paths: Sequence[str]) -> dict[str, str]:
    """Each path by as many of its last parts as make it unique."""
    short: dict[str, str] = {}
    waiting, parts = sorted(set(paths)), 1
    while waiting:
        names = {path: "/".join(path.replace("\\", "/").split("/")[-parts:]) for path in waiting}
        counts = Counter(names.values())
        whole = {path for path, name in names.items() if len(name) >= len(path)}
        short |= {path: name for path, name in names.items() if counts[name] == 1 or path in whole}
        waiting = [path for path in waiting if path not in short]
        parts += 1
    return short
