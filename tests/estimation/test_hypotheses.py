"""What is put wrong into a flight is found: what it was, how large, and since when."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from companion.constants import num
from companion.constants.priors import ACCUSED, CALM_SHOCK_RATE
from companion.estimation import HYPOTHESES, BestEstimate, Effort, Explained, hypothesis_of, probabilities, smooth
from companion.estimation.aiding_sensors import FIXED, SLOW
from companion.estimation.candidate import Candidate, with_candidate
from companion.estimation.hypotheses import SECANTS, Hypothesis
from companion.estimation.learned_noise import FIRST_NOISE
from companion.estimation.linearisation import linearise, preintegrate_imu
from companion.estimation.scan import Scan, scan, score
from companion.estimation.setup import first_guess, set_up
from companion.estimation.system import Problem, motion_residual
from companion.model import STANDARD_GRAVITY, Array, Flight, geodetic_from_ned
from companion.strapdown import quaternion
from tests.estimation.sensed import PLACE, at, sensed, true_states, with_imu
from tests.flights import moved_north

pytestmark = pytest.mark.slow

ONSET = 30.0


def gyro_step(flight: Flight) -> Flight:
    imu = flight.imu()
    return with_imu(flight, replace(imu, gyro=imu.gyro + (imu.t >= ONSET)[:, None] * np.array([0.0, 0.02, 0.0])))


def accel_step(flight: Flight) -> Flight:
    imu = flight.imu()
    return with_imu(flight, replace(imu, accel=imu.accel + (imu.t >= ONSET)[:, None] * np.array([0.8, 0.0, 0.0])))


def gps_creep(flight: Flight) -> Flight:
    """The position moves off north at 1.5 m/s; the velocity does not know of it."""
    (gps,) = flight.gps
    off = np.maximum(gps.t - ONSET, 0.0)[:, None] * np.array([1.5, 0.0, 0.0])
    where = geodetic_from_ned(off, PLACE) - np.array(PLACE)
    return replace(
        flight, gps=(replace(gps, latitude=gps.latitude + where[:, 0], longitude=gps.longitude + where[:, 1]),)
    )


def gps_jump(flight: Flight) -> Flight:
    (gps,) = flight.gps
    return replace(flight, gps=(moved_north(gps, 20.0 * (gps.t >= ONSET)),))


def gps_motion(flight: Flight) -> Flight:
    """Position and velocity move off together, at 1 m/s to the east for 20 s."""
    (gps,) = flight.gps
    moving = ((gps.t >= ONSET) & (gps.t < ONSET + 20.0))[:, None] * np.array([0.0, 1.0, 0.0])
    off = np.clip(gps.t - ONSET, 0.0, 20.0)[:, None] * np.array([0.0, 1.0, 0.0])
    where = geodetic_from_ned(off, PLACE) - np.array(PLACE)
    told = replace(gps, longitude=gps.longitude + where[:, 1], velocity=gps.velocity + moving)
    return replace(flight, gps=(told,))


def field_turn(flight: Flight) -> Flight:
    """The field turns by 30° about down."""
    (compass,) = flight.compasses
    q = flight.require_attitude()
    i = np.searchsorted(q.t, compass.t)
    world = quaternion.rotate(q.q_ned_frd[i], compass.field)
    turned = quaternion.rotate(quaternion.exp(np.radians([0.0, 0.0, 30.0])), world)
    later = (compass.t >= ONSET)[:, None]
    field = np.where(later, quaternion.rotate(quaternion.conjugate(q.q_ned_frd[i]), turned), compass.field)
    return replace(flight, compasses=(replace(compass, field=field),))


def compass_turn(flight: Flight) -> Flight:
    """The compass turns by 27° in its mounting."""
    (compass,) = flight.compasses
    turned = quaternion.rotate(quaternion.exp(np.array([0.2, 0.0, 0.42])), compass.field)
    field = np.where((compass.t >= ONSET)[:, None], turned, compass.field)
    return replace(flight, compasses=(replace(compass, field=field),))


FAULTS: dict[str, tuple[Callable[[Flight], Flight], str, float]] = {
    "gyro step": (gyro_step, "gyro_bias", 0.02),
    "accelerometer step": (accel_step, "accel_bias", 0.8),
    "gps creep": (gps_creep, "gps_position", 1.5),
    "gps jump": (gps_jump, "gps_position", 20.0),
    "gps motion": (gps_motion, "gps_motion", 1.0),
    "field turn": (field_turn, "compass_field", 11.0),
    "compass turn": (compass_turn, "compass_turn", 0.465),
}


def log_odds(one: Explained) -> float:
    """Of what was found, against nothing."""
    return next(rival.log_odds for rival in one.rivals if (rival.kind, rival.shape) == (one.kind, one.shape))


@cache
def found_in(fault: str) -> BestEstimate:
    flight, _ = sensed(60.0, fixes_hz=5.0 if fault == "gps motion" else 2.5)  # which half as many do not show
    return smooth(FAULTS[fault][0](flight))


@pytest.mark.parametrize("fault", FAULTS)
def test_an_injected_fault_is_found(fault: str) -> None:
    _, kind, size = FAULTS[fault]
    explained = found_in(fault).explained
    assert explained, "nothing found"
    largest: Explained = max(explained, key=log_odds)
    together = found_in(fault).explained_covariance
    for one in explained:
        assert one.place is not None
        np.testing.assert_allclose(np.sqrt(np.diagonal(together)[one.place]), one.sigma)
    assert largest.kind == kind
    assert probabilities(largest.rivals)[hypothesis_of(kind).device] > ACCUSED
    all_of_it = np.sum([one.size for one in explained if (one.kind, one.shape) == (kind, largest.shape)], axis=0)
    assert np.linalg.norm(all_of_it) == pytest.approx(size, rel=0.25)
    assert abs(largest.onset - ONSET) < max(4.0 * largest.onset_sigma, 2.0)


OFF: dict[str, Callable[[Flight, Array], Flight]] = {
    "gps_position": lambda f, during: replace(f, gps=(moved_north(f.gps[0], 40.0 * during),)),
    "gps_velocity": lambda f, during: replace(
        f, gps=(replace(f.gps[0], velocity=f.gps[0].velocity + during[:, None] * [3.0, 4.0, 0.0]),)
    ),
}


@pytest.mark.parametrize("aiding", OFF)
def test_what_is_off_for_a_third_of_a_flight_is_not_its_noise(aiding: str) -> None:
    """With a fix a second it would be: it scatters as little as ever, and by so much more than one in order."""
    flight, _ = sensed(60.0, fixes_hz=1.0)
    t = flight.gps[0].t
    away = smooth(OFF[aiding](flight, np.where((t > 22.0) & (t < 42.0), 1.0, 0.0)))
    (one,) = away.explained
    assert (one.kind, one.shape) == (aiding, "pulse")
    assert (one.onset, one.end) == pytest.approx((22.0, 42.0), abs=1.0)
    assert np.linalg.norm(one.size) == pytest.approx(40.0 if aiding == "gps_position" else 5.0, rel=0.05)
    assert away.measurement_scale[aiding] < 3.0


@pytest.mark.parametrize(("share", "told"), [(0.5, False), (1.6, True)])
def test_what_would_have_shown_is_accused(share: float, told: bool) -> None:
    """A GPS that creeps away within 30 s and a field that turns within 10 s, by shares of what is said to be enough."""
    flight, _ = sensed(60.0)
    enough = smooth(flight).detectable
    assert set(num.CREEPS) <= enough.keys()
    (gps,), (compass,) = flight.gps, flight.compasses
    q, middle = flight.require_attitude(), 30.0
    gone = np.clip((gps.t - middle + 15.0) / 30.0, 0.0, 1.0) * share * enough["gps_position"]
    away = replace(flight, gps=(moved_north(gps, gone),))
    i = np.clip(np.searchsorted(q.t, compass.t), 0, len(q) - 1)
    more = np.clip((compass.t - middle + 5.0) / 10.0, 0.0, 1.0)[:, None] * [
        0.0,
        1e-6 * share * enough["compass_field"],
        0.0,
    ]
    field = compass.field + quaternion.rotate(quaternion.conjugate(q.q_ned_frd[i]), more)
    turned = replace(flight, compasses=(replace(compass, field=field),))
    for kind, wrong in (("gps_position", away), ("compass_field", turned)):
        explained = [one for one in smooth(wrong).explained if one.kind == kind]
        sure = (probabilities(one.rivals)[hypothesis_of(kind).device] for one in explained)
        assert (max(sure, default=0.0) >= ACCUSED) == told


def test_no_more_is_explained_than_is_asked_for() -> None:
    """Of a gyro that steps and a GPS that jumps the likelier alone."""
    both = smooth(gyro_step(gps_jump(sensed(60.0, rate=50.0)[0])), effort=Effort(most_causes=1))
    assert len(both.explained) == 1


def test_with_the_first_cause_it_is_asked_whether_that_is_enough() -> None:
    """It goes on from there, or ends as if one cause were all that it may explain."""
    wrong, asked = gyro_step(gps_jump(sensed(60.0, rate=50.0)[0])), list[BestEstimate]()

    def never(best: BestEstimate) -> bool:
        asked.append(best)
        return False

    whole = smooth(wrong, enough=never)
    (first,) = asked
    assert {one.kind for one in first.explained} < {one.kind for one in whole.explained}
    np.testing.assert_array_equal(smooth(wrong, enough=lambda _: True).states.q_ned_frd, first.states.q_ned_frd)


def test_a_compass_that_turns_has_its_axis() -> None:
    """As the rotation of what it reads, in the body; to first order."""
    largest = max(found_in("compass turn").explained, key=log_odds)
    np.testing.assert_allclose(largest.size, [0.2, 0.0, 0.42], atol=0.05)


@pytest.mark.parametrize("fault", ["gyro step", "accelerometer step", "gps creep", "gps jump", "gps motion"])
def test_the_other_side_is_not_accused(fault: str) -> None:
    _, kind, _ = FAULTS[fault]
    side = hypothesis_of(kind).device
    for one in found_in(fault).explained:
        shares = probabilities(one.rivals)
        assert max(share for name, share in shares.items() if name not in (side, "nobody")) < 1.0 - ACCUSED


@pytest.mark.parametrize("gps", [True, False], ids=["with GPS", "with the compass alone"])
def test_a_bias_that_comes_and_goes_has_its_times_and_its_size(gps: bool) -> None:
    """A third of the flight: what is not explained is learned as noise, and hides in it."""
    flight, _ = sensed(90.0, "circle", rate=50.0)
    imu = flight.imu()
    wrong = ((imu.t >= ONSET) & (imu.t < 60.0))[:, None] * np.array([0.0, 0.0, 0.03])
    flight = with_imu(flight, replace(imu, gyro=imu.gyro + wrong))
    explained = smooth(flight if gps else replace(flight, gps=())).explained
    assert {one.kind for one in explained} == {"gyro_bias"}
    grid = np.array([20.0, 45.0, 75.0])
    level = np.sum([(grid >= one.onset)[:, None] * (grid < one.end)[:, None] * one.size for one in explained], axis=0)
    assert np.allclose(level, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.03], [0.0, 0.0, 0.0]]), atol=0.004)
    assert min(abs(one.onset - ONSET) - 2.0 * one.onset_sigma for one in explained) < 0.0


@pytest.mark.parametrize("wrong", ["gyro", "compass"])
@pytest.mark.parametrize(("degrees", "lasts"), [(45.0, 10.0), (45.0, 30.0), (90.0, 10.0), (90.0, 30.0)])
def test_gyro_and_compass_are_told_apart_by_gravity(wrong: str, degrees: float, lasts: float) -> None:
    """A field that turns evenly looks like a gyro; on a banked circle gravity knows which of the two it was.

    However far it turns, and with whichever of them the iteration goes astray.
    """
    flight, _ = sensed(90.0, "circle")
    imu, (compass,), q = flight.imu(), flight.compasses, flight.require_attitude()
    if wrong == "gyro":
        rate = np.array([0.0, 0.0, np.radians(degrees) / lasts])
        too_much = ((imu.t >= 40.0) & (imu.t < 40.0 + lasts))[:, None] * rate
        flight = with_imu(flight, replace(imu, gyro=imu.gyro + too_much))
    else:
        i = np.clip(np.searchsorted(q.t, compass.t), 0, len(q) - 1)
        turn = np.clip((compass.t - 40.0) / lasts, 0.0, 1.0)[:, None] * np.array([0.0, 0.0, np.radians(degrees)])
        world = quaternion.rotate(quaternion.exp(turn), quaternion.rotate(q.q_ned_frd[i], compass.field))
        field = quaternion.rotate(quaternion.conjugate(q.q_ned_frd[i]), world)
        flight = replace(flight, compasses=(replace(compass, field=field),))
    largest = max(smooth(replace(flight, gps=())).explained, key=log_odds)
    shares = probabilities(largest.rivals)
    assert max(shares, key=lambda side: shares[side]) == {"gyro": "imu", "compass": "compass"}[wrong]


@pytest.mark.parametrize("degrees", [60.0, 90.0])
def test_a_compass_that_turns_far_in_its_mounting_is_one_cause_of_that_angle(degrees: float) -> None:
    flight, _ = sensed(90.0, "circle")
    (compass,) = flight.compasses
    turn = np.radians(degrees) * (compass.t >= ONSET)[:, None] * np.array([0.0, 0.0, 1.0])
    loose = replace(compass, field=quaternion.rotate(quaternion.exp(turn), compass.field))
    (one,) = smooth(replace(flight, compasses=(loose,))).explained
    assert one.kind == "compass_turn"
    assert np.degrees(one.size) == pytest.approx([0.0, 0.0, degrees], abs=1.0)


@pytest.mark.parametrize(("path", "seed"), [("circle", 2), ("coning", 4)])
def test_a_field_that_turns_far_is_explained_once(path: str, seed: int) -> None:
    """By 120° in 20 s, of a compass with soft iron: what an arc leaves about another place is no second turn."""
    flight, truth = sensed(60.0, path, seed=seed, rate=50.0)
    (compass,) = flight.compasses
    turn = np.radians(120.0) * np.clip((compass.t - 20.0) / 20.0, 0.0, 1.0)
    q = truth.q_ned_frd[np.searchsorted(truth.t, compass.t - 1e-9)]
    in_ned = quaternion.rotate(quaternion.exp(turn[:, None] * [0.0, 0.0, 1.0]), quaternion.rotate(q, compass.field))
    iron = np.eye(3) + [[0.04, 0.03, -0.02], [0.02, -0.05, 0.03], [-0.03, 0.02, 0.03]]
    read = quaternion.rotate(quaternion.conjugate(q), in_ned) @ iron.T
    best = smooth(replace(flight, compasses=(replace(compass, field=read),)))
    (only,) = best.explained
    level = complex(*best.states.constant("earth_field")[:2])
    changed = level * (np.exp(1j * turn[-1]) - 1.0) / 20.0
    assert (only.kind, only.shape) == ("compass_field", "creep")
    assert only.size == pytest.approx([changed.real, changed.imag], abs=0.25)


@pytest.fixture(scope="module")
def linear() -> Problem:
    """The linear problem of a short flight, as it stands before anything is explained."""
    flight, _ = sensed(25.0, "circle")
    setup = set_up(flight, None, STANDARD_GRAVITY, None)
    states = first_guess(setup, flight)
    path = preintegrate_imu(setup, (np.zeros(3), np.zeros(3)))
    scale, slow = {one.name: 1.0 for one in setup.readings}, {name: SLOW[name][0] for name in setup.slow}
    for _ in range(4):
        found = linearise(setup, path, states, FIRST_NOISE, scale, {}, slow)
        states = states.moved(found.solution.x, found.solution.c)
    return found


@pytest.mark.parametrize(("row", "late"), list(zip(SECANTS, num.LATENCIES_S, strict=True)))
def test_a_late_fix_reads_where_the_vehicle_was_and_how_fast(linear: Problem, row: Hypothesis, late: float) -> None:
    flight, truth = sensed(25.0, "circle")
    setup = set_up(flight, None, STANDARD_GRAVITY, None)
    problem = replace(linear, states=true_states(setup, flight, truth))
    columns = row.of(problem)
    assert columns is not None
    assert columns.motion is None
    assert set(columns.measurements) == set(row.time_shifts)
    for name, column in columns.measurements.items():
        observed, axes = FIXED[name]
        t = linear.t[next(one.keyframe for one in linear.measurements if one.name == name)]
        t, column = t[t > late], column[t > late]  # noqa: PLW2901  (before the first keyframe nothing is known)
        then, now = (at(one, truth.t, getattr(truth, observed))[:, axes] for one in (t - late, t))
        np.testing.assert_allclose(late * column[..., 0], then - now, atol=0.01 if observed == "position" else 0.05)


def misfit(problem: Problem) -> float:
    """The sum of all squared residuals."""
    prior, solution = problem.prior, problem.solution
    left = motion_residual(problem.motion, solution)
    total = float(np.einsum("ki,kij,kj->", left, problem.motion.weight, left))
    for one in problem.measurements:
        rest = one.residual - np.einsum("mdi,mi->md", one.states, solution.x[one.keyframe]) - one.constants @ solution.c
        total += float((rest**2 * one.information).sum())
    total += float((((prior.residual - solution.x[0]) / prior.sigma) ** 2).sum())
    return total + float((((prior.constants_residual - solution.c) / prior.constants_sigma) ** 2).sum())


LAWS = [(kind.name, shape) for kind in HYPOTHESES for shape in kind.shapes if shape not in ("pulse", "shock")]


@pytest.mark.parametrize(("name", "shape"), LAWS)
def test_the_score_is_that_of_estimating_anew_with_the_unknowns(linear: Problem, name: str, shape: str) -> None:
    """A law: score() asks the old solution what `solve` with further unknowns would say."""
    kind = hypothesis_of(name)
    found = score(linear, kind, shape, np.array([11.3]))
    assert found is not None
    b, v = found[0][0], found[1][0]
    wider = with_candidate(linear, Candidate(kind, shape, 11.3, np.inf, 0.1, -1, 0.0, 0.0))
    again = wider.solution
    unknowns = len(b)
    covariance = np.linalg.inv(v + np.diag(wider.prior.constants_sigma[-unknowns:] ** -2.0))
    np.testing.assert_allclose(
        again.c[-unknowns:], covariance @ b, rtol=1e-4, atol=1e-3 * float(np.sqrt(covariance.max()))
    )
    np.testing.assert_allclose(
        again.constants_covariance[-unknowns:, -unknowns:], covariance, rtol=1e-4, atol=1e-4 * covariance.max()
    )
    better = misfit(linear) - misfit(wider)
    assert b @ covariance @ b == pytest.approx(better, rel=1e-3, abs=1e-3 * max(1.0, abs(better)))


GRID_LAWS = [(kind.name, shape) for kind in HYPOTHESES for shape in kind.shapes if shape != "shock"]


def assert_same(one: tuple[Array, Array] | None, other: tuple[Array, Array] | None) -> None:
    assert one is not None
    assert other is not None
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-6 * float(np.abs(b).max()))


@pytest.fixture(scope="module")
def grids(linear: Problem) -> tuple[Scan, ...]:
    """Of readings that count from their keyframe on; of a short flight every keyframe is a cut, and none is inside."""
    at_keyframes = tuple(replace(one, t=linear.t[one.keyframe]) for one in linear.measurements)
    problem = replace(linear, measurements=at_keyframes)
    return tuple(scan(problem, stretches) for stretches in (9, len(problem.t)))


@pytest.mark.parametrize(("name", "shape"), GRID_LAWS)
def test_the_scan_says_what_the_score_of_each_onset_says(grids: tuple[Scan, ...], name: str, shape: str) -> None:
    """A law: columns of stretches, summed, are hypotheses from cut to cut."""
    kind = hypothesis_of(name)
    onset, end = np.array([1, 2, 5]), np.array([4, 7, 6])
    ends = shape in ("pulse", "creep")
    for grid in grids:
        found = grid.score(kind, shape, onset, end if ends else None)
        assert_same(found, score(grid.problem, kind, shape, grid.cuts[onset], grid.cuts[end] if ends else None))


@pytest.mark.parametrize("together", [10**6, 1])
@pytest.mark.parametrize(("name", "shape"), [law for law in GRID_LAWS if law[1] in ("pulse", "creep", "ramp")])
def test_what_is_scored_together_is_each_alone(
    linear: Problem, name: str, shape: str, together: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A law: from moment to moment is the sum of all that lies between, whatever else is tried."""
    monkeypatch.setattr("companion.constants.num.WEIGH_SIZE", together)
    onset, end = np.array([5.1, 9.0, 5.1, 16.2]), np.array([9.0, 14.7, 14.7, 18.0])
    ends = shape != "ramp"
    problem, kind = linear, hypothesis_of(name)
    found = score(problem, kind, shape, onset, end if ends else None)
    assert found is not None
    for i in range(len(onset)):
        one = slice(i, i + 1)
        alone = score(problem, kind, shape, onset[one], end[one] if ends else None)
        assert_same((found[0][one], found[1][one]), alone)


def test_a_sensor_is_likelier_to_miss_a_motion_at_the_end_of_its_range() -> None:
    flight, _ = sensed(60.0, rate=50.0)
    imu = flight.imu()
    held = np.minimum(imu.accel, np.quantile(imu.accel, 0.98, axis=0))
    flights = flight, with_imu(flight, replace(imu, accel=held))
    calm, clipped = (set_up(one, None, STANDARD_GRAVITY, None).shock_rate for one in flights)
    assert (calm == CALM_SHOCK_RATE).mean() > 0.9
    assert 0.02 < (clipped[:, 1] == 1.0).mean() < 0.6
    np.testing.assert_array_equal(clipped[:, 0], calm[:, 0])


def test_what_is_not_tried_any_more_is_not_held_for_nothing() -> None:
    """Where the work that an estimate may take is done, a fault that it has not explained has its odds all the same."""
    best = smooth(gyro_step(sensed(60.0, rate=50.0)[0]), effort=Effort(most_linearisations=1))
    assert best.explained == ()
    assert best.linearisations > 1
    assert best.further[0].kind == "gyro_bias"
    assert probabilities(best.further)["nobody"] < 0.5
