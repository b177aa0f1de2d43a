"""`companion lanes`: what it says of a flight whose EKF changed its core, and the keys of its JSON."""

from __future__ import annotations

import json
from typing import Any

import pytest

from companion.cli import main
from tests.documents.test_keys import KEYS, differences
from tests.recordings import BUNDLED, recording

pytestmark = pytest.mark.slow

Captured = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def switched() -> str:
    """Accelerometer 0 is off by 3 m/s² from 68.8 s on, and the EKF changes to core 1 at 69.7 s."""
    return str(recording("dataflash/sitl__copter-imu1-fail.BIN"))


def test_the_switch_away_from_the_faulty_imu_was_right(switched: str, capsys: Captured) -> None:
    assert main(["lanes", switched, "--json"]) == 0
    document: Any = json.loads(capsys.readouterr().out)
    assert differences(document, KEYS["lanes"], "lanes") == []
    (flight,) = document["flights"]
    assert flight["imu"] == "IMU[1]"  # the estimate is not carried by the IMU that is accused
    assert [(one["core"], one["imu"]) for one in flight["lanes"]] == [(0, 0), (1, 1), (None, None)]
    (switch,) = flight["switches"]
    assert switch["judgement"] == "right"
    assert switch["t_s"] == pytest.approx(69.7, abs=0.1)
    fault = next(span for span in flight["spans"] if span["what"] == "accel_bias")
    assert (fault["right"], fault["readers"]) == ("EKF3 core 1", ["EKF3 core 0"])
    off = {one["lane"]: one["off"] for span in flight["spans"] for one in span["lanes"]}
    assert off["EKF3 core 0"]
    assert not off["EKF3 core 1"]


def test_the_lines_are_of_a_terminals_width(switched: str, capsys: Captured, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["lanes", switched]) == 0
    printed = capsys.readouterr().out
    assert "right (over 99.9 % that it is nearer to the truth)" in " ".join(printed.split())
    assert max(map(len, printed.splitlines())) <= 80


def test_a_link_tells_of_what_flew_alone(capsys: Captured) -> None:
    assert main(["lanes", str(BUNDLED / "copter-demo-100hz.tlog"), "--json"]) == 0
    (flight,) = json.loads(capsys.readouterr().out)["flights"]
    assert [one["name"] for one in flight["lanes"]] == ["as flown"]
    assert "on-board log" in flight["notes"][0]
    assert not any(one["off"] for span in flight["spans"] for one in span["lanes"])
