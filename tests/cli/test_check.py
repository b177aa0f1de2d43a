"""`companion check`: flights as tests, for continuous integration."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
import yaml
from junitparser import JUnitXml

from companion.cli import main
from companion.cli.check import Case, Suite, junit_xml
from companion.cli.main import parser
from tests.recordings import BUNDLED, ROOT
from tests.tlogs import Writer
from tests.waiting import LIMIT_S

Captured = pytest.CaptureFixture[str]


def standing(path: Path, *, tilt_mg: int = 0) -> str:
    """40 s at rest: consistent; with a tilt of the IMU against the autopilot nobody can tell which is wrong."""
    log = Writer(path)
    for i in range(2001):
        t = i / 50
        if i % 50 == 0:
            log.heartbeat(t)
        log.raw_imu(t, 20 + t, accel_mg=(0, tilt_mg, -1000))
        log.attitude(t, 20 + t)
        log.local_position(t, 20 + t)
    return str(log.close())


def stuck(path: Path) -> str:
    """A circle of 50 s, in which the IMU freezes after 30."""
    how = ["--motion", "circle", "--duration", "50", "--fault", "imu-stuck@30"]
    assert main(["simulate", "-o", str(path), *how]) == 0
    return str(path)


@pytest.mark.parametrize(
    ("make", "options", "code", "outcome"),
    [
        (standing, [], 0, "passed"),
        (stuck, [], 1, "failures"),
        (partial(standing, tilt_mg=300), [], 0, "skipped"),
        (partial(standing, tilt_mg=300), ["--fail-on", "insufficient"], 1, "failures"),
        (standing, ["--imu", "SCALED_IMU3"], 2, "errors"),
    ],
)
def test_the_exit_code_and_the_xml_are_those_of_the_verdict(
    make: Callable[[Path], str], options: list[str], code: int, outcome: str, tmp_path: Path
) -> None:
    log, xml = make(tmp_path / "a.tlog"), tmp_path / "out.xml"
    assert main(["check", log, "--junit", str(xml), *options]) == code
    read = JUnitXml.fromfile(str(xml))
    counts = {name: getattr(read, name) for name in ("failures", "errors", "skipped")}
    assert counts == {name: int(name == outcome) for name in counts}
    assert main(["analyze", log, *options, *([] if "--fail-on" in options else ["--fail-on", "suspect"])]) == code


def test_a_log_that_cannot_be_read_is_an_error_and_the_others_are_tested(tmp_path: Path, capsys: Captured) -> None:
    standing(tmp_path / "good.tlog")
    (tmp_path / "broken.tlog").write_bytes(b"")
    xml = tmp_path / "out.xml"
    assert main(["check", str(tmp_path), "--junit", str(xml)]) == 2
    assert "broken.tlog, is read" in capsys.readouterr().out
    suites = {suite.name: suite for suite in JUnitXml.fromfile(str(xml))}
    assert (suites["broken.tlog"].errors, suites["good.tlog"].errors, suites["good.tlog"].tests) == (1, 0, 1)


def test_a_flight_is_as_good_as_its_own_baseline_and_no_better_one(tmp_path: Path, capsys: Captured) -> None:
    log, file = standing(tmp_path / "a.tlog"), tmp_path / "baseline.json"
    assert main(["check", log, "--write-baseline", str(file)]) == 0
    check = ["check", log, "--baseline", str(file), "--tolerance"]
    assert main([*check, "0%"]) == 0
    baseline = json.loads(file.read_text())
    measures = baseline["flights"][0]["measures"]
    name = "drift 10 s velocity_mps"
    measures[name] /= 1.2
    file.write_text(json.dumps(baseline))
    assert main([*check, "10%"]) == 1
    assert f"{name}: " in capsys.readouterr().out
    assert main([*check, "25%"]) == 0
    baseline["flights"].append({"measures": {name: 1e9}})  # the worst of its flights is the limit
    file.write_text(json.dumps(baseline))
    assert main([*check, "0%"]) == 0


def test_what_every_flight_of_the_baseline_shows_and_this_one_does_not(tmp_path: Path, capsys: Captured) -> None:
    file = tmp_path / "baseline.json"
    file.write_text(json.dumps({"flights": [{"measures": {"detectable nothing": 1.0}}]}))
    assert main(["check", standing(tmp_path / "a.tlog"), "--baseline", str(file)]) == 1
    assert "detectable nothing: not known" in capsys.readouterr().out


@pytest.mark.parametrize("text", ["", "{}", '{"flights": []}', '{"flights": [{"measures": {"a": "b"}}]}', "\xff"])
def test_a_baseline_that_is_none(text: str, tmp_path: Path, capsys: Captured) -> None:
    file = tmp_path / "baseline.json"
    file.write_bytes(text.encode("latin-1"))
    assert main(["check", "demo", "--baseline", str(file)]) == 2
    assert "baseline" in capsys.readouterr().err


def test_any_text_makes_xml(tmp_path: Path) -> None:
    """Texts of a vehicle and names of files are of any bytes."""
    every = "".join(map(chr, [*range(0x300), 0xD800, 0xFFFE, 0x1F600]))
    path = tmp_path / "out.xml"
    path.write_bytes(junit_xml([Suite(every, 1.0, (Case(every, "failure", every, every),))]))
    (suite,) = JUnitXml.fromfile(str(path))
    assert suite.failures == 1


def test_the_github_action_runs_a_command_that_there_is(tmp_path: Path) -> None:
    """Its last step as the runner starts it, on a folder with one log."""
    action = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
    step = action["runs"]["steps"][-1]
    names = {value.strip("${ }").partition(".")[2]: name for name, value in step["env"].items()}
    given = {name: action["inputs"][name]["default"] for name in names if "default" in action["inputs"][name]}
    standing(tmp_path / "a.tlog")
    (tmp_path / "companion").write_text(f'#!/bin/sh\nexec "{sys.executable}" -m companion "$@"\n')
    (tmp_path / "companion").chmod(0o755)
    env = os.environ | {names[name]: value for name, value in (given | {"logs": "*.tlog"}).items()}
    env |= {"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
    if not (bash := shutil.which("bash")):
        pytest.skip("no bash here")
    run = subprocess.run(
        [bash, "-e", "-c", step["run"]],
        cwd=tmp_path,
        env=env,
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert JUnitXml.fromfile(str(tmp_path / given["junit"])).tests == 1


def test_the_demo_is_a_baseline_of_every_measure(tmp_path: Path) -> None:
    """Its document has a measure for each fault that `analyze` says is detectable."""
    file = tmp_path / "baseline.json"
    log = str(BUNDLED / "copter-demo-100hz.tlog")
    arguments = parser("check").parse_args(["check", log, "--write-baseline", str(file)])
    assert arguments.run(arguments) == 0
    measures = json.loads(file.read_text())["flights"][0]["measures"]
    assert {"detectable gyro_bias", "detectable gps", "drift 30 s position_m"} <= measures.keys()
