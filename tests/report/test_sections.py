"""Lanes have a section where the log has several, and the checks before take-off where a vehicle only stands."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.recordings import recording
from tests.report.pages import Contents, report
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
