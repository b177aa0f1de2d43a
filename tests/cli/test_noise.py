"""`companion noise`: what it prints and writes, and what bad input gets."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from companion.app.sensors import load_imu_spec
from companion.cli import main
from companion.comparison import GENERIC
from companion.simulate import SimulatedVehicle, fly, write_flight
from companion.strapdown import ImuModel, Sensor
from tests.recordings import BUNDLED, recording
from tests.tlogs import Writer

pytestmark = pytest.mark.slow

DEMO = str(BUNDLED / "copter-demo-100hz.tlog")
GYRO, ACCEL = 2e-4, 3e-3
Captured = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def standing(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A vehicle that stands for 130 s: 400 Hz noise behind a 20 Hz low-pass, sampled at 50 Hz."""
    model = ImuModel(gyro=Sensor(GYRO), accel=Sensor(ACCEL))
    vehicle = SimulatedVehicle(
        fly(130.0, motion="rest", model=model, filter_hz=20.0), streams={"HIGHRES_IMU": 50.0, "ATTITUDE": 2.0}
    )
    path = tmp_path_factory.mktemp("standing") / "rest.tlog"
    write_flight(vehicle, path)
    return str(path)


def refused(arguments: list[str], capsys: Captured) -> str:
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert not said.out
    assert said.err.count("\n") == 1
    return said.err


def one(log: str, capsys: Captured, *options: str) -> dict[str, Any]:
    assert main(["noise", log, "--json", *options]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == 2
    (imu, *_) = document["flights"][0]["imus"]
    return dict(imu)


def test_the_tables_fit_into_sixty_columns(standing: str, capsys: Captured) -> None:
    for log in (standing, DEMO):
        assert main(["noise", log]) == 0
        tables = [line for line in capsys.readouterr().out.splitlines() if line.startswith((" gyro", " accel"))]
        assert len(tables) >= 6
        assert max(map(len, tables)) <= 60


def test_the_json_has_the_figures_of_the_rest(standing: str, capsys: Captured) -> None:
    imu = one(standing, capsys)
    assert imu.keys() == {
        "message", "rate_hz", "sampling", "accel_sampling", "imu_model", "datasheet", "rests", "flight", "notes",
    }  # fmt: skip
    (rest,) = imu["rests"]
    assert rest["end_s"] - rest["start_s"] > 120
    white = [axis["white"]["value"] for axis in rest["gyro"]["axes"]]
    np.testing.assert_allclose(white, GYRO, rtol=0.15)
    assert len(rest["accel"]["tau_s"]) == len(rest["accel"]["deviation"][2])


def test_in_flight_there_are_densities_and_peaks(capsys: Captured) -> None:
    imu = one(DEMO, capsys, "--imu", "raw_imu")
    assert imu["message"] == "RAW_IMU"
    flight = imu["flight"]
    assert flight["gyro"]["band_hz"][0] == 3.0
    assert len(flight["accel"]["density"]) == 3
    assert flight["gyro"]["below_quantisation"][2] is True
    assert any("below quantisation" in note for note in imu["notes"])


def test_kalibr_and_the_imu_library_read_what_is_written(standing: str, tmp_path: Path, capsys: Captured) -> None:
    assert main(["noise", standing, "-o", str(tmp_path / "out")]) == 0
    kalibr = yaml.safe_load((tmp_path / "out" / "imu.yaml").read_text(encoding="utf-8"))
    assert kalibr.keys() == {
        "accelerometer_noise_density", "accelerometer_random_walk", "gyroscope_noise_density",
        "gyroscope_random_walk", "rostopic", "update_rate",
    }  # fmt: skip
    assert kalibr["gyroscope_noise_density"] == pytest.approx(GYRO, rel=0.15)
    assert kalibr["accelerometer_noise_density"] == pytest.approx(ACCEL, rel=0.15)
    assert kalibr["update_rate"] == pytest.approx(50.0)
    model = tmp_path / "out" / "imu.toml"
    figures = load_imu_spec(str(model))
    assert figures.gyro.noise_density == pytest.approx(kalibr["gyroscope_noise_density"], rel=1e-3)
    assert figures.accel.noise_density == pytest.approx(kalibr["accelerometer_noise_density"], rel=1e-3)
    assert figures.accel.full_scale == pytest.approx(GENERIC.accel.full_scale, rel=0.01)
    capsys.readouterr()
    assert main(["analyze", DEMO, "--full", "--imu-model", str(model)]) == 0
    assert "imu.toml (requested)" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["imu.yaml", "imu.toml"])
def test_one_file_alone(name: str, standing: str, tmp_path: Path, capsys: Captured) -> None:
    target = tmp_path / name
    assert main(["noise", standing, "-o", str(target)]) == 0
    assert f"written: {target} (HIGHRES_IMU)" in capsys.readouterr().err
    assert "exists" in refused(["noise", standing, "-o", str(target)], capsys)
    assert main(["noise", standing, "-o", str(target), "--force"]) == 0


@pytest.mark.parametrize(("target", "expected"), [("imu.txt", ".yaml"), ("no/such/imu.yaml", "cannot write")])
def test_a_place_that_cannot_be_written(
    target: str, expected: str, standing: str, tmp_path: Path, capsys: Captured
) -> None:
    assert expected in refused(["noise", standing, "-o", str(tmp_path / target)], capsys)


def test_an_imu_that_is_not_there(capsys: Captured) -> None:
    assert "no usable RAW_MIU" in refused(["noise", DEMO, "--imu", "RAW_MIU"], capsys)


def test_a_log_that_is_too_short(tmp_path: Path, capsys: Captured) -> None:
    log = Writer(tmp_path / "short.tlog")
    log.rest(3.0)
    assert "10 s" in refused(["noise", str(log.close())], capsys)


def test_a_low_rate_says_what_it_cannot_tell(capsys: Captured) -> None:
    assert main(["noise", str(BUNDLED / "copter-mission-default-rates.tlog")]) == 0
    assert "too low to tell noise from motion" in capsys.readouterr().out


def test_a_real_quad_is_a_hundred_times_noisier_in_flight_than_its_data_sheet(capsys: Captured) -> None:
    """25 Hz: what two independent prototypes learned from this flight is 0.012 rad/s/√Hz."""
    log = recording("real/spark404__dataflashlog__log.bin")
    gyro = one(str(log), capsys)["flight"]["gyro"]["density"]
    assert max(gyro) == pytest.approx(0.012, rel=0.3)
