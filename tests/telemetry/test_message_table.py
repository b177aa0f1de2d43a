"""The tables of what each message and record says: a row that is incomplete, or not documented, fails here."""

from __future__ import annotations

import re

import pytest

from companion.links.request_table import TABLE, Row, with_every_imu
from companion.mavlink import load_dialect
from companion.model import IMU_MESSAGES
from companion.telemetry.convert import SI
from companion.telemetry.dataflash import RECORDS
from companion.telemetry.dataflash.sensors import SOURCES, RecordSource
from companion.telemetry.flights import NEEDED
from companion.telemetry.quantities import COLUMNS
from companion.telemetry.sensors import _SOURCES, Source  # the table itself
from tests.recordings import ROOT

DIALECT = load_dialect()
DOCUMENTED = (ROOT / "docs/messages.md").read_text(encoding="utf-8")
ROWS = pytest.mark.parametrize("row", _SOURCES, ids=lambda row: f"{row.message}-{row.kind}")


@ROWS
def test_the_fields_are_those_of_the_message(row: Source) -> None:
    layout = DIALECT.by_name[row.message]
    for field, _ in row.fields.values():
        name, _, place = field.partition("[")
        assert name in layout.fields, field
        if place:
            assert int(place[:-1]) < layout.dtype[name].shape[0], field


@ROWS
def test_every_field_has_a_unit(row: Source) -> None:
    """The dialect's, which must then be one that is known, or the row's own; counts and flags have "" for none."""
    for column, (field, unit) in row.fields.items():
        stated = DIALECT.by_name[row.message].units.get(field, "")
        assert unit in SI, (column, unit)
        measured = re.search(r"_(rad|radps|m|mps|mps2|pa|degc|tesla)$", column)
        if measured and "[" not in field:
            assert stated in SI or unit, f"{column}: {stated!r} is not known, and the row has no unit"


@ROWS
def test_the_columns_are_those_of_the_kind(row: Source) -> None:
    """A row with columns of its own must be described, by every column, in docs/messages.md."""
    assert f"`{row.kind}" in DOCUMENTED, f"docs/messages.md says nothing of {row.kind!r}"
    assert row.message.rstrip("23") in DOCUMENTED, f"docs/messages.md says nothing of {row.message}"
    if not row.fields.keys() <= set(COLUMNS.get(row.kind, ())):
        assert row.kind in ("vibration", "flow"), f"{row.kind} has columns that COLUMNS lacks: {list(row.fields)}"


def test_no_two_rows_say_the_same() -> None:
    told = [(row.message, row.kind) for row in _SOURCES]
    assert len(told) == len(set(told))


RECORD_ROWS = pytest.mark.parametrize("row", SOURCES, ids=lambda row: f"{row.names[0]}-{row.kind}")


@RECORD_ROWS
def test_a_record_s_columns_are_those_of_its_kind_in_known_units(row: RecordSource) -> None:
    assert row.fields.keys() <= set(COLUMNS[row.kind])
    for column, (_, unit) in row.fields.items():
        assert unit in SI, (column, unit)
        measured = re.search(r"_(rad|radps|m|mps|mps2|pa|degc|tesla)$", column)
        assert not measured or unit, f"{column} has no unit where the log states none"


@RECORD_ROWS
def test_a_record_is_read_and_documented(row: RecordSource) -> None:
    assert set(row.names) <= RECORDS
    assert row.names[0] in DOCUMENTED, f"docs/messages.md says nothing of {row.names[0]}"
    assert f"`{row.kind}" in DOCUMENTED, f"docs/messages.md says nothing of {row.kind!r}"


@pytest.mark.parametrize("name", IMU_MESSAGES)
def test_an_imu_message_is_read_whole_and_documented(name: str) -> None:
    layout = DIALECT.by_name[name]
    axes = {f"{axis}{what}" for axis in "xyz" for what in ("acc", "gyro", "mag")}
    assert axes <= set(layout.fields)
    assert IMU_MESSAGES[name].clock in layout.fields
    assert any(row.name == name for row in TABLE), "it is never asked for"
    assert name in NEEDED
    assert any(row.message == name and row.kind == "magnetometer" for row in _SOURCES)
    assert name.rstrip("23") in DOCUMENTED


def test_an_imu_message_without_a_row_is_asked_for_as_one_more_imu() -> None:
    first = Row("RAW_IMU", "imu", 10.0)
    assert with_every_imu([first], ["RAW_IMU", "SCALED_IMU3"]) == (
        first,
        Row("SCALED_IMU3", "half the imu", 0.0, optional=True),
    )


def test_every_imu_message_has_a_place_in_the_order() -> None:
    assert sorted(one.rank for one in IMU_MESSAGES.values()) == list(range(len(IMU_MESSAGES)))
