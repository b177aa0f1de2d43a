"""Corrections on disk."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import companion as c
from companion.app.correction import correction_text, load_correction
from companion.comparison import GENERIC, PARTS, ReferenceSpec, calibrate, compare
from tests.recordings import BUNDLED

OLD = "gyro_bias = [0.01, 0, 0]\naccel_bias = [0, 0.1, 0]\nmounting = [0.01, -0.02, 0.03]\ntime_offset = 0.012\n"


def test_a_file_holds_what_the_flight_tells(tmp_path: Path) -> None:
    flight = c.open_log(BUNDLED / "copter-demo-100hz.tlog")[0]
    found = calibrate(compare(flight), GENERIC, ReferenceSpec())
    assert found
    every = replace(found, correction=replace(found.correction, lever_arm=np.array([0.1, -0.2, 0.3])))
    path = tmp_path / "imu.toml"
    path.write_text(correction_text(every, "a flight"), encoding="utf-8")
    loaded = load_correction(path)
    assert loaded.values == pytest.approx(every.correction.values, abs=1e-8)
    told = np.array(found.observable) | np.array(found.assumed)
    told[PARTS["lever_arm"]] = True
    assert not loaded.values[~told].any()
    differs = np.abs(found.correction.values - found.values)[told] > 0.1 * found.sigma[told]
    assert differs.any()
    assert "not quite as `companion calibrate` prints it" in path.read_text(encoding="utf-8")


def test_a_file_of_the_first_format_turns_the_readings_as_it_did(tmp_path: Path) -> None:
    """It meant true = (1 - [mounting]x)(measured - bias)."""
    path = tmp_path / "old.toml"
    path.write_text(OLD, encoding="utf-8")
    loaded = load_correction(path)
    imu = c.ImuTrack(np.array([0.0, 1.0]), np.full((2, 3), 0.1), np.full((2, 3), 1.0))
    gyro = imu.gyro[0] - [0.01, 0, 0]
    assert loaded.apply(imu).gyro[0] == pytest.approx(gyro - np.cross([0.01, -0.02, 0.03], gyro))
    assert not loaded.values[10:].any()
