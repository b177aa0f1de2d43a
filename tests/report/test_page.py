"""The page as a file: every log has one, with the numbers of `companion analyze`, and no vehicle's text is markup."""

from __future__ import annotations

import base64
import gzip
import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from companion.app.examination import examine
from companion.app.recording import read_recording
from companion.app.settings import Settings, load_settings
from companion.cli import main
from companion.present import STATISTICS, palette, words
from companion.report import html_page, report_html
from companion.verdict import Finding
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


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The report of the demo, with its playback."""
    return report(DEMO, tmp_path_factory.mktemp("report") / "demo.html")


def test_a_report_of_everything_has_every_section_and_can_be_mailed(demo: str) -> None:
    found = Contents(demo)
    assert list(found.sections) == SECTIONS
    assert not any("Not drawn" in words or "Not made" in words for words in found.sections.values())
    assert len(found.figures) >= 9
    assert json.loads(found.scripts["player"]).lstrip().lower().startswith("<!doctype html>")
    assert len(demo.encode()) < 3_000_000
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


def close(cell: str, value: float | None) -> bool:
    """Whether a cell of three digits says the value."""
    if value is None:
        return cell == "–"
    return abs(float(cell) - value) <= max(0.006 * abs(value), 0.0006)


def test_report_and_json_say_the_same(demo: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["analyze", DEMO, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    found = Contents(demo)
    assert json.loads(found.scripts["companion"]) == document
    flight = document["flights"][0]
    assert flight["verdict"]["summary"] in re.sub("&#x27;", "'", demo)

    rows = [row for row in found.tables["drift-table"] if row[0].endswith(" s")]
    assert len(rows) == len(flight["drift"]) == 5
    for cells, row in zip(rows, flight["drift"], strict=True):
        assert cells[:2] == [f"{row['horizon_s']:g} s", str(row["windows"])]
        values = []
        for quantity in ("attitude_deg", "velocity_mps", "position_m"):
            values += [row[quantity][key] for key in STATISTICS] + [row["expected"][quantity]]
        assert all(close(cell, value) for cell, value in zip(cells[2:], values, strict=True))

    for cells, row in zip(found.tables["inside-table"][2:], flight["consistency"], strict=True):
        judged, quantities = row["judged"], ("attitude", "velocity", "position")
        assert [cells[0], *cells[2:5]] == [f"{row['horizon_s']:g} s", *(f"{row[q]:.0%}" for q in quantities)]
        assert cells[5:] == [str(judged["windows"]), *(f"{judged[q]:.0%}" for q in quantities)]
    for cells, imu in zip(found.tables["imus-table"][1:], flight["imus"], strict=True):
        assert cells[0] == imu["message"]
        assert close(cells[3], imu["attitude_deg"]["median"])
        assert close(cells[4], imu["position_m"]["median"])
    for cells, imu in zip(found.tables["rates-table"][1:], flight["imu"], strict=True):
        assert cells[:2] == [imu["message"], str(imu["samples"])]
    fitted = flight["calibration"]["gyro_bias_radps"]
    said = ", ".join(
        f"{axis} {1e3 * value:.2f} ± {1e3 * sigma:.2f}"
        for axis, value, sigma in zip(("forward", "right", "down"), fitted["value"], fitted["sigma"], strict=True)
    )
    assert found.tables["calibration-table"][1] == ["gyro bias", said, "mrad/s"]


def test_the_charts_are_drawn_from_the_same_numbers(demo: str) -> None:
    found = Contents(demo)
    flight = json.loads(found.scripts["companion"])["flights"][0]
    figures = found.figures
    bars = {t["name"]: t for figure in figures for t in figure["data"] if t["type"] == "bar" and t["yaxis"] == "y"}
    shares = [100 * row["expected"]["shares"]["attitude"]["gyro_bias"] for row in flight["drift"]]
    assert bars["gyro bias"]["y"] == pytest.approx(shares)
    causes = {words(cause) for cause in flight["drift"][0]["expected"]["shares"]["attitude"]}
    assert {row[0] for row in found.tables["shares-table"][1:]} == causes
    assert re.findall(r'id="chart(\d+)"', demo) == [str(i + 1) for i in range(len(figures))]


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


def test_the_chart_of_a_finding_is_of_that_finding() -> None:
    """Also of one that accuses nobody for certain."""
    read = read_recording(DEMO)
    examined = examine(read.flights[0])
    begin, assessment = read.flights[0].start, examined.assessment
    for kind, shows in (("accel_bias", "IMU minus what"), ("samples_irregular", "Time between")):
        finding = Finding(kind, "data", "warning", begin + 10.0, begin + 40.0, "perhaps", "")
        accused = replace(assessment, verdict=replace(assessment.verdict, findings=(finding,)))
        page = report_html(replace(examined, assessment=accused), read.source, with_playback=False)
        assert shows in Contents(page).sections["findings"]


def usual(page: str) -> list[list[str]]:
    """The rows of the table of the first screen."""
    (table,) = re.findall(r'<table id="usual".*?</table>', page)
    return [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in re.findall(r"<tr>(.*?)</tr>", table)][1:]


def test_a_healthy_flight(demo: str) -> None:
    assert demo.index("✓ No IMU fault found") < demo.index("chart1") < demo.index("<nav>"), "the track comes first"
    assert "farthest apart at" in demo
    assert [row[0] for row in usual(demo)] == ["attitude, °", "velocity, m/s", "position, m"]
    assert all(float(median) <= float(p95) for _, median, p95, _ in usual(demo))
    assert "98\N{NO-BREAK SPACE}% of 46 windows" in demo, "said once, of the windows that the verdict judges"
    assert "best estimate" in demo


def test_the_sentence_does_not_contradict_a_suspect(tmp_path: Path) -> None:
    page = report(recording("sitl/copter-imu1-fail-100hz.tlog"), tmp_path / "report.html", "--no-playback")
    assert "✗ Accelerometer x of IMU 0 wrong, 69-81 s" in page
    times = re.search(r"([\d.]+) times the [\d.]+ m allowed", page.replace("\N{NO-BREAK SPACE}", " "))
    assert times
    assert float(times[1]) > 3


def test_the_style_has_the_colours_of_the_palette() -> None:
    """A style sheet cannot import it: on dark it finds the line of the best estimate by its colour."""
    style = (Path(html_page.__file__).parent / "page.css").read_text(encoding="utf-8")
    light = "".join(f"{part:02x}" for part in palette.BEST_LIGHT)
    assert f'[style*="stroke: rgb{palette.BEST}"] {{ stroke: #{light} !important; }}' in style
    assert f"--bad: {palette.css(palette.BAD)}; --doubtful: {palette.css(palette.DOUBTFUL)};" in style
    assert ".finding.error { border-color: var(--bad); }" in style
