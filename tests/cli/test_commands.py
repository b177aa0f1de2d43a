"""The commands as their users run them: output, exit codes, and what bad input gets."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from companion.app.examination import examine
from companion.app.recording import read_recording
from companion.cli import main
from tests.recordings import BUNDLED, all_shared, beginning
from tests.remembered import once
from tests.tlogs import Writer

pytestmark = pytest.mark.slow

DEMO = str(BUNDLED / "copter-demo-100hz.tlog")

Captured = pytest.CaptureFixture[str]


def refused(arguments: list[str], capsys: Captured) -> str:
    """What a command says on stderr that exits with 2: one sentence or two, no traceback."""
    try:
        code = main(arguments)
    except SystemExit as stop:  # argparse's own errors
        code = int(stop.code or 0)
    said = capsys.readouterr()
    assert code == 2
    assert "Traceback" not in said.err
    assert not said.out
    return said.err


def test_analyze_prints_the_drift_table(capsys: Captured) -> None:
    assert main(["analyze", DEMO, "--full"]) == 0
    out = capsys.readouterr().out
    assert "RAW_IMU (IMU 0), 10121 samples at 100.0 Hz" in out
    assert "ATTITUDE, LOCAL_POSITION_NED" in out
    assert max(len(line) for line in out.splitlines() if re.match(r" *\d+ s ", line)) <= 80
    rows = [line.split() for line in out.split("Allowed drift")[0].splitlines() if re.match(r" *\d+ s ", line)]
    assert [row[0] for row in rows] == ["1", "2", "5", "10", "30"]
    assert all(len(row) == 12 for row in rows), "after, s, used, and three times median, 95 %, worst"
    assert "Warning" not in out


def test_analyze_json_is_of_what_was_chosen(capsys: Captured) -> None:
    options = ["--method", "midpoint", "--horizons", "2,4", "--imu", "scaled_imu2", "--vehicle", "1:1", "--boot", "1"]
    assert main(["analyze", DEMO, "--json", *options]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["log"]["frames"] == 23872
    (flight,) = found["flights"]
    known = {"sysid": 1, "compid": 1, "autopilot": "ARDUPILOTMEGA", "type": "QUADROTOR"}
    assert known.items() <= flight["vehicle"].items()
    assert flight["reference"] == {"attitude": "ATTITUDE", "position": "LOCAL_POSITION_NED"}
    assert (flight["used_imu"], flight["method"]) == ("SCALED_IMU2", "midpoint")
    assert [row["horizon_s"] for row in flight["drift"]] == [2, 4]
    for row in flight["drift"]:
        for quantity in ("attitude_deg", "velocity_mps", "position_m"):
            assert 0 < row[quantity]["median"] <= row[quantity]["p95"] <= row[quantity]["max"]


def test_info_json_is_what_is_in_the_log(capsys: Captured) -> None:
    assert main(["info", DEMO, "--json"]) == 0
    (flight,) = json.loads(capsys.readouterr().out)["flights"]
    assert flight["messages"]["RAW_IMU"]["count"] == 10121
    assert [part["kind"] for part in flight["phases"]] == ["standing", "flight", "landed"]
    sensors = {sensor["source"]: sensor for sensor in flight["sensors"] if sensor["kind"] in ("GPS", "compass")}
    assert sensors.keys() == {"GPS_RAW_INT", "RAW_IMU", "SCALED_IMU2"}
    assert sensors["GPS_RAW_INT"]["rate_hz"] == pytest.approx(2.0, rel=0.01)
    assert flight["imu_in_use"] == [{"t_s": pytest.approx(flight["start_s"]), "instance": 0}]
    assert [reset["kind"] for reset in flight["resets"]] == ["heading", "heading"]


@pytest.mark.skipif(os.name == "nt", reason="no such names there")
@pytest.mark.parametrize("whole", [True, False], ids=["folder", "log"])
def test_the_name_of_a_log_tells_the_terminal_nothing(tmp_path: Path, capsys: Captured, *, whole: bool) -> None:
    """Of a log from elsewhere it may set colours and titles, or turn what is read around."""
    log = tmp_path / "a\x1b[31m\u202eb.tlog"
    shutil.copy(DEMO, log)
    assert main(["info", str(tmp_path if whole else log)]) == 0
    assert not {"\x1b", "\u202e"} & set(capsys.readouterr().out)


def test_several_logs_are_a_table_that_fits_a_terminal(tmp_path: Path, capsys: Captured) -> None:
    (tmp_path / "broken.tlog").write_bytes(b"")
    shutil.copy(DEMO, tmp_path / f"{'a-long-name-' * 5}.tlog")
    assert main(["info", "demo", str(tmp_path)]) == 2
    said = capsys.readouterr()
    lines = said.out.splitlines()
    assert max(map(len, lines)) <= 80
    assert "broken.tlog" in said.err
    (demo,) = (line.split() for line in lines if "copter-demo-100hz.tlog" in line)
    assert demo[1:] == ["ArduPilot", "1:1", "102", "99.7", "24.9", "49.9", "20", "2"]
    assert [line.split()[1:] for line in lines if line.startswith("broken")] == [["not", "read"]]


def test_the_table_has_a_line_for_each_flight(tmp_path: Path, capsys: Captured) -> None:
    (tmp_path / "broken.tlog").write_bytes(b"")
    assert main(["info", "demo", str(tmp_path), "--table"]) == 2
    head, _, *lines = (
        [cell.strip() for cell in line.split("|")[1:-1]] for line in capsys.readouterr().out.splitlines()
    )
    rows = {line[0]: dict(zip(head, line, strict=True)) for line in lines}
    demo = rows["copter-demo-100hz.tlog"]
    assert (demo["IMU"], demo["GPS"], demo["attitude"]) == ("99.7 24.9", "2", "49.9")
    assert demo["vehicle"] == "ArduPilot 1:1, boot 1"
    assert rows["broken.tlog"]["vehicle"].startswith("not read:")


@pytest.mark.parametrize(
    ("command", "option"),
    [("info", "--json"), ("info", "--verbose"), ("analyze", "--confusion"), ("analyze", "--anchor rest")],
)
def test_an_option_of_one_log(command: str, option: str, capsys: Captured) -> None:
    assert f"{option} is of one log" in refused([command, DEMO, DEMO, *option.split()], capsys)


def test_the_verdicts_on_several_logs_are_a_table(
    tmp_path: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    (tmp_path / "broken.tlog").write_bytes(b"")
    low = str(BUNDLED / "copter-mission-default-rates.tlog")
    assert main(["analyze", DEMO, low, str(tmp_path)]) == 2
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 60
    assert "CONSISTENT" in out
    assert "CANNOT TELL" in out
    assert "not read" in out
    assert main(["analyze", DEMO, low, "--fail-on", "insufficient"]) == 1
    capsys.readouterr()
    assert main(["analyze", DEMO, low, "--json"]) == 2
    assert "fleet" in capsys.readouterr().err


def test_info_says_what_would_be_used(capsys: Captured) -> None:
    assert main(["info", DEMO]) == 0
    out = capsys.readouterr().out
    assert "would integrate: RAW_IMU (IMU 0), 10121 samples at 100.0 Hz" in out
    assert "would compare with: ATTITUDE, LOCAL_POSITION_NED" in out
    assert "estimator used: IMU 0 (EK3_PRIMARY)" in out
    assert "announced: 2 heading resets" in out
    assert re.search(r"GPS +GPS_RAW_INT +203 +2\.0", out)
    assert "ArduPilot 4.7.0-dev quadrotor" in out


@pytest.mark.parametrize("columns", [60, 80, 130])
def test_what_a_sensor_tells_is_whole_in_every_terminal(
    columns: int, monkeypatch: pytest.MonkeyPatch, capsys: Captured
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    assert main(["info", DEMO]) == 0
    out = capsys.readouterr().out
    assert "IMU 0, device 2752772, low-pass 20 Hz" in out
    assert "…" not in out
    assert max(map(len, out.splitlines()[1:])) <= columns


def test_several_flights_are_listed_and_one_is_chosen(tmp_path: Path, capsys: Captured) -> None:
    log = Writer(tmp_path / "two.tlog")
    log.rest(10.0, boot=300.0)
    log.rest(60.0, begin=60.0, boot=2.0)
    path = str(log.close())
    assert main(["analyze", path, "--json"]) == 0
    said = capsys.readouterr()
    assert "2 flights: using vehicle 1:1, boot 2. Others: --vehicle 1:1 --boot 1" in said.err
    assert json.loads(said.out)["flights"][0]["boot"] == 2
    assert main(["analyze", path, "--boot", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["flights"][0]["duration_s"] == pytest.approx(10)
    assert "--vehicle 1:1 --boot 2" in refused(["analyze", path, "--vehicle", "9"], capsys)


def log_of(path: Path, *, imu: int = 0, attitude: int = 0, heartbeat: int = 50, **sender: int) -> None:
    """So many of each message, one a second."""
    log = Writer(path)
    for i in range(50):
        if i < heartbeat:
            log.heartbeat(i, **sender)
        if i < imu:
            log.raw_imu(i, 10 + i)
        if i < attitude:
            log.attitude(i, 10 + i)
    log.close()


LACKING = [
    (partial(log_of, attitude=50), "no IMU message"),
    (partial(log_of, imu=50), "no attitude"),
    (partial(log_of, imu=1, attitude=50, heartbeat=0), "RAW_IMU (1)"),
]


@pytest.mark.parametrize("command", ["analyze", "view"])
@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda _: None, "no file"),
        (Path.mkdir, "director"),
        (Path.touch, "empty"),
        (lambda path: path.write_bytes(b"no telemetry in here\n" * 100), "not a flight log"),
        (partial(log_of, sysid=255, compid=190, autopilot=8, kind=6), "no vehicle found"),
    ],
)
def test_bad_logs(command: str, make: Callable[[Path], None], expected: str, tmp_path: Path, capsys: Captured) -> None:
    make(tmp_path / "bad.tlog")
    said = refused([command, str(tmp_path / "bad.tlog")], capsys)
    assert expected.lower() in said.lower()


def test_a_log_without_a_vehicle_among_several_fails_as_it_does_alone(tmp_path: Path, capsys: Captured) -> None:
    logs = [str(tmp_path / name) for name in ("a.tlog", "b.tlog")]
    for log in logs:
        log_of(Path(log), kind=6)
    for named in (logs[:1], logs):
        assert main(["analyze", *named, "--fail-on", "insufficient"]) == 2
        assert main(["info", *named]) == 0
    assert "no vehicle" in capsys.readouterr().out


@pytest.mark.parametrize(("make", "expected"), LACKING)
def test_a_log_with_nothing_to_compare(
    make: Callable[[Path], None], expected: str, tmp_path: Path, capsys: Captured
) -> None:
    """The verdict is that it cannot tell, in words and in JSON; the other commands refuse it with the same sentence."""
    log = tmp_path / "bad.tlog"
    make(log)
    assert main(["analyze", str(log)]) == 2
    said = capsys.readouterr()
    assert said.out.startswith("CANNOT TELL  ")
    assert expected in said.out
    assert "Record" in said.out or "Ask" in said.out
    assert said.err.startswith("companion: nothing was analysed.")
    assert main(["analyze", str(log), "--json"]) == 2
    (flight,) = json.loads(capsys.readouterr().out)["flights"]
    verdict = flight["verdict"]
    assert verdict["status"] == "insufficient_data"
    assert verdict["summary"].startswith("Cannot tell: ")
    assert "CANNOT TELL  " + verdict["summary"].removeprefix("Cannot tell: ") + "\n" == said.out
    assert (flight["used_imu"], flight["figures"], flight["drift"], verdict["findings"]) == (None, None, [], [])
    for command in ("view", "calibrate"):
        assert expected in refused([command, str(log)], capsys)
    assert f"{log}: " in refused(["compare", DEMO, str(log)], capsys)


@pytest.mark.parametrize(
    ("text", "line", "expected"),
    [
        ("[drift]\nhorizons_s = [1]\nhorizon = 5\n", 3, "horizon"),
        ("[integration]\nmethod = 'rk5'\n", 2, "rk5"),
        ("[view]\n# comment\nport = 'http'\n", 3, "int"),
        ("[drift]\nhorizons_s = [1, -2]\n", 2, "> 0"),
        ("[drift]\ngap_s = inf\n", 2, "1000000"),
        ("[view]\nport = 1\n\n[drift]\ngap_s = 1\n[drift.sub]\nx = 1\n", 6, "sub"),
        ("[view]\n\n['drift']\ngap_s = 'x'\n", 4, "float"),
        ("[autopilot]\ntilt = 1e300\n", 2, "10"),
        ("[wiev]\nport = 1\n", 1, "wiev"),
        ("[view\n", 1, "TOML"),
    ],
)
def test_a_bad_config_names_the_line(text: str, line: int, expected: str, tmp_path: Path, capsys: Captured) -> None:
    config = tmp_path / "my.toml"
    config.write_text(text)
    said = refused(["analyze", DEMO, "--config", str(config)], capsys)
    assert expected in said
    assert f"line {line}" in said


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--imu", "RAW_MIU"], "no usable RAW_MIU"),
        (["--imu", "HIGHRES_IMU"], "no usable HIGHRES_IMU"),
        (["--horizons", "5,-1"], "--horizons"),
        (["--horizons", "five"], "must be positive seconds like 1,5,10, got 'five'"),
        (["--method", "rk5"], "rk5"),
        (["--method", "euler", "--middle", "cubic"], "--middle is rk4's, and euler has no sample in mid-step"),
        (["--config", "missing.toml"], "cannot read the settings file"),
        (["--dialect", "ardupilotmeag"], "ardupilotmega"),
    ],
)
def test_bad_options(options: list[str], expected: str, capsys: Captured) -> None:
    assert expected in refused(["analyze", DEMO, *options], capsys)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--port", "70000"], "--port: expected `int` <= 65535"),
        (["--reanchor", "-3"], "--reanchor: expected `float`"),
        (["--host", "no.such.host.invalid"], "no.such.host"),
    ],
)
def test_bad_view_options(options: list[str], expected: str, capsys: Captured) -> None:
    assert expected in refused(["view", DEMO, *options], capsys)


@pytest.mark.parametrize("command", ["info", "analyze"])
@pytest.mark.parametrize("path", all_shared())
def test_every_recording_goes_through(
    command: str, path: Path, tmp_path: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a result, or with a sentence and exit code 2: never a traceback. Read once, printed twice."""
    log = str(beginning(path, tmp_path))
    monkeypatch.setattr("companion.cli.options.read_recording", once(read_recording))
    monkeypatch.setattr("companion.app.examination.examine", once(examine))
    for json_too in ([], ["--json"]):
        code = main([command, log, *json_too])
        said = capsys.readouterr()
        assert code in {0, 2}
        if code:
            assert "\ncompanion: " in f"\n{said.err}"
            assert command == "analyze", "info reads every log"
        if said.out and json_too:
            assert json.loads(said.out)["schema"] == 2
        assert said.out or code


