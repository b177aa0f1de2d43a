"""The benchmark of labelled recordings: what counts as what, and a whole run over the bundled logs."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from benchmarks.accuracy.answer import Answer, Side
from benchmarks.accuracy.labelled import rows, run, table, wrong_reason
from benchmarks.accuracy.labels import Label, Outcome, details, load_labels, outcome, recordings
from benchmarks.accuracy.parallel import Failed, each
from companion.model import InputError
from tests.recordings import BUNDLED, ROOT, SHARED

pytestmark = pytest.mark.slow

LABELS = ROOT / "benchmarks" / "accuracy" / "labels.toml"


@pytest.mark.parametrize(
    ("truth", "said", "expected"),
    [
        ("none", "none", "right"),
        ("none", "imu", "false alarm"),
        ("none", "autopilot", "false alarm"),
        ("none", "cannot_tell", "missed"),
        ("imu", "imu", "right"),
        ("imu", "autopilot", "inverted"),
        ("autopilot", "imu", "inverted"),
        ("imu", "none", "missed"),
        ("imu", "cannot_tell", "missed"),
        ("none_judgeable", "cannot_tell", "right"),
        ("none_judgeable", "imu", "false alarm"),
        ("none_judgeable", "none", "missed"),
    ],
)
def test_every_answer_has_one_outcome(truth: str, said: Side, expected: Outcome) -> None:
    label = Label("a", truth)  # type: ignore[arg-type]
    assert outcome(label, Answer(said)) == expected
    assert outcome(label, None) == "unread"


def test_an_accepted_answer_is_no_fault_and_cannot_tell_is_counted_apart() -> None:
    label = Label("a", "autopilot", accept=("cannot_tell", "imu:noise"))
    assert outcome(label, Answer("cannot_tell")) == "cannot tell"
    assert outcome(label, Answer("imu", "noise")) == "right"
    assert outcome(label, Answer("imu", "gyro_bias")) == "inverted"


@pytest.mark.parametrize(
    ("smallest", "expected"),
    [({"tilt": 0.06}, "not shown"), ({"tilt": 0.06, "position": 40.0}, "not shown"),
     ({"tilt": 0.02}, "missed"), ({"tilt": 0.06, "position": 4.0}, "missed")],
)  # fmt: skip
def test_a_fault_below_what_the_verdict_says_would_have_shown_is_counted_apart(
    smallest: dict[str, float], expected: Outcome
) -> None:
    label = Label("a", "autopilot", hidden={"tilt": 0.04, "position": 12.0})
    assert outcome(label, Answer("none", smallest=smallest)) == expected
    assert outcome(label, Answer("imu", smallest=smallest)) == "inverted"


def test_the_details_that_a_label_has_are_compared() -> None:
    label = Label("a", "imu", cause=("gyro_bias",), sensor="gyro", onset=100.0, size=0.02)
    good = Answer("imu", "gyro_bias", "gyro", onset=104.0, size=0.021)
    assert details(label, good) == {"cause": True, "sensor": True, "onset": True, "size": True}
    late = Answer("imu", "gyro_bias", "gyro", onset=120.0)
    assert details(label, late) == {"cause": True, "sensor": True, "onset": False, "size": False}


def test_flights_that_were_not_found_and_logs_that_failed_are_unread() -> None:
    labels = [Label("a.tlog", "none", flight="1/1"), Label("a.tlog", "none", flight="1/2")]
    one = rows("a.tlog.xz", labels, {"1/1": Answer("none")})
    assert [(row.flight, row.outcome) for row in one] == [("1/1", "right"), ("1/2", "unread")]
    assert [row.outcome for row in rows("a.tlog", labels, Failed("broken"))] == ["unread", "unread"]
    (alone,) = rows("gcs.tlog", [Label("gcs.*", "no_flight")], {})
    assert alone.outcome == "right"


def test_the_bundled_logs_run_whole(tmp_path: Path) -> None:
    file = tmp_path / "labels.toml"
    file.write_text(
        '[[label]]\nlog = "copter-demo-100hz.tlog"\ntruth = "none"\n'
        '[[label]]\nlog = "copter-mission-*"\ntruth = "none_judgeable"\n'
        '[[label]]\nlog = "lost.tlog"\ntruth = "imu"\n'
    )
    found = run(BUNDLED, load_labels(file), workers=2, timeout=600)
    assert [(row.log, row.outcome) for row in found] == [
        ("copter-demo-100hz.tlog", "right"),
        ("copter-mission-default-rates.tlog", "right"),
    ]
    assert not any(map(wrong_reason, found))
    assert "| **all** | 2 | 2 |" in table(found)


def test_labels_that_say_what_no_label_can_say_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "labels.toml"
    file.write_text('[[label]]\nlog = "a.tlog"\ntruth = "the compass"\n')
    with pytest.raises(InputError, match="truth"):
        load_labels(file)


_WITHOUT_TRUTH = ("strangers/", "invariance/")  # where some have a label, and the truth of the others is not known


def test_every_label_and_every_shared_recording_have_each_other() -> None:
    labels = load_labels(LABELS)
    if not SHARED.exists():
        pytest.skip("the labelled recordings are not on this machine")
    names = [path.relative_to(SHARED).as_posix() for path in recordings(SHARED)]
    known = [name for name in names if not name.startswith(_WITHOUT_TRUTH)]
    assert [name for name in known if not any(label.matches(name) for label in labels)] == []
    assert [label.log for label in labels if not any(label.matches(name) for name in names)] == []


def _work(what: str) -> str:
    if what == "hang":
        time.sleep(600)
    if what == "die":
        os._exit(3)
    if what == "raise":
        raise ValueError(what)
    return what


def test_a_log_that_hangs_or_kills_its_process_is_a_row() -> None:
    assert dict(each(_work, ["hang"], timeout=1)) == {0: Failed("no result within 1 s")}
    found = dict(each(_work, ["good", "die", "raise"], workers=2, timeout=600))
    assert found == {0: "good", 1: Failed("its process ended with exit code 3"), 2: Failed("ValueError: raise")}
