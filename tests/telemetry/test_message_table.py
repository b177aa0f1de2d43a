"""The table of what each message, record and topic says: a row that is incomplete, or not documented, fails here."""

from __future__ import annotations

import re

import pytest

from companion.links.request_table import TABLE, Row, with_every_imu
from companion.mavlink import load_dialect
from companion.model import IMU_MESSAGES
from companion.telemetry import NEEDED, RECORDS, TOPICS
from companion.telemetry.sources import (
    COLUMNS,
    DRIVER_SOURCES,
    MESSAGE_SOURCES,
    RECORD_SOURCES,
    SI,
    TOPIC_SOURCES,
    Source,
    covariances,
)
from tests.recordings import ROOT

DIALECT = load_dialect()
DOCUMENTED = (ROOT / "docs/messages.md").read_text(encoding="utf-8")
TABLES = (*MESSAGE_SOURCES, *RECORD_SOURCES, *TOPIC_SOURCES, *DRIVER_SOURCES, *covariances(4))
OWN_COLUMNS = {"vibration", "flow", "innovation", "aiding", "test_ratio"}
"""Kinds of which a format has columns that the others lack."""

IN_LOGS_OF_PX4_ALONE = {"inconsistency", "aiding", "test_ratio"}


def of(*rows: Source) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("row", rows, ids=lambda row: f"{row.name}-{row.kind}")


@of(*TABLES)
def test_every_column_is_known_and_every_field_has_a_unit(row: Source) -> None:
    """In SI, which its name ends in, or a count, ratio or flag without one."""
    assert row.fields
    assert row.fields.keys() <= set(COLUMNS.get(row.kind, ())) or row.kind in OWN_COLUMNS, list(row.fields)
    for column, ways in row.fields.items():
        for field, unit in ways:
            assert unit in SI, (column, unit)
            measured = re.search(r"_(rad|radps|m|mps|mps2|pa|degc|tesla)$", column)
            stated = row in MESSAGE_SOURCES and DIALECT.by_name[row.name].units.get(field, "") in SI
            assert unit or stated or not measured, f"{column} of {row.name} has no unit"


@of(*MESSAGE_SOURCES)
def test_the_fields_are_those_of_the_message(row: Source) -> None:
    layout = DIALECT.by_name[row.name]
    for ((field, _),) in row.fields.values():
        name, _, place = field.partition("[")
        assert name in layout.fields, field
        assert not place or int(place[:-1] or 0) < layout.dtype[name].shape[0], field  # "[]": all of them


@of(*MESSAGE_SOURCES, *RECORD_SOURCES, *(row for row in TOPIC_SOURCES if row.kind not in IN_LOGS_OF_PX4_ALONE))
def test_every_kind_and_where_it_comes_from_are_documented(row: Source) -> None:
    assert f"`{row.kind}" in DOCUMENTED, f"docs/messages.md says nothing of {row.kind!r}"
    if row in (*MESSAGE_SOURCES, *RECORD_SOURCES):
        assert row.name.rstrip("23") in DOCUMENTED, f"docs/messages.md says nothing of {row.name}"


def test_every_row_is_read() -> None:
    assert {row.name for row in MESSAGE_SOURCES} <= NEEDED
    assert {name for row in RECORD_SOURCES for name in row.names} <= RECORDS
    assert {row.name for row in (*TOPIC_SOURCES, *DRIVER_SOURCES)} <= TOPICS


def test_no_two_rows_say_the_same() -> None:
    told = [(row.name, row.kind) for row in TABLES]
    assert len(told) == len(set(told))


@pytest.mark.parametrize("name", IMU_MESSAGES)
def test_an_imu_message_is_read_whole_and_documented(name: str) -> None:
    layout = DIALECT.by_name[name]
    axes = {f"{axis}{what}" for axis in "xyz" for what in ("acc", "gyro", "mag")}
    assert axes <= set(layout.fields)
    assert IMU_MESSAGES[name].clock in layout.fields
    assert any(row.name == name for row in TABLE), "it is never asked for"
    assert name in NEEDED
    assert any(row.name == name and row.kind == "magnetometer" for row in MESSAGE_SOURCES)
    assert name.rstrip("23") in DOCUMENTED


def test_an_imu_message_without_a_row_is_asked_for_as_one_more_imu() -> None:
    first = Row("RAW_IMU", "imu", 10.0)
    assert with_every_imu([first], ["RAW_IMU", "SCALED_IMU3"]) == (
        first,
        Row("SCALED_IMU3", "half the imu", 0.0, optional=True),
    )


def test_every_imu_message_has_a_place_in_the_order() -> None:
    assert sorted(one.rank for one in IMU_MESSAGES.values()) == list(range(len(IMU_MESSAGES)))
