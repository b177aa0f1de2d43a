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


def cards(page: str) -> dict[str, str]:
    """Label → value."""
    return {label: value for value, label in re.findall(r'class="card"><b>(.*?)</b><span>(.*?)</span>', page)}


def test_a_healthy_flight(tmp_path: Path) -> None:
    page = report(DEMO, tmp_path / "report.html", "--no-playback")
    assert page.index("✓ Consistent") < page.index("chart1") < page.index("<nav>"), "the track is on the first screen"
    shown = cards(page)
    assert shown["farthest apart"].endswith(" m")
    assert any(label.startswith("expected there, 1σ") for label in shown)
    assert any("seconds since boot" in label for label in shown)
    assert "98\N{NO-BREAK SPACE}% of 46 windows" in page, "said once, of the windows that the verdict judges"
    assert not any("inside" in label for label in shown)
    assert "best estimate" in page


def test_no_tile_contradicts_a_suspect(tmp_path: Path) -> None:
    page = report(recording("sitl/copter-imu1-fail-100hz.tlog"), tmp_path / "report.html", "--no-playback")
    assert "✗ IMU suspect" in page
    shown = cards(page)
    (expected,) = (label for label in shown if label.startswith("expected there, 1σ"))
    times = re.search(r"([\d.]+) times that", expected)
    assert times
    assert float(times[1]) > 3
    assert not any("inside" in label for label in shown), "a share of good windows would read as a contradiction"


def test_the_style_lights_up_the_best_estimate_s_own_colour() -> None:
    """A style sheet cannot import the palette: on dark it finds the line by its colour."""
    style = (Path(html_page.__file__).parent / "page.css").read_text(encoding="utf-8")
    light = "".join(f"{part:02x}" for part in palette.BEST_LIGHT)
    assert f'[style*="stroke: rgb{palette.BEST}"] {{ stroke: #{light} !important; }}' in style


def test_findings_and_verdicts_have_the_page_s_colours_and_no_source_s() -> None:
    style = (Path(html_page.__file__).parent / "page.css").read_text(encoding="utf-8")
    assert f"--bad: {palette.css(palette.BAD)}; --doubtful: {palette.css(palette.DOUBTFUL)};" in style
    assert ".finding.error { border-color: var(--bad); }" in style
