"""Which of several causes the verdict is about."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.constants import num, priors
from companion.verdict.finding import Cause, Finding, Side
from companion.verdict.findings.detect import misled
from companion.verdict.verdict import Agreement, decide
from tests.verdict.deviating import off_by


def cause(kind: str, side: Side, onset: float, sigma: float | None, sensor: str) -> Finding:
    about = Cause(kind, side, onset, onset_sigma_s=sigma, sensor=sensor)
    return Finding(kind, side, "error", onset, 100.0, f"{kind} seen", "do this", f"{kind} seen", about)


def agreements(windows: int, inside: dict[str, float], excluded: dict[str, int] | None = None) -> list[Agreement]:
    """So many windows of 5 s, and as many of a second as that makes."""
    each = {5.0: windows, 1.0: 5 * windows}
    return [Agreement(horizon, each.get(horizon, 0), excluded or {}, inside) for horizon in num.AGREEING_S]


VAGUE = cause("accel_scale", "imu", 66.6, 3.6, "accel")


@pytest.mark.parametrize(
    ("other", "first"),
    [
        (cause("accel_bias", "imu", 68.9, 0.2, "accel"), "accel_bias"),
        (cause("stuck_axis", "imu", 68.9, None, "accel"), "stuck_axis"),
        (cause("accel_bias", "imu", 68.9, 5.0, "accel"), "accel_scale"),
        (cause("accel_bias", "imu", 80.0, 0.2, "accel"), "accel_scale"),
        (cause("gyro_bias", "imu", 68.9, 0.2, "gyro"), "accel_scale"),
        (cause("heading_off", "autopilot", 68.9, None, ""), "accel_scale"),
    ],
)
def test_of_one_sensors_causes_that_may_have_begun_together_the_surest_time_counts(other: Finding, first: str) -> None:
    verdict = decide(agreements(5, {"attitude": 0.5}), (VAGUE, other), None, "RAW_IMU")
    assert verdict.status == "imu_suspect"
    assert verdict.summary == f"Suspect the IMU: {first} seen."
    assert verdict.cause is not None
    assert verdict.cause.kind == first


def test_the_probability_of_a_cause_is_said_with_it() -> None:
    """At its end: what stands before is what its status says already."""
    one = cause("gyro_bias", "imu", 30.0, 0.1, "gyro")
    assert one.cause is not None
    sure = replace(one, cause=replace(one.cause, probability=0.97, side_probability=0.97))
    verdict = decide(agreements(5, {"attitude": 0.5}), (sure,), None, "RAW_IMU")
    assert verdict.summary == "Suspect the IMU: gyro_bias seen (probability 97 %)."
    assert sure.cause is not None
    shared = replace(sure, cause=replace(sure.cause, probability=0.7, sensor="gps"))
    verdict = decide(agreements(5, {"attitude": 0.5}), (shared,), None, "RAW_IMU")
    assert verdict.summary == "Suspect the IMU: gyro_bias seen (probability 97 %; gps: 70 %).", (
        "of one sensor it is less"
    )


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_what_cannot_be_told_is_said_rather_than_that_nothing_explains_it(share: float) -> None:
    judged = agreements(5, {"attitude": share})
    seen = Finding("gyro_bias", "data", "warning", 10.0, 20.0, "gyro or compass", "", undecided=True)
    verdict = decide(judged, (seen,), None, "RAW_IMU")
    assert (verdict.status, verdict.summary) == ("insufficient_data", "Cannot tell: gyro or compass.")
    nothing = decide(judged, (), None, "RAW_IMU")
    assert nothing.status == ("insufficient_data" if share < 0.7 else "consistent")


@pytest.mark.parametrize("share", [1.0, 0.99])
def test_a_suspicion_beside_windows_that_all_agree_says_so(share: float) -> None:
    """A slow creep, or the fault of an IMU that nobody flew on: no window shows it."""
    judged = agreements(31, {"attitude": 1.0, "position": share})
    slow = cause("gps_motion", "autopilot", 66.6, 0.4, "gps")
    bound = "inside the 95 % bound, known errors removed."
    said = f"RAW_IMU and the autopilot nevertheless agree: 100 % of 31 windows of 5 s {bound}"
    verdict = decide(judged, (slow,), None, "RAW_IMU")
    assert verdict.status == "autopilot_suspect"
    assert verdict.summary.endswith(said) == (share == 1.0)


@pytest.mark.parametrize(
    ("usable", "excluded", "said"),
    [
        (0, {}, "no window of 5 s can be used (the flight is too short: at least 15 s are needed)"),
        (1, {"imu_gap": 9}, "only 1 window of 5 s can be used (left out: 9 across an IMU gap)"),
        (
            2,
            {"no_position": 1, "not_judged": 3},
            "only 2 windows of 5 s can be used (left out: 1 without a position, 3",
        ),
    ],
)
def test_too_few_windows_say_in_words_why(usable: int, excluded: dict[str, int], said: str) -> None:
    verdict = decide(agreements(usable, {}, excluded), (), None, "RAW_IMU")
    assert verdict.status == "insufficient_data"
    assert verdict.summary.startswith(f"Cannot tell: {said}")


@pytest.mark.parametrize(
    ("windows", "outside", "consistent"), [(3, 1, True), (3, 2, False), (4, 2, False), (2, 1, False)]
)
def test_one_window_of_few_may_be_outside(windows: int, outside: int, *, consistent: bool) -> None:
    assert Agreement(5.0, windows, {}, {"attitude": 1.0 - outside / windows}).is_consistent is consistent


def test_consistent_holds_at_every_horizon_that_has_many_windows() -> None:
    """After a second no window agrees, after five nearly all: 10 windows are many, 9 may be chance."""
    for seconds, status in ((9, "consistent"), (10, "insufficient_data")):
        shares = {5.0: (4, 0.96), 1.0: (seconds, 0.0)}
        judged = [
            Agreement(h, shares.get(h, (0, 0.0))[0], {}, {"velocity": shares.get(h, (0, 0.0))[1]})
            for h in num.AGREEING_S
        ]
        verdict = decide(judged, (), None, "RAW_IMU")
        assert verdict.status == status
        assert ("0 % of 10 windows of 1 s" in verdict.summary) == (status == "insufficient_data")


def test_an_error_of_the_estimator_is_the_likelier_the_further_it_is_off() -> None:
    """An estimator that is off by less than three σ may be in order; from five on it hardly is."""
    shares = [off_by("tilt", 0.0, 9.0, size, 0.02).probability for size in np.linspace(0.0, 0.12, 50)]
    assert (np.diff(shares) > 0.0).all()
    assert off_by("tilt", 0.0, 9.0, 0.06, 0.02).probability < priors.ACCUSED
    assert off_by("tilt", 0.0, 9.0, 0.10, 0.02).probability > priors.ACCUSED


def test_what_is_off_for_a_moment_of_a_long_flight_may_be_chance_where_the_same_throughout_is_not() -> None:
    """The largest of many independent stretches is large by chance."""
    shares = [off_by("tilt", 0.0, 9.0, 0.10, 0.02, places=times).probability for times in (1.0, 10.0, 100.0)]
    odds = [share / (1.0 - share) for share in shares]
    assert odds[0] == pytest.approx(10.0 * odds[1])
    assert odds[1] == pytest.approx(10.0 * odds[2])
    assert shares[0] > 0.99
    assert shares[2] < 0.97


@pytest.mark.parametrize("size", [0.05, 0.2])
def test_the_autopilot_has_a_probability_beside_the_sensors(size: float) -> None:
    off = off_by("tilt", 50.0, 60.0, size, 0.02)
    finding = replace(cause("tilt_off", "autopilot", 50.0, None, ""), cause=off.cause)
    sensors = {"imu": 0.04, "gps": 0.0, "compass": 0.06, "barometer": 0.0, "nobody": 0.9}
    shares = decide(agreements(5, {"attitude": 0.9}), (finding,), None, "RAW_IMU", sensors).probability
    assert sum(shares.values()) == pytest.approx(1.0)
    assert shares["autopilot"] == pytest.approx(0.9 * off.probability)
    assert shares["imu"] == sensors["imu"]


@pytest.mark.parametrize(("imu", "status"), [(0.04, "autopilot_suspect"), (0.27, "insufficient_data")])
def test_no_side_is_accused_that_has_less_than_95_percent_of_all_shares(imu: float, status: str) -> None:
    """An estimator that is off for certain, beside an IMU that may have been at fault since the start."""
    off = off_by("tilt", 50.0, 60.0, 0.3, 0.02)
    finding = replace(cause("tilt_off", "autopilot", 50.0, None, ""), cause=off.cause)
    sensors = {"imu": imu, "gps": 0.0, "compass": 0.0, "barometer": 0.0, "nobody": 1.0 - imu}
    verdict = decide(agreements(5, {"attitude": 0.9}), (finding,), None, "RAW_IMU", sensors)
    assert verdict.status == status
    assert any(f.severity == "error" for f in verdict.findings) == (status == "autopilot_suspect")
    if verdict.cause is None:
        assert verdict.summary.startswith("Cannot tell the autopilot's estimate from the IMU (73 % / 27 %): tilt_off")


def test_the_autopilot_has_no_share_in_what_a_compass_or_the_board_led_it_to() -> None:
    """Which of these is turned cannot be told, and with it whether the autopilot was misled."""
    turned = Finding("compass_orientation", "data", "warning", 0.0, 100.0, "either is turned", "", undecided=True)
    findings = tuple(misled([turned, cause("heading_jump", "autopilot", 50.0, None, "")]))
    sensors = {"imu": 0.01, "gps": 0.0, "compass": 0.0, "barometer": 0.0, "nobody": 0.99}
    verdict = decide(agreements(5, {"attitude": 0.9}), findings, None, "RAW_IMU", sensors)
    assert verdict.status == "insufficient_data"
    assert verdict.probability["autopilot"] == 0.0


def test_no_flight_of_a_log_accuses_a_side_that_the_log_does_not() -> None:
    off = off_by("tilt", 50.0, 60.0, 0.3, 0.02)
    finding = replace(cause("tilt_off", "autopilot", 50.0, None, ""), cause=off.cause)
    sensors = {"imu": 0.27, "gps": 0.0, "compass": 0.0, "barometer": 0.0, "nobody": 0.73}
    judged = agreements(5, {"attitude": 0.9})
    flights = {(0.0, 100.0): judged, (100.0, 200.0): judged}
    verdict = decide(judged, (finding,), None, "RAW_IMU", sensors, flights)
    assert [one.status for one in verdict.flights] == ["insufficient_data", "consistent"]


def test_where_either_may_be_wrong_both_have_their_share() -> None:
    off = off_by("tilt", 50.0, 60.0, 0.2, 0.02)
    sure, imu = off.or_imu
    assert sure / imu == pytest.approx(priors.ESTIMATOR_ERROR / priors.FAULTY_IMU)
    assert sure + imu > off.probability - 0.01
    either = replace(off.cause, probability=sure, side_probability=sure, rival="gyro_bias", rival_probability=imu)
    finding = Finding("tilt_off", "data", "warning", 50.0, 60.0, "they differ", "", cause=either, undecided=True)
    sensors = {"imu": 0.04, "gps": 0.0, "compass": 0.06, "barometer": 0.0, "nobody": 0.9}
    verdict = decide(agreements(5, {"attitude": 0.9}), (finding,), None, "RAW_IMU", sensors)
    assert verdict.status == "insufficient_data"
    assert sum(verdict.probability.values()) == pytest.approx(1.0)
    assert verdict.probability["autopilot"] == pytest.approx(0.9 * sure)
    assert verdict.probability["imu"] == pytest.approx(0.04 + 0.9 * imu)
