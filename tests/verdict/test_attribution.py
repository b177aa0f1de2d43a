"""Which of the two is wrong: what the best estimate explained, and where the autopilot leaves it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.accuracy.answer import CAUSES
from companion.comparison import GENERIC, Agreement
from companion.comparison.imu_noise import FlightDensity
from companion.comparison.imu_spec import ReferenceSpec
from companion.comparison.reference import Limits, reference_at
from companion.comparison.windows import compare
from companion.constants import healthy
from companion.estimation import CONSTANTS, HYPOTHESES, BestEstimate, Explained, Rival, Size, hypothesis_of
from companion.estimation.learned_noise import FIRST_NOISE
from companion.model import Array, EstimatorReset, Flight, Origin, PositionTrack, SensorInUse, geodetic_from_ned
from companion.strapdown import quaternion
from companion.verdict.attribution import fault_probability, findings_of, follows
from companion.verdict.deviations import deviations_of
from companion.verdict.fault_interval import EstimatorDeviation, FaultInterval, cause_of, described, fault_intervals
from companion.verdict.finding import Finding
from companion.verdict.findings.detect import findings
from companion.verdict.verdict import decide
from tests.flights import turned
from tests.verdict.deviating import off_by

ONSET = 30.0
NORTH, DOWN = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def estimator_deviations(
    flight: Flight, best: BestEstimate, limits: Limits, tilted: tuple[float, float] = (0.0, 0.0)
) -> tuple[EstimatorDeviation, ...]:
    return tuple(one for one in deviations_of(flight, best, limits, tilted) if one.probability > 0.5)


def headed(flight: Flight, degrees: float) -> Flight:
    """The autopilot's heading off from the onset on."""
    return turned(flight, np.radians(degrees) * (flight.require_attitude().t >= ONSET)[:, None] * DOWN)


def moving(best: BestEstimate, velocity: Array, position: Array) -> BestEstimate:
    """The best estimate of a vehicle that moves by so much more, (K, 3) NED."""
    faster = replace(best.states, velocity=best.velocity + velocity, position=best.position + position)
    return replace(best, states=faster)


def accepted(kind: str, *size: float, onset: float = ONSET, end: float = np.inf, sigma: float = 0.1) -> Explained:
    """What was explained by a step, beyond doubt."""
    rivals = (Rival(kind, "step", 50.0, 1.0),)
    return Explained(kind, "step", onset, 0.1, end, np.array(size), np.full(len(size), sigma), rivals)


def step(onset: float, end: float, size: float) -> Explained:
    return accepted("gyro_bias", 0.0, 0.0, size, onset=onset, end=end, sigma=1e-4)


def test_an_estimate_that_agrees_does_not_depart(flight: Flight, best: BestEstimate) -> None:
    assert estimator_deviations(flight, best, Limits()) == ()
    assert findings_of((), (), best) == []


@pytest.mark.parametrize(("lost", "parts"), [(2.0, 1), (9.0, 2)], ids=["a gap", "too long to know"])
def test_a_gap_of_a_log_ends_no_deviation(flight: Flight, best: BestEstimate, lost: float, parts: int) -> None:
    off = headed(flight, 40.0)
    attitude = off.require_attitude()
    known = np.flatnonzero(np.abs(attitude.t - (ONSET + 12.0)) > 0.5 * lost)
    rest = replace(attitude, t=attitude.t[known], q_ned_frd=attitude.q_ned_frd[known], rates=attitude.rates[known])
    found = estimator_deviations(replace(off, attitude=rest), best, Limits())
    assert [one.quantity for one in found] == ["heading"] * parts
    assert found[-1].end > ONSET + 12.0 + 0.5 * lost


@pytest.mark.parametrize(("flown_on", "misled"), [(0, True), (1, False)])
def test_an_imu_that_the_autopilot_did_not_fly_on_misleads_nobody(
    flight: Flight, best: BestEstimate, flown_on: int, misled: bool
) -> None:
    off = replace(best, explained=(step(ONSET, np.inf, 0.05),))
    deviations = estimator_deviations(headed(flight, 40.0), best, Limits())
    in_use = SensorInUse(np.array([0.0]), np.array([flown_on]))
    found = findings_of(fault_intervals(off), deviations, off, in_use=in_use)
    assert ("misled" in found[0].evidence) is misled
    assert any(one.kind == "heading_off" for one in found) is not misled


def test_a_deviation_that_nothing_explains_is_the_autopilots(flight: Flight, best: BestEstimate) -> None:
    found = estimator_deviations(headed(flight, 40.0), best, Limits())
    (heading,) = (d for d in found if d.quantity == "heading")
    assert heading.start == pytest.approx(ONSET, abs=1.0)
    assert np.degrees(heading.size) == pytest.approx(40.0, abs=2.0)
    (finding,) = (f for f in findings_of((), found, best) if f.kind == "heading_off")
    assert (finding.side, finding.severity) == ("autopilot", "error")


def turned_whole(best: BestEstimate) -> BestEstimate:
    """The whole flight may be turned by 20°, 1σ, as by a compass that nobody calibrated."""
    known = best.covariance.copy()
    known[:, 2, 2] += np.radians(20.0) ** 2
    unknown = best.correlation.constants.copy()
    whole = np.zeros((*best.correlation.border.shape[:2], 1))
    whole[:, 2] = np.radians(20.0)
    return replace(
        best,
        covariance=known,
        correlation=replace(
            best.correlation,
            border=np.concatenate((best.correlation.border, whole), axis=2),
            constants=np.block(
                [[unknown, np.zeros((len(unknown), 1))], [np.zeros((1, len(unknown))), np.ones((1, 1))]]
            ),
        ),
    )


def unsure(best: BestEstimate) -> BestEstimate:
    """The heading is in doubt by 3° more, 1σ, at each time anew."""
    known = best.covariance.copy()
    known[:, 2, 2] += np.radians(3.0) ** 2
    return replace(best, covariance=known)


def test_a_heading_that_changes_is_judged_by_the_change(flight: Flight, best: BestEstimate) -> None:
    doubted = turned_whole(best)
    (heading,) = estimator_deviations(headed(flight, 20.0), doubted, Limits())
    assert heading.start == pytest.approx(ONSET, abs=1.0)
    assert np.degrees([heading.size, heading.sigma]) == pytest.approx([20.0, 3.1], abs=1.0)
    assert estimator_deviations(turned(flight, np.radians(20.0) * DOWN), doubted, Limits()) == ()


