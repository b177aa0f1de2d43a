"""The trajectory: laws of the field, analytic truth, and a plain scalar loop written from docs/mathematics.md."""

from __future__ import annotations

import numpy as np
import pytest

from companion.model import STANDARD_GRAVITY, Array, DataError, ImuTrack, NavState, SettingsError, Trajectory
from companion.strapdown import METHODS, MIDDLES, dead_reckon, motions, preintegrate, quaternion
from companion.strapdown.motions import Motion
from tests.oracle import scalar_rk4

RNG = np.random.default_rng(2)
DOWN = np.array([0.0, 0.0, STANDARD_GRAVITY])


def attitude_error(a: Array, b: Array) -> Array:
    """rad, angle between attitudes."""
    return np.asarray(np.linalg.norm(quaternion.log(quaternion.multiply(a, quaternion.conjugate(b))), axis=-1))


def assert_same(a: Trajectory, b: Trajectory, tolerance: float = 1e-12) -> None:
    """Equal relative to the terms that are summed up: gravity's g t and ½ g t² are larger than the motion itself."""
    tau = b.t - b.t[0]
    np.testing.assert_array_equal(a.t, b.t)
    assert np.abs(a.q_ned_frd - b.q_ned_frd).max() <= tolerance
    assert (np.abs(a.velocity - b.velocity).max(axis=1) <= tolerance * (1 + STANDARD_GRAVITY * tau)).all()
    assert (np.abs(a.position - b.position).max(axis=1) <= tolerance * (1 + STANDARD_GRAVITY / 2 * tau**2)).all()


def irregular_coning(n: int = 300, seconds: float = 4.0) -> Motion:
    steps = np.random.default_rng(3).uniform(0.5, 1.5, n)
    return motions.coning(np.concatenate(([0.0], np.cumsum(steps) * seconds / steps.sum())))


# --- an independent oracle -------------------------------------------------------------------------------------


@pytest.mark.parametrize("middle", MIDDLES)
def test_scalar_loop_agrees(middle: str) -> None:
    n = 700
    t = 100.0 + np.cumsum(RNG.uniform(0.004, 0.03, n))
    imu = ImuTrack(t, RNG.normal(0, 2, (n, 3)), RNG.normal(0, 5, (n, 3)) - DOWN)
    start = NavState(t[0], quaternion.normalize(RNG.normal(size=4)), RNG.normal(0, 5, 3), RNG.normal(0, 50, 3))
    found = dead_reckon(imu, start, middle=middle)
    q, v, p = scalar_rk4(imu, start, middle)
    for ours, theirs in ((found.q_ned_frd, q), (found.velocity, v), (found.position, p)):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-10 * max(1.0, np.abs(theirs).max()))


# --- laws ------------------------------------------------------------------------------------------------------

SPACINGS = {"regular": (1.0, 1.0), "irregular": (0.6, 1.4)}


@pytest.mark.parametrize("spacing", SPACINGS)
@pytest.mark.parametrize(
    ("method", "middle", "order"),
    [
        (name, middle, one.order if middle == "cubic" else min(one.order, 2))
        for name, one in METHODS.items()
        for middle in (MIDDLES if one.looks_inside else ("linear",))
    ],
)
def test_order_of_convergence(method: str, middle: str, order: int, spacing: str) -> None:
    """Halving the interval divides the error by 2 to the order, of what converges slowest; nothing cancels at 3.3 s."""
    errors = []
    for n in (400, 800, 1600):
        steps = np.tile(SPACINGS[spacing], n // 2)
        t = np.concatenate(([0.0], np.cumsum(steps) * 3.3 / steps.sum()))
        motion = motions.coning(t)
        end = dead_reckon(motion.imu, motion.start, method=method, middle=middle).end
        errors.append(
            (
                attitude_error(end.q_ned_frd, motion.q_ned_frd[-1]),
                np.linalg.norm(end.velocity - motion.velocity[-1]),
                np.linalg.norm(end.position - motion.position[-1]),
            )
        )
    slopes = -np.diff(np.log2(np.array(errors, dtype=np.float64)), axis=0)
    np.testing.assert_allclose(slopes[-1].min(), order, atol=0.1)


NOTES_FIGURES = {  # degrees after 20 s of 1.5 Hz coning at 0.4 rad: Euler, midpoint, RK4 linear, RK4 cubic
    50: (2.8, 10.0, 4.8, 0.030),
    100: (0.71, 2.5, 1.2, 0.0019),
    200: (0.18, 0.63, 0.30, 0.00012),
}


@pytest.mark.parametrize("rate", NOTES_FIGURES)
def test_figures_of_the_notes(rate: int) -> None:
    motion = motions.coning(np.arange(20 * rate + 1) / rate)
    schemes = [("euler", "linear"), ("midpoint", "linear"), ("rk4", "linear"), ("rk4", "cubic")]
    ends = [dead_reckon(motion.imu, motion.start, method=method, middle=middle).end for method, middle in schemes]
    degrees = [float(np.degrees(attitude_error(end.q_ned_frd, motion.q_ned_frd[-1]))) for end in ends]
    metres = [float(np.linalg.norm(end.position - motion.position[-1])) for end in ends]
    np.testing.assert_allclose(degrees, NOTES_FIGURES[rate], rtol=0.03)  # two digits are printed there
    assert degrees[2] > 50 * degrees[3]
    assert metres[2] > 50 * metres[3]


@pytest.mark.parametrize("method", METHODS)
def test_rotations_stay_of_unit_length_and_continuous_in_sign(method: str) -> None:
    motion = irregular_coning(20_000, 600.0)
    q = dead_reckon(motion.imu, motion.start, method=method).q_ned_frd
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-14)
    assert (np.einsum("ij,ij->i", q[1:], q[:-1]) > 0).all()


