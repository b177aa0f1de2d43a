"""Samples that are means over joining intervals: the integrals of a motion go in, the motion comes out."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from companion.model import Array, ImuTrack, Trajectory
from companion.strapdown import DeadReckoner, dead_reckon, increments, motions, preintegrate, propagate, quaternion
from companion.strapdown.motions import Motion

RNG = np.random.default_rng(11)


def integrals(motion: Callable[[Array], Motion], edges: Array) -> ImuTrack:
    """What a flight controller hands out: rotation vector and ∫f dt (body axes) between edges, over dt."""
    own = np.diff(edges)
    at_edges = motion(edges).q_ned_frd
    turned = quaternion.log(quaternion.multiply(quaternion.conjugate(at_edges[:-1]), at_edges[1:]))
    nodes, weights = np.polynomial.legendre.leggauss(8)
    middle = 0.5 * (edges[1:] + edges[:-1])
    inside = (middle[:, None] + 0.5 * own[:, None] * nodes).ravel()
    force = np.einsum("nkj,k->nj", motion(inside).accel.reshape(-1, 8, 3), weights) / 2.0
    return ImuTrack(middle, turned / own[:, None], force, interval=own)


def uneven_edges(n: int, duration: float) -> Array:
    steps = np.random.default_rng(n).uniform(0.8, 1.2, n)
    return np.concatenate(([0.0], np.cumsum(steps) * duration / steps.sum()))


def errors(path: Trajectory, motion: Motion) -> Array:
    """Worst attitude, velocity and position error."""
    apart = quaternion.log(quaternion.multiply(quaternion.conjugate(motion.q_ned_frd), path.q_ned_frd))
    gone = (apart, path.velocity - motion.velocity, path.position - motion.position)
    return np.array([np.linalg.norm(error, axis=1).max() for error in gone])


@pytest.mark.parametrize("segments", [1, 2])
def test_coning_comes_out_at_order_four_at_the_middles_of_the_intervals(segments: int) -> None:
    """Taken as readings the same numbers reach order 2 only, with 1,000 times the error."""
    found, as_readings = [], []
    for n in (200, 400, 800):
        imu = integrals(motions.coning, np.linspace(0.0, 4.0, n + 1))
        motion = motions.coning(imu.t)
        found.append(errors(dead_reckon(imu, motion.start, segments=segments), motion))
        as_readings.append(errors(dead_reckon(replace(imu, interval=None), motion.start, segments=segments), motion))
    orders = np.log2(np.array(found[:-1]) / np.array(found[1:]))
    assert (orders > 3.9).all()
    assert (np.log2(np.array(as_readings[:-1]) / np.array(as_readings[1:])) < 2.1).all()
    assert found[-1][0] < 1e-3 * as_readings[-1][0]


def test_intervals_of_unequal_length_keep_order_three() -> None:
    found = []
    for n in (400, 800, 1600):
        imu = integrals(motions.coning, uneven_edges(n, 4.0))
        motion = motions.coning(imu.t)
        found.append(errors(dead_reckon(imu, motion.start), motion))
    assert (np.log2(found[0] / found[2]) / 2 > 2.9).all()


def test_a_force_that_grows_with_the_square_of_time_is_exact_in_unequal_intervals_to_both_ends() -> None:
    """The parabola through three means is that force itself, one-sided at the ends too."""
    force = [Polynomial([1.0, -3.0, 40.0]), Polynomial([0.0, 5.0, -25.0]), Polynomial([-9.8, 2.0, 60.0])]
    edges = np.array([0.0, 0.01, 0.022, 0.031, 0.045])
    own, middle = np.diff(edges), 0.5 * (edges[1:] + edges[:-1])
    means = np.stack([np.diff(one.integ()(edges)) / own for one in force], axis=1)
    gained = increments(ImuTrack(middle, np.zeros((4, 3)), means, interval=own)).dv
    np.testing.assert_allclose(gained, np.stack([np.diff(one.integ()(middle)) for one in force], axis=1), atol=1e-14)


def test_the_rotation_over_an_interval_is_exactly_that_of_its_sample() -> None:
    """Whatever the samples are: shaking beyond what their rate could follow does not make the attitude drift."""
    own = RNG.uniform(0.004, 0.006, 500)
    edges = np.concatenate(([0.0], np.cumsum(own)))
    gyro = RNG.normal(0.0, 5.0, (500, 3))
    gyro[:3] = gyro[-3:] = 0.0  # at rest at both ends, where the middle of an interval is as its edges
    imu = ImuTrack(0.5 * (edges[1:] + edges[:-1]), gyro, RNG.normal(0.0, 9.0, (500, 3)), interval=own)
    turned = quaternion.IDENTITY
    for step in quaternion.exp(gyro * own[:, None]):
        turned = quaternion.multiply(turned, step)
    path = preintegrate(imu)
    assert abs(path.q[-1] @ turned) == pytest.approx(1.0, abs=1e-14)


def test_a_small_gap_or_overlap_of_the_clock_is_bridged() -> None:
    """A clock of whole milliseconds: the angle stays what turned, the time what passed."""
    imu = integrals(motions.coning, np.linspace(0.0, 4.0, 401))
    stepped = replace(imu, t=np.round(imu.t, 3) + 1e-9 * np.arange(400))
    motion = motions.coning(imu.t)
    attitude, velocity, _ = errors(dead_reckon(stepped, replace(motion.start, t=float(stepped.t[0]))), motion)
    assert attitude < 5e-3
    assert velocity < 5e-2


@pytest.mark.parametrize("share", [0.01, 0.4])
def test_means_with_gaps_between_them_are_readings(share: float) -> None:
    """As of a log that holds only every hundredth integral."""
    motion = motions.coning(np.linspace(0.0, 2.0, 101))
    sparse = replace(motion.imu, interval=np.full(101, share * 0.02))
    for ours, theirs in zip(
        (increments(sparse).dq, increments(sparse).dv),
        (increments(motion.imu).dq, increments(motion.imu).dv),
        strict=True,
    ):
        np.testing.assert_array_equal(ours, theirs)


def test_a_lost_sample_is_crossed_on_the_curve() -> None:
    imu = integrals(motions.coning, np.linspace(0.0, 4.0, 801))
    kept = np.delete(np.arange(800), [100, 101, 400])
    lossy = replace(imu, t=imu.t[kept], gyro=imu.gyro[kept], accel=imu.accel[kept], interval=np.full(797, 0.005))
    motion = motions.coning(lossy.t)
    attitude, velocity, position = errors(dead_reckon(lossy, motion.start), motion)
    assert attitude < 2e-4
    assert velocity < 2e-3
    assert position < 8e-3


def test_a_first_interval_that_is_not_known_costs_no_other() -> None:
    """Intervals of 98 % of the time between their middles: what lies between two of them is integrated all the same."""
    motion = motions.spin(np.linspace(0.0, 4.0, 1001))
    own = np.full(1001, 0.98 * 0.004)
    own[0] = np.nan
    assert errors(dead_reckon(replace(motion.imu, interval=own), motion.start), motion)[0] < 1e-9
    short = dead_reckon(replace(motion.imu, interval=own)[:2], motion.start)
    assert np.isfinite(short.q_ned_frd).all()


@pytest.mark.parametrize("method", ["euler", "midpoint", "rk4"])
def test_any_cutting_gives_the_batch(method: str) -> None:
    imu = integrals(motions.coning, uneven_edges(600, 6.0))
    kept = np.delete(np.arange(600), [50, 51, 52, 300, 597])
    assert imu.interval is not None
    imu = replace(imu, t=imu.t[kept], gyro=imu.gyro[kept], accel=imu.accel[kept], interval=imu.interval[kept])
    start = motions.coning(imu.t).start
    batch = dead_reckon(imu, start, method=method)
    for cuts in ([0, *range(4, 596)], [0, 5, 49, 51, 298, 595], sorted({0, 595, *RNG.integers(4, 595, 60).tolist()})):
        dead_reckoner = DeadReckoner(start, method=method)
        answers = [dead_reckoner.push(imu[a:b]) for a, b in itertools.pairwise(cuts)] + [dead_reckoner.finish()]
        q, v = (np.concatenate([getattr(a, name) for a in answers]) for name in ("q_ned_frd", "velocity"))
        np.testing.assert_allclose(q, batch.q_ned_frd, atol=1e-12)
        np.testing.assert_allclose(v, batch.velocity, atol=1e-10)


@pytest.mark.parametrize(("n", "worst"), [(1, 1e-15), (2, 1e-6), (3, 1e-8), (4, 1e-8)])
def test_short_tracks(n: int, worst: float) -> None:
    imu = integrals(motions.spin, np.linspace(0.0, 0.01 * n, n + 1))
    motion = motions.spin(imu.t)
    assert errors(dead_reckon(imu, motion.start), motion).max() < worst


def test_what_starts_from_a_pass_over_the_track_works_with_it() -> None:
    """`carry` and `propagate` stand at the samples' times, whatever the samples are."""
    imu = integrals(motions.coning, np.linspace(0.0, 4.0, 801))
    motion = motions.coning(imu.t)
    path = preintegrate(imu)
    q, v, _ = path.carry(100, 700, motion.q_ned_frd[100], motion.velocity[100], motion.position[100])
    assert abs(q @ motion.q_ned_frd[700]) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(v, motion.velocity[700], atol=1e-5)
    window = ([100], [700], motion.q_ned_frd[100:101], motion.velocity[100:101])
    ours, theirs = (propagate(track, preintegrate(track), *window) for track in (imu, motion.imu))
    np.testing.assert_allclose(ours.transition, theirs.transition, atol=1e-3)
