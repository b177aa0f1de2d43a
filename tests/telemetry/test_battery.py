"""The battery: the same from a link, from ArduPilot's logs of any age, and from PX4's; what nobody knows is NaN."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import companion as c
from tests.dataflash_writer import write_dataflash
from tests.recordings import BUNDLED
from tests.telemetry.test_quantities import read
from tests.tlogs import Writer
from tests.ulogs import ulog

DEMO = BUNDLED / "copter-demo-100hz.tlog"


def test_a_links_battery_is_what_pymavlink_reads() -> None:
    theirs, own = read(DEMO, "SYS_STATUS"), c.open_log(DEMO)[0].series["battery"]
    assert len(own) == len(theirs)
    np.testing.assert_allclose(own["voltage_v"], [m.voltage_battery * 1e-3 for m in theirs])
    np.testing.assert_allclose(own["current_a"], [m.current_battery * 1e-2 for m in theirs])
    np.testing.assert_allclose(own["remaining"], [m.battery_remaining * 1e-2 for m in theirs])


def test_cells_are_added_and_what_is_unknown_is_not_a_number(tmp_path: Path) -> None:
    log = Writer(tmp_path / "cells.tlog")
    log.rest(3.0)
    given = {"battery_function": 0, "type": 1, "temperature": 32767, "current_consumed": -1, "energy_consumed": -1}
    for i, (cells, current, left) in enumerate((([4100, 4000, 3900], 1250, 80), ([], -1, -1))):
        voltages = [*cells, *[65535] * (10 - len(cells))]
        log.send(1.0 + i, "battery_status", id=0, voltages=voltages, current_battery=current, battery_remaining=left,
                 **given)  # fmt: skip
    (flight,) = c.open_log(log.close())
    battery = flight.series["battery"]
    assert (battery["voltage_v"][0], battery["current_a"][0], battery["remaining"][0]) == pytest.approx(
        (12.0, 12.5, 0.8)
    )
    assert len(battery) == 1, "the second report knows nothing"


@pytest.mark.parametrize(
    ("record", "row", "voltage"),
    [
        ("BAT", ("QBffB", "TimeUS,Instance,Volt,Curr,RemPct", (0, 12.34, 5.5, 60)), 12.34),
        ("CURR", ("Qff", "TimeUS,Volt,Curr", (12.34, 5.5)), 12.34),
        ("CURR", ("Qhh", "TimeUS,Volt,Curr", (1234, 550)), 12.34),  # hundredths, as until ArduPilot 3.2
    ],
)
def test_ardupilots_records_of_any_age(
    record: str, row: tuple[str, str, tuple[float, ...]], voltage: float, tmp_path: Path
) -> None:
    kinds, names, values = row
    rows = [(record, (10_000_000 + 100_000 * i, *values)) for i in range(20)]
    (flight,) = c.open_log(write_dataflash(tmp_path / "log.bin", {record: (kinds, names)}, rows))
    battery = flight.series["battery"]
    assert battery["voltage_v"][0] == pytest.approx(voltage)
    assert battery["current_a"][0] == pytest.approx(5.5)
    assert (battery["remaining"][0] == pytest.approx(0.6)) == (record == "BAT")


def test_px4s_topic(tmp_path: Path) -> None:
    t = np.arange(20, dtype=np.uint64) * 100_000 + 10_000_000
    topic: dict[str, Any] = {
        "timestamp": t,
        "voltage_v": np.full(20, 15.5, np.float32),
        "current_a": np.full(20, -1.0, np.float32),
        "remaining": np.linspace(0.9, 0.8, 20, dtype=np.float32),
    }
    (tmp_path / "log.ulg").write_bytes(ulog({"battery_status": topic}))
    (flight,) = c.open_log(tmp_path / "log.ulg")
    battery = flight.series["battery"]
    assert battery["voltage_v"][0] == pytest.approx(15.5)
    assert np.isnan(battery["current_a"]).all(), "-1 A is what PX4 says where it measures none"
    assert battery["remaining"][[0, -1]] == pytest.approx([0.9, 0.8])
