"""Faults that stand: an alarm ends by evidence that the fault has ended, and by nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from benchmarks.accuracy.cutting import cut
from companion.comparison import GENERIC
from companion.estimation import Explained, Rival
from companion.model import Flight, rows
from companion.strapdown import motions
from companion.verdict import (
    Cause,
    Doubt,
    Finding,
    StandingFault,
    Verdict,
    assess,
    beside_doubt,
    carried_on,
    standing_verdict,
)
from companion.verdict import standing as standing_faults
from companion.verdict.fault_interval import FaultInterval
from tests.flights import flown, seconds, with_imu

pytestmark = pytest.mark.slow

FLIGHT = flown(motions.circle(seconds(130, 50)))
PIECES = ((10.0, 44.0), (20.0, 54.0), (20.0, 62.0), (58.0, 92.0), (66.0, 100.0), (98.0, 132.0))
BEGIN = 45.0


def misread(end: float, **errors: Any) -> Flight:
    """The IMU reads too much from BEGIN to end, s."""
    imu = FLIGHT.imu()
    during = ((imu.t >= BEGIN) & (imu.t < end)).astype(float)[:, None]
    changed = {sensor: getattr(imu, sensor) + during * np.array(error) for sensor, error in errors.items()}
    return with_imu(FLIGHT, **changed)


def heard(flight: Flight, pieces: Sequence[tuple[float, float]] = PIECES) -> list[tuple[Verdict, Verdict]]:
    """The verdict on each piece by itself, and beside the faults that stand."""
    standing: tuple[StandingFault, ...] = ()
    verdicts = []
    for begin, end in pieces:
        piece = cut(flight, begin, end)
        own = assess(piece, GENERIC)
        standing = carried_on(standing, piece, own.verdict, own.best)
        verdicts.append((own.verdict, standing_verdict(standing, own.verdict)))
    return verdicts


@pytest.mark.parametrize(
    ("sensor", "error"), [("gyro", (0.0, 0.0, 0.015)), ("accel", (0.6, 0.0, 0.0))], ids=["gyro", "accelerometer"]
)
def test_a_bias_is_a_fault_as_long_as_it_lasts_though_its_onset_lies_before_the_piece(
    sensor: str, error: tuple[float, ...]
) -> None:
    verdicts = heard(misread(np.inf, **{sensor: error}))
    assert [said.status for _, said in verdicts] == ["consistent", *["imu_suspect"] * 5], "it never takes it back"
    alone, said = verdicts[-1]
    assert alone.status != "imu_suspect", "the piece alone takes it for the part's own bias"
    assert said.cause is not None
    assert said.cause.kind == f"{sensor}_bias"
    assert said.cause.onset_s == pytest.approx(BEGIN, abs=2.0)
    assert "until now" in said.summary


def test_an_alarm_ends_when_the_fault_is_seen_to_end_and_not_by_another_alarm() -> None:
    verdicts = heard(misread(78.0, gyro=[0.0, 0.0, 0.015]))
    status = [said.status for _, said in verdicts]
    assert status[:3] == ["consistent", "imu_suspect", "imu_suspect"]
    assert status[4:] == ["consistent", "consistent"]
    assert sum(a != b for a, b in pairwise(status)) == 2, "on, and off"


def test_two_pieces_have_to_see_the_end() -> None:
    """A turn that ends looks so, where what is wrong is the scale."""
    pieces = (*PIECES[:2], (28.0, 70.0), (30.0, 72.0))
    verdicts = [said for _, said in heard(misread(62.0, gyro=[0.0, 0.0, 0.02]), pieces)]
    assert [one.status for one in verdicts] == ["consistent", "imu_suspect", "imu_suspect", "consistent"]
    assert "still there: 50 %" in verdicts[2].summary


@pytest.mark.parametrize("scale", [0.05, 0.0])
def test_a_scale_stays_though_a_piece_takes_it_for_a_bias(scale: float) -> None:
    """A vehicle that turns the same way all the time shows only what both come to."""
    turns = with_imu(FLIGHT, gyro=FLIGHT.imu().gyro * (1.0 + scale * np.array([0.0, 0.0, 1.0])))
    piece = cut(turns, 58.0, 92.0)
    own = assess(piece, GENERIC)
    (found,) = alarm("gyro_scale", "imu", BEGIN, None, sensor="gyro", axis="z", size=0.05, sigma=0.003).findings
    before = np.zeros(6), np.diag([1e-3] * 3 + [5e-3] * 3) ** 2
    fault = StandingFault(found, 0.9, 55.0, before, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.05]))
    (kept, *_) = carried_on([fault], piece, own.verdict, own.best)
    assert (kept.over_s is None) == (scale > 0.0)


@pytest.mark.parametrize("explained", [True, False])
def test_a_bias_that_is_a_scale_instead_is_not_over_where_a_piece_cannot_tell(*, explained: bool) -> None:
    piece = cut(FLIGHT, 20.0, 62.0)
    best = assess(piece, GENERIC).best
    assert best is not None
    rivals = (Rival("gyro_scale", "step", 2.6, 1.0),)
    scale = Explained("gyro_scale", "step", BEGIN, 0.2, np.inf, np.full(3, 0.05), np.full(3, 0.01), rivals)
    known = replace(best, explained=(scale,) * explained, explained_covariance=np.zeros((0, 0)), further=())
    (found,) = alarm("gyro_bias", "imu", BEGIN, None, sensor="gyro", axis="z", size=0.02, onset_sigma_s=0.2).findings
    fault = StandingFault(found, 0.9, 58.0, (np.zeros(3), np.eye(3) * 1e-6), np.array([0.0, 0.0, 0.02]))
    (kept,) = carried_on([fault], piece, UNSURE, known)
    assert (kept.over_s is None) is explained
    assert kept.probability == pytest.approx(0.93 * explained, abs=0.01)


def test_a_piece_that_begins_shortly_before_an_onset_does_not_end_an_alarm() -> None:
    """As on a computer that is behind, which judges the newest seconds alone."""
    creeps = alarm("gps_motion", "autopilot", 70.0, None, sensor="gps", size=1.5, sigma=0.1, onset_sigma_s=0.1)
    standing: tuple[StandingFault, ...] = (StandingFault(creeps.findings[0], 1.0, 85.0, size=np.array([1.5, 0.0])),)
    for end in (96.0, 98.0):
        piece = cut(FLIGHT, 62.0, end)
        own = assess(piece, GENERIC)
        standing = carried_on(standing, piece, own.verdict, own.best)
    assert standing[0].over_s is None


def test_a_healthy_flight_has_no_fault_that_stands() -> None:
    assert {said.status for _, said in heard(FLIGHT, PIECES[:3])} == {"consistent"}


def test_one_verdict_without_it_does_not_end_an_alarm_and_a_second_does() -> None:
    """Both share most of their data: what the first explains otherwise the next may find again."""
    false = alarm("gyro_bias", "imu", 30.0, None, sensor="gyro", axis="z", size=0.01, sigma=1e-3, onset_sigma_s=0.2)
    standing: tuple[StandingFault, ...] = (StandingFault(false.findings[0], 1.0, 33.0),)
    said = []
    for begin, end in ((10.0, 49.0), (12.0, 51.0)):
        piece = cut(FLIGHT, begin, end)
        own = assess(piece, GENERIC)
        standing = carried_on(standing, piece, own.verdict, own.best)
        said.append(standing_verdict(standing, own.verdict))
    assert [one.status for one in said] == ["imu_suspect", "consistent"]
    assert "still there: 50 %" in said[0].summary


PIECE = replace(cut(FLIGHT, 10.0, 20.0), gps=(), compasses=(), barometers=())
GOOD, UNSURE = Verdict("consistent", "all is well", ()), Verdict("insufficient_data", "Cannot tell: too short.", ())


def alarm(kind: str, side: Any, onset: float, end: float | None, **more: Any) -> Verdict:
    cause = Cause(kind, side, onset, end, **more)
    finding = Finding(kind, side, "error", onset, end or onset + 5.0, f"{kind} seen", "", cause=cause)
    return Verdict("imu_suspect" if side == "imu" else "autopilot_suspect", f"Suspect: {kind}.", (finding,), cause)


def moved_gps(begin: float, end: float | None) -> Verdict:
    """The GPS is off since 5 s before, and the autopilot with it."""
    return alarm("gps_position", "autopilot", begin - 5.0, end, sensor="gps", size=20.0, sigma=1.0)


def after(seconds_: float) -> Flight:
    """A piece that ends so much later."""
    imus = {source: replace(track, t=track.t + seconds_) for source, track in PIECE.imus.items()}
    return replace(PIECE, start=PIECE.start + seconds_, imus=imus)


@pytest.mark.parametrize(("later", "stands"), [(0.0, False), (9.0, True)])
def test_no_fault_stands_again_by_a_piece_that_begins_before_it_was_over(later: float, stands: bool) -> None:
    piece = after(later)
    shown = alarm("gyro_bias", "imu", piece.start, None, sensor="gyro", axis="z", size=0.05, sigma=1e-3)
    over = PIECE.start + 8.0
    (kept,) = carried_on([StandingFault(shown.findings[0], 0.0, over, over_s=over)], piece, shown, None)
    assert (kept.over_s is None) == stands


def test_what_has_no_size_of_its_own_is_over_when_enough_was_judged_without_it() -> None:
    begin = PIECE.start + PIECE.duration
    standing = carried_on((), PIECE, alarm("tilt_off", "autopilot", begin - 5.0, begin), None)
    assert standing[0].probability == 1.0
    assert carried_on(standing, after(60.0), UNSURE, None) == standing, "to be unable to tell clears nobody"
    soon = carried_on(standing, after(10.0), GOOD, None)
    assert 0.05 < soon[0].probability < 0.95
    assert standing_verdict(soon, GOOD).status == "autopilot_suspect"
    assert standing_verdict(carried_on(soon, after(31.0), GOOD, None), GOOD) == GOOD


@pytest.mark.parametrize(("fault", "goes"), [(0.04, 0.0), (0.1, 3.8), (0.5, 15.0), (1.0, 30.0)])
def test_a_doubt_goes_the_later_the_likelier_it_was(fault: float, goes: float) -> None:
    """Half a doubt in as long as shows what is there in 95 % of pieces: 15 s."""
    likely = replace(UNSURE, probability={"nobody": 1.0 - fault, "imu": fault})
    said: tuple[Verdict, Doubt | None] = beside_doubt(likely, 100.0, None)
    assert said[0] == likely
    for end in np.arange(100.5, 140.0):
        said = beside_doubt(GOOD, float(end), said[1])
        assert said[0].status == ("consistent" if end > 100.0 + goes else "insufficient_data")
        assert (said[0] == GOOD) == (said[1] is None)


def test_a_doubt_gives_way_to_an_alarm_and_not_to_what_cannot_be_judged() -> None:
    _, doubt = beside_doubt(replace(UNSURE, probability={"nobody": 0.4, "imu": 0.6}), 100.0, None)
    assert beside_doubt(UNSURE, 110.0, doubt) == (UNSURE, doubt)
    suspect = alarm("gyro_bias", "imu", 95.0, None, sensor="gyro")
    assert beside_doubt(suspect, 110.0, doubt) == (suspect, None)


def there(piece: Flight) -> Verdict:
    """The second accelerometer reads too much from the first sample of a piece on."""
    return alarm("accel_bias", "imu", piece.start, None, sensor="accel", axis="z", size=0.8, sigma=0.03, imu=1)


def test_what_every_piece_shows_from_its_first_sample_on_is_not_over() -> None:
    pieces = [after(later) for later in np.arange(0.0, 200.0, 10.0)]
    standing: tuple[StandingFault, ...] = ()
    for piece in pieces:
        standing = carried_on(standing, piece, there(piece), None)
        assert [(one.over_s, one.cause.onset_s) for one in standing] == [(None, PIECE.start)], "one fault, the same"
    assert standing_verdict(carried_on(standing, after(300.0), GOOD, None), GOOD) == GOOD, "it reads right for minutes"


def test_a_piece_that_begins_after_the_onset_takes_nothing_of_what_was_measured() -> None:
    onset = PIECE.start - 0.7
    finding = alarm("accel_bias", "imu", onset, None, sensor="accel", axis="z", size=0.8, sigma=0.01, imu=1).findings[0]
    before, size = (np.zeros(3), 1e-4 * np.eye(3)), np.array([0.0, 0.0, 0.8])
    known = StandingFault(finding, 1.0, PIECE.start, before=before, size=size)
    (kept,) = carried_on((known,), PIECE, there(PIECE), None)
    assert (kept.cause.onset_s, kept.before, kept.over_s) == (onset, before, None)


def test_an_offset_that_nothing_measures_stays_until_it_is_seen_to_change_back() -> None:
    """A GPS that has moved, and the autopilot with it, agree for ever."""
    begin = PIECE.start + PIECE.duration
    standing = carried_on((), PIECE, moved_gps(begin, None), None)
    for later in range(10, 600, 30):
        standing = carried_on(standing, after(float(later)), GOOD, None)
        assert standing_verdict(standing, GOOD).status == "autopilot_suspect"


@pytest.mark.parametrize(
    ("north", "status"),
    [(-20.0, "consistent"), (-60.0, "consistent"), (-12.0, "autopilot_suspect"), (20.0, "autopilot_suspect")],
    ids=["back", "a creep that was longer", "half of it", "it goes on"],
)
def test_an_offset_is_over_when_it_changes_back_and_not_when_it_grows(
    north: float, status: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin, best = PIECE.start + PIECE.duration, assess(cut(FLIGHT, 10.0, 30.0), GENERIC).best

    def seen(start: float, size: float) -> None:
        interval = FaultInterval("gps_position", "gps", start, 0.1, np.inf, np.array([size, 0.0]), 0.5, ())
        monkeypatch.setattr(standing_faults, "fault_intervals", lambda _: (interval,))

    seen(begin - 5.0, 20.0)
    standing = carried_on((), PIECE, moved_gps(begin, None), best)
    seen(begin + 40.0, north)
    standing = carried_on(standing, after(60.0), UNSURE, best)
    assert standing_verdict(standing, GOOD).status == status


def test_what_was_seen_to_end_does_not_stand_for_ever() -> None:
    begin = PIECE.start + PIECE.duration
    standing = carried_on((), PIECE, moved_gps(begin, begin - 2.0), None)
    assert standing_verdict(standing, GOOD).status == "autopilot_suspect", "which it is said of"
    assert standing_verdict(carried_on(standing, after(40.0), GOOD, None), GOOD) == GOOD


@pytest.mark.parametrize(("left", "stands"), [(0.0, False), (0.02, True)], ids=["it is", "it is not"])
def test_a_bias_that_is_over_when_it_is_first_seen_does_not_stand_for_ever(
    left: float, stands: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the end of that piece the gyro reads right: that is not the size of its fault."""
    best, size, onset = assess(cut(FLIGHT, 10.0, 30.0), GENERIC).best, np.array([0.0, 0.0, 0.02]), PIECE.start + 1.0
    interval = FaultInterval("gyro_bias", "imu", onset, 0.1, onset + 3.0, size, 1e-3, ())
    monkeypatch.setattr(standing_faults, "fault_intervals", lambda _: (interval,))
    monkeypatch.setattr(standing_faults, "reads", lambda *_, **__: (np.zeros(3), 1e-8 * np.eye(3)))
    seen = alarm("gyro_bias", "imu", onset, onset + 3.0, sensor="gyro", axis="z", size=0.02, sigma=1e-3)
    standing = carried_on((), PIECE, seen, best)
    assert standing_verdict(standing, seen).status == "imu_suspect", "which it is said of"
    read = np.array([0.0, 0.0, left]), 1e-8 * np.eye(3)
    monkeypatch.setattr(standing_faults, "reads", lambda *_, **__: read)
    for later in (40.0, 43.0):
        standing = carried_on(standing, after(later), GOOD, best)
    assert (standing_verdict(standing, GOOD).status == "imu_suspect") == stands


