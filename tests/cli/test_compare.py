"""`companion compare` as its users run it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from companion.cli import main
from tests.recordings import BUNDLED

pytestmark = pytest.mark.slow

DEMO, HOVER = (str(BUNDLED / f"copter-{name}-100hz.tlog") for name in ("demo", "hover"))

Captured = pytest.CaptureFixture[str]


def test_two_flights_side_by_side(capsys: Captured, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["compare", DEMO, HOVER]) == 0
    out = capsys.readouterr().out
    assert re.match(r"(B is (worse|better): |No significant change)", out), "the answer comes first"
    table = out.split("Drift: median")[1].split("Allowed drift")[0]
    rows = [line.split() for line in table.splitlines() if line.strip().startswith(("1 s", "5 s"))]
    assert rows[0][2:4] == ["101", "99"]
    assert rows[1][4:6] == ["0.165", "0.499"]
    assert max(len(line) for line in table.splitlines() if " s  " in line) <= 80
    assert "Finding only in B: heading jump" in out
    assert "one set of windows against the other" in out


def test_the_medians_are_those_of_analyze(capsys: Captured) -> None:
    assert main(["compare", DEMO, HOVER, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    for side, log in (("a", DEMO), ("b", HOVER)):
        assert main(["analyze", log, "--json"]) == 0
        assert found[side] == json.loads(capsys.readouterr().out)
        assert [row[side] for row in found["drift"]] == found[side]["flights"][0]["drift"]
    assert not found["same_flight"]
    change = found["drift"][2]["change"]["position"]
    assert change["low"] < change["ratio"] < change["high"]
    assert change["direction"] == "worse"
    assert found["drift"][4]["change"]["position"]["high"] is None, "three windows a side bound nothing"


def test_fail_on_worse(capsys: Captured) -> None:
    assert main(["compare", DEMO, HOVER, "--fail-on-worse", "10%"]) == 1
    assert "worse than allowed: position after 5 s" in capsys.readouterr().err
    assert main(["compare", HOVER, DEMO, "--fail-on-worse", "10%"]) == 0
    assert main(["compare", DEMO, HOVER, "--fail-on-worse", "100000"]) == 0
    with pytest.raises(SystemExit):
        main(["compare", DEMO, HOVER, "--fail-on-worse", "much"])
    assert "percentage" in capsys.readouterr().err


def test_before_and_after_a_change_of_settings(tmp_path: Path, capsys: Captured) -> None:
    config = tmp_path / "euler.toml"
    config.write_text("[integration]\nmethod = 'euler'\n")
    for option in (["--config-b", str(config)], ["--method-b", "euler"]):
        assert main(["compare", DEMO, *option, "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        assert found["same_flight"]
        assert [found[side]["flights"][0]["method"] for side in "ab"] == ["rk4", "euler"]
        assert found["drift"][1]["change"]["position"]["paired"]
        assert found["drift"][1]["change"]["position"]["direction"] == "worse"
    assert main(["compare", DEMO, "--imu-b", "SCALED_IMU2", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["b"]["flights"][0]["used_imu"] == "SCALED_IMU2"


def test_before_and_after_a_correction(tmp_path: Path, capsys: Captured) -> None:
    """One that takes a roll rate out which was never there makes every window worse by it."""
    correction = tmp_path / "imu.toml"
    zero = "accel_bias = [0, 0, 0]\nmounting = [0, 0, 0]\ntime_offset = 0\n"
    correction.write_text(f"gyro_bias = [0.01, 0, 0]\n{zero}")
    assert main(["compare", DEMO, "--correction-b", str(correction), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [found[side]["flights"][0]["correction"] for side in "ab"] == [None, str(correction)]
    assert found["drift"][2]["change"]["attitude"]["direction"] == "worse"
    assert found["drift"][2]["b"]["attitude_deg"]["median"] == pytest.approx(0.05 * 57.3, rel=0.1)
    assert [figure["name"] for figure in found["calibration"] if figure["differs"]] == ["gyro_bias_x"]


def test_nothing_to_compare_with(capsys: Captured) -> None:
    assert main(["compare", DEMO]) == 2
    assert "--correction-b" in capsys.readouterr().err
