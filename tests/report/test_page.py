"""The page as a file: every log has one, it says what it cannot show, and nothing that a vehicle says is markup."""

from __future__ import annotations

import base64
import gzip
import json
import re
import sys
from pathlib import Path

import pytest

from companion.app.settings import Settings, load_settings
from companion.cli import main
from companion.present import STATISTICS
from tests.recordings import BUNDLED, recording
from tests.report.pages import DEMO, Contents, report
from tests.tlogs import Writer, resting

pytestmark = pytest.mark.slow

SECTIONS = ["findings", "errors", "drift", "budget", "calibration", "imus", "noise", "spectra", "vibration", "track"]
SECTIONS += ["playback", "log", "again"]

HOSTILE = [
    "<script>window.hacked=1</script>",
    "</script><script>window.hacked=2</script>",
    "<img src=x onerror=window.hacked=3>",
    "\"'><svg/onload=window.hacked=4>",
    '<a href="http://127.0.0.1:9/x">click</a>',
    "\u202e\x00\x1b[31mred",
]


def hostile_log(folder: Path) -> Path:
    """A log whose name, texts and parameters are attacks."""
    writer = Writer(folder / "<img src=x onerror=window.hacked=5>&amp;.tlog")
    writer.rest(12.0)
    for i, text in enumerate(HOSTILE):
        writer.send(11.0, "statustext", severity=4, text=text.encode()[:50], id=0, chunk_seq=0)
        writer.send(
            11.1, "param_value", param_id=f"<b>{i}</b>".encode(), param_value=1.0, param_type=9, param_count=9,
            param_index=i,
        )  # fmt: skip
    return writer.close()


def test_a_report_of_everything_has_every_section(tmp_path: Path) -> None:
    page = report(DEMO, tmp_path / "report.html")
    found = Contents(page)
    assert list(found.sections) == SECTIONS
    assert not any("Not drawn" in words or "Not made" in words for words in found.sections.values())
    assert len(found.figures) >= 9
    assert json.loads(found.scripts["player"]).lstrip().lower().startswith("<!doctype html>")
    assert len(page) < 8e6
    assert "INS_GYR_ID" in found.sections["log"]
    assert "GUIDED" in found.sections["log"]


@pytest.mark.parametrize(
    ("name", "missing"),
    [
        ("copter-mission-default-rates.tlog", {"vibration": "VIBRATION"}),
        ("public/squilter__gridlines__kresge_02.tlog", {"track": "no position"}),
        ("public/SemvdH__5g_drone_ROS2__src_mav.tlog", {"track": "no position"}),
        ("public/jschall__magfit_scaling__test.tlog", {"track": "no position", "vibration": "slow"}),
        ("public/4belito__uav-cyber-sim__537f370f_mav.tlog", {}),
        ("public/LucaGemma__MasterThesis__mav.tlog", {}),
        ("px4/px4_hover.tlog", {}),
        ("dataflash/sitl__copter-imu1-fail.BIN", {"vibration": "VIBE"}),
    ],
)
def test_a_section_that_cannot_be_made_says_why(name: str, missing: dict[str, str], tmp_path: Path) -> None:
    log = BUNDLED / name if "/" not in name else recording(name)
    found = Contents(report(log, tmp_path / "report.html", "--no-playback"))
    more = set(found.sections) - set(SECTIONS)  # of logs that have several lanes, or that stand
    assert more <= {"lanes", "preflight"}
    assert set(found.sections) - more == set(SECTIONS) - {"playback"}
    assert len(found.figures) > 0
    for section, reason in missing.items():
        assert reason in found.sections[section]
    assert all(words.strip() for words in found.sections.values())


def test_a_flight_without_position_is_compared_in_attitude(tmp_path: Path) -> None:
    writer = Writer(tmp_path / "bench.tlog")
    for i in range(40 * 50):
        t = i / 50
        if i % 50 == 0:
            writer.heartbeat(t)
        writer.raw_imu(t, 20 + t)
        writer.attitude(t, 20 + t)
    found = Contents(report(writer.close(), tmp_path / "report.html", "--no-playback"))
    assert "no position" in found.sections["track"]
    assert all(len(row) == 2 + len(STATISTICS) + 1 for row in found.tables["drift-table"][1:])


