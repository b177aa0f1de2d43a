"""What is done stays done, through crashes and changes."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from companion.app.settings import AutopilotSettings, Settings, ViewSettings
from companion.fleet.journal import MAKING, NAME, Journal, LogRecord, version_of
from companion.fleet.search import FoundLog
from companion.model import InputError
from tests.test_architecture import MAY_IMPORT

LOG = FoundLog("/logs/a.tlog", 100, "1-1")
RECORD = LogRecord(sha256="aa", error="no vehicle found in it")


def written(folder: Path, *logs: FoundLog) -> None:
    journal = Journal(folder, "v1")
    for log in logs:
        journal.add(log, RECORD)


@pytest.mark.parametrize(
    ("log", "version", "known"),
    [
        (LOG, "v1", True),
        (LOG, "v2", False),
        (FoundLog("/logs/b.tlog", 100, "1-1"), "v1", False),
        (FoundLog("/logs/a.tlog", 101, "1-1"), "v1", False),
        (FoundLog("/logs/a.tlog", 100, "2-1"), "v1", False),
    ],
)
def test_a_log_is_known_by_name_size_times_and_version(
    log: FoundLog, version: str, known: bool, tmp_path: Path
) -> None:
    written(tmp_path, LOG)
    journal = Journal(tmp_path, version)
    assert journal.record(log) == (RECORD if known else None)


def test_known_content_under_another_name(tmp_path: Path) -> None:
    written(tmp_path, LOG)
    moved = FoundLog("/logs/moved.tlog", 100, "3-3")
    journal = Journal(tmp_path, "v1")
    assert list(journal.same_size(moved)) == ["aa"]
    assert journal.add(moved, LogRecord(sha256="aa")) == RECORD
    journal = Journal(tmp_path, "v1")
    assert journal.record(moved) == RECORD


def test_an_error_speaks_of_the_file_of_its_own_row(tmp_path: Path) -> None:
    journal = Journal(tmp_path, "v1")
    journal.add(LOG, LogRecord(sha256="aa", error=f"{LOG.path} holds no MAVLink frame"))
    copy = FoundLog("/logs/copy.tlog", 100, "3-3")
    journal = Journal(tmp_path, "v1")
    assert list(journal.same_size(copy)) == ["aa"]
    assert journal.add(copy, LogRecord(sha256="aa")).error == "/logs/copy.tlog holds no MAVLink frame"


def test_a_run_of_one_log_with_other_options_costs_the_others_nothing(tmp_path: Path) -> None:
    logs = [FoundLog(f"/logs/{i}.tlog", 100, "1-1") for i in range(5)]
    written(tmp_path, *logs)
    for stamp in range(9):
        journal = Journal(tmp_path, "v2")
        journal.add(FoundLog("/logs/0.tlog", 100, f"{stamp}"), RECORD)
    journal = Journal(tmp_path, "v1")
    assert [journal.record(log) for log in logs[1:]] == [RECORD] * 4


def test_a_line_that_a_crash_cut_off_costs_that_log_alone(tmp_path: Path) -> None:
    other = FoundLog("/logs/b.tlog", 100, "1-1")
    written(tmp_path, LOG, other)
    path = tmp_path / NAME
    path.write_bytes(path.read_bytes()[:-20])
    third = FoundLog("/logs/c.tlog", 100, "1-1")
    journal = Journal(tmp_path, "v1")
    assert [journal.record(log) for log in (LOG, other)] == [RECORD, None]
    journal.add(third, RECORD)
    journal = Journal(tmp_path, "v1")
    assert journal.record(third) == RECORD


def test_it_does_not_grow_without_end(tmp_path: Path) -> None:
    for i in range(20):
        written(tmp_path, FoundLog(LOG.path, LOG.size_bytes, f"{i}"))
    assert len((tmp_path / NAME).read_bytes().splitlines()) <= 3


def test_two_runs_at_once_lose_nothing(tmp_path: Path) -> None:
    """Where a third that opens shortens the file while they go on."""
    one, two = Journal(tmp_path, "v1"), Journal(tmp_path, "v1")
    others = [FoundLog(f"/logs/{i}.tlog", 100, "1-1") for i in range(4)]
    for other in others:
        for stamp in range(9):
            one.add(FoundLog(LOG.path, LOG.size_bytes, f"{stamp}"), RECORD)
        two.add(other, RECORD)
        before = (tmp_path / NAME).stat().st_size
        again = Journal(tmp_path, "v1")
        assert (tmp_path / NAME).stat().st_size < before
    assert [again.record(log) for log in others] == [RECORD] * 4


def test_a_folder_that_cannot_be_written_to(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot write"):
        Journal(tmp_path / "file", "v1")


def test_the_version_follows_what_makes_the_numbers() -> None:
    own = version_of(Settings(), None, None)
    assert version_of(Settings(), None, None) == own
    assert version_of(Settings(view=ViewSettings(port=81)), None, None) == own
    others = [
        version_of(Settings(autopilot=AutopilotSettings(tilt=0.1)), None, None),
        version_of(Settings(), "RAW_IMU", None),
        version_of(Settings(), None, "bmi088"),
    ]
    assert len({own, *others}) == 4
    with pytest.raises(InputError, match="bmi99"):
        version_of(Settings(), None, "bmi99")


def test_every_part_that_a_row_comes_out_of_is_in_the_version() -> None:
    parts = {"fleet"}
    waiting = {"app.recording", "app.examination", "documents"}
    while waiting:
        parts |= waiting
        waiting = {other for part in waiting for other in MAY_IMPORT[part]} - parts
    assert parts == MAKING


def test_records_survive_the_journey() -> None:
    assert msgspec.json.decode(msgspec.json.encode(RECORD), type=LogRecord) == RECORD