def test_a_harmful_deviation_that_may_be_chance_accuses_nobody(flight: Flight, best: BestEstimate) -> None:
    """13° where both may be off by 4.3°, 1σ: three of them."""
    doubted = unsure(best)
    (heading,) = deviations_of(headed(flight, 13.0), doubted, Limits())
    assert np.degrees([heading.size, heading.sigma]) == pytest.approx([13.0, 4.3], abs=1.0)
    assert 0.05 < heading.probability < 0.95
    (finding,) = findings_of((), (heading,), doubted)
    assert (finding.side, finding.undecided) == ("data", True)
    assert deviations_of(headed(flight, 6.0), doubted, Limits()) == ()  # harms nobody
    (sure,) = estimator_deviations(headed(flight, 40.0), doubted, Limits())
    assert sure.probability > 0.95


def test_a_heading_that_is_off_by_half_a_turn_changes_by_little_on_either_side_of_it(
    flight: Flight, best: BestEstimate
) -> None:
    """As where the whole flight is reckoned backwards: from 178 to 182° is 4°, and not 356."""
    doubted, later = turned_whole(best), flight.require_attitude().t >= ONSET
    other = turned(flight, np.radians(np.where(later, 182.0, 178.0))[:, None] * DOWN)
    assert estimator_deviations(other, doubted, Limits()) == ()
    further = turned(flight, np.radians(np.where(later, 200.0, 178.0))[:, None] * DOWN)
    (heading,) = estimator_deviations(further, doubted, Limits())
    assert np.degrees(heading.size) == pytest.approx(22.0, abs=2.0)


def test_a_change_that_is_known_no_better_than_the_heading_is_none(flight: Flight, best: BestEstimate) -> None:
    """Off by 8° to one side, then to the other: no fault where that is in doubt at each time anew."""
    later = flight.require_attitude().t >= ONSET
    other = turned(flight, np.radians(np.where(later, 8.0, -8.0))[:, None] * DOWN)
    (heading,) = estimator_deviations(other, turned_whole(best), Limits())
    assert np.degrees(heading.size) == pytest.approx(16.0, abs=2.0)
    assert estimator_deviations(other, unsure(best), Limits()) == ()


def test_a_heading_in_doubt_that_does_not_change_is_no_deviation(flight: Flight, best: BestEstimate) -> None:
    """Off by 16° throughout, where 3σ are 13°: an offset that nothing tells apart from the estimate's own."""
    always = turned(flight, np.radians(16.0) * DOWN)
    assert [d.quantity for d in estimator_deviations(always, best, Limits())] == ["heading"]
    assert estimator_deviations(always, unsure(best), Limits()) == ()


def test_a_heading_that_drifts_on_a_circle_is_no_lag(flight: Flight, best: BestEstimate) -> None:
    """It was taken for one of 0.1 s; a quick turn then looked like an attitude that is off."""
    t, track = best.t, flight.require_attitude()
    circling, quickly = t < ONSET, (t > 40.0) & (t < 48.0)
    rate = np.where(circling, 0.2, np.where(quickly, 2.5, 0.0))
    heading = np.cumsum(rate * np.gradient(t))
    gyro = best.imu.gyro.copy()
    gyro[best.index] = rate[:, None] * DOWN
    turns = replace(
        best,
        imu=replace(best.imu, gyro=gyro),
        states=replace(best.states, q_ned_frd=quaternion.exp(heading[:, None] * DOWN)),
    )
    off = np.radians(np.where(circling, 1.5, -1.5))
    track = replace(track, q_ned_frd=quaternion.exp(np.interp(track.t, t, heading + off)[:, None] * DOWN))
    assert estimator_deviations(replace(flight, attitude=track), turns, Limits()) == ()


@pytest.mark.parametrize(("before", "after"), [(20.0, 0.0), (0.0, 20.0)], ids=["nearer", "further off"])
@pytest.mark.parametrize("compass", [True, False], ids=["turned", "in order"])
def test_a_heading_that_is_set_anew_begins_anew_unless_a_turned_compass_sets_it(
    flight: Flight, best: BestEstimate, before: float, after: float, compass: bool
) -> None:
    later = flight.require_attitude().t >= ONSET
    other = turned(flight, np.radians(np.where(later, after, before))[:, None] * DOWN)
    other = replace(other, resets=(EstimatorReset(ONSET, "heading"),))
    field = accepted("compass_field", 0.0, 8.0, onset=ONSET - 5.0)
    known = replace(turned_whole(best), explained=(field,) * compass)
    deviations = estimator_deviations(other, known, Limits())
    assert [d.quantity for d in deviations] == ["heading"] * (compass and after > before)


@pytest.mark.parametrize(("rise_s", "deviates"), [(0.05, True), (4.0, False)], ids=["in a step", "little by little"])
def test_what_begins_with_a_step_need_not_last(
    flight: Flight, best: BestEstimate, rise_s: float, deviates: bool
) -> None:
    """A live verdict cannot wait; what an estimator mends by itself grows and goes."""
    attitude = flight.require_attitude()
    gone = np.clip((ONSET + 2.5 - attitude.t) / rise_s, 0.0, 1.0)
    angle = 20.0 * np.clip((attitude.t - ONSET) / rise_s, 0.0, 1.0) * gone
    for_a_while = turned(flight, np.radians(angle)[:, None] * DOWN)
    assert [d.quantity for d in estimator_deviations(for_a_while, best, Limits())] == ["heading"] * deviates


def test_a_step_is_one_though_a_keyframe_lies_within_it(flight: Flight, best: BestEstimate) -> None:
    before, within, after = best.t[np.searchsorted(best.t, ONSET) :][:3]
    attitude = flight.require_attitude()
    times = [before, within, after, after + 2.0, after + 2.2]
    angle = np.radians(np.interp(attitude.t, times, [0.0, 8.0, 14.0, 14.0, 0.0]))
    other = turned(flight, angle[:, None] * DOWN)
    assert [d.quantity for d in estimator_deviations(other, best, Limits())] == ["heading"]


@pytest.mark.parametrize(("sigma", "deviates"), [(0.0, True), (3.0, False)], ids=["known", "known to 3°"])
def test_a_tilt_departs_by_more_than_it_is_known(
    flight: Flight, best: BestEstimate, sigma: float, deviates: bool
) -> None:
    lean = np.radians(6.0) * (flight.require_attitude().t >= ONSET)
    other = turned(flight, lean[:, None] * [1.0, 0.0, 0.0])
    known = best.covariance.copy()
    known[:, :2, :2] += np.radians(sigma) ** 2 * np.eye(2)
    assert [d.quantity for d in estimator_deviations(other, replace(best, covariance=known), Limits())] == [
        "tilt"
    ] * deviates