def test_a_gps_that_is_lost_is_an_alarm_until_it_is_received_again() -> None:
    whole = cut(FLIGHT, 10.0, 40.0)
    silent = replace(whole, gps=tuple(rows(one, one.t < 25.0) for one in whole.gps))
    lost = Finding("dead_reckoned", "data", "warning", 25.0, 40.0, "no GPS fix for 15.0 s", "")
    standing = carried_on((), silent, replace(UNSURE, findings=(lost,)), None)
    assert standing_verdict(standing, UNSURE).status == "autopilot_suspect"
    assert standing_verdict(carried_on(standing, silent, GOOD, None), GOOD).status == "autopilot_suspect"
    assert standing_verdict(carried_on(standing, whole, GOOD, None), GOOD) == GOOD


def test_a_gps_that_comes_for_a_moment_and_is_lost_again_is_an_alarm_again() -> None:
    """The second outage begins before the end of the piece that showed the fix."""
    end = PIECE.start + PIECE.duration
    lost = replace(alarm("dead_reckoned", "autopilot", end - 8.0, end - 2.0), status="consistent")
    lost = replace(lost, findings=tuple(replace(one, severity="warning") for one in lost.findings))
    over = StandingFault(lost.findings[0], 0.0, end - 2.0, over_s=end)
    again = replace(lost.findings[0], start_s=end - 1.0, end_s=end + 6.0)
    said = replace(lost, findings=(*lost.findings, replace(again, cause=None)))
    standing = carried_on([over], after(6.0), said, None)
    assert standing_verdict(standing, said).status == "autopilot_suspect"