def test_a_flight_without_imu_has_a_report_of_the_rest(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    writer = Writer(tmp_path / "ground-station.tlog")
    for i in range(30 * 10):
        t = i / 10
        if i % 10 == 0:
            writer.heartbeat(t)
        writer.attitude(t, 20 + t)
        writer.local_position(t, 20 + t)
    log = writer.close()
    found = Contents(report(log, tmp_path / "report.html"))
    assert "The IMU was not judged: no IMU message" in capsys.readouterr().out
    assert list(found.sections) == ["findings", "track", "log", "again"]
    assert len(found.figures) == 2
    assert "Every message" in found.sections["log"]
    assert main(["report", DEMO, "-o", str(tmp_path / "x.html"), "--imu", "NOSUCH_IMU"]) == 2
    assert not (tmp_path / "x.html").exists()


def test_the_vehicle_is_chosen_as_elsewhere(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    writer = Writer(tmp_path / "two.tlog")
    writer.rest(12.0, sysid=1)
    writer.rest(12.0, sysid=2, begin=13.0)
    log = str(writer.close())
    page = report(log, tmp_path / "report.html", "--vehicle", "2", "--no-playback")
    assert "Vehicle 2:1, boot 1" in page
    assert main(["report", log, "-o", str(tmp_path / "x.html"), "--vehicle", "3"]) == 2
    assert "--vehicle 1:1 --boot 1" in capsys.readouterr().err


def test_what_a_vehicle_says_is_text(tmp_path: Path) -> None:
    page = report(hostile_log(tmp_path), tmp_path / "report.html", "--no-playback")
    found = Contents(page)
    assert "<script>window.hacked=1</script>" in found.sections["log"]  # as words
    assert "<b>1</b>" in found.sections["log"]
    assert sorted(found.scripts) == ["companion", "figures", "plotly", "without id"]
    assert [tag for tag, _ in found.elements if tag in {"img", "svg", "b", "iframe", "object", "link", "base"}] == [
        "b" for _ in re.findall('class="card"', page)
    ]
    assert not [a for _, attributes in found.elements for a in attributes if a.startswith("on")]
    links = [attributes["href"] for tag, attributes in found.elements if tag == "a"]
    assert links
    assert all(link and link.startswith("#") for link in links)
    assert "\x1b" not in page
    assert "\u202e" not in page


def test_an_existing_file_is_kept_unless_forced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, path = resting(tmp_path / "rest.tlog"), tmp_path / "report.html"
    path.write_text("mine")
    assert main(["report", str(log), "-o", str(path)]) == 2
    assert "--force" in capsys.readouterr().err
    assert path.read_text() == "mine"
    report(log, path, "--force", "--no-playback")
    assert "<!doctype html>" in path.read_text(encoding="utf-8")
    assert {p.name for p in tmp_path.iterdir()} == {"report.html", "rest.tlog"}


def test_a_report_needs_no_plotly_of_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "plotly", None)
    page = report(resting(tmp_path / "rest.tlog"), tmp_path / "report.html", "--no-playback")
    packed = Contents(page).scripts["plotly"]
    assert b"Licensed under the MIT license" in gzip.decompress(base64.b64decode(packed))[:300]


def test_a_report_with_its_playback_can_be_mailed(tmp_path: Path) -> None:
    report(DEMO, tmp_path / "report.html")
    assert (tmp_path / "report.html").stat().st_size < 3_000_000


def test_the_settings_on_the_page_are_a_settings_file(tmp_path: Path) -> None:
    log, own = resting(tmp_path / "rest.tlog"), tmp_path / "own.toml"
    own.write_text("[drift]\nhorizons_s = [1, 4]\n[integration]\ngravity = 9.8\n")
    page = report(log, tmp_path / "report.html", "--config", str(own), "--method", "euler", "--no-playback")
    (settings,) = re.findall(r"<pre>(.*?)</pre>", page, re.DOTALL)
    again = tmp_path / "again.toml"
    again.write_text(settings.replace("&quot;", '"'))
    expected = load_settings(own)
    assert load_settings(again) != Settings()
    assert load_settings(again).drift == expected.drift
    assert load_settings(again).integration.method == "euler"
    twice = report(log, tmp_path / "twice.html", "--config", str(again), "--no-playback")
    assert Contents(twice).scripts["companion"] == Contents(page).scripts["companion"]
