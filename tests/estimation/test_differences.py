"""IMU against IMU: whose error it is, and that two which agree contradict an accusation."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from companion.estimation import BestEstimate, hypothesis_of, probabilities, smooth
from companion.estimation.candidate import Candidate
from companion.estimation.differences import in_blocks, weighed
from companion.model import Array, Flight, ImuTrack, SensorInUse
from tests.estimation.sensed import sensed

ONSET = 31.0


@cache
def flown() -> Flight:
    return sensed(60.0, rate=50.0)[0]


def sibling(every: int = 1, gyro: Array | float = 0.0, accel: Array | float = 0.0, instance: int = 1) -> ImuTrack:
    """Another IMU, logged less often by a factor, with errors of its own (N, 3)."""
    own = flown().imu()
    noise = np.random.default_rng(instance).normal(size=(2, len(own), 3))
    turn, force = own.gyro + gyro + 2e-3 * noise[0], own.accel + accel + 0.05 * noise[1]
    return replace(own, source=f"IMU[{instance}]", instance=own.instance + instance, gyro=turn, accel=force)[::every]


def step(*size: float) -> Array:
    return np.asarray((flown().imu().t >= ONSET)[:, None] * np.array(size))


def beside(*others: ImuTrack, own: Array | float = 0.0) -> Flight:
    """The flight with other IMUs, and an error of its own gyro (N, 3)."""
    imu = flown().imu()
    imu = replace(imu, gyro=imu.gyro + own)
    return replace(flown(), imus={imu.source: imu, **{one.source: one for one in others}})


def faults(best: BestEstimate) -> list[tuple[int | None, str]]:
    """The IMU and the kind of what was explained as a fault."""
    return [(one.imu, one.kind) for one in best.explained if probabilities(one.rivals)["imu"] > 0.5]


@pytest.mark.parametrize("every", [1, 5])
def test_the_imu_that_steps_is_named_whichever_was_logged_more_often(every: int) -> None:
    best = smooth(beside(sibling(every, gyro=step(0.0, 0.02, 0.0))))
    one = max(best.explained, key=lambda e: float(np.linalg.norm(e.size)))
    assert (one.imu, one.kind, one.shape) == (1, "gyro_bias", "step")
    assert one.onset == pytest.approx(ONSET, abs=2.5)
    assert one.size == pytest.approx([0.0, 0.02, 0.0], abs=5.0 * float(one.sigma.max()))
    assert faults(best) == [(1, "gyro_bias")]


@pytest.mark.parametrize("siblings", [1, 2])
def test_an_error_of_the_estimates_own_imu_is_no_other_ones(siblings: int) -> None:
    others = [sibling(instance=number + 1) for number in range(siblings)]
    best = smooth(beside(*others, own=step(0.0, 0.02, 0.0)))
    assert faults(best) == [(None, "gyro_bias")]
    one = max(best.explained, key=lambda e: float(np.linalg.norm(e.size)))
    assert one.size == pytest.approx([0.0, 0.02, 0.0], abs=2e-3)


@pytest.mark.parametrize("others", [(0,), (0, 1), (0, 1, 2)], ids=["one", "two", "three"])
def test_readings_that_go_on_with_another_imu_are_each_ones_own(others: tuple[int, ...]) -> None:
    """PX4's sensor_combined: a fault lasts until the selector leaves the IMU that has it, and no other is accused."""
    at, wrong = 34.0, sibling(instance=0, gyro=step(0.0, 0.02, 0.0))
    right = sibling(gyro=np.array([0.0, 0.004, -0.003]))
    later = (right.t >= at)[:, None]
    mixed = replace(
        right,
        source="sensor_combined",
        instance=0,
        gyro=np.where(later, right.gyro, wrong.gyro),
        accel=np.where(later, right.accel, wrong.accel),
        switches=SensorInUse(np.array([0.0, at]), np.array([0, 1]), "sensor_selection"),
    )
    whole = [[wrong, right, sibling(instance=2)][number][::5] for number in others]
    flight = replace(flown(), imus={one.source: one for one in (mixed, *whole)})
    assert {one.instance for one in in_blocks(flight, mixed)} == set(others)
    best = smooth(flight, "sensor_combined")
    assert faults(best) == [(None, "gyro_bias")]
    one = next(one for one in best.explained if one.imu is None)
    assert one.onset == pytest.approx(ONSET, abs=1.0)
    assert one.size == pytest.approx([0.0, 0.02, 0.0], abs=4.0 * float(one.sigma.max()))


def test_two_imus_in_order_accuse_none() -> None:
    assert faults(smooth(beside(sibling(), sibling(instance=2)))) == []


def test_a_parting_without_an_aiding_sensor_names_both() -> None:
    """Without GPS and compass a gyro about the vertical is known by the other IMU alone."""
    best = smooth(replace(beside(sibling(gyro=step(0.0, 0.0, 0.02))), gps=(), compasses=()))
    one = max(best.explained, key=lambda e: float(np.linalg.norm(e.size)))
    mine, its = (max(r.fault_log_odds for r in one.rivals if r.imu == imu) for imu in (None, 1))
    assert abs(mine - its) < 3.0


def test_an_imu_that_drifts_away_is_named() -> None:
    drift = np.linspace(0.0, 0.06, len(flown().imu()))[:, None] * np.array([1.0, 0.0, 0.0])
    assert faults(smooth(beside(sibling(gyro=drift)))) == [(1, "gyro_bias")]