@pytest.mark.parametrize(("speed", "deviates"), [(0.0, True), (60.0, False)], ids=["standing", "at 60 m/s"])
def test_a_position_may_be_off_by_what_a_late_gps_makes_of_the_speed(
    flight: Flight, best: BestEstimate, speed: float, deviates: bool
) -> None:
    """Each estimator assumes one latency of its GPS: they need not assume the same."""
    flown_s = (best.t - best.t[0])[:, None]
    swift = moving(best, speed * NORTH, speed * flown_s * NORTH)
    off = 8.0 * (best.t >= ONSET)[:, None] * NORTH
    other = replace(flight, position=PositionTrack(best.t, swift.position + off, swift.velocity))
    assert [d.quantity for d in estimator_deviations(other, swift, Limits())] == ["position"] * deviates


def test_what_chance_does_in_a_long_flight_is_a_consequence_where_a_fault_comes_before_it(best: BestEstimate) -> None:
    off = off_by("tilt", ONSET + 2.0, ONSET + 5.0, 0.05, 0.0135, places=300.0)
    assert not off.may_be_error
    assert findings_of((), (off,), best) == []
    biased = replace(best, explained=(step(ONSET, np.inf, 0.02),))
    (one,) = findings_of(fault_intervals(biased), (off,), biased)
    assert (one.kind, one.severity) == ("gyro_bias", "error")
    assert "the autopilot was misled by it: 2.9 ± 0.8° in tilt" in one.evidence


@pytest.mark.parametrize("radius", [6_378_100.0, 6_371_000.0], ids=["ArduPilot", "PX4"])
def test_an_autopilot_that_counts_degrees_on_a_sphere_is_in_order(
    flight: Flight, best: BestEstimate, radius: float
) -> None:
    """Near the equator its north is stretched by 0.6 %: 15 m in 2.5 km."""
    origin = (0.1, 0.5, 0.0)
    far = 2_500.0 * np.clip((best.t - ONSET) / 20.0, 0.0, 1.0)[:, None] * np.array([0.9, 0.4, 0.0])
    gone = moving(replace(best, origin=Origin(*origin)), np.zeros_like(far), far)
    latitude, longitude, _ = geodetic_from_ned(gone.position, origin).T
    north, east = radius * (latitude - origin[0]), radius * np.cos(origin[0]) * (longitude - origin[1])
    told = np.column_stack([north, east, gone.position[:, 2]])
    other = replace(flight, position=PositionTrack(best.t, told, gone.velocity))
    assert np.abs(told - gone.position).max() > 10.0
    assert estimator_deviations(other, gone, Limits()) == ()
    elsewhere = replace(other, position=PositionTrack(best.t, told + 0.01 * far[:, [1, 0, 2]], gone.velocity))
    assert [d.quantity for d in estimator_deviations(elsewhere, gone, Limits())] == ["position"]


def test_an_autopilot_may_follow_a_gps_as_far_as_that_is_explained_to_be_off_and_no_further(
    flight: Flight, best: BestEstimate
) -> None:
    """0.4 m/s is no fault of a GPS, and 10 m after 25 s."""
    drifts = 0.4 * np.clip(best.t - ONSET, 0.0, 25.0)[:, None] * NORTH
    known = replace(best, explained=(accepted("gps_motion", 0.4, 0.0, end=ONSET + 25.0),))
    assert not fault_intervals(known)
    for times, deviates in ((1.0, False), (0.5, False), (2.5, True), (-1.0, True)):
        other = replace(flight, position=PositionTrack(best.t, best.position + times * drifts, best.velocity))
        assert [d.quantity for d in estimator_deviations(other, known, Limits())] == ["position"] * deviates, times


@pytest.mark.parametrize(
    ("metres", "within_s", "side"),
    [(5.0, 0.1, None), (5.0, 15.0, None), (9.0, 0.1, "autopilot"), (20.0, 15.0, "autopilot")],
)
def test_an_autopilot_is_not_accused_of_what_a_receiver_in_order_does(
    flight: Flight, best: BestEstimate, metres: float, within_s: float, side: str | None
) -> None:
    """A GPS in order shifts by some metres, and the autopilot need not follow it."""
    off = metres * np.clip((best.t - ONSET) / within_s, 0.0, 1.0)[:, None] * NORTH
    other = replace(flight, position=PositionTrack(best.t, best.position + off, best.velocity))
    found = [
        f.side for f in findings_of((), estimator_deviations(other, best, Limits()), best) if f.kind == "position_off"
    ]
    assert found == ([] if side is None else [side])


@pytest.mark.parametrize("until", [40.0, np.inf], ids=["recovers", "stays"])
def test_an_estimate_that_is_off_from_the_beginning_is_told(flight: Flight, best: BestEstimate, until: float) -> None:
    other = turned(flight, np.radians(40.0) * (flight.require_attitude().t < until)[:, None] * DOWN)
    found = [f for f in findings_of((), estimator_deviations(other, best, Limits()), best) if f.kind == "heading_off"]
    assert found[0].side == "autopilot"


@pytest.mark.parametrize(("off", "deviates"), [(-12.0, False), (12.0, True), (-60.0, True)])
def test_a_heading_that_follows_a_calibrated_compass_is_not_off(
    flight: Flight, best: BestEstimate, off: float, deviates: bool
) -> None:
    """One whose constant errors turn the field by 20° about the vertical of the body."""
    constants = best.states.constants.copy()
    place, _ = CONSTANTS["soft_iron"]
    about_down = quaternion.to_matrix(quaternion.exp(np.radians([0.0, 0.0, 20.0])))
    constants[place] = (about_down - np.eye(3)).ravel()
    with_iron = replace(best, states=replace(best.states, constants=constants))
    follows_it = turned(flight, np.radians([[0.0, 0.0, off]]))
    found = estimator_deviations(follows_it, with_iron, Limits())
    assert ("heading" in [d.quantity for d in found]) is deviates


def test_an_imu_that_is_known_to_sit_askew_is_no_deviation(flight: Flight, best: BestEstimate) -> None:
    tilted = (np.radians(4.0), np.radians(-2.0))
    attitude = flight.require_attitude()
    askew = quaternion.multiply(attitude.q_ned_frd, quaternion.exp(-np.array([*tilted, 0.0])))
    other = replace(flight, attitude=replace(attitude, q_ned_frd=askew))
    assert {d.quantity for d in estimator_deviations(other, best, Limits())} == {"tilt"}
    assert estimator_deviations(other, best, Limits(), tilted) == ()


