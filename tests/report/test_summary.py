"""The first screen of a report: verdict, worst, expected, when; nothing on it contradicts the verdict."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from companion.present import palette
from companion.report import html_page
from tests.recordings import recording
from tests.report.pages import DEMO, report

pytestmark = pytest.mark.slow


def usual(page: str) -> list[list[str]]:
    """The rows of the table of the first screen."""
    (table,) = re.findall(r'<table id="usual".*?</table>', page)
    return [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in re.findall(r"<tr>(.*?)</tr>", table)][1:]


def test_a_healthy_flight(tmp_path: Path) -> None:
    page = report(DEMO, tmp_path / "report.html", "--no-playback")
    assert page.index("✓ No IMU fault found") < page.index("chart1") < page.index("<nav>"), "the track comes first"
    assert "farthest apart at" in page
    assert [row[0] for row in usual(page)] == ["attitude, °", "velocity, m/s", "position, m"]
    assert all(float(median) <= float(p95) for _, median, p95, _ in usual(page))
    assert "98\N{NO-BREAK SPACE}% of 46 windows" in page, "said once, of the windows that the verdict judges"
    assert "best estimate" in page


def test_the_sentence_does_not_contradict_a_suspect(tmp_path: Path) -> None:
    page = report(recording("sitl/copter-imu1-fail-100hz.tlog"), tmp_path / "report.html", "--no-playback")
    assert "✗ Accelerometer x wrong, 69-81 s" in page
    times = re.search(r"([\d.]+) times the [\d.]+ m allowed", page.replace("\N{NO-BREAK SPACE}", " "))
    assert times
    assert float(times[1]) > 3


def test_the_style_lights_up_the_best_estimate_s_own_colour() -> None:
    """A style sheet cannot import the palette: on dark it finds the line by its colour."""
    style = (Path(html_page.__file__).parent / "page.css").read_text(encoding="utf-8")
    light = "".join(f"{part:02x}" for part in palette.BEST_LIGHT)
    assert f'[style*="stroke: rgb{palette.BEST}"] {{ stroke: #{light} !important; }}' in style


def test_findings_and_verdicts_have_the_page_s_colours_and_no_source_s() -> None:
    style = (Path(html_page.__file__).parent / "page.css").read_text(encoding="utf-8")
    assert f"--bad: {palette.css(palette.BAD)}; --doubtful: {palette.css(palette.DOUBTFUL)};" in style
    assert ".finding.error { border-color: var(--bad); }" in style