def test_a_step_across_a_time_in_which_it_was_not_heard_is_none() -> None:
    other = sibling(5, accel=step(0.6, 0.0, 0.0))
    heard = _without(other, ONSET - 8.0, ONSET + 8.0)
    assert faults(smooth(beside(heard))) == []


def _without(track: ImuTrack, begin: float, end: float) -> ImuTrack:
    kept = (track.t < begin) | (track.t > end)
    return replace(track, t=track.t[kept], gyro=track.gyro[kept], accel=track.accel[kept])


def test_the_order_of_two_imus_is_that_of_the_sign() -> None:
    """What one tells of an error of the other is the negative of what the other tells of the same."""
    one, other = flown().imu(), sibling(gyro=step(0.0, 0.02, 0.0))
    (there,), (back,) = (weighed(in_blocks(beside(other), used)) for used in (one, other))
    times = np.array([ONSET]), np.array([np.inf])
    b, v = there.score(hypothesis_of("gyro_bias"), "step", *times)
    b_back, v_back = back.score(hypothesis_of("gyro_bias"), "step", *times)
    assert b == pytest.approx(-b_back)
    assert v == pytest.approx(v_back)
    assert (b / np.diagonal(v, axis1=1, axis2=2))[0] == pytest.approx([0.0, 0.02, 0.0], abs=1e-3)


def test_sizes_are_those_of_least_squares_and_what_is_free_tells_nothing() -> None:
    (one,) = weighed(in_blocks(beside(sibling(gyro=step(0.0, 0.02, 0.0))), flown().imu()))
    error = Candidate(replace(hypothesis_of("gyro_bias"), prior=1e3), "step", ONSET, np.inf, 0.1, -1, 0.0, 0.0)
    ((size, sigma),) = one.sizes([error])
    b, v = one.score(hypothesis_of("gyro_bias"), "step", np.array([ONSET]), np.array([np.inf]))
    assert size == pytest.approx(np.linalg.solve(v[0], b[0]))
    assert sigma == pytest.approx(np.diagonal(v[0]) ** -0.5)
    b, v = one.beside(error).score(hypothesis_of("gyro_bias"), "step", np.array([ONSET]), np.array([np.inf]))
    assert abs(b).max() < 1e-2 * sigma.min() ** -1
    assert np.trace(v[0]) < 1e-3


@pytest.mark.parametrize("onset", [30.6, 31.0, 31.3, 33.3])
def test_a_step_is_known_to_begin_when_it_does_wherever_in_a_block(onset: float) -> None:
    track = flown().imu()
    own = (track.t >= onset)[:, None] * np.array([0.0, 0.0, 0.06])
    one = max(smooth(beside(sibling(), own=own)).explained, key=lambda e: float(np.linalg.norm(e.size)))
    assert (one.imu, one.kind) == (None, "gyro_bias")
    assert one.onset == pytest.approx(onset, abs=0.2 + 2.0 * one.onset_sigma)


@pytest.mark.parametrize("other", ["none", "felt it", "missed it too"])
def test_of_a_moment_another_imu_tells_nothing(other: str) -> None:
    """A push of 10 m/s in 0.2 s that the IMU misses: in the means of seconds there is nothing of it."""
    track = flown().imu()
    missed = ((track.t >= ONSET) & (track.t < ONSET + 0.2))[:, None] * np.array([-50.0, 0.0, 0.0])
    imu, sister = replace(track, accel=track.accel + missed), sibling(accel=missed if other == "missed it too" else 0.0)
    imus = {imu.source: imu} | ({sister.source: sister} if other != "none" else {})
    (one,) = smooth(replace(flown(), imus=imus)).explained
    assert (one.kind, one.imu) == ("accel_shock", None)
    assert probabilities(one.rivals)["nobody"] > 0.95


@pytest.mark.parametrize("duration", [2400.0, 3600.0])
def test_another_imu_tells_as_much_of_a_flight_however_long_its_blocks_are(duration: float) -> None:
    t = np.arange(0.0, duration, 0.2)
    noise = np.random.default_rng(0).normal(size=(2, 2, len(t), 3))
    own, other = (
        ImuTrack(t, 1e-3 * gyro, 0.02 * accel + [0.0, 0.0, -9.8], source=f"IMU[{k}]", instance=k)
        for k, (gyro, accel) in enumerate(noise)
    )
    flight = replace(flown(), start=0.0, duration=duration, imus={own.source: own, other.source: other})
    (one,) = weighed(in_blocks(flight, own))
    _, v = one.score(hypothesis_of("gyro_bias"), "step", np.array([0.5 * duration]), np.array([np.inf]))
    assert float(v[0, 2, 2]) ** -0.5 < 1e-3


def test_sensors_without_noise_have_finite_weights() -> None:
    """As simulators have them: two that read the very same, but for a moment."""
    own = flown().imu()
    twin = replace(own, source="IMU[1]", instance=own.instance + 1)
    jolted = replace(twin, accel=twin.accel + ((own.t > 30.0) & (own.t < 30.5))[:, None] * np.array([0.0, 0.0, 3.0]))
    for other in (twin, jolted):
        (one,) = weighed(in_blocks(beside(other), own))
        assert all(np.isfinite(weight).all() for weight in one.weight.values())
