"""Where the page opens, and where a finding shows most."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.comparison import Integration, replay
from companion.verdict import Cause, Finding, Verdict
from companion.verdict.finding import KINDS
from companion.view import ReplayChoice, display_trajectory, with_result
from companion.view.state.moments import (
    BEFORE_S,
    PLAYED_S,
    anchored_at_opening,
    decisive,
    errors_in,
    moment_of,
    sigmas_along,
    since_anchor,
)
from companion.view.state.player import Player
from companion.view.state.sending import by_shape
from companion.view.state.trajectory import DisplayTrajectory
from tests.view.circles import BOOT, dead_reckon, examine, make_flight

FLIGHT = make_flight()
CHOICE = ReplayChoice()


@pytest.fixture(scope="module")
def display() -> DisplayTrajectory:
    shown = display_trajectory(dead_reckon(FLIGHT, CHOICE), FLIGHT.imu("RAW_IMU"))
    return with_result(shown, examine(FLIGHT, CHOICE, shown))


def accused(display: DisplayTrajectory, *findings: Finding) -> DisplayTrajectory:
    assert display.result is not None
    verdict = Verdict("consistent", "They agree.", ())
    if findings:
        verdict = Verdict("imu_suspect", "Suspect the IMU.", findings, findings[0].cause)
    assessment = replace(display.result.assessment, verdict=verdict)
    return replace(display, result=replace(display.result, assessment=assessment))


def fault(start: float, end: float, kind: str = "gyro_bias") -> Finding:
    cause = Cause(kind, "imu", start, end, 0.1, kind.partition("_")[0])
    return Finding(kind, "imu", "error", start, end, "it is off", "mend it", cause=cause)


def test_it_opens_where_the_error_that_follows_the_onset_shows_most(display: DisplayTrajectory) -> None:
    """What is played begins before the onset, at an anchor: there nothing is wrong to be seen."""
    shown = accused(display, fault(BOOT + 27.5, BOOT + 36.0))
    both = anchored_at_opening(FLIGHT, shown, "RAW_IMU", Integration(), 10.0)
    assert both is not None
    opened = replace(display_trajectory(both), result=shown.result)
    moment = decisive(opened)
    assert moment is not None
    assert moment.error == "attitude"
    begins, opens = moment.begins_at(both.anchors), moment.opens_at(opened)
    assert begins == pytest.approx(BOOT + 27.5 - BEFORE_S, abs=0.02)
    curve = since_anchor(opened, "attitude")
    played = curve.values[(curve.t >= begins) & (curve.t < begins + PLAYED_S)]
    assert curve.values[np.searchsorted(curve.t, opens)] == played.max() > 0.0
    assert begins + BEFORE_S < opens < begins + PLAYED_S


def test_a_fault_that_grows_slowly_is_shown_at_its_strongest(display: DisplayTrajectory) -> None:
    """What the windows at its onset are off by is allowed; at its strongest instant it is not."""
    shown = accused(display, fault(BOOT + 13.0, BOOT + 56.0))
    assert shown.result is not None
    t = shown.result.trailing.t
    slow = np.where(t < BOOT + 40.0, 0.01, 90.0)
    trailing = replace(shown.result.trailing, tilt_deg=slow, heading_deg=np.zeros_like(t))
    moment, early = decisive(replace(shown, result=replace(shown.result, trailing=trailing))), decisive(shown)
    assert moment is not None
    assert moment.is_slow
    assert moment.begins_s == moment.strongest_s - PLAYED_S > BOOT + 13.0
    assert early is not None
    assert early.begins_s == BOOT + 13.0 - BEFORE_S


def test_without_a_cause_it_opens_at_the_worst_window(display: DisplayTrajectory) -> None:
    moment = decisive(accused(display))
    assert moment is not None
    assert moment.end_s - moment.onset_s == pytest.approx(5.0, abs=0.05)
    assert moment.strongest_s == moment.end_s
    most = np.nanmax(sigmas_along(display, display.replay.t))
    assert sigmas_along(display, np.array([moment.end_s - 2.5]))[0] == pytest.approx(most, rel=1e-6)


def test_before_the_analysis_it_opens_at_the_worst_stretch() -> None:
    shown = display_trajectory(dead_reckon(FLIGHT, CHOICE))
    moment = decisive(shown)
    assert moment is not None
    apart = np.linalg.norm(shown.replay.position_error, axis=1)
    assert moment.strongest_s == shown.replay.t[apart.argmax()]


def test_a_finding_leads_to_where_its_error_is_largest(display: DisplayTrajectory) -> None:
    """The dead reckoning is anchored every 10 s and its error grows: the strongest instant is not the onset."""
    finding = fault(BOOT + 21.0, BOOT + 36.0)
    moment = moment_of(finding, display)
    assert finding.start_s < moment.strongest_s <= finding.end_s + 5.0
    assert (moment.onset_s, moment.end_s) == (finding.start_s, finding.end_s)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_finding_shows_somewhere(kind: str, display: DisplayTrajectory) -> None:
    finding = Finding(kind, "imu", "info", BOOT + 10.0, BOOT + 20.0, "so", "")
    attitude_alone = replace(display, replay=replace(display.replay, has_position=False))
    for shown in (display, attitude_alone):
        moment = moment_of(finding, shown)
        assert moment.error in errors_in(shown)
        assert finding.start_s <= moment.strongest_s <= finding.end_s + 5.0


def test_an_anchor_is_added_where_the_page_opens_and_nothing_else_changes(display: DisplayTrajectory) -> None:
    shown = accused(display, fault(BOOT + 27.5, BOOT + 36.0))
    start, how = BOOT + 27.5 - BEFORE_S, Integration()
    before, after = shown.replay, replay(FLIGHT, imu="RAW_IMU", how=how, reanchor_s=10.0, start_s=start)
    both = anchored_at_opening(FLIGHT, shown, "RAW_IMU", how, 10.0)
    assert both is not None
    assert np.array_equal(both.t, before.t)
    assert np.array_equal(both.position_ref, before.position_ref)
    early = both.t < start
    assert np.array_equal(both.position_imu[early], before.position_imu[early])
    assert np.array_equal(both.position_imu[~early], after.position_imu)
    assert start in both.anchors
    assert anchored_at_opening(FLIGHT, replace(shown, replay=both), "RAW_IMU", how, 10.0) is None


def test_a_part_is_played_once_and_pauses_at_its_end() -> None:
    player = Player(100.0, 160.0)
    player.play(120.0, 130.0)
    assert (player.playing, player.time) == (True, 120.0)
    for _ in range(300):
        player.advance(0.1)
    assert (player.playing, player.time) == (False, 130.0)
    player.play(120.0, 130.0)
    player.seek(140.0)  # whoever goes elsewhere plays on from there
    player.advance(1.0)
    assert player.time == 141.0


def test_the_colours_of_a_track_tell_where_it_differs(display: DisplayTrajectory) -> None:
    t = display.replay.t[by_shape(display.replay.position_ref, 50)]
    assert len(sigmas_along(display, t)) == len(t)
    assert np.isnan(sigmas_along(replace(display, result=None), t)).all()