WANDERING = replace(FIRST_NOISE, gyro_noise=1e-5, accel_noise=1e-4, gyro_walk=6e-4)


def perhaps(kind: str, log_odds: float = -2.0, fault: float = 1.0) -> tuple[Rival, ...]:
    """What is not in the best estimate and may be the reason all the same."""
    return (Rival(kind, "step", log_odds, fault),)


@pytest.mark.parametrize(
    ("doubt", "said", "tells"),
    [
        ({"further": perhaps("accel_bias")}, "a fault of the accelerometer", "A second sensor of the same kind"),
        ({"further": perhaps("compass_field")}, "a fault of the compass", "A second sensor of the same kind"),
        ({"residuals": {}}, "without GPS", "GPS while the vehicle moves"),
        ({"converged": False}, "has not converged", "A second sensor of the same kind"),
        ({"noise": WANDERING}, "the gyro's bias wanders by 4.6 mrad/s in a minute", "An IMU that is better damped"),
    ],
    ids=["the accelerometer nearly explains it", "the compass does", "no GPS", "not converged", "the gyro wanders"],
)
def test_where_the_best_estimate_is_in_doubt_nobody_is_accused(
    flight: Flight, best: BestEstimate, doubt: dict[str, object], said: str, tells: str
) -> None:
    """And what would tell is what such a log lacks."""
    found = estimator_deviations(headed(flight, 40.0), best, Limits())
    (finding,) = (f for f in findings_of((), found, replace(best, **doubt)) if f.kind == "heading_off")  # type: ignore[arg-type]
    assert (finding.side, finding.severity) == ("data", "warning")
    assert said in finding.evidence
    assert finding.advice.startswith(tells)


@pytest.mark.parametrize("kind", ["gyro_bias", "accel_bias", "compass_field"])
def test_what_moves_no_gps_does_not_explain_a_position(flight: Flight, best: BestEstimate, kind: str) -> None:
    """The GPS says where the vehicle is, whatever else may be wrong: an estimate 30 m off it is off by itself."""
    off = 30.0 * np.clip((best.t - ONSET) / 10.0, 0.0, 1.0)[:, None] * NORTH
    other = replace(flight, position=PositionTrack(best.t, best.position + off, best.velocity))
    doubted = replace(best, further=perhaps(kind))
    (finding,) = findings_of((), estimator_deviations(other, best, Limits()), doubted)
    assert (finding.kind, finding.side) == ("position_off", "autopilot")


@pytest.mark.parametrize(("log_odds", "fault"), [(-4.0, 1.0), (-2.0, 0.01)], ids=["as a whole", "as a fault"])
def test_what_is_far_less_likely_than_nothing_excuses_no_autopilot(
    flight: Flight, best: BestEstimate, log_odds: float, fault: float
) -> None:
    """What parts in order show as well is often there, and misleads nobody."""
    unlikely = replace(best, further=perhaps("accel_bias", log_odds, fault))
    (finding,) = findings_of((), estimator_deviations(headed(flight, 40.0), best, Limits()), unlikely)
    assert (finding.kind, finding.side) == ("heading_off", "autopilot")


@pytest.mark.parametrize("felt", [True, False], ids=["as the gyro turned", "the gyro did not turn"])
def test_an_estimate_that_turns_as_the_imu_does_is_not_accused(flight: Flight, best: BestEstimate, felt: bool) -> None:
    """The autopilot turns by 30° within 10 s, and the best estimate does not: which of them followed the gyro?"""
    attitude, rate = flight.require_attitude(), np.radians(3.0)
    other = turned(flight, rate * np.clip(attitude.t - ONSET, 0.0, 10.0)[:, None] * DOWN)
    imu = best.imu
    if felt:
        during = (imu.t >= ONSET) & (imu.t < ONSET + 10.0)
        q = reference_at(attitude, None, imu.t, Limits()).q_ned_frd
        imu = replace(imu, gyro=imu.gyro + during[:, None] * quaternion.rotate(quaternion.conjugate(q), rate * DOWN))
    third = replace(best, imu=imu)
    found = estimator_deviations(other, third, Limits())
    assert {(d.quantity, d.imu_confirms) for d in found} == {("heading", felt)}
    (finding,) = findings_of((), found, third)
    assert finding.side == ("data" if felt else "autopilot")
    assert ("the IMU moved as the autopilot says" in finding.evidence) == felt


@pytest.mark.parametrize("felt", [True, False], ids=["as the accelerometer felt", "the accelerometer felt nothing"])
def test_an_estimate_that_speeds_up_as_the_accelerometer_says_is_not_accused(
    flight: Flight, best: BestEstimate, felt: bool
) -> None:
    attitude, imu, north = flight.require_attitude(), best.imu, np.array([1.0, 0.0, 0.0])
    faster = np.clip(best.t - ONSET, 0.0, 5.0)[:, None] * north  # 1 m/s² for 5 s
    track = PositionTrack(best.t, best.position, best.velocity + faster)
    if felt:
        during = (imu.t >= ONSET) & (imu.t < ONSET + 5.0)
        q = reference_at(attitude, None, imu.t, Limits()).q_ned_frd
        imu = replace(imu, accel=imu.accel + during[:, None] * quaternion.rotate(quaternion.conjugate(q), north))
    third = replace(best, imu=imu)
    found = estimator_deviations(replace(flight, position=track), third, Limits())
    assert {(d.quantity, d.imu_confirms) for d in found} == {("velocity", felt)}
    assert [f.side for f in findings_of((), found, third)] == ["data" if felt else "autopilot"]


def raised(flight: Flight, best: BestEstimate, metres: float) -> Flight:
    """The autopilot's position that of the best estimate, its height off from the onset on."""
    off = metres * (best.t >= ONSET)[:, None] * np.array([0.0, 0.0, -1.0])
    return replace(flight, position=PositionTrack(best.t, best.position + off, best.velocity))


@pytest.mark.parametrize(("metres", "deviates"), [(12.0, True), (8.0, False)])
def test_a_height_departs(flight: Flight, best: BestEstimate, metres: float, deviates: bool) -> None:
    found = estimator_deviations(raised(flight, best, metres), best, Limits())
    assert [d.quantity for d in found] == ["height"] * deviates
    if deviates:
        assert found[0].start == pytest.approx(ONSET, abs=1.0)
        assert found[0].size == pytest.approx(metres, abs=1.0)


