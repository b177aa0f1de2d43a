"""What an IMU reads wrongly from the first second on: whose it is, how large, and when it is a fault."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.constants import healthy
from companion.constants.priors import ACCUSED
from companion.estimation import BestEstimate, Explained, Rival, smooth
from companion.model import Array, Event, Flight, ImuTrack
from companion.verdict.constant_faults import (
    ConstantError,
    constant_errors,
    constant_fault_probability,
    constant_findings,
    errors_at_rest,
    fault_probabilities,
    lone_fault_probability,
)
from tests.estimation.sensed import sensed


def probability(sensor: str, *values: float, sigma: float = 1e-3) -> Array:
    return fault_probabilities(sensor, np.array(values), sigma, np.full(len(values), 1e-4))


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_five_times_what_parts_do_is_a_fault_and_twice_is_none(sensor: str) -> None:
    part = 0.5 * healthy.USUAL_BIAS[sensor]
    assert probability(sensor, 5.0 * part)[0] > ACCUSED
    assert probability(sensor, 2.0 * part)[0] < 1.0 - ACCUSED
    assert probability(sensor, 5.0 * part, sigma=5.0 * part)[0] < 0.5, "nothing is known of it"


def test_its_probability_grows_with_its_size() -> None:
    shares = [float(probability("accel", size)[0]) for size in np.linspace(0.0, 3.0, 60)]
    assert (np.diff(shares) >= 0).all()


@pytest.mark.parametrize("size", [3.0, 34.9])
def test_beside_one_that_is_off_by_more_than_any_fault_the_others_are_in_order(size: float) -> None:
    assert (probability("gyro", 0.0, size) > ACCUSED).tolist() == [False, True]
    assert (probability("gyro", size, size) < ACCUSED).all(), "an error of the estimate"


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_what_all_imus_read_alike_is_an_error_of_the_estimate(sensor: str) -> None:
    part = 0.5 * healthy.USUAL_BIAS[sensor]
    assert (probability(sensor, 6.0 * part, 6.1 * part, sigma=0.5 * part) < 1.0 - ACCUSED).all()
    one, other = probability(sensor, 6.0 * part, 0.1 * part, sigma=0.5 * part)
    assert one > ACCUSED
    assert other < 1.0 - ACCUSED
    opposite = probability(sensor, 6.0 * part, -6.0 * part, sigma=0.5 * part)
    assert (opposite > ACCUSED).all(), "both are off, each its own way"


def wrong(flight: Flight, **errors: Array) -> Flight:
    imu = flight.imu()
    return replace(flight, imus={imu.source: replace(imu, **{k: getattr(imu, k) + v for k, v in errors.items()})})


def test_an_accelerometer_that_is_off_from_the_start_is_named(flight: Flight) -> None:
    bad = wrong(flight, accel=np.array([0.0, 0.0, 1.5]))
    best = smooth(bad)
    errors = constant_errors(best, bad)
    (one,) = (f for f in constant_findings(errors, 0.0, 60.0) if f.severity == "error")
    assert (one.kind, one.side) == ("accel_bias", "imu")
    assert one.cause is not None
    assert (one.cause.sensor, one.cause.axis, one.cause.imu) == ("accel", "z", 0)
    assert one.cause.size == pytest.approx(1.5, abs=0.1)
    assert constant_fault_probability(errors) > ACCUSED


def sibling(flight: Flight, **errors: Array) -> ImuTrack:
    """A second IMU, logged five times less often."""
    own = flight.imu()
    noise = np.random.default_rng(5).normal(size=(2, len(own), 3))
    gyro, accel = own.gyro + errors.get("gyro", 0.0) + 2e-3 * noise[0], own.accel + errors.get("accel", 0.0)
    return replace(own, source="IMU[1]", instance=own.instance + 1, gyro=gyro, accel=accel + 0.05 * noise[1])[::5]


@pytest.mark.parametrize(("sensor", "value"), [("gyro", (0.0, 0.0, -0.06)), ("accel", (0.8, 0.0, 0.0))])
def test_of_another_imu_it_is_that_one(
    flight: Flight, best: BestEstimate, sensor: str, value: tuple[float, float, float]
) -> None:
    other = sibling(flight, **{sensor: np.array(value)})
    both = replace(flight, imus={**flight.imus, other.source: other})
    (one,) = constant_findings(constant_errors(best, both), 0.0, 60.0)
    assert one.severity == "error"
    assert one.cause is not None
    assert (one.cause.imu, one.cause.sensor) == (1, sensor)
    assert one.cause.size == pytest.approx(max(np.abs(value)), rel=0.1)


@pytest.mark.parametrize(("parts", "axis"), [((0.001, 0.99, 0.0), "y"), ((0.981, 0.982, 0.0), "x")])
def test_the_axis_at_fault_is_named_and_not_one_on_which_all_imus_are_further_off(
    parts: tuple[float, float, float], axis: str
) -> None:
    value, sigma = np.array([0.09, 0.06, 0.0]), np.full(3, 1e-3)
    (one,) = constant_findings([ConstantError(1, "IMU[1]", "gyro", value, sigma, np.array(parts))], 0.0, 60.0)
    assert one.cause is not None
    assert (one.cause.axis, one.cause.size) == (axis, value["xyz".index(axis)])
    assert f"gyro {axis} of IMU 1" in one.headline


@pytest.mark.parametrize("sure", [0.14, 0.99])
def test_of_two_imus_that_are_off_the_other_way_round_each_is_named_beside_the_other(sure: float) -> None:
    value, sigma, each = np.array([0.35, 0.0, 0.0]), np.full(3, 0.04), np.array([sure, 0.0, 0.0])
    errors = [ConstantError(k, f"IMU[{k}]", "accel", sign * value, sigma, each) for k, sign in enumerate((1.0, -1.0))]
    told = list(constant_findings([*errors, replace(errors[0], imu=2, value=0.1 * value, by_axis=0 * each)], 0.0, 60.0))
    assert len(told) == 2
    assert all("IMU 0" in one.evidence and "IMU 1" in one.evidence and "IMU 2" not in one.evidence for one in told)


@pytest.mark.parametrize(
    ("onset", "sigma", "fault", "reads"),
    [(0.5, 0.2, 1.0, 0.06), (20.0, 15.0, 1.0, 0.06), (20.0, 1.0, 1.0, None), (20.0, 1.0, 0.01, 0.0)],
)
def test_what_a_fault_changes_in_flight_is_no_constant_error(
    flight: Flight, best: BestEstimate, onset: float, sigma: float, fault: float, reads: float | None
) -> None:
    """What the smoother explains by a step at the start it leaves out of the bias; what is no fault hides nothing."""
    size, own = np.array([0.0, 0.0, 0.06]), np.full(3, 1e-3)
    rivals = (Rival("gyro_bias", "step", 20.0, fault),)
    step = Explained("gyro_bias", "step", float(best.t[0]) + onset, sigma, np.inf, size, own, rivals)
    errors = constant_errors(replace(best, explained=(step,)), flight)
    gyro = [one for one in errors if one.sensor == "gyro"]
    assert bool(gyro) == (reads is not None)
    for one in gyro:
        assert one.value[2] == pytest.approx(reads, abs=0.01)
        assert (one.probability > ACCUSED) == (reads == 0.06)


def test_a_scale_is_at_fault_beyond_what_parts_do() -> None:
    part = 0.5 * healthy.USUAL_SCALE
    scales = (np.array([0.0, -size, 0.0]) for size in (0.0, 2.0 * part, 5.0 * part, 0.2))
    sizes = [lone_fault_probability("scale", scale, 0.005) for scale in scales]
    assert (np.diff(sizes) > 0.0).all()
    assert sizes[1] < 1.0 - ACCUSED
    assert sizes[3] > ACCUSED


def test_imus_in_order_are_accused_of_nothing(flight: Flight, best: BestEstimate) -> None:
    other = sibling(flight, gyro=np.array([0.0, 0.0, 0.008]), accel=np.array([0.0, 0.08, 0.0]))
    both = replace(flight, imus={**flight.imus, other.source: other})
    assert list(constant_findings(constant_errors(best, both), 0.0, 60.0)) == []


@pytest.mark.parametrize("rate", [1, 25])
def test_at_rest_gravity_alone_tells_and_no_estimate_is_needed(rate: int) -> None:
    """At the 2 Hz of a ground station too."""
    flight = sensed(30.0, rate=50.0)[0]
    bad = wrong(flight, gyro=np.array([0.4, 0.0, 0.0]), accel=np.array([0.0, 0.0, 2.0]))
    imu = bad.imu()
    resting = replace(bad, imus={imu.source: imu[:250][::rate]}, gps=())
    gyro, accel = errors_at_rest(resting, 9.80665)
    assert (gyro.sensor, accel.sensor) == ("gyro", "accel")
    assert gyro.value[0] == pytest.approx(0.4, abs=0.02)
    assert accel.value[2] == pytest.approx(2.0, abs=0.2)
    assert min(gyro.probability, accel.probability) > ACCUSED
    fine = replace(flight, imus={imu.source: flight.imu()[:250][::rate]})
    assert all(one.probability < 1.0 - ACCUSED for one in errors_at_rest(fine, 9.80665))


def test_what_a_gyro_reads_only_after_the_landing_is_none_of_its_start() -> None:
    flight = sensed(30.0, rate=50.0)[0]
    imu = flight.imu()
    flight = replace(flight, events=(*flight.events, Event(float(imu.t[-1]), "disarmed", "disarmed")))
    rest, rates = imu[:250], np.array([0.4, 0.0, 0.0])
    shown = [
        [error.value[0] for error in errors_at_rest(replace(flight, imus={imu.source: track}, gps=()), 9.80665)]
        for track in (replace(rest, gyro=rest.gyro + rates), _joined(imu[250:], rest, rates))
    ]
    assert shown[0][0] == pytest.approx(0.4, abs=0.02)
    assert shown[1] == []


def _joined(flown: ImuTrack, rest: ImuTrack, rates: Array) -> ImuTrack:
    """A flight, and after it a rest in which the gyro is off."""
    t = np.concatenate([flown.t, rest.t - rest.t[0] + flown.t[-1] + 0.02])
    gyro, accel = np.concatenate([flown.gyro, rest.gyro + rates]), np.concatenate([flown.accel, rest.accel])
    return ImuTrack(t, gyro, accel, flown.source)


def test_a_compass_is_at_fault_since_the_start_beyond_what_a_calibration_leaves() -> None:
    sizes = np.array([5.0, 15.0, 30.0, 60.0, 120.0])
    sure = np.array([lone_fault_probability("compass", np.array([size]), 2.0) for size in sizes])
    assert (np.diff(sure) > 0.0).all()
    assert sure[1] < 0.05
    assert sure[3] > 0.95
    unsure = lone_fault_probability("compass", np.array([40.0]), 30.0)
    assert unsure < 0.5, "one that is hardly known accuses nobody"