def test_a_calibration_is_written_and_applied(tmp_path: Path, capsys: Captured) -> None:
    target = tmp_path / "imu.toml"
    assert main(["calibrate", DEMO, "-o", str(target)]) == 0
    assert "CONSISTENT" in capsys.readouterr().out
    assert "exists" in refused(["calibrate", DEMO, "-o", str(target)], capsys)
    assert main(["analyze", DEMO, "--correction", str(target), "--json"]) == 0
    flight = json.loads(capsys.readouterr().out)["flights"][0]
    assert flight["correction"] == str(target)
    assert abs(flight["calibration"]["gyro_bias_radps"]["value"][2]) < 1e-4, "what is left after it"


@pytest.mark.parametrize("target", ["/no/such/folder/imu.toml", "/tmp"])
def test_a_calibration_that_cannot_be_written(target: str, capsys: Captured) -> None:
    assert "cannot write" in refused(["calibrate", DEMO, "-o", target], capsys)


def test_a_calibration_of_a_flight_that_cannot_tell_is_not_written(tmp_path: Path, capsys: Captured) -> None:
    target = tmp_path / "imu.toml"
    log = str(BUNDLED / "copter-mission-default-rates.tlog")
    assert main(["calibrate", log, "-o", str(target)]) == 2
    assert "not written" in capsys.readouterr().err
    assert not target.exists()


