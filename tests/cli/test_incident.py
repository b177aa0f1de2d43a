"""`companion incident`: a page in Markdown, HTML and JSON."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from companion.cli import main
from tests.documents.test_keys import KEYS, differences
from tests.recordings import recording
from tests.report.pages import Contents
from tests.tlogs import Writer

pytestmark = pytest.mark.slow

Captured = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def switched() -> str:
    """Accelerometer 0 is off by 3 m/s² from 68.8 s on, and the EKF changes to core 1 at 69.7 s."""
    return str(recording("dataflash/sitl__copter-imu1-fail.BIN"))


def test_the_first_fault_is_the_moment(switched: str, capsys: Captured) -> None:
    assert main(["incident", switched, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert differences(document, KEYS["incident"], "incident") == []
    (flight,) = document["flights"]
    assert flight["moment"]["kind"] == "cause"
    assert flight["moment"]["t_s"] == pytest.approx(68.8, abs=0.5)
    assert flight["causes"][0]["name"] == "imu"
    assert any(row["what"] == "lane" for row in flight["timeline"])


def test_the_page_is_markdown_or_html(switched: str, tmp_path: Path, capsys: Captured) -> None:
    assert main(["incident", switched, "--at", "69.7"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("## ")
    assert "### Probable causes" in printed
    page = tmp_path / "page.html"
    assert main(["incident", switched, "-o", str(page)]) == 0
    contents = Contents(page.read_text(encoding="utf-8"))
    assert set(contents.sections) == {"causes", "charts", "facts", "timeline"}
    assert contents.figures
    assert main(["incident", switched, "-o", str(tmp_path / "page.pdf")]) == 2


def test_of_a_flight_without_anything_to_draw_the_page_says_so(tmp_path: Path, capsys: Captured) -> None:
    log, page = Writer(tmp_path / "landed.tlog"), tmp_path / "page.html"
    for t in range(30):
        log.heartbeat(float(t))
        log.send(float(t), "extended_sys_state", vtol_state=0, landed_state=1)
    assert main(["incident", str(log.close()), "--at", "10", "-o", str(page)]) == 0, capsys.readouterr().err
    contents = Contents(page.read_text(encoding="utf-8"))
    assert not contents.figures
    assert "charts" in contents.sections