@pytest.mark.parametrize(("pull", "deviates"), [(0.0, True), (20.0, False)], ids=["even", "at 20 m/s²"])
def test_a_velocity_may_be_off_by_what_a_late_gps_makes_of_the_pull(
    flight: Flight, best: BestEstimate, pull: float, deviates: bool
) -> None:
    flown_s = (best.t - best.t[0])[:, None]
    swift = moving(best, pull * flown_s * NORTH, 0.5 * pull * flown_s**2 * NORTH)
    off = 2.0 * (best.t >= ONSET)[:, None] * NORTH
    other = replace(flight, position=PositionTrack(best.t, swift.position, swift.velocity + off))
    assert [d.quantity for d in estimator_deviations(other, swift, Limits())] == ["velocity"] * deviates


def test_a_height_that_follows_the_barometer_is_its_consequence(flight: Flight, best: BestEstimate) -> None:
    faulty = replace(best, explained=(accepted("barometer", 12.0),))
    (finding,) = findings_of(
        fault_intervals(faulty), estimator_deviations(raised(flight, faulty, 12.0), faulty, Limits()), faulty
    )
    assert (finding.kind, finding.side, finding.severity) == ("barometer", "autopilot", "error")
    (heading,) = (d for d in estimator_deviations(headed(flight, 40.0), faulty, Limits()) if d.quantity == "heading")
    assert not follows(heading, fault_intervals(faulty)[0], faulty)
    (far,) = estimator_deviations(raised(flight, faulty, 60.0), faulty, Limits())
    assert not follows(far, fault_intervals(faulty)[0], faulty)


@pytest.mark.parametrize(("fault", "severity"), [(1.0, "warning"), (0.2, "info")])
def test_a_fault_that_misled_nobody_is_a_warning_and_accuses_nobody(
    best: BestEstimate, fault: float, severity: str
) -> None:
    turned_by = replace(accepted("compass_turn", 0.0, 0.0, 1.6), rivals=(Rival("compass_turn", "step", 50.0, fault),))
    off = replace(best, explained=(turned_by,))
    (finding,) = findings_of(fault_intervals(off), (), off)
    assert (finding.kind, finding.side, finding.severity) == ("compass_turn", "data", severity)


@pytest.mark.parametrize(("parts", "sure"), [(1, False), (2, True), (3, True)])
def test_several_parts_of_one_error_are_a_fault_by_what_they_sum_to(
    best: BestEstimate, parts: int, *, sure: bool
) -> None:
    each = accepted("compass_iron", 16.0, 0.0, 0.0, onset=0.0, sigma=0.2)
    explained = tuple(
        replace(each, onset=ONSET + i, rivals=(Rival("compass_iron", "step", 50.0, 0.0),)) for i in range(parts)
    )
    (interval,) = fault_intervals(replace(best, explained=explained))
    assert interval.size == pytest.approx([16.0 * parts, 0.0, 0.0])
    assert (interval.rivals[0].fault > 0.95) is sure


@pytest.mark.parametrize(("later", "sure"), [(0.0, True), (20.0, False)])
def test_a_scale_that_begins_with_a_bias_of_one_accelerometer_adds_to_it(
    best: BestEstimate, later: float, *, sure: bool
) -> None:
    """In level flight 1 % and 0.1 m/s² are much the same, and the halves of a fault harm nobody."""
    harmless = [Rival(kind, "step", 50.0, 0.0) for kind in ("accel_bias", "accel_scale")]
    bias = accepted("accel_bias", 0.0, 0.0, -0.15, sigma=0.01)
    scale = accepted("accel_scale", 0.0, 0.0, 0.015, sigma=0.001, onset=ONSET + later)
    halves = tuple(replace(one, rivals=tuple(harmless)) for one in (bias, scale))
    off = replace(best, explained=halves, explained_covariance=np.zeros((0, 0)), further=())
    (interval, *_) = fault_intervals(off)
    assert interval.size[2] == pytest.approx(-0.15 - 0.15 * sure, abs=0.01)
    assert (fault_probability(off)["imu"] > 0.95) is sure


def test_what_follows_a_fault_of_the_imu_is_its_consequence(flight: Flight, best: BestEstimate) -> None:
    faulty = replace(best, explained=(step(ONSET - 1.0, np.inf, 0.05),))
    found = estimator_deviations(headed(flight, 40.0), faulty, Limits())
    (finding,) = findings_of(fault_intervals(faulty), found, faulty)
    assert (finding.kind, finding.side, finding.severity) == ("gyro_bias", "imu", "error")
    assert finding.cause is not None
    assert any("heading" in one for one in finding.cause.consequences)


@pytest.mark.parametrize("explained", [step(ONSET, np.inf, 0.05), accepted("gps_motion", 30.0, 0.0)])
def test_an_estimate_that_has_not_converged_accuses_nobody(
    flight: Flight, best: BestEstimate, explained: Explained
) -> None:
    astray = replace(best, explained=(explained,), converged=False)
    found = estimator_deviations(headed(flight, 40.0), astray, Limits())
    for finding in findings_of(fault_intervals(astray), found, astray):
        assert (finding.side, finding.undecided) == ("data", True)
        assert finding.severity != "error"


def test_what_comes_after_a_sensor_that_reads_nothing_is_no_earlier_faults(flight: Flight, best: BestEstimate) -> None:
    """A small bias before it, which harmed nothing until then, is not what misled the autopilot."""
    biased = replace(best, explained=(step(20.0, np.inf, 4e-3),))
    away, comparison = headed(flight, 40.0), compare(flight)
    stuck = Finding("stuck_axis", "imu", "error", ONSET, ONSET + 5.0, "reads the same", "do not fly on it")

    def severity(*faults: Finding) -> str:
        found, _ = findings(away, comparison, None, GENERIC, FlightDensity(None, None), ReferenceSpec(), faults, biased)
        return next(one.severity for one in found if one.kind == "gyro_bias")

    assert (severity(), severity(stuck)) == ("error", "info")


def test_where_the_imu_fits_with_far_more_noise_than_it_shows_no_other_sensor_is_accused(
    flight: Flight, best: BestEstimate
) -> None:
    quiet = best.noise.gyro_noise / 20.0, best.noise.accel_noise / 20.0
    doubted = replace(best, spectral=quiet, explained=(accepted("gps_motion", 30.0, 0.0),))
    (finding,) = findings_of(
        fault_intervals(doubted), estimator_deviations(headed(flight, 40.0), doubted, Limits()), doubted
    )
    assert (finding.kind, finding.side) == ("gps_motion", "data")


