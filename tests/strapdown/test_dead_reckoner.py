"""Live is the batch in small pieces: any cutting of the stream gives the same numbers."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from companion.model import STANDARD_GRAVITY, DataError, ImuTrack, NavState, SettingsError, Trajectory
from companion.strapdown import METHODS, MIDDLES, DeadReckoner, dead_reckon, motions, quaternion
from companion.strapdown.motions import Motion


def stream(n: int = 1_500) -> Motion:
    steps = np.random.default_rng(5).uniform(0.5, 1.5, n - 1)
    return motions.coning(np.concatenate(([0.0], np.cumsum(steps) * 15 / steps.sum())))


def push_all(dead_reckoner: DeadReckoner, imu: ImuTrack, cuts: list[int]) -> Trajectory:
    answers = [dead_reckoner.push(imu[a:b]) for a, b in itertools.pairwise(cuts)] + [dead_reckoner.finish()]
    return Trajectory(
        np.concatenate([a.t for a in answers]),
        np.concatenate([a.q_ned_frd for a in answers]),
        np.concatenate([a.velocity for a in answers]),
        np.concatenate([a.position for a in answers]),
    )


def assert_same(a: Trajectory, b: Trajectory) -> None:
    """To 1e-12 of the terms that are summed up: gravity's g t and ½ g t² are larger than the motion itself."""
    tau = b.t - b.t[0]
    np.testing.assert_array_equal(a.t, b.t)
    assert np.abs(a.q_ned_frd - b.q_ned_frd).max() <= 1e-12
    assert (np.abs(a.velocity - b.velocity).max(axis=1) <= 1e-12 * (1 + STANDARD_GRAVITY * tau)).all()
    assert (np.abs(a.position - b.position).max(axis=1) <= 1e-12 * (1 + STANDARD_GRAVITY / 2 * tau**2)).all()


RANDOM_CUTS = sorted({0, 1_500, *np.random.default_rng(6).integers(1, 1_500, 200).tolist()})


@pytest.mark.parametrize(
    "cuts", [list(range(1_501)), [0, 1_500], [0, 0, 2, 3, 3, 7, 1_500], [0, 9, 10, 1_499, 1_500, 1_500], RANDOM_CUTS]
)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("middle", MIDDLES)
def test_any_cutting_gives_the_batch(cuts: list[int], method: str, middle: str) -> None:
    motion = stream()
    batch = dead_reckon(motion.imu, motion.start, method=method, middle=middle)
    assert_same(push_all(DeadReckoner(motion.start, method=method, middle=middle), motion.imu, cuts), batch)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
def test_short_streams_end_as_short_tracks_do(n: int) -> None:
    motion = stream(n + 1)
    imu = motion.imu[:n]
    assert_same(push_all(DeadReckoner(motion.start), imu, list(range(n + 1))), dead_reckon(imu, motion.start))


def test_segments_and_a_start_inside_the_first_push() -> None:
    motion = stream(200)
    start = NavState(motion.t[5], motion.q_ned_frd[5], motion.velocity[5], motion.position[5])
    batch = dead_reckon(motion.imu, start, method="midpoint", segments=4)
    assert_same(push_all(DeadReckoner(start, method="midpoint", segments=4), motion.imu, [0, 6, 7, 60, 200]), batch)


def test_the_cubic_is_one_sample_late_and_says_so() -> None:
    motion = stream(50)
    late, prompt = DeadReckoner(motion.start), DeadReckoner(motion.start, middle="linear")
    for i in range(50):
        late.push(motion.imu[i : i + 1])
        prompt.push(motion.imu[i : i + 1])
        assert prompt.behind == 0
        assert late.behind == (1 if i >= 3 else i)
    assert late.state.t == motion.t[-2]
    assert prompt.state.t == motion.t[-1]
    assert len(late.finish()) == 1
    assert late.behind == 0
    assert len(late.finish()) == 0


def test_an_anchor_moves_the_reckoning_to_another_state() -> None:
    motion = stream(400)
    dead_reckoner = DeadReckoner(NavState(0.0, quaternion.IDENTITY, np.ones(3), np.zeros(3)))
    dead_reckoner.push(motion.imu[:200])
    k = 198  # one sample late
    truth = NavState(motion.t[k], motion.q_ned_frd[k], motion.velocity[k], motion.position[k])
    dead_reckoner.anchor(truth)
    rest = dead_reckoner.push(motion.imu[200:])
    whole = dead_reckon(motion.imu, truth)
    np.testing.assert_allclose(rest.position, whole.position[1 : 1 + len(rest)], atol=1e-10)
    with pytest.raises(ValueError, match="does not fit"):
        dead_reckoner.anchor(truth)


def test_bad_pushes_are_named() -> None:
    motion = stream(50)
    dead_reckoner = DeadReckoner(motion.start)
    assert len(dead_reckoner.push(motion.imu[:0])) == 0
    with pytest.raises(DataError, match="not the time of a sample"):
        dead_reckoner.push(motion.imu[10:20])
    dead_reckoner.push(motion.imu[:20])
    with pytest.raises(DataError, match="increase strictly"):
        dead_reckoner.push(motion.imu[19:30])
    dead_reckoner.push(motion.imu[20:30])  # the refused chunk has left no trace
    with pytest.raises(SettingsError, match="gravity must be finite"):
        DeadReckoner(motion.start, gravity=float("nan"))
    with pytest.raises(SettingsError, match="unknown middle"):
        DeadReckoner(motion.start, middle="quintic")