@pytest.mark.parametrize("middle", MIDDLES)
def test_time_reversal_returns_to_the_start(middle: str) -> None:
    """Backwards in time rates and velocities change their sign; only RK4's own error remains."""
    motion = motions.coning(np.linspace(0, 5, 5001))
    there = dead_reckon(motion.imu, motion.start, middle=middle).end
    back_imu = ImuTrack(motion.t, -motion.gyro[::-1], motion.accel[::-1])
    back = dead_reckon(back_imu, NavState(0.0, there.q_ned_frd, -there.velocity, there.position), middle=middle).end
    assert attitude_error(back.q_ned_frd, motion.start.q_ned_frd) < 1e-9
    np.testing.assert_allclose(-back.velocity, motion.start.velocity, atol=1e-8)
    np.testing.assert_allclose(back.position, motion.start.position, atol=1e-8)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("middle", MIDDLES)
@pytest.mark.parametrize("cut", [4, 37, 4096, 8_990])
def test_pieces_with_a_sample_more_at_both_ends_give_the_whole(method: str, middle: str, cut: int) -> None:
    motion = irregular_coning(9_000, 100.0)
    whole = dead_reckon(motion.imu, motion.start, method=method, middle=middle)
    head = dead_reckon(motion.imu[: cut + 2], motion.start, method=method, middle=middle)
    state = NavState(head.t[cut], head.q_ned_frd[cut], head.velocity[cut], head.position[cut])
    tail = dead_reckon(motion.imu[cut - 1 :], state, method=method, middle=middle)
    both = [np.concatenate((a[:cut], b)) for a, b in zip(columns(head), columns(tail), strict=True)]
    assert_same(Trajectory(whole.t, both[0], both[1], both[2]), whole)


def columns(trajectory: Trajectory) -> tuple[Array, Array, Array]:
    return trajectory.q_ned_frd, trajectory.velocity, trajectory.position


@pytest.mark.parametrize("method", METHODS)
def test_segments_are_the_same_as_samples_put_on_the_line_between(method: str) -> None:
    coarse = irregular_coning(200, 4.0).imu
    fine_t = np.interp(np.arange(4 * 200 + 1) / 4, np.arange(201), coarse.t)
    between = [
        np.stack([np.interp(fine_t, coarse.t, x[:, i]) for i in range(3)], 1) for x in (coarse.gyro, coarse.accel)
    ]
    start = NavState(coarse.t[0], quaternion.from_euler(0.3, -0.2, 1.0), np.ones(3), np.zeros(3))
    pieces = dead_reckon(coarse, start, method=method, middle="linear", segments=4)
    fine = dead_reckon(ImuTrack(fine_t, between[0], between[1]), start, method=method, middle="linear")
    np.testing.assert_allclose(pieces.q_ned_frd, fine.q_ned_frd[::4], atol=1e-12)
    np.testing.assert_allclose(pieces.velocity, fine.velocity[::4], atol=1e-11)
    np.testing.assert_allclose(pieces.position, fine.position[::4], atol=1e-10)