def test_what_was_wrong_from_the_beginning_on_accuses_nobody(flight: Flight, best: BestEstimate) -> None:
    begin = float(best.t[0])
    early = replace(best, explained=(step(begin + 1.0, np.inf, 0.05),))
    (finding,) = findings_of(fault_intervals(early), (), early)
    assert (finding.side, finding.severity, finding.undecided) == ("data", "warning", False)
    assert "from the beginning on" in finding.evidence
    harmed = estimator_deviations(headed(flight, 40.0), early, Limits())
    (finding,) = findings_of(fault_intervals(early), harmed, early)
    assert (finding.side, finding.severity, finding.undecided) == ("data", "warning", True)
    for sigma, side in ((1.0, "imu"), (4.0, "data")):  # as a scale, which shows only from the launch on
        launched = replace(step(begin + 8.0, np.inf, 0.05), onset_sigma=sigma)
        late = replace(best, explained=(launched,))
        assert [one.side for one in findings_of(fault_intervals(late), (), late)] == [side]


def test_a_gyro_that_warms_from_the_beginning_on_is_accused(best: BestEstimate) -> None:
    """What grows in the flight is none of calibration or mounting."""
    begin, rate = float(best.t[0]) + 1.0, 1e-3
    warms = replace(step(begin, np.inf, rate), shape="ramp", size=np.array([0.0, 0.0, rate]), sigma=np.full(3, 1e-6))
    (interval,) = fault_intervals(replace(best, explained=(warms,)))
    assert interval.slow
    (finding,) = findings_of((interval,), (), replace(best, explained=(warms,)))
    assert (finding.side, finding.severity) == ("imu", "error")


def test_an_estimator_that_jumps_as_its_imu_is_contradicted_is_not_accused(best: BestEstimate) -> None:
    """It has to follow a gyro that wanders, and corrects itself again and again."""
    noisy = replace(best, noise=replace(best.noise, gyro_noise=1e3 * best.spectral[0]))
    away = off_by("position", ONSET - 1.0, ONSET + 5.0, 100.0, 1.0)
    (told,) = findings_of((), (away,), noisy)
    assert (told.side, told.undecided) == ("data", True)
    assert "far more noise than it shows" in told.evidence


def test_where_an_imu_is_contradicted_no_sensor_is_accused_and_not_the_imu_alone(best: BestEstimate) -> None:
    """A GPS that stands still in flight is explained by it, and the rest by whatever comes near it."""
    noisy = replace(best, noise=replace(best.noise, gyro_noise=1e3 * best.spectral[0]))
    for one in (weighed(kind, size, (kind, 1.0, 1.0)) for kind, size in (("gyro_bias", BIAS), ("gps_position", AWAY))):
        for estimate in (noisy, best):
            (told,) = findings_of((one,), (off_by("position", ONSET + 1.0, ONSET + 5.0, 100.0, 1.0),), estimate)
            assert told.undecided == (estimate is noisy)
            verdict = decide([Agreement(5.0, 9, {}, {"attitude": 1.0})], (told,), estimate, "RAW_IMU", {"imu": 0.999})
            assert (verdict.status == "insufficient_data") == told.undecided == (not verdict.probability)


@pytest.mark.parametrize(("begun", "misled"), [(ONSET, 1), (ONSET - 12.0, 0)], ids=["with it", "before"])
def test_a_deviation_follows_what_begins_with_it_before_what_was_there_already(
    flight: Flight, best: BestEstimate, begun: float, misled: int
) -> None:
    both = (step(ONSET - 20.0, np.inf, 0.05), accepted("compass_field", 0.0, 20.0, onset=begun))
    deviations = estimator_deviations(headed(flight, 40.0), best, Limits())
    findings = findings_of(fault_intervals(replace(best, explained=both)), deviations, best)
    assert ["the autopilot was misled by it" in f.evidence for f in findings] == [not misled, bool(misled)]


def test_a_fast_vehicle_is_where_a_gps_of_another_latency_would_have_it(flight: Flight, best: BestEstimate) -> None:
    wind = np.array([40.0, 0.0, 0.0])
    fast = replace(best, states=replace(best.states, velocity=best.velocity + wind))
    moved = best.position + (best.t >= ONSET)[:, None] * [7.0, 0.0, 0.0]
    track = PositionTrack(best.t, moved, best.velocity, "LOCAL_POSITION_NED")
    swift = replace(track, velocity=best.velocity + wind)
    assert [d.quantity for d in estimator_deviations(replace(flight, position=track), best, Limits())] == ["position"]
    assert estimator_deviations(replace(flight, position=swift), fast, Limits()) == ()


def test_steps_that_cancel_are_one_fault_interval(best: BestEstimate) -> None:
    (one,) = fault_intervals(replace(best, explained=(step(20.0, np.inf, 0.02), step(40.0, np.inf, -0.02))))
    assert one.start == 20.0
    assert one.end == pytest.approx(40.0, abs=0.2)
    assert one.size == pytest.approx([0.0, 0.0, 0.02])
    (same,) = fault_intervals(replace(best, explained=(step(20.0, 40.0, 0.02),)))
    assert same.start == 20.0
    assert same.end == pytest.approx(40.0, abs=0.2)


@pytest.mark.parametrize("lasts", [0.1, 2.0, 5.0])
def test_a_fault_interval_ends_when_what_was_explained_does(best: BestEstimate, lasts: float) -> None:
    (one,) = fault_intervals(replace(best, explained=(step(20.0, 20.0 + lasts, 0.02),)))
    assert one.start == 20.0
    assert one.end == pytest.approx(20.0 + lasts)


def test_what_begins_together_is_known_together(best: BestEstimate) -> None:
    """Of two steps at one time each alone may be anything: their sum is what is known."""
    halves = [
        replace(step(ONSET, np.inf, 0.008), sigma=np.full(3, 0.02), place=slice(3 * i, 3 * i + 3)) for i in (0, 1)
    ]
    apart = np.eye(3) * 0.02**2
    together = np.block([[apart, 1e-6 * np.eye(3) - apart], [1e-6 * np.eye(3) - apart, apart]])
    known = replace(best, explained=tuple(halves), explained_covariance=together)
    (one,) = fault_intervals(known)
    assert one.size == pytest.approx([0.0, 0.0, 0.016])
    assert one.sigma == pytest.approx(np.sqrt(2e-6))
    (one,) = fault_intervals(replace(known, explained_covariance=0.02**2 * np.eye(6)))
    assert one.sigma == pytest.approx(np.sqrt(2.0) * 0.02)


