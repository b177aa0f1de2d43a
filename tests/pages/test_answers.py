"""What the page of a log is told: the verdict first, and whatever takes longer after it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import companion as c
from companion.app.examination import integration_of
from companion.app.recording import read_recording
from companion.app.settings import Settings
from companion.model import Flight
from companion.pages.replay import Answers
from companion.view import ReplayChoice
from companion.view.state.trajectory import DisplayTrajectory
from tests.recordings import BUNDLED

SETTINGS = Settings()


@pytest.fixture(scope="module")
def flight() -> Flight:
    return c.open_log(BUNDLED / "copter-demo-100hz.tlog")[0]


def corrected(answers: Answers, flight: Flight, choice: ReplayChoice) -> DisplayTrajectory:
    return answers.recompute(flight, replace(choice, correction="flight"))


def test_the_verdict_does_not_wait_for_the_calibration(flight: Flight, monkeypatch: pytest.MonkeyPatch) -> None:
    answers, choice = Answers(SETTINGS), ReplayChoice(how=integration_of(SETTINGS, flight))
    display = answers.recompute(flight, choice)
    with monkeypatch.context() as patch:
        patch.delattr("companion.verdict.assessment.calibrate")
        assert answers.judge(flight, choice, display).status == "consistent"
    with monkeypatch.context() as patch:
        patch.delattr("companion.pages.replay.assess_imu")  # it goes on from what the verdict rests on
        before = corrected(answers, flight, choice)
    answers.examine(flight, choice, display)
    after = corrected(answers, flight, choice)
    alone = corrected(Answers(SETTINGS), flight, choice)
    for other in (after, alone):
        assert np.array_equal(before.replay.position_imu, other.replay.position_imu)


def test_beside_a_corrected_imu_all_stand_as_they_are(flight: Flight) -> None:
    """As `companion analyze --correction` has it; what was taken off is named."""
    answers = Answers(SETTINGS)
    choice = ReplayChoice(how=integration_of(SETTINGS, flight), gyro_bias=(0.02, 0.0, 0.0))
    display = answers.recompute(flight, choice)
    of_page, alone = answers.examine(flight, choice, display), c.examine(flight, SETTINGS)
    shown, known = ([one.drift.position_m for one in found.redundant_imus] for found in (of_page, alone))
    assert shown == known
    recording = read_recording(BUNDLED / "copter-demo-100hz.tlog")
    report = answers.report(recording.source, flight, choice, display)
    assert "gyro bias 20, 0, 0 mrad/s" in report
