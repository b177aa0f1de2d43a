"""Names as people write them."""

from __future__ import annotations

import re

import pytest

import companion
from companion import analysis, comparison
from companion.model import words
from tests.recordings import ROOT


@pytest.mark.parametrize(
    ("name", "written"),
    [
        ("gps_position", "GPS position"),
        ("between_imus", "between IMUs"),
        ("imu_suspect", "IMU suspect"),
        ("accel_bias", "accelerometer bias"),
        ("compass_turn", "compass turn"),
    ],
)
def test_an_identifier_is_written_as_the_field_writes_it(name: str, written: str) -> None:
    assert words(name) == written


OF_OUR_OWN = re.compile(
    r"(?<![Dd]ead-)\b(reckon|Reckoning|Reckoner|episodes?|Episode|departures?|Departure|witness(es)?|Witness(es)?|seconded|"
    r"unrest|Footage|Insight|Opinion|Bystander|go_on|attitude_bend|PROMISING|Parting|retimed|at_work|told_of_own|"
    r"lasting_errors)\b"
)
"""The field has a word for each: dead_reckon, ImuSolution, fault interval, deviation, aiding sensor, time-shifted."""

KEYS = {"documents/document.py", "__init__.py", "json.md"}  # a key of the JSON; an old name that warns


def test_words_that_the_field_does_not_use_stay_away() -> None:
    pages = [*(ROOT / "companion").rglob("*.py"), *(ROOT / "docs").glob("*.md"), ROOT / "README.md"]
    assert len(pages) > 200
    found = {
        f"{page.relative_to(ROOT)}:{n}: {word.group()}"
        for page in pages
        for n, line in enumerate(page.read_text().splitlines(), 1)
        if (word := OF_OUR_OWN.search(line)) and not any(str(page).endswith(f"/{key}") for key in KEYS)
    }
    assert not found


def test_an_old_name_warns_and_works() -> None:
    with pytest.warns(DeprecationWarning, match="dead_reckon"):
        assert companion.reckon is companion.dead_reckon
    with pytest.warns(DeprecationWarning, match=r"companion\.comparison\.ape now"):
        assert analysis.ape is comparison.ape
    with pytest.raises(AttributeError):
        _ = analysis.no_such_name
