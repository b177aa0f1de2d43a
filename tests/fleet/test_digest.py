"""Which flights to look at first."""

from __future__ import annotations

from typing import Any

import pytest

from companion.fleet.rows import Rows


def key(log: str) -> dict[str, Any]:
    return {"log": log, "vehicle": "1:1", "boot": 1}


def drift(log: str, worst: float, expected: float | None = 2.0, horizon: float = 5.0) -> dict[str, Any]:
    return key(log) | {"horizon_s": horizon, "position_max_m": worst, "position_expected_m": expected}


def found(log: str, severity: str) -> dict[str, Any]:
    return key(log) | {"kind": "frozen", "severity": severity}


def test_the_worst_finding_comes_first_then_the_worst_window() -> None:
    """A 55 m jump in a flight whose median is fine stands above one that drifts a little more all the time."""
    flights = [key(log) | {"status": status} for log, status in (
        ("calm", "consistent"), ("jump", "consistent"), ("frozen", "imu_suspect"), ("poor", "insufficient_data"),
    )]  # fmt: skip
    flights.append({"log": "broken", "error": "cannot be read"})
    rows = Rows(
        tuple(flights),
        (drift("calm", 3.0), drift("calm", 8.0, horizon=10.0), drift("jump", 55.0), drift("frozen", 1.0)),
        (found("frozen", "error"), found("frozen", "info"), found("poor", "warning")),
        (),
    )
    assert [row["log"] for row in rows.by_concern()] == ["frozen", "poor", "jump", "calm"]
    ratios = rows.worst_ratios()
    assert ratios["jump", "1:1", 1] == pytest.approx(27.5)
    assert ratios["calm", "1:1", 1] == pytest.approx(4.0), "at the horizon where it is largest"


def test_without_an_expectation_there_is_no_ratio() -> None:
    rows = Rows((key("a") | {"status": "consistent"},), (drift("a", 5.0, None), drift("a", 5.0, 0.0)), (), ())
    assert rows.worst_ratios() == {}
    assert len(rows.by_concern()) == 1
