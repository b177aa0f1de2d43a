"""A vehicle against its own earlier flights: a gyro that ages is found from its logs and from the fleet's table."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from companion.app.recording import read_recording
from companion.app.settings import Settings
from companion.cli import main
from companion.fleet import earlier_checks
from companion.fleet.journal import Plan, version_of
from companion.fleet.run import write_results
from companion.fleet.search import find_logs
from companion.fleet.task import decode, examine_log, sensor_ids
from companion.model import Flight, ImuTrack, Vehicle
from companion.simulate import TYPICAL, SimulatedVehicle, fly

pytestmark = pytest.mark.slow

BIAS_MRADPS = (0.5, 1.0, 0.7, 1.2, 8.0)  # on the x axis of one gyro, flight after flight: the last is still a go
STREAMS = {"HIGHRES_IMU": 50.0, "ATTITUDE": 20.0, "LOCAL_POSITION_NED": 10.0}
Captured = pytest.CaptureFixture[str]


def record(path: Path, bias: float, seed: int, gyro: int) -> None:
    """A vehicle that stands for 12 s."""
    sensor = replace(TYPICAL.gyro, bias=np.array([bias, 0.0, 0.0]))
    flown = fly(13.0, motion="rest", model=replace(TYPICAL, gyro=sensor), seed=seed)
    vehicle = SimulatedVehicle(flown, streams=STREAMS, parameters={"INS_GYR_ID": gyro}, send_parameters=True)
    sent = vehicle.advance(12.0)
    path.write_bytes(b"".join(struct.pack(">Q", round((1.7e9 + t) * 1e6)) + packet for t, packet in sent))


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five flights of one vehicle, and two of another that is like it."""
    folder = tmp_path_factory.mktemp("logs")
    for i, bias in enumerate(BIAS_MRADPS):
        record(folder / f"{i}.tlog", 1e-3 * bias, seed=i, gyro=2752514)
    for i in (5, 6):
        record(folder / f"{i}.tlog", 20e-3, seed=i, gyro=2752530)
    return folder


@pytest.fixture(scope="module")
def results(logs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `companion fleet` writes of them."""
    folder, settings = tmp_path_factory.mktemp("results"), Settings()
    plan = Plan(version=version_of(settings, None, None), settings=msgspec.msgpack.encode(settings))
    write_results(folder, [(log, decode(examine_log(log.path, plan))) for log in find_logs([str(logs)]).logs], {})
    return folder


def test_an_ageing_gyro_is_found_by_its_logs_and_by_the_table(logs: Path, results: Path, capsys: Captured) -> None:
    for history in (logs, results, results / "preflight.parquet"):
        assert main(["preflight", str(logs / "4.tlog"), "--history", str(history), "--json"]) == 0
        checks = {one["name"]: one for one in json.loads(capsys.readouterr().out)["flights"][0]["checks"]}
        aged = checks["gyro_bias"]["history"]
        assert (aged["times"], aged["changed"]) == (4, True), "its own four flights before, not the other vehicle's"
        assert aged["before"] == pytest.approx(1e-3 * np.median(BIAS_MRADPS[:4]), abs=1e-4)
        assert checks["gyro_bias"]["outcome"] == "go"
        assert not checks["accel_size"]["history"]["changed"]


def test_a_healthy_one_has_not_changed(logs: Path, results: Path, capsys: Captured) -> None:
    assert main(["preflight", str(logs / "3.tlog"), "--history", str(results), "--json"]) == 0
    checks = {one["name"]: one for one in json.loads(capsys.readouterr().out)["flights"][0]["checks"]}
    assert not checks["gyro_noise"]["history"]["changed"]
    assert checks["gyro_bias"]["history"]["times"] == 4


def test_a_log_is_not_its_own_past_by_another_name(logs: Path, results: Path, tmp_path: Path) -> None:
    (tmp_path / "today.tlog").write_bytes((logs / "4.tlog").read_bytes())
    recording = read_recording(tmp_path / "today.tlog")
    for history in (logs, results):
        assert len(earlier_checks(history, Settings(), recording, recording.flights[0])) == 4


def test_another_table_and_no_table_are_refused(logs: Path, results: Path, tmp_path: Path, capsys: Captured) -> None:
    broken = tmp_path / "broken.parquet"
    broken.write_bytes(b"PAR1 and nothing else")
    for table in (results / "flights.parquet", broken):
        assert main(["preflight", str(logs / "4.tlog"), "--history", str(table)]) == 2
        assert "is no table of checks before take-off" in capsys.readouterr().err
    assert main(["preflight", str(logs / "5.tlog"), "--history", str(results)]) == 2
    assert "1 flight of this vehicle" in capsys.readouterr().err


def test_ids_are_those_of_the_gyros_that_were_read() -> None:
    """PX4 numbers its calibrations in the order in which they were made, and its IMUs as they start."""
    t, zero = np.arange(3.0), np.zeros((3, 3))
    imus = {
        f"vehicle_imu_{i}": ImuTrack(t, zero, zero, f"vehicle_imu_{i}", instance=i, device_id=device)
        for i, device in enumerate((2, 1, 3))
    }
    named = {"CAL_GYRO0_ID": 1.0, "CAL_GYRO1_ID": 2.0, "CAL_GYRO2_ID": 3.0, "CAL_ACC0_ID": 1.0, "CAL_ACC2_ID": 33.0}
    flight = Flight(Vehicle(1, 1, autopilot="PX4", type="QUADROTOR"), 1, 0.0, 2.0, imus=imus, parameters=named)
    assert sensor_ids(flight, "gyro") == {"vehicle_imu_0": 2, "vehicle_imu_1": 1, "vehicle_imu_2": 3}
    assert sensor_ids(flight, "accel") == {"vehicle_imu_2": 33}