def test_a_stuck_axis_is_over_when_it_moves_again() -> None:
    imu = PIECE.imu()
    stuck = alarm("stuck_axis", "imu", imu.t[0] + 4.0, imu.t[-1], sensor="gyro", axis="x", imu=imu.instance)
    held = imu.gyro.copy()
    held[imu.t > imu.t[0] + 4.0, 0] = 0.1
    still = with_imu(PIECE, gyro=held)
    standing = carried_on((), still, stuck, None)
    assert standing
    assert carried_on(standing, still, GOOD, None), "though nothing is found: at rest nothing would be"
    assert standing_verdict(carried_on(standing, PIECE, GOOD, None), GOOD) == GOOD


def test_what_a_fault_does_to_the_autopilot_is_no_second_fault() -> None:
    begin = PIECE.start + PIECE.duration
    standing = carried_on((), PIECE, moved_gps(begin, None), None)
    misled = alarm("velocity_off", "autopilot", begin + 20.0, begin + 25.0)
    assert len(carried_on(standing, after(25.0), misled, None)) == 1


def test_while_it_is_not_known_which_imu_it_is_neither_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    piece = cut(misread(np.inf, gyro=[0.0, 0.015, 0.0]), 20.0, 62.0)
    own = assess(piece, GENERIC)
    assert own.verdict.cause is not None
    known = standing_verdict(carried_on((), piece, own.verdict, own.best), own.verdict)
    assert known.cause is not None
    assert known.cause.imu == piece.imu().instance
    monkeypatch.setattr("companion.verdict.standing.probability_by_imu", lambda *_: {0: 0.6, 1: 0.4})
    unknown = standing_verdict(carried_on((), piece, own.verdict, own.best), own.verdict)
    assert unknown.status == "imu_suspect"
    assert unknown.cause is not None
    assert unknown.cause.imu is None
    assert unknown.summary.startswith("Suspect the IMU: IMU 0 and IMU 1 differ by 1")
    assert unknown.summary.endswith("mrad/s in y since 45 s: which one is not known yet.")


@pytest.mark.parametrize(("sensor", "faults"), [("gyro", 1), ("accel", 2)])
def test_another_imu_beside_one_that_recovers_is_not_accused(sensor: str, faults: int) -> None:
    """They part again as the faulty one recovers; of another sensor that fault tells nothing."""
    piece = cut(misread(np.inf, gyro=[0.0, 0.015, 0.0]), 20.0, 62.0)
    own = assess(piece, GENERIC)
    standing = carried_on((), piece, own.verdict, own.best)
    assert [one.cause.sensor for one in standing] == ["gyro"]
    end = piece.start + piece.duration
    beside = alarm(f"{sensor}_bias", "imu", end - 10.0, None, sensor=sensor, size=0.015, sigma=1e-3, imu=1)
    assert len(carried_on(standing, piece, beside, own.best)) == faults
