"""Terminal, JSON, export, report and page show one set of numbers: those of `companion.app.examination.examine`."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import re
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import companion as c
from companion.app.examination import integration_of
from companion.app.settings import Settings
from companion.cli import main
from companion.model import STANDARD_GRAVITY
from companion.pages.replay import Answers
from companion.present import STATISTICS, palette
from companion.view import ReplayChoice, with_result, worst_stretch
from companion.view.panels.verdict import drift_table
from tests.processes import COMPANION
from tests.recordings import BUNDLED

pytestmark = pytest.mark.slow

DEMO = str(BUNDLED / "copter-demo-100hz.tlog")
QUANTITIES = ("attitude_deg", "velocity_mps", "position_m")

Captured = pytest.CaptureFixture[str]
Document = dict[str, Any]


class Cells(HTMLParser):
    """The rows of every table of a page, and its scripts by id."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.scripts: dict[str, str] = {}
        self._into: str | None = None
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th") and self.rows:
            self.rows[-1].append("")
        self._into = (dict(attrs).get("id") or "") if tag == "script" else tag if tag in ("td", "th") else self._into

    def handle_endtag(self, tag: str) -> None:
        if tag in ("td", "th", "script"):
            self._into = None

    def handle_data(self, data: str) -> None:
        if self._into in ("td", "th"):
            self.rows[-1][-1] += data
        elif self._into is not None:
            self.scripts[self._into] = self.scripts.get(self._into, "") + data


@pytest.fixture(scope="module")
def flight() -> Document:
    """The flight in the JSON document, which all others are held against."""
    with contextlib.redirect_stdout(io.StringIO()) as said:
        assert main(["analyze", DEMO, "--json"]) == 0
    found: Document = json.loads(said.getvalue())["flights"][0]
    return found


def same(shown: str, value: float) -> bool:
    """Whether what is shown, in the digits that it has, is this value."""
    digits = len(shown.partition(".")[2])
    return abs(float(shown) - value) <= 0.5001 * 0.1**digits


def test_a_process_that_knows_no_other_flight(flight: Document) -> None:
    """What was analysed before changes nothing: here others may have been, and their answers are remembered."""
    alone = subprocess.run([*COMPANION, "analyze", DEMO, "--json"], check=True, capture_output=True, text=True)
    assert json.loads(alone.stdout)["flights"][0] == flight


def test_the_terminal(flight: Document, capsys: Captured) -> None:
    assert main(["analyze", DEMO, "--full"]) == 0
    drift, rest = capsys.readouterr().out.split("Allowed drift")
    rows = [line.split() for line in drift.splitlines() if re.match(r" *\d+ s ", line)]
    tables = rest.split("Every IMU")[0].split("Windows inside")
    expected, inside = ([c.split() for c in part.splitlines() if re.match(r" *\d+ s ", c)] for part in tables)
    assert flight["verdict"]["summary"] in drift
    for cells, sigma, row in zip(rows, expected, flight["drift"], strict=True):
        assert (float(cells[0]), int(cells[2])) == (row["horizon_s"], row["windows"])
        values = [row[quantity][statistic] for quantity in QUANTITIES for statistic in STATISTICS]
        assert all(same(cell, value) for cell, value in zip(cells[3:], values, strict=True))
        assert all(same(sigma[2 + i], row["expected"][quantity]) for i, quantity in enumerate(QUANTITIES))
    for cells, row in zip(inside, flight["consistency"], strict=True):
        assert cells[3:6] == [f"{row[quantity]:.0%}" for quantity in ("attitude", "velocity", "position")]
        judged = row["judged"]
        shares = [judged[quantity] for quantity in ("attitude", "velocity", "position")]
        assert cells[6:] == [str(judged["windows"]), *(f"{share:.0%}" for share in shares)]
    share, count, horizon = re.findall(r"(\d+) % of (\d+) windows of (\d+) s", flight["verdict"]["summary"])[0]
    told = next(cells for cells in inside if cells[0] == horizon)
    assert (told[6], f"{share}%") == (count, min(told[7:], key=lambda cell: int(cell[:-1])))
    fitted = flight["calibration"]["gyro_bias_radps"]
    line = next(line for line in rest.splitlines() if line.strip().startswith("gyro bias"))
    shown = re.findall(r"(-?[\d.]+) ± ([\d.]+)", line)
    for (value, sigma), figure, error in zip(shown, fitted["value"], fitted["sigma"], strict=True):
        assert same(value, 1e3 * figure)
        assert same(sigma, 1e3 * error)


def test_the_noise(flight: Document, capsys: Captured) -> None:
    """`noise` by axis, `smooth` and `analyze` of the worst one that the steps of the readings do not hide."""
    assert main(["noise", DEMO, "--imu", flight["used_imu"], "--json"]) == 0
    own = json.loads(capsys.readouterr().out)["flights"][0]["imus"][0]["flight"]
    assert main(["smooth", DEMO, "--imu", flight["used_imu"]]) == 0
    smoothed = capsys.readouterr().out
    for sensor, factor, unit in (("gyro", 1e3 * np.degrees(1.0), "mdps"), ("accel", 1e6 / STANDARD_GRAVITY, "µg")):
        axes = zip(own[sensor]["density"], own[sensor]["below_quantisation"], strict=True)
        worst = max(density for density, hidden in axes if not hidden)
        assert flight["figures"][f"measured_{sensor}_noise"] == worst
        cells = next(line.split() for line in smoothed.splitlines() if line.split()[:2] == [sensor, unit])
        assert same(cells[2], worst * factor)


