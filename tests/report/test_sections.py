"""Sections that some flights have, lanes and checks before take-off, and the charts of findings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from companion.analysis import Finding
from companion.app.examination import examine
from companion.app.recording import read_recording
from companion.report import report_html
from tests.recordings import recording
from tests.report.pages import DEMO, Contents, report
from tests.tlogs import resting

pytestmark = pytest.mark.slow


def test_the_lanes_have_a_section_where_there_are_several(tmp_path: Path) -> None:
    log = recording("dataflash/sitl__copter-imu1-fail.BIN")
    contents = Contents(report(log, tmp_path / "page.html", "--no-playback"))
    assert "right (over 99.9 %" in " ".join(contents.sections["lanes"].split())
    assert [row[0] for row in contents.tables["lanes1"]][1:4] == ["EKF3 core 0", "EKF3 core 1", "DCM"]
    assert contents.figures


def test_a_vehicle_that_only_stands_has_its_checks(tmp_path: Path) -> None:
    contents = Contents(report(resting(tmp_path / "resting.tlog"), tmp_path / "page.html", "--no-playback"))
    assert "preflight" in contents.sections
    assert "lanes" not in contents.sections


@pytest.mark.parametrize(("kind", "shows"), [("accel_bias", "IMU minus what"), ("samples_irregular", "Time between")])
def test_the_chart_of_a_finding_is_of_that_finding(kind: str, shows: str) -> None:
    """Also of one that accuses nobody for certain."""
    read = read_recording(DEMO)
    (flight,), source = read.flights, read.source
    examined = examine(flight)
    finding = Finding(kind, "data", "warning", flight.start + 10.0, flight.start + 40.0, "perhaps", "")
    assessment = examined.assessment
    assessment = replace(assessment, verdict=replace(assessment.verdict, findings=(finding,)))
    page = report_html(replace(examined, assessment=assessment), source, with_playback=False)
    assert shows in Contents(page).sections["findings"]
