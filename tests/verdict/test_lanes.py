"""Lanes of an estimator: a good one is never called off, the right one is named, a switch is judged by its effect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from companion.constants import healthy
from companion.estimation import BestEstimate
from companion.model import Array, EstimatorLane, EstimatorReset, Flight, PositionTrack, SensorInUse, interpolated
from companion.present import lane_lines
from companion.strapdown import quaternion
from companion.verdict import Cause, Finding, Lanes, judge_lanes
from companion.verdict.lanes import compare_lanes, healthy_bound, nearer_probability
from tests.estimation.sensed import sensed

TRUTH = sensed(60.0, rate=50.0)[1]
T = np.arange(0.5, 59.5, 0.1)
FAULT_S = 30.0

Error = Callable[[Array], Array]


def none(t: Array) -> Array:
    return np.zeros((len(t), 3))


def turned(degrees: float, since: float = FAULT_S) -> Error:
    """So far off in heading from some time on."""
    return lambda t: np.radians(degrees) * np.where(t >= since, 1.0, 0.0)[:, None] * [0.0, 0.0, 1.0]


def lane(core: int | None, turn: Error = none, moved: Error = none, imu: int | None = None) -> EstimatorLane:
    """The truth at 10 Hz, with a rotation vector and a velocity that it is off by, NED."""
    q = TRUTH.q_ned_frd[np.searchsorted(TRUTH.t, T - 1e-9)]
    q = quaternion.multiply(quaternion.exp(turn(T)), q)
    velocity = interpolated(T, TRUTH.t, TRUTH.velocity) + moved(T)
    name = "DCM" if core is None else f"EKF3 core {core}"
    position = interpolated(T, TRUTH.t, TRUTH.position)
    return EstimatorLane(T, q, velocity, position, name, core, f"XKQ[{core}]", core if imu is None else imu)


def use(*changes: tuple[float, int]) -> SensorInUse:
    t, core = zip(*changes, strict=True)
    return SensorInUse(np.array(t, np.float64), np.array(core, np.int64), "XKF4.PI")


GYRO = Finding(
    "gyro_bias",
    "imu",
    "error",
    FAULT_S,
    60.0,
    "gyro z",
    "",
    cause=Cause("gyro_bias", "imu", FAULT_S, sensor="gyro", imu=0),
)


def judged(
    flight: Flight, best: BestEstimate, lanes: tuple[EstimatorLane, ...], used: SensorInUse, *resets: EstimatorReset
) -> Lanes:
    return judge_lanes(replace(flight, lanes=lanes, lane_in_use=used, resets=resets), best, [GYRO])


def test_the_lane_without_the_fault_was_the_right_one(flight: Flight, best: BestEstimate) -> None:
    made = judged(flight, best, (lane(0, turned(10.0)), lane(1)), use((0.0, 0)))
    _, fault = made.spans
    assert fault.right == "EKF3 core 1"
    assert {one.lane: one.off for one in fault.lanes} == {"EKF3 core 0": True, "EKF3 core 1": False}
    assert fault.readers == ("EKF3 core 0",)
    bad = next(e for e in fault.lanes[0].errors if e.quantity == "heading")
    assert np.degrees(bad.rms) == pytest.approx(10.0, abs=2.0)


def test_of_three_lanes_two_that_nothing_tells_apart_are_both_right(flight: Flight, best: BestEstimate) -> None:
    made = judged(flight, best, (lane(0, turned(10.0)), lane(1), lane(2)), use((0.0, 0)))
    _, fault = made.spans
    assert {fault.right, *fault.as_good} == {"EKF3 core 1", "EKF3 core 2"}
    apart = judged(flight, best, (lane(0, turned(10.0)), lane(1), lane(2, turned(9.9))), use((0.0, 0)))
    assert (apart.spans[1].right, apart.spans[1].as_good) == ("EKF3 core 1", ())


def test_how_far_off_a_lane_is_need_not_be_certain_where_the_better_one_is(flight: Flight, best: BestEstimate) -> None:
    """As far off as hardly a healthy one, the other less; both differ by less than that, and by more than 1σ."""
    most = float(np.degrees(healthy_bound("heading")))
    made = judged(flight, best, (lane(0, turned(1.05 * most)), lane(1, turned(0.1 * most))), use((0.0, 0)))
    assert made.spans[1].right == "EKF3 core 1"
    near = judged(flight, best, (lane(0, turned(1.05 * most)), lane(1, turned(0.95 * most))), use((0.0, 0)))
    assert not near.spans[1].lanes[1].off
    assert near.spans[1].right is None


def test_a_lane_that_is_surely_worse_by_next_to_nothing_is_as_good(flight: Flight, best: BestEstimate) -> None:
    """The errors of the best estimate are in both lanes alike: a small constant difference is told all the same."""
    slow = lane(2, moved=lambda t: np.full((len(t), 3), [0.15, 0.15, 0.0]))
    made = judged(flight, best, (lane(0, turned(15.0)), lane(1), slow), use((0.0, 0)))
    _, fault = made.spans
    assert (fault.right, fault.as_good) == ("EKF3 core 1", ("EKF3 core 2",))
    told = next(one.nearest for one in fault.lanes if one.lane == "EKF3 core 2")
    assert told is not None
    assert told < 0.05


def test_what_another_lane_than_the_flown_one_has_is_no_reason_to_change(flight: Flight, best: BestEstimate) -> None:
    made = judged(flight, best, (lane(0, turned(10.0)), lane(1)), use((0.0, 1)))
    assert made.spans[1].right is None
    assert made.spans[1].lanes[0].off


@pytest.mark.parametrize(
    ("used", "judgement"),
    [
        (use((0.0, 0), (35.0, 1)), "right"),
        (use((0.0, 1), (35.0, 0)), "wrong"),
        (use((0.0, 0), (8.0, 1)), "indifferent"),
    ],
)
def test_a_switch_is_judged_by_what_came_of_it(
    flight: Flight, best: BestEstimate, used: SensorInUse, judgement: str
) -> None:
    (switch,) = judged(flight, best, (lane(0, turned(12.0)), lane(1)), used).switches
    assert (switch.judgement, switch.t) == (judgement, used.changes[1][0])
    assert switch.probability is not None
    if judgement != "indifferent":
        assert switch.quantity == "heading"
        assert abs(np.degrees(switch.before_size - switch.after_size)) == pytest.approx(12.0, abs=2.0)


@pytest.mark.parametrize("used", [None, use((0.0, 7))], ids=["not logged", "not in the log"])
def test_no_lane_is_cleared_where_the_one_that_flew_is_not_known(
    used: SensorInUse | None, flight: Flight, best: BestEstimate
) -> None:
    lanes = judge_lanes(replace(flight, lanes=(lane(0), lane(1, turned(20.0))), lane_in_use=used), best)
    (whole,) = lanes.spans
    assert [one.lane for one in whole.lanes if one.off] == ["EKF3 core 1"]
    said = next(line for line in lane_lines(lanes) if line.startswith("Whole flight"))
    assert said.startswith("Whole flight: which of the lanes flew is not known; EKF3 core 1 was off by")


@pytest.mark.filterwarnings("error")
def test_a_lane_of_one_sample_is_compared_there(flight: Flight, best: BestEstimate) -> None:
    whole = lane(1)
    once = EstimatorLane(
        T[:1], whole.q_ned_frd[:1], whole.velocity[:1], whole.position[:1], whole.name, 1, whole.source, 1
    )
    compared = compare_lanes(flight, best, (lane(0), once))
    assert np.isfinite(compared.lanes[1].error["tilt"]).all(axis=1).sum() <= 1


def test_a_reset_of_the_new_lane_is_told(flight: Flight, best: BestEstimate) -> None:
    reset = EstimatorReset(39.6, "heading", "EKF3 IMU1 MAG0 yaw reset", 1)
    (switch,) = judged(flight, best, (lane(0), lane(1)), use((0.0, 0), (40.0, 1)), reset).switches
    assert switch.reset_s == pytest.approx(0.4)


@pytest.mark.parametrize("most", [0.8, 0.95])
@pytest.mark.parametrize("seed", range(6))
def test_lanes_that_err_as_healthy_ones_do_are_never_called_off(
    flight: Flight, best: BestEstimate, seed: int, most: float
) -> None:
    """Up to what 95 % of healthy estimators stay below, each lane by itself."""
    rng = np.random.default_rng(seed)

    def within(quantity: str, count: int) -> Array:
        vector = rng.normal(size=count)
        return healthy_bound(quantity) * float(rng.uniform(0.0, most)) * vector / np.linalg.norm(vector)

    def healthy_lane(core: int) -> EstimatorLane:
        off = np.concatenate([within("tilt", 2), within("heading", 1)])
        moved = np.concatenate([within("velocity", 2), [0.0]])
        return lane(core, lambda t: np.tile(off, (len(t), 1)), lambda t: np.tile(moved, (len(t), 1)))

    made = judged(flight, best, (healthy_lane(0), healthy_lane(1), healthy_lane(2)), use((0.0, 0), (20.0, 1)))
    assert not [one.lane for span in made.spans for one in span.lanes if one.off]
    if most < 0.9:
        assert all(span.right is None for span in made.spans)
        assert made.switches[0].judgement in ("indifferent", "undecided")


def test_what_all_lanes_share_is_no_lanes_fault(flight: Flight, best: BestEstimate) -> None:
    both = tuple(lane(core, turned(20.0), imu=0) for core in (0, 1))
    made = judged(flight, best, both, use((0.0, 0)))
    assert not any(one.off for span in made.spans for one in span.lanes)
    assert made.spans[1].readers == ("EKF3 core 0", "EKF3 core 1")
    assert any("same IMU" in note for note in made.notes)


def test_of_two_lanes_one_is_the_nearer(flight: Flight, best: BestEstimate) -> None:
    compared = compare_lanes(flight, best, [lane(0, turned(1.0)), lane(1, turned(-1.5))])
    first, second = compared.lanes
    where = compared.within(FAULT_S, 60.0)
    p, q = nearer_probability(first, second, compared, where), nearer_probability(second, first, compared, where)
    assert p is not None
    assert q is not None
    assert p + q == pytest.approx(1.0)
    assert p > 0.5
    assert nearer_probability(first, first, compared, where) == 0.5


def test_an_error_of_the_best_estimate_counts_for_as_long_as_it_lasts(flight: Flight, best: BestEstimate) -> None:
    """Of a velocity that is off for seconds little is left in the mean, of a heading by the compass most."""
    compared = compare_lanes(flight, best, [lane(0)])
    within = np.flatnonzero(compared.within(10.0, 50.0))

    def sigma(quantity: str, at: npt.NDArray[np.intp]) -> float:
        weights = np.zeros((len(best.t), compared.covariance[quantity].shape[-1]))
        weights[at, 0] = 1.0 / at.size
        return compared.sigma_of_sum({quantity: weights})

    single = {name: np.sqrt(own[within, 0, 0]) for name, own in compared.covariance.items()}
    assert sigma("velocity", within[7:8]) == pytest.approx(single["velocity"][7])
    assert sigma("velocity", within) < 0.5 * single["velocity"].mean()
    assert 0.75 * single["heading"].mean() < sigma("heading", within) < single["heading"].mean()
    begin = compared.since["position"][within[:1]]
    assert sigma("position", begin) == pytest.approx(0.0, abs=1e-3), "positions are counted from there"


def test_a_lane_is_off_by_what_it_was_put_off_by(flight: Flight, best: BestEstimate) -> None:
    """Of three quantities at once; positions begin together, whatever their zero."""
    off = np.array([0.02, -0.01, 0.1])
    moved = lane(0, lambda t: np.tile(off, (len(t), 1)), lambda t: np.tile([1.0, -2.0, 0.0], (len(t), 1)))
    moved = replace(moved, position=moved.position + [100.0, 50.0, -7.0])
    (one,) = compare_lanes(flight, best, [moved]).lanes
    assert np.nanmedian(one.error["tilt"], axis=0) == pytest.approx(off[:2], abs=5e-3)
    assert np.nanmedian(one.error["heading"]) == pytest.approx(0.1, abs=0.03)
    assert np.nanmedian(one.error["velocity"], axis=0) == pytest.approx([1.0, -2.0], abs=0.1)
    assert np.nanmedian(np.abs(one.error["position"])) < 0.5 * healthy.AP_SIGMA["position"]


def test_dcm_competes_with_no_lane(flight: Flight, best: BestEstimate) -> None:
    """It is what an autopilot falls back to, not a lane that it chooses among."""
    made = judged(flight, best, (lane(0, turned(2.0)), lane(None)), use((0.0, 0)))
    assert [one.nearest for one in made.spans[0].lanes] == [None, None]


def test_without_lanes_what_flew_is_shown_alone(flight: Flight, best: BestEstimate) -> None:
    made = judge_lanes(flight, best)
    assert [one.name for one in made.lanes] == ["as flown"]
    assert made.notes
    assert not made.switches


def test_what_flew_is_not_known_in_a_gap_of_its_positions(flight: Flight, best: BestEstimate) -> None:
    def errors(seen: npt.NDArray[np.bool_]) -> dict[str, float]:
        track = PositionTrack(TRUTH.t[seen], TRUTH.position[seen], TRUTH.velocity[seen], "LOCAL_POSITION_NED")
        (one,) = judge_lanes(replace(flight, position=track), best).spans[0].lanes
        return {error.quantity: error.worst for error in one.errors}

    holed, whole = (errors((TRUTH.t < 20.0) | (TRUTH.t > end)) for end in (40.0, 20.0))
    assert holed["position"] < 1.5 * whole["position"]
    assert holed["velocity"] < 1.5 * whole["velocity"]