@pytest.mark.parametrize(
    "text",
    ["gyro_bias = [nan, 0, 0]", "time_offset = inf", "gyro_bias = [1e30, 0, 0]", "accel_bias = [1, 2]", "bias = 3"],
)
def test_a_correction_that_is_none(text: str, tmp_path: Path, capsys: Captured) -> None:
    whole = {"gyro_bias": "[0, 0, 0]", "accel_bias": "[0, 0, 0]", "mounting": "[0, 0, 0]", "time_offset": "0"}
    key, value = text.split(" = ")
    path = tmp_path / "c.toml"
    path.write_text("\n".join(f"{k} = {v}" for k, v in (whole | {key: value}).items()))
    assert "is no correction" in refused(["analyze", DEMO, "--correction", str(path)], capsys)


def test_fail_on(capsys: Captured) -> None:
    low = str(BUNDLED / "copter-mission-default-rates.tlog")
    assert main(["analyze", DEMO, "--fail-on", "insufficient", "--json"]) == 0
    assert main(["analyze", low, "--fail-on", "suspect", "--json"]) == 0
    assert main(["analyze", low, "--fail-on", "insufficient", "--json"]) == 1
    capsys.readouterr()


def test_an_imu_model_can_be_chosen(capsys: Captured) -> None:
    assert main(["analyze", DEMO, "--full", "--imu-model", "icm-42688-p"]) == 0
    assert "icm-42688-p (requested)" in capsys.readouterr().out
    assert "bmi088" in refused(["analyze", DEMO, "--imu-model", "bmi99"], capsys)
