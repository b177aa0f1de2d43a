"""What `companion info` lists is exported: a table for every sensor and estimate of a flight."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import companion as c
from companion.export import tables
from companion.export.table import table_name
from companion.model import inventory
from tests.recordings import BUNDLED
from tests.ulogs import ulog

TESTS = Path(__file__).parent.parent
LOGS = (
    BUNDLED / "copter-demo-100hz.tlog",
    TESTS / "data" / "copter-takeoff.bin.xz",
    TESTS / "telemetry" / "logs" / "px4_two_imus.ulg.xz",
)


@pytest.mark.parametrize("path", LOGS, ids=lambda path: path.name)
def test_everything_in_the_inventory_has_a_table(path: Path) -> None:
    (flight,) = c.open_log(path)
    exported = tables(flight)
    sources = {table.about["source"] for name, table in exported.items() if not name.startswith("temperature")}
    items = inventory(flight)
    assert {"IMU", "GPS", "compass", "attitude", "position", "IMU bias"} <= {item.kind for item in items}
    for item in items:
        assert item.source in sources, item
    for imu in flight.imus.values():
        assert len(exported[table_name(imu.source)]) == len(imu)
    assert exported["attitude"].about["source"] == flight.require_attitude().source


def test_a_sensor_that_only_its_driver_tells_of(tmp_path: Path) -> None:
    t = np.arange(1, 51, dtype=np.uint64) * np.uint64(100_000)
    field = np.linspace(0.1, 0.3, 50).astype(np.float32)
    imu = {name: np.full((50, 3), 1e-3, np.float32) for name in ("delta_angle", "delta_velocity")}
    spans = {f"{name}_dt": np.full(50, 100_000, np.uint32) for name in imu}
    path = tmp_path / "log.ulg"
    path.write_bytes(
        ulog({
            "sensor_mag": {"timestamp": t, "x": field, "y": field, "z": field},
            "sensor_baro": {"timestamp": t, "pressure": 95_000 + 100 * field},
            "vehicle_imu": {"timestamp": t, "timestamp_sample": t} | imu | spans,
        })
    )  # fmt: skip
    (flight,) = c.open_log(path)
    found = tables(flight)
    np.testing.assert_array_equal(found["magnetometer_sensor_mag"]["z_tesla"], flight.compasses[0].field[:, 2])
    np.testing.assert_array_equal(found["barometer_sensor_baro"]["pressure_pa"], flight.barometers[0].pressure)
    np.testing.assert_allclose(found["vehicle_imu"]["interval_s"], 0.1)
    assert found["vehicle_imu"].about["bias_removed"] == "no"