def test_the_export(flight: Document, tmp_path: Path) -> None:
    assert main(["export", DEMO, "--format", "json", "-o", str(tmp_path / "x.json")]) == 0
    exported = json.loads((tmp_path / "x.json").read_text())
    assert exported["flights"] == [flight]
    assert main(["export", DEMO, "--format", "csv", "-o", str(tmp_path / "csv")]) == 0
    with (tmp_path / "csv" / "drift.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row, told in zip(rows, flight["drift"], strict=True):
        for quantity in QUANTITIES:
            name, unit = quantity.split("_")
            assert float(row[f"{name}_expected_{unit}"]) == told["expected"][quantity]
            assert [float(row[f"{name}_{s}_{unit}"]) for s in STATISTICS] == [told[quantity][s] for s in STATISTICS]
    errors = np.loadtxt(tmp_path / "csv" / "windows.csv", delimiter=",", skiprows=1)
    names = (tmp_path / "csv" / "windows.csv").read_text().splitlines()[0].split(",")
    north = names.index("position_error_north_m")
    for told in flight["drift"]:
        of_horizon = errors[errors[:, 0] == told["horizon_s"]]
        length = np.linalg.norm(of_horizon[:, north : north + 3], axis=1)
        assert np.median(length) == pytest.approx(told["position_m"]["median"], rel=1e-12)


def test_the_report(flight: Document, tmp_path: Path) -> None:
    assert main(["report", DEMO, "-o", str(tmp_path / "x.html"), "--no-playback"]) == 0
    page = Cells((tmp_path / "x.html").read_text(encoding="utf-8"))
    assert json.loads(page.scripts["companion"])["flights"] == [flight]
    rows = {
        row[0]: row
        for row in page.rows
        if len(row) == 2 + len(QUANTITIES) * (len(STATISTICS) + 1) and row[0].endswith(" s")
    }
    assert len(rows) == len(flight["drift"])
    for told in flight["drift"]:
        values = [
            told[q][s] if s != "expected" else told["expected"][q]
            for q in QUANTITIES
            for s in (*STATISTICS, "expected")
        ]
        assert all(same(cell, value) for cell, value in zip(rows[f"{told['horizon_s']:g} s"][2:], values, strict=True))


def test_the_page_in_the_browser(flight: Document) -> None:
    opened = c.open_log(DEMO)[0]
    settings = c.Settings()
    answers = Answers(settings)
    choice = ReplayChoice(how=integration_of(settings, opened))
    display = answers.recompute(opened, choice)
    result = answers.examine(opened, choice, display)
    found = result.assessment
    assert found.verdict.summary == flight["verdict"]["summary"]
    page = Cells(drift_table(found.drift, found, palette.IMU, result.horizon_s))
    lines = [row for row in page.rows[1:] if len(row) == 2 + len(QUANTITIES)]
    of_horizons = zip(lines[::3], lines[1::3], lines[2::3], strict=True)
    for told, (median, p95, expected) in zip(flight["drift"], of_horizons, strict=True):
        assert median[0] == f"{told['horizon_s']:g} s"
        assert p95[0] == f"{told['windows']} windows"
        for i, quantity in enumerate(QUANTITIES, start=2):
            assert same(median[i], told[quantity]["median"])
            assert same(p95[i], told[quantity]["p95"])
            assert same(expected[i], told["expected"][quantity])
    exported = c.export.tables(opened, display.replay)["reckoning"]
    own = c.export.assessed_replay(opened, found, choice.reanchor_s)
    assert np.array_equal(exported["position_imu_north_m"], own.position_imu[:, 0]), "the trajectory that is exported"


def test_page_and_report_name_the_same_farthest_moment(tmp_path: Path) -> None:
    """Both dead-reckon with the anchor from which the page's opening is played."""
    assert main(["report", DEMO, "-o", str(tmp_path / "x.html"), "--no-playback"]) == 0
    report = (tmp_path / "x.html").read_text(encoding="utf-8")
    flight, answers = c.open_log(DEMO)[0], Answers(Settings())
    choice = ReplayChoice(imu=flight.default_imu, how=integration_of(Settings(), flight))
    shown = answers.recompute(flight, choice)
    worst = worst_stretch(with_result(shown, answers.examine(flight, choice, shown)).replay)
    assert worst is not None
    found = re.search(r"farthest apart at ([\d.]+) s: ([\d.]+)\sm,", report)
    assert found
    assert float(found[1]) == pytest.approx(worst.end_s, abs=0.051)
    assert float(found[2]) == pytest.approx(worst.apart_m, rel=5e-3)
