"""The findings as Flight Review reads them: its own rules (docs/annotations.md there), put down here anew."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from companion.cli import main
from companion.export import write_annotations
from companion.verdict import Finding, Verdict
from tests.recordings import BUNDLED

_TIME = re.compile(r"^(?:(?:(\d+):)?(\d+):)?(\d+(?:\.\d+)?)$")


def seconds(text: str) -> float:
    found = _TIME.match(text)
    assert found, text
    hours, minutes, rest = found.groups()
    return 3600 * int(hours or 0) + 60 * int(minutes or 0) + float(rest)


def read(path: Path) -> list[dict[str, Any]]:
    """The categories of the one source, each held against what Flight Review refuses or cuts."""
    document = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert document["version"] == 1
    categories: list[dict[str, Any]] = []
    for source in document["sources"]:
        assert source["name"] == "companion"
        categories += source["annotations"]
    assert len({(c["category"], c["graph"]) for c in categories}) == len(categories) <= 50
    for category in categories:
        assert len(category["category"]) <= 64
        assert re.match(r"^#[0-9a-f]{6}$", category["color"])
        for interval in category["intervals"]:
            assert seconds(interval.get("end", interval["start"])) >= seconds(interval["start"])
            assert len(interval["annotation"]) <= 200
    return categories


def finding(kind: str, severity: Any, start: float, end: float, evidence: str = "seen") -> Finding:
    return Finding(kind, "imu", severity, start, end, evidence, "do this")


def test_one_category_a_kind_with_boot_clock_and_severity(tmp_path: Path) -> None:
    found = (
        finding("gyro_bias", "error", 68.25, 3700.5),
        finding("position_jump", "warning", 26.0, 26.0),
        finding("gyro_bias", "info", 10.0, 12.0),
    )
    write_annotations(tmp_path / "a.yaml", Verdict("imu_suspect", "Suspect.", found))
    gyro, jump = read(tmp_path / "a.yaml")
    assert (gyro["category"], gyro["graph"]) == ("gyro bias", "Raw Angular Speed (Gyroscope)")
    assert [(seconds(i["start"]), seconds(i["end"])) for i in gyro["intervals"]] == [(10.0, 12.0), (68.25, 3700.5)]
    assert [i["annotation"] for i in gyro["intervals"]] == ["info: seen", "error: seen"]
    assert jump["intervals"] == [{"start": "0:26.000", "annotation": "warning: seen"}], "an instant has no end"
    assert gyro["color"] != jump["color"]


def test_a_hostile_text_stays_a_text(tmp_path: Path) -> None:
    evil = 'x"\n  - name: owned\x00 ' + "long " * 100
    write_annotations(tmp_path / "a.yaml", Verdict("imu_suspect", evil, (finding("frozen", "error", -1.0, 2.0, evil),)))
    (category,) = read(tmp_path / "a.yaml")
    assert category["intervals"][0]["annotation"].startswith('error: x" - name: owned long')
    assert category["intervals"][0]["start"] == "0:00.000"


def test_without_findings_the_file_says_so(tmp_path: Path) -> None:
    write_annotations(tmp_path / "a.yaml", Verdict("consistent", "They agree.", ()))
    assert read(tmp_path / "a.yaml") == []


@pytest.mark.slow
def test_the_command_writes_it(tmp_path: Path) -> None:
    log = str(BUNDLED / "copter-demo-100hz.tlog")
    assert main(["export", log, "--format", "annotations", "-o", str(tmp_path / "a.yaml")]) == 0
    assert read(tmp_path / "a.yaml")


def test_of_too_many_findings_the_least_serious_are_left_out(tmp_path: Path) -> None:
    """Flight Review takes a thousand intervals."""
    many = [finding("accel_shock", "info", float(i), i + 0.5) for i in range(1200)]
    write_annotations(
        tmp_path / "a.yaml", Verdict("imu_suspect", "Suspect.", (*many, finding("stuck_axis", "error", 9.0, 9.5)))
    )
    shocks, stuck = read(tmp_path / "a.yaml")
    assert (len(shocks["intervals"]), len(stuck["intervals"])) == (999, 1)


def test_every_character_is_read_as_it_was(tmp_path: Path) -> None:
    """Evidence quotes the vehicle: of a character beyond 16 bits YAML would make two that no file can hold."""
    spoken = 'the vehicle said "\N{GRINNING FACE}: 1 µT, \\n"'
    (path,) = write_annotations(
        tmp_path / "a.yaml", Verdict("imu_suspect", spoken, (finding("gyro_bias", "error", 1.0, 2.0, spoken),))
    )
    ((interval,),) = [category["intervals"] for category in read(path)]
    assert interval["annotation"] == f"error: {spoken}"
