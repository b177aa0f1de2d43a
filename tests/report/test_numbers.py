"""The numbers of the page are those of `companion analyze --json`."""

from __future__ import annotations

import json
import re

import pytest

from companion.cli import main
from companion.present import STATISTICS
from tests.report.pages import DEMO, Contents, report

pytestmark = pytest.mark.slow


def close(cell: str, value: float | None) -> bool:
    """Whether a cell of three digits says the value."""
    if value is None:
        return cell == "–"
    return abs(float(cell) - value) <= max(0.006 * abs(value), 0.0006)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    return report(DEMO, tmp_path_factory.mktemp("report") / "demo.html", "--no-playback")


def test_report_and_json_say_the_same(page: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["analyze", DEMO, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    found = Contents(page)
    assert json.loads(found.scripts["companion"]) == document
    flight = document["flights"][0]
    assert flight["verdict"]["summary"] in re.sub("&#x27;", "'", page)

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


def test_the_charts_are_drawn_from_the_same_numbers(page: str) -> None:
    found = Contents(page)
    flight = json.loads(found.scripts["companion"])["flights"][0]
    figures = found.figures
    bars = {t["name"]: t for figure in figures for t in figure["data"] if t["type"] == "bar" and t["yaxis"] == "y"}
    shares = [100 * row["expected"]["shares"]["attitude"]["gyro_bias"] for row in flight["drift"]]
    assert bars["gyro bias"]["y"] == pytest.approx(shares)
    assert re.findall(r'id="chart(\d+)"', page) == [str(i + 1) for i in range(len(figures))]
