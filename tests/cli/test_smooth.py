"""`companion smooth`: what it prints and writes, and what bad input gets."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import companion as c
from companion.app.recording import Source
from companion.cli import main, smooth
from companion.documents import encode, estimate_document
from companion.estimation import CONSTANTS, Explained, Rival
from tests.recordings import BUNDLED
from tests.tlogs import Writer

pytestmark = pytest.mark.slow

DEMO = str(BUNDLED / "copter-demo-100hz.tlog")
Captured = pytest.CaptureFixture[str]


@pytest.mark.parametrize(("shape", "unit"), [("pulse", "µT"), ("creep", "µT/s")])
def test_what_grows_is_told_per_second(shape: str, unit: str) -> None:
    turns: Any = SimpleNamespace(
        kind="compass_field", shape=shape, size=np.array([0.2]), sigma=np.array([0.01]), onset=116.8, onset_sigma=4.2,
        end=166.5, rivals=(Rival("compass_field", shape, 3.0, 1.0), Rival("gyro_bias", "step", 0.0, 1.0)),
    )  # fmt: skip
    (line,) = smooth.explained_lines([turns])
    assert f": 0.2 ± 0.01 {unit} from 116.8 ± 4.2 to 166.5 s (compass 75 %; " in line
    assert "; nobody 5 %; " in line
    assert line.endswith("; runner-up: gyro bias)")


def test_the_tables_fit_a_terminal_and_the_trajectory_is_written(tmp_path: Path, capsys: Captured) -> None:
    path = tmp_path / "best.tum"
    assert main(["smooth", DEMO, "-o", str(path)]) == 0
    printed = capsys.readouterr().out
    for title in ("Measurements used", "Biases", "White noise in flight", "Constants", "Autopilot minus best estimate"):
        assert title in printed
    rows = [line for line in printed.splitlines() if line.startswith(" ")]
    assert max(map(len, rows)) <= 80
    assert "nothing: they agree" in printed

    rows_written = np.loadtxt(path)
    flight = c.open_log(DEMO)[0]
    track = flight.imu()
    assert len(rows_written) == len(track)
    assert np.abs(rows_written[:, 0] - track.t).max() < 0.03  # readings speak of the time before the filter's delay
    np.testing.assert_allclose(np.linalg.norm(rows_written[:, 4:], axis=1), 1.0, atol=1e-6)
    truth = flight.truth
    assert truth is not None
    north = np.interp(rows_written[:, 0], truth.t, truth.position[:, 0])
    assert np.percentile(np.abs(rows_written[:, 1] - north), 95) < 1.0

    assert main(["smooth", DEMO, "-o", str(path)]) == 2
    assert "--force" in capsys.readouterr().err


def test_the_json_says_the_same_with_every_constant(capsys: Captured) -> None:
    assert main(["smooth", DEMO, "--json"]) == 0
    (flight,) = json.loads(capsys.readouterr().out)["flights"]
    assert flight["imu"] == "RAW_IMU"
    assert flight["explained"] == []
    assert set(flight["constants"]) == set(CONSTANTS)
    assert [one["quantity"] for one in flight["autopilot_error"]] == ["tilt", "heading", "velocity", "position"]
    for one in flight["autopilot_error"]:
        assert 0 <= one["median"] <= one["p95"] <= one["worst"]
        assert one["sigma"] > 0
    assert {one["name"] for one in flight["witnesses"]} >= {"gps_position", "gps_velocity", "compass"}


def test_the_json_has_the_probability_of_every_side() -> None:
    log = c.open_log(DEMO)
    rivals = (Rival("gyro_bias", "step", 2.0, 1.0), Rival("compass_field", "pulse", 1.0, 0.5))
    one = Explained("gyro_bias", "step", 60.0, 0.1, np.inf, np.array([0.0, 0.0, 0.02]), np.full(3, 1e-3), rivals)
    best = replace(c.smooth(log[0]), explained=(one,))
    source = Source(Path(DEMO), "tlog", 1, 1)
    (told,) = json.loads(encode(estimate_document(source, log[0], best, (), None)))["flights"][0]["explained"]
    assert told["probability"].keys() == {"imu", "gps", "compass", "barometer", "nobody"}
    assert sum(told["probability"].values()) == pytest.approx(1.0)
    assert told["probability"]["imu"] > told["probability"]["compass"] > told["probability"]["gps"]
    assert told["rivals"][1] == {"kind": "compass_field", "shape": "pulse", "log_odds": 1.0, "fault": 0.5}


def test_another_ending_is_refused_before_the_work_is_done(tmp_path: Path, capsys: Captured) -> None:
    assert main(["smooth", DEMO, "-o", str(tmp_path / "best.csv")]) == 2
    assert "companion export" in capsys.readouterr().err


def test_an_imu_that_is_too_slow_gets_one_sentence(tmp_path: Path, capsys: Captured) -> None:
    log = Writer(tmp_path / "slow.tlog")
    log.rest(40.0, hz=1.0)
    assert main(["smooth", str(log.close())]) == 2
    said = capsys.readouterr()
    assert not said.out
    assert "1.5 Hz or more" in said.err


def test_a_repr_fits_in_a_line() -> None:
    shown = repr(c.smooth(c.open_log(DEMO)[0]))
    assert shown.startswith("BestEstimate(RAW_IMU, 307 keyframes")
    assert len(shown) < 200
