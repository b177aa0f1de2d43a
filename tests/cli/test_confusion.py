"""The tables of `analyze --confusion`, of figures made by hand."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from companion.cli import tables
from companion.cli.analyze import confusion_lines
from companion.estimation import BestEstimate, ConfusionMatrix, Identifiability, smooth
from tests.estimation.sensed import sensed

GYRO = Identifiability(
    "gyro_bias", "step", 0.0, 5e-3, 12.5e-3, {"gyro_bias": 0.25, "cannot tell": 0.75}, 0.01, 0.1, 0.5, 40.0
)
GPS = Identifiability("gps_position", "creep", 30.0, 11.0, None, {"nobody": 1.0}, 0.0, 0.0, 0.02, 11.0)


@cache
def best() -> BestEstimate:
    return smooth(sensed(20.0, "rest", rate=25.0)[0])


@pytest.mark.slow
def test_sizes_and_shares_are_in_the_units_of_people(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    matrix = ConfusionMatrix((GYRO, GPS), ("gyro_scale",), 100)
    tables.console().lines(*confusion_lines(replace(best(), confusion=matrix), 100))
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert "gyro bias 5.0 mrad/s 12 mrad/s 0.57° 5.7° 0.50 m/s 40 m" in lines
    assert "GPS position, 30 s 11 m never 0.00° 0.00° 0.02 m/s 11 m" in lines
    assert "fault gyro bias cannot tell nobody" in lines
    assert "gyro bias 25% 75%" in lines
    assert "Not detectable at any likely size: gyro scale." in lines


def test_without_a_best_estimate_nothing_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    tables.console().lines(*confusion_lines(None, 100))
    assert "no best estimate" in capsys.readouterr().out