# --- analytic truth --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("middle", MIDDLES)
def test_constant_specific_force_integrates_exactly(middle: str) -> None:
    t = np.cumsum(RNG.uniform(0.005, 0.02, 2_000))
    force = np.array([0.5, -0.2, -9.0])
    imu = ImuTrack(t, np.zeros((2_000, 3)), np.tile(force, (2_000, 1)))
    found = dead_reckon(imu, NavState(t[0], quaternion.IDENTITY, np.ones(3), np.zeros(3)), middle=middle)
    tau = (t - t[0])[:, None]
    np.testing.assert_allclose(found.velocity, 1.0 + (force + DOWN) * tau, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found.position, tau + 0.5 * (force + DOWN) * tau**2, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("middle", MIDDLES)
def test_constant_rate_and_specific_force_are_exact_up_to_the_step_of_rk4(middle: str) -> None:
    """RK4 expands exp(½ w h) to its fourth power: what it leaves out, (½ |w| h)⁵ / 120 a step, vanishes with the step.

    Truth by Rodrigues: v(t) = ∫C(s) f ds = t f + (1 - cos θ)/|w| (n x f) + (t - sin θ/|w|) n x (n x f), θ = |w| t.
    """
    rate, force = np.array([0.3, -0.2, 1.0]), np.array([1.0, 2.0, -9.0])
    w = float(np.linalg.norm(rate))
    n = rate / w
    once, twice = np.cross(n, force), np.cross(n, np.cross(n, force))
    for samples, bound in ((100, 1e-8), (1_000, 1e-12), (10_000, 1e-12)):
        t = np.linspace(0, 1, samples + 1)
        imu = ImuTrack(t, np.tile(rate, (len(t), 1)), np.tile(force, (len(t), 1)))
        found = preintegrate(imu, middle=middle)
        angle, tau = w * t[:, None], t[:, None]
        v = tau * force + (1 - np.cos(angle)) / w * once + (tau - np.sin(angle) / w) * twice
        p = tau**2 / 2 * force + (tau - np.sin(angle) / w) / w * once
        p += (tau**2 / 2 - (1 - np.cos(angle)) / w**2) * twice
        assert attitude_error(found.q, quaternion.exp(tau * rate)).max() < bound
        np.testing.assert_allclose(found.v, v, atol=10 * bound)
        np.testing.assert_allclose(found.p, p, atol=10 * bound)


@pytest.mark.parametrize("method", METHODS)
def test_rest_stays_at_rest_for_an_hour(method: str) -> None:
    motion = motions.rest(np.arange(360_000) / 100, quaternion.from_euler(0.1, -0.2, 1.0))
    end = dead_reckon(motion.imu, motion.start, method=method).end
    np.testing.assert_allclose(end.q_ned_frd, motion.start.q_ned_frd, atol=1e-12)
    np.testing.assert_allclose(end.velocity, 0.0, atol=1e-9)
    np.testing.assert_allclose(end.position, 0.0, atol=1e-6)


@pytest.mark.parametrize("motion", [motions.free_fall, motions.circle, motions.spin])
def test_closed_form_motions(motion: object) -> None:
    truth = motion(np.linspace(0, 20, 4001))  # type: ignore[operator]
    found = dead_reckon(truth.imu, truth.start)
    assert attitude_error(found.q_ned_frd, truth.q_ned_frd).max() < 1e-8
    np.testing.assert_allclose(found.velocity, truth.velocity, atol=1e-6)
    np.testing.assert_allclose(found.position, truth.position, atol=1e-5)


# --- one pass, any window --------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_windows_from_one_pass_equal_separate_integrations(method: str) -> None:
    motion = irregular_coning(6_000, 60.0)
    once = preintegrate(motion.imu, method=method)
    whole = dead_reckon(motion.imu, motion.start, method=method)
    starts = np.array([0, 17, 2_500, 5_000])
    ends = starts[:, None] + np.array([0, 1, 400, 900])
    states = [RNG.normal(size=(4, 3)) for _ in range(2)]
    q = quaternion.normalize(RNG.normal(size=(4, 4)))
    q_e, v_e, p_e = once.carry(starts, ends, q, *states)
    for w, k in enumerate(starts):
        start = NavState(motion.t[k], q[w], states[0][w], states[1][w])
        alone = dead_reckon(motion.imu, start, method=method)
        at = ends[w] - k
        assert attitude_error(q_e[w], alone.q_ned_frd[at]).max() < 1e-12
        np.testing.assert_allclose(v_e[w], alone.velocity[at], atol=1e-9)
        np.testing.assert_allclose(p_e[w], alone.position[at], atol=1e-7)
    first = motion.start
    q_0, v_0, p_0 = once.carry(0, np.arange(len(motion.t)), first.q_ned_frd, first.velocity, first.position)
    assert attitude_error(q_0, whole.q_ned_frd).max() < 1e-12
    np.testing.assert_allclose(v_0, whole.velocity, atol=1e-9)
    np.testing.assert_allclose(p_0, whole.position, atol=1e-7)


def test_re_anchoring_a_replay_is_one_call() -> None:
    motion = motions.coning(np.linspace(0, 20, 4001))
    anchor = np.arange(4001) // 500 * 500  # each sample belongs to the anchor before it
    once = preintegrate(motion.imu)
    q, v, p = once.carry(
        anchor, np.arange(4001), motion.q_ned_frd[anchor], motion.velocity[anchor], motion.position[anchor]
    )
    assert attitude_error(q, motion.q_ned_frd).max() < 1e-6
    np.testing.assert_allclose(v, motion.velocity, atol=1e-5)
    np.testing.assert_allclose(p, motion.position, atol=1e-5)


def test_carry_there_and_back_is_the_identity() -> None:
    motion = irregular_coning()
    once = preintegrate(motion.imu)
    start = (motion.q_ned_frd[:1], motion.velocity[:1], motion.position[:1])
    there = once.carry([10], [250], *start)
    for back, original in zip(once.carry([250], [10], *there), start, strict=True):
        np.testing.assert_allclose(back, original, atol=1e-9)


def test_carry_names_what_does_not_fit() -> None:
    once = preintegrate(irregular_coning().imu)
    q, v = np.tile(quaternion.IDENTITY, (2, 1)), np.zeros((2, 3))
    with pytest.raises(ValueError, match="velocity must have shape"):
        once.carry([0, 1], [5, 6], q, v[:1], v)
    with pytest.raises(ValueError, match="end_index must have shape"):
        once.carry([0, 1], [5, 6, 7], q, v, v)
    with pytest.raises(IndexError):
        once.carry([0, 1], [5, 600], q, v, v)


# --- starts and bad input --------------------------------------------------------------------------------------


def test_first_row_is_the_start_and_gravity_can_be_set() -> None:
    motion = irregular_coning()
    found = dead_reckon(motion.imu, motion.start, gravity=0.0)
    np.testing.assert_allclose(found.q_ned_frd[0], motion.start.q_ned_frd, atol=1e-15)
    np.testing.assert_array_equal(found.position[0], motion.start.position)
    standard = dead_reckon(motion.imu, motion.start)
    tau = (motion.t - motion.t[0])[:, None]
    np.testing.assert_allclose(standard.velocity - found.velocity, DOWN * tau, atol=1e-10)
    np.testing.assert_allclose(standard.position - found.position, 0.5 * DOWN * tau**2, atol=1e-10)


def test_single_sample_is_its_start() -> None:
    motion = irregular_coning()
    found = dead_reckon(motion.imu[:1], motion.start)
    assert len(found) == 1
    np.testing.assert_array_equal(found.position[0], motion.start.position)


def test_notes_reach_the_trajectory() -> None:
    motion = irregular_coning()
    assert "needs 4 samples" in dead_reckon(motion.imu[:3], motion.start).notes[0]
    assert "needs 4 samples" in preintegrate(motion.imu[:3]).notes[0]
    assert dead_reckon(motion.imu, motion.start).notes == ()


def test_a_start_that_cannot_be_is_named() -> None:
    motion = irregular_coning()
    good = motion.start
    bad = [
        (NavState(-1.0, good.q_ned_frd, good.velocity, good.position), "not the time of a sample"),
        (NavState(1e9, good.q_ned_frd, good.velocity, good.position), "not the time of a sample"),
        (NavState(float("nan"), good.q_ned_frd, good.velocity, good.position), "the time of a sample"),
        (NavState(0.0, 2 * good.q_ned_frd, good.velocity, good.position), "unit length"),
        (NavState(0.0, good.q_ned_frd, good.velocity * np.nan, good.position), "velocity holds non-finite"),
        (NavState(0.0, good.q_ned_frd, good.velocity, np.zeros(2)), "position must have shape"),
    ]
    for start, message in bad:
        with pytest.raises(DataError, match=message):
            dead_reckon(motion.imu, start)
    with pytest.raises(SettingsError, match="gravity must be finite"):
        dead_reckon(motion.imu, good, gravity=float("inf"))
    with pytest.raises(SettingsError, match="unknown method"):
        dead_reckon(motion.imu, good, method="heun")
    with pytest.raises(SettingsError, match="unknown middle"):
        preintegrate(motion.imu, middle="quintic")
