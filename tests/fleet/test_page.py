"""The page of a fleet: whatever a log, its file's name or its sensors say is text on it."""

from __future__ import annotations

import json
from typing import Any

from companion.fleet.page import fleet_html
from companion.fleet.rows import Rows
from tests.report.pages import Contents

EVIL = "</script><img src=x onerror=alert(1)><a href='javascript:alert(2)' onclick=\"alert(3)\">"
LOG = f"/logs/{EVIL}\udcff?#%41.tlog".encode("utf-8", "backslashreplace").decode()


def test_what_logs_say_is_only_text() -> None:
    key: dict[str, Any] = {"log": LOG, "vehicle": "1:1", "boot": 1}
    told = {"status": "imu_suspect", "drift_ratio": 3.0, "rate_hz": 100.0, "date_s": 1.7e9}
    flight = key | told | {"imu": EVIL, "report": f"reports/{EVIL}?#%41.html", "board": EVIL}
    failed = {"log": "/logs/b.tlog", "error": f"cannot be read: {EVIL}"}
    finding = key | {"kind": f"kind_{EVIL}", "severity": "error"}
    biases = {f"gyro_bias_{axis}_{what}": 0.1 for axis in "xyz" for what in ("radps", "sigma_radps", "observable")}
    still = {f"accel_bias_{axis}_{what}": 0.1 for axis in "xyz" for what in ("mps2", "sigma_mps2", "observable")}
    fit = key | biases | still | {"date_s": 1.7e9, "temperature_degc": 30.0, "board": EVIL, "imu": EVIL}
    page = fleet_html(Rows((flight, failed), (), (finding,), (fit,)), [(f"made {EVIL}", EVIL)])
    found = Contents(page)
    assert not [name for name, _ in found.elements if name in ("img", "iframe", "object", "embed", "base")]
    handlers = [name for _, attributes in found.elements for name in attributes if name.startswith("on")]
    assert handlers == []
    links = {attributes["href"] or "" for name, attributes in found.elements if name == "a"}
    assert all(link.startswith(("./", "#")) for link in links)
    (to_report,) = (link for link in links if link.startswith("./"))
    assert not set(to_report) & set("<>\"' ?#"), "a name with ? or # is still a path"
    figures = found.figures
    assert len(figures) == 5  # two biases over time and over temperature, and the findings
    assert "<" not in json.dumps(figures), "plotly reads some tags in texts"
    assert found.sections.keys() == {"first", "errors", "history", "warmth", "findings", "flights", "made"}
    assert EVIL in found.sections["errors"]


def test_a_heading_names_the_horizon_that_its_column_is_of() -> None:
    key: dict[str, Any] = {"log": "/a.tlog", "vehicle": "1:1", "boot": 1}
    drift = tuple(key | {"horizon_s": horizon, "attitude_median_deg": horizon} for horizon in (2.0, 30.0))
    page = fleet_html(Rows((key | {"status": "consistent"},), drift, (), ()), [])
    assert "° after 2 s" in page
    assert "after 5 s" not in page
