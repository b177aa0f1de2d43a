"""`companion series`: values over time for programs, thinned out without losing the extremes."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import companion as c
from companion.cli import main
from tests.tlogs import resting

Captured = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return resting(tmp_path_factory.mktemp("series") / "rest.tlog")


def columns(capsys: Captured, *arguments: str) -> dict[str, dict[str, Any]]:
    assert main(["series", *arguments, "--json"]) == 0
    (flight,) = json.loads(capsys.readouterr().out)["flights"]
    assert flight["tables"] == []
    return {column["name"]: column for column in flight["series"]["columns"]}


def test_without_a_table_those_that_there_are(log: Path, capsys: Captured) -> None:
    assert main(["series", str(log), "--json"]) == 0
    (flight,) = json.loads(capsys.readouterr().out)["flights"]
    assert flight["series"] is None
    assert {table["name"] for table in flight["tables"]} == c.export.tables(c.open_log(log)[0]).keys()
    assert main(["series", str(log)]) == 0
    assert "attitude: 601 rows: t_s, unix_s, q_w" in capsys.readouterr().out


def test_values_are_those_of_the_table_and_extremes_those_of_all_rows(log: Path, capsys: Captured) -> None:
    table = c.export.tables(c.open_log(log)[0])["raw_imu"]
    found = columns(capsys, str(log), "raw_imu", "--points", "5000")
    assert found["accel_z_mps2"]["values"] == table["accel_z_mps2"].tolist()
    thin = columns(capsys, str(log), "raw_imu", "--points", "7")
    assert len(thin["t_s"]["values"]) == 7
    assert set(thin["t_s"]["values"]) <= set(table["t_s"])
    assert (thin["t_s"]["least"], thin["t_s"]["greatest"]) == (table["t_s"][0], table["t_s"][-1])
    part = columns(capsys, str(log), "raw_imu", "--from", "22", "--to", "23")["t_s"]["values"]
    assert part == table["t_s"][(table["t_s"] >= 22) & (table["t_s"] <= 23)].tolist()


def test_of_rows_that_last_those_that_reach_into_the_time_are_given(capsys: Captured) -> None:
    part = columns(capsys, "demo", "windows", "--from", "100", "--to", "101")
    begin, end = (np.array(part[name]["values"]) for name in ("anchor_t_s", "end_t_s"))
    assert 0 < len(begin) < len(columns(capsys, "demo", "windows")["end_t_s"]["values"])
    assert ((begin <= 101) & (end >= 100)).all()


def test_csv_reads_back(log: Path, capsys: Captured) -> None:
    assert main(["series", str(log), "attitude", "--points", "20"]) == 0
    rows = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    assert len(rows) == 20
    assert np.all(np.diff([float(row["t_s"]) for row in rows]) > 0)


def test_a_table_of_the_analysis_is_made_when_it_is_asked_for(log: Path, capsys: Captured) -> None:
    assert "horizon_s" in columns(capsys, str(log), "drift")


def test_a_table_that_there_is_not(log: Path, capsys: Captured) -> None:
    assert main(["series", str(log), "atitude"]) == 2
    assert "Did you mean attitude?" in capsys.readouterr().err


@pytest.mark.parametrize("given", ["nan", "noon"])
def test_a_time_is_a_number(given: str, capsys: Captured) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["series", "demo", "attitude", "--from", given])
    assert f"--from: must be a number, got '{given}'" in capsys.readouterr().err