def test_a_size_is_told_of_the_time_at_which_it_is_known(best: BestEstimate) -> None:
    """A third of a second between two steps tells nothing, however much larger the first one alone may be."""
    first = replace(step(ONSET, np.inf, -0.02), place=slice(0, 3))
    back = replace(step(ONSET + 0.3, np.inf, 0.003), place=slice(3, 6))
    apart = np.eye(3) * 0.014**2
    together = np.block([[apart, 1e-6 * np.eye(3) - apart], [1e-6 * np.eye(3) - apart, apart]])
    (one,) = fault_intervals(replace(best, explained=(first, back), explained_covariance=together))
    assert one.size == pytest.approx([0.0, 0.0, -0.017])
    assert one.start == ONSET
    assert one.sigma == pytest.approx(np.sqrt(2e-6))


def test_nothing_follows_what_came_later_or_was_over_or_cannot_mislead(best: BestEstimate) -> None:
    early = off_by("heading", 10.0, 20.0, 0.5, 0.05)

    def interval(kind: str, side: str, start: float, end: float = np.inf) -> FaultInterval:
        return FaultInterval(kind, side, start, 0.1, end, np.ones(3), 0.1, ())

    late = off_by("heading", 10.0 + healthy.EKF_RECOVERS_S, 60.0, 0.5, 0.05)
    assert follows(late, interval("gyro_bias", "imu", 5.0, 11.0), best), "an estimator takes so long to recover"
    assert not follows(late, interval("gyro_bias", "imu", 5.0, 9.0), best)

    assert follows(early, interval("gyro_bias", "imu", 9.0), best)
    assert not follows(early, interval("gyro_bias", "imu", 30.0), best)
    assert not follows(early, interval("barometer", "barometer", 9.0), best)
    assert not follows(early, interval("gps_height", "gps", 9.0), best)


def test_a_heading_does_not_follow_a_field_that_only_grows(best: BestEstimate) -> None:
    """Along the field that is there a compass points where it did: it has turned nothing that would mislead."""
    level = best.states.constant("earth_field")[:2]
    level = level / np.linalg.norm(level)
    off = off_by("heading", 10.0, 20.0, 0.5, 0.05)

    def field(along: Array) -> FaultInterval:
        return FaultInterval("compass_field", "compass", 9.0, 0.1, np.inf, 12.0 * along, 0.5, ())

    assert not follows(off, field(level), best)
    assert follows(off, field(np.array([-level[1], level[0]])), best)


def test_every_kind_of_explanation_has_its_words_and_its_size() -> None:
    """A row of HYPOTHESES is all that a new kind needs; the benchmarks know it too."""
    for kind in HYPOTHESES:
        told = kind.phrase(Size(np.array([2.0, -0.1, 0.1]), 0.25, np.array([20.0, 5.0, 40.0])))
        assert re.search(r"\d", told), f"{kind.name}: {told!r} gives no size"
        assert "±" in told
        assert kind.about
        assert kind.advice.endswith(".")
    assert set(CAUSES) >= {kind.name for kind in HYPOTHESES}
    assert all(kind.fault_threshold == 0 or kind.device == "imu" for kind in HYPOTHESES)


def test_what_shifts_a_reading_is_said_in_the_axes_of_that_reading() -> None:
    size = Size(np.array([-19.5, 0.0, 1.0]), 0.1, np.array([20.0, 5.0, 40.0]))
    assert hypothesis_of("compass_iron").phrase(size).endswith("19.5 ± 0.1 µT (x -19.5, y 0.0, z 1.0)")
    assert hypothesis_of("gps_velocity").phrase(size).endswith("m/s (north -19.5, east 0.0)")


def test_a_single_number_keeps_its_sign() -> None:
    told = hypothesis_of("gps_latency").phrase(Size(np.array([-0.2]), 0.01, np.zeros(3)))
    assert told == "the GPS fixes come -0.200 ± 0.010 s later than before"


@pytest.mark.parametrize("degrees", [30.0, -20.0])
def test_a_field_turns_clockwise_seen_from_above_where_its_angle_is_positive(
    best: BestEstimate, degrees: float
) -> None:
    """As a heading grows: about down."""
    field = best.states.constant("earth_field")
    change = quaternion.rotate(quaternion.exp(np.radians([0.0, 0.0, degrees])), field) - field
    interval = FaultInterval("compass_field", "compass", ONSET, 0.1, np.inf, change[:2], 0.3, ())
    assert described(interval, best).startswith(f"the compass's field turns by {degrees:.0f} ± ")
    cause = cause_of(interval, best, "autopilot", ())
    assert cause.size == pytest.approx(np.radians(abs(degrees)))
    assert cause.unit == "rad"


def weighed(kind: str, size: Array, *rivals: tuple[str, float, float]) -> FaultInterval:
    """Of a minute's middle; rivals: kind, weight beside a nothing of 1e-6, probability that it is harmful.

    The weights are those at the rates of the table, which are known to an order of magnitude each.
    """
    odds = (Rival(name, "step", float(np.log(1e6 * weight)), fault) for name, weight, fault in rivals)
    return FaultInterval(kind, hypothesis_of(kind).device, ONSET, 0.1, np.inf, size, 1e-3, tuple(odds))


BIAS, AWAY = np.array([0.0, 0.0, 0.08]), np.array([30.0, 0.0])


def test_a_side_is_accused_from_a_probability_of_95_percent_on(best: BestEstimate) -> None:
    interval = weighed("gyro_bias", BIAS, ("gyro_bias", 0.9985, 1.0), ("compass_field", 0.0015, 1.0))
    (finding,) = findings_of((interval,), (), best)
    assert (finding.side, finding.undecided) == ("imu", False)
    assert finding.evidence.startswith("gyro z bias 80.0")
    assert finding.evidence.endswith("(probability 96 %; runner-up: compass field, 4 %)")
    assert finding.advice == hypothesis_of("gyro_bias").advice
    assert finding.cause is not None
    assert finding.cause.rival == "compass_field"
    assert (finding.cause.probability, finding.cause.rival_probability) == pytest.approx((0.96, 0.04), abs=5e-3)


def test_below_that_it_says_so_first_and_what_would_tell(best: BestEstimate) -> None:
    """A reader who stops after the first words must not take a doubt for an accusation, nor act upon it."""
    interval = weighed("gyro_bias", BIAS, ("gyro_bias", 0.997, 1.0), ("compass_field", 0.003, 1.0))
    (finding,) = findings_of((interval,), (), best)
    assert (finding.side, finding.undecided, finding.cause) == ("data", True, None)
    assert finding.evidence.startswith("perhaps gyro z bias 80.0")
    assert finding.evidence.endswith("; cannot tell gyro bias from compass field (94 % / 6 %)")
    assert finding.evidence.count("%") == 2, "said once"
    assert "would tell" in finding.advice


