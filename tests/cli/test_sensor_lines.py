"""What the commands print about the sensor, and the choice of where to start from."""

from __future__ import annotations

import json

import pytest

from companion.cli.main import main
from tests.recordings import BUNDLED, recording

pytestmark = pytest.mark.slow

DEMO = str(BUNDLED / "copter-demo-100hz.tlog")


def test_from_rest_in_words_and_numbers(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["analyze", DEMO, "--anchor", "rest"]) == 0
    text = capsys.readouterr().out
    assert "The IMU alone, from rest (62.5-74.8 s)" in text
    assert "heading from the magnetometer" in text
    assert main(["analyze", DEMO, "--anchor", "rest", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["flights"][0]
    assert found["alignment"]["heading_from"] == "magnetometer"
    assert [round(row["since_s"]) for row in found["alignment"]["later"]] == [1, 10, 60, 89]
    assert found["rests"][0]["gyro_noise"] is None, "RAW_IMU at rest reads nothing but zeros"
    assert found["autopilot_gyro_bias"]["sigma"][0] < 1e-3


def test_noise_at_rest_stands_beside_the_data_sheet(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["analyze", str(recording("px4/px4_square_lownoise.tlog")), "--full"]) == 0
    noise = [line for line in capsys.readouterr().out.splitlines() if "/√Hz expected" in line]
    assert len(noise) == 2
    assert all("at rest" in line and "in flight" in line for line in noise)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["view", DEMO, "--anchor", "rest", "--reanchor", "5"], "leave --reanchor out"),
        (["view", "udpin:127.0.0.1:14999", "--anchor", "rest"], "--anchor rest is for a log"),
    ],
)
def test_what_rest_does_not_go_with(arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 2
    assert words in capsys.readouterr().err


def test_a_flight_without_rest(capsys: pytest.CaptureFixture[str]) -> None:
    log = str(recording("public/squilter__gridlines__kresge_02.tlog"))
    for command in ("analyze", "view"):
        assert main([command, log, "--anchor", "rest"]) == 2
        assert "no rest of three seconds" in capsys.readouterr().err
