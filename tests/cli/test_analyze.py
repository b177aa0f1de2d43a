"""The first screen of `analyze`: short, whatever the flight, and the rest is behind --full."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from companion import examine, open_log
from companion.cli import main
from companion.cli.analyze import first_screen
from companion.estimation import HYPOTHESES
from companion.verdict import Finding
from tests.recordings import BUNDLED, recording

pytestmark = pytest.mark.slow

Captured = pytest.CaptureFixture[str]

LOGS = [
    "sitl/copter-biased-imu-100hz.tlog",
    "sitl/copter-gps-glitch-50hz.tlog",
]


@pytest.mark.parametrize("log", LOGS)
def test_it_fits_on_a_screen(log: str, monkeypatch: pytest.MonkeyPatch, capsys: Captured) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["analyze", str(recording(log))]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 24
    assert max(len(line) for line in lines) <= 80
    text = "\n".join(lines)
    assert lines[0].startswith(("IMU SUSPECT", "AUTOPILOT SUSPECT", "CONSISTENT"))
    assert "After 10 s" in text
    assert "allowed)" in text
    assert "Detectable" in text
    assert "--full" in text
    assert lines[0].startswith("CONSISTENT") or "What to do" in text


def test_the_gravest_finding_is_shown_however_long_it_is() -> None:
    examined = examine(open_log(BUNDLED / "copter-demo-100hz.tlog")[0])
    long = Finding("gyro_bias", "imu", "error", 70.0, 80.0, "it is off " * 200, "Look at it.")
    verdict = replace(examined.verdict, findings=(long, replace(long, severity="info")))
    screen = first_screen(replace(examined, assessment=replace(examined.assessment, verdict=verdict)), 80)
    assert sum("it is off" in line for line in screen) > 20
    assert "  and 1 more: --full" in screen


def test_what_a_low_rate_leaves_open_is_stated_once(capsys: Captured) -> None:
    assert main(["analyze", str(BUNDLED / "copter-mission-default-rates.tlog")]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "would not have shown" in out
    assert "2.0 Hz is too low to integrate" in out
    assert out.count("Record the IMU at 50-200 Hz") == 1


def test_the_cause_in_numbers(capsys: Captured) -> None:
    """A gyro bias of (9.55, -14.48, 7.52) mrad/s is switched on at rest."""
    assert main(["analyze", str(recording("sitl/copter-biased-imu-100hz.tlog")), "--json"]) == 0
    verdict = json.loads(capsys.readouterr().out)["flights"][0]["verdict"]
    cause = verdict["cause"]
    assert (cause["kind"], cause["side"], cause["sensor"], cause["unit"]) == ("gyro_bias", "imu", "gyro", "rad/s")
    assert cause["size"] == pytest.approx(18.9e-3, abs=3e-3)
    assert cause["onset_s"] == pytest.approx(57.3, abs=3.0)
    assert 0.95 <= cause["probability"] <= 1.0
    assert cause["rival"] in {kind.name for kind in HYPOTHESES if kind.device != "imu"}
    assert cause["rival_probability"] <= 1.0 - cause["probability"]
    assert verdict["detectable"].keys() == {"gyro_bias", "accel_bias", "tilt", "heading", "position", "gps", "compass"}
    assert verdict["not_judged"] == []
    assert verdict["probability"]["imu"] > 0.95
    assert sum(verdict["probability"].values()) == pytest.approx(1.0)


def test_a_healthy_flight_has_no_cause(capsys: Captured) -> None:
    assert main(["analyze", "demo", "--json"]) == 0
    verdict = json.loads(capsys.readouterr().out)["flights"][0]["verdict"]
    assert (verdict["status"], verdict["cause"]) == ("consistent", None)
    assert verdict["probability"]["nobody"] > 0.95
    assert 1e-3 < verdict["detectable"]["gyro_bias"] < 20e-3


def test_a_narrow_terminal_still_shows_what_was_found(monkeypatch: pytest.MonkeyPatch, capsys: Captured) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    assert main(["analyze", str(recording("sitl/copter-imu1-fail-100hz.tlog"))]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 60
    assert sum(line.startswith("  ✗") for line in lines) == 2
    assert not any(line.strip() in {"m", "m/s", "m/s²", "Hz"} for line in lines), "a number without its unit"


def test_what_faults_would_be_called(capsys: Captured, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    assert main(["analyze", "demo", "--confusion", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["flights"][0]
    rows = {row["kind"]: row for row in found["confusion"]["faults"]}
    assert rows["gyro_bias"]["detectable"] == pytest.approx(found["verdict"]["detectable"]["gyro_bias"])
    for row in rows.values():
        assert sum(row["called"].values()) == pytest.approx(1.0)
        assert row["identifiable"] is None or row["identifiable"] >= row["detectable"]
    assert rows["gps_position"]["lasts_s"] == 30.0
    creep = rows["gps_position"]
    assert creep["undetected"]["position_m"] == pytest.approx(creep["detectable"], rel=0.4), "it is followed"