def test_what_is_named_beside_a_cause_blames_another(best: BestEstimate) -> None:
    """Its probability is that of its sensor, whichever way that is off: beside it stands what would acquit it."""
    rivals = (("gyro_bias", 0.6, 1.0), ("accel_bias", 0.3985, 1.0), ("compass_field", 0.0015, 1.0))
    cause = cause_of(weighed("gyro_bias", BIAS, *rivals), best, "imu", ())
    assert cause.rival == "compass_field"
    assert (cause.probability, cause.rival_probability) == pytest.approx((0.96, 0.04), abs=5e-3)


@pytest.mark.parametrize(("kind", "size", "rivals", "side"), [
    ("gyro_bias", BIAS, (("gyro_bias", 0.5, 1.0), ("accel_bias", 0.5, 1.0)), "imu"),
    ("gps_position", AWAY, (("gps_position", 0.5, 1.0), ("compass_turn", 0.5, 1.0)), "autopilot"),
    ("gps_position", AWAY, (("gps_position", 0.5, 1.0), ("accel_bias", 0.5, 1.0)), "data"),
    ("gyro_bias", BIAS, (("gyro_bias", 1.0, 0.5),), "data"),
    ("gyro_bias", BIAS, (("gyro_bias", 0.5, 1.0), ("gyro_shock", 0.5, 0.0)), "data"),
    ("gps_position", AWAY, (("gps_position", 1.0, 0.02),), "nobody"),
    ("gyro_bias", BIAS, (), "nobody"),
], ids=["IMU together", "others together", "one or the other", "harmless", "a shock", "no fault",
        "nothing weighed"])  # fmt: skip
def test_the_imu_the_other_sensors_and_nobody_are_told_apart(
    best: BestEstimate, kind: str, size: Array, rivals: tuple[tuple[str, float, float], ...], side: str
) -> None:
    """Which of the IMU's errors it is, or which sensor misled the autopilot, need not be known to say whose it is."""
    misled = off_by("position", ONSET, ONSET + 20.0, 30.0, 1.0)
    (finding,) = findings_of((weighed(kind, size, *rivals),), (misled,), best)
    if side == "nobody":  # the autopilot is off, and no sensor's fault explains it
        kind, side = "position_off", "data"
    assert (finding.kind, finding.side, finding.undecided) == (kind, side, side == "data")


def test_the_first_fault_of_a_flight_is_one_sides_or_nobodys(best: BestEstimate) -> None:
    early = replace(accepted("gps_position", 30.0, 0.0, onset=10.0), rivals=(Rival("gps_position", "step", 0.0, 1.0),))
    late = replace(accepted("gyro_bias", *BIAS), rivals=(Rival("gyro_bias", "step", 50.0, 0.8),))
    shares = fault_probability(replace(best, explained=(late, early), further=()))
    assert shares["gps"] == pytest.approx(0.5)
    assert shares["imu"] == pytest.approx(0.5 * 0.8)
    assert shares["nobody"] == pytest.approx(0.5 * 0.2)
    assert sum(shares.values()) == pytest.approx(1.0)


def test_a_scale_from_the_start_is_a_fault_as_far_as_no_calibration_leaves_it(best: BestEstimate) -> None:
    """What the text says of it and what the probabilities of the sides say is one number."""
    early = replace(accepted("gyro_scale", 0.0, 0.0, 0.10, onset=best.t[0], sigma=0.02))
    off = replace(best, explained=(early,), further=())
    misled = off_by("heading", best.t[0], ONSET, 0.5, 0.05)
    (finding,) = findings_of(fault_intervals(off), (misled,), off)
    said = re.search(r"\(a fault: ([\d.]+) %\)", finding.evidence)
    assert said, finding.evidence
    assert 100.0 * fault_probability(off)["imu"] == pytest.approx(float(said[1]), abs=0.6)


@pytest.mark.parametrize("kind", [kind.name for kind in HYPOTHESES if kind.nuisance])
def test_a_nuisance_accuses_nobody(best: BestEstimate, kind: str) -> None:
    """However sure it is, and whatever it did."""
    moment = replace(accepted(kind, 9.0, 0.0, 0.0), shape="shock", rivals=(Rival(kind, "shock", 50.0, 0.0),))
    misled = off_by("velocity", ONSET, ONSET + 20.0, 9.0, 0.1)
    (finding,) = findings_of(fault_intervals(replace(best, explained=(moment,))), (misled,), best)
    assert (finding.kind, finding.side, finding.severity) == (kind, "data", "warning")
    assert "no sensor is blamed for a single moment" in finding.evidence


def test_a_harmless_size_is_told_as_no_fault(best: BestEstimate) -> None:
    (finding,) = findings_of((weighed("gyro_bias", 0.05 * BIAS, ("gyro_bias", 1.0, 0.0)),), (), best)
    assert (finding.side, finding.severity, finding.undecided) == ("imu", "info", False)
    assert finding.evidence.endswith("(no fault: over 99.9 %)")


def test_in_the_place_of_a_moment_stands_a_fault_and_no_other_moment(best: BestEstimate) -> None:
    odds = ("gyro_shock", 2.0, 0.0), ("gyro_bias", 1.8, 1.0)
    rivals = tuple(Rival(kind, "step", value, fault) for kind, value, fault in odds)
    sized = np.array([0.1, 0.0, 0.0]), np.full(3, 0.005)
    turned = replace(best, explained=(Explained("gyro_shock", "shock", ONSET, 0.2, np.inf, *sized, rivals),))
    (finding,) = findings_of(fault_intervals(turned), (), turned)
    assert finding.evidence.endswith("; cannot tell that from gyro bias (58 % / 42 %)")


@pytest.mark.parametrize(("odds", "undecided"), [(6.0, False), (2.0, True)])
def test_a_moment_that_may_be_a_fault_instead_is_undecided(best: BestEstimate, odds: float, undecided: bool) -> None:
    """A push that the accelerometer misses, and a GPS whose velocity steps, leave nearly the same readings."""
    rivals = (Rival("accel_shock", "shock", odds, 0.0), Rival("gps_motion", "step", 1.8, 1.0))
    sized = np.array([1.5, 0.0, 0.0]), np.full(3, 0.05)
    pushed = replace(best, explained=(Explained("accel_shock", "shock", ONSET, 0.2, np.inf, *sized, rivals),))
    (finding,) = findings_of(fault_intervals(pushed), (), pushed)
    assert (finding.side, finding.undecided) == ("data" if undecided else "imu", undecided)
    assert ("cannot tell that from GPS motion (58 % / 42 %)" in finding.evidence) is undecided
