"""The problem made linear about the present states; `propagate` gives Φ and the noise of every interval."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from companion.constants import healthy, num
from companion.estimation.aiding_sensors import RECEIVER_MOTION, SENSORS, SLOW
from companion.estimation.block_tridiagonal import inverses, scaled
from companion.estimation.candidate import Candidate, with_candidate
from companion.estimation.hypotheses import hypothesis_of
from companion.estimation.model import (
    ACCEL_BIAS,
    ATTITUDE,
    CONSTANT_STATES,
    CONSTANTS,
    GYRO_BIAS,
    NOISES,
    POSITION,
    STATES,
    VELOCITY,
    ProcessNoise,
    States,
)
from companion.estimation.readings import Kinematics, Readings, three_samples
from companion.estimation.setup import Setup
from companion.estimation.system import Measurement, Motion, Prior, Problem
from companion.estimation.turning import about_sizes
from companion.model import Array, IntArray
from companion.strapdown import MOVED, Preintegration, error_sums, left_jacobian, preintegrate, quaternion, skew

_NOTHING = np.zeros(0)

_BLOCKS: Mapping[str, slice] = {
    "attitude": ATTITUDE, "velocity": VELOCITY, "position": POSITION, "gyro_bias": GYRO_BIAS,
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class PreintegratedImu:
    """One pass over the IMU with a constant bias taken off, and what it says of every interval."""

    bias: tuple[Array, Array]  # rad/s, m/s²
    preintegration: Preintegration  # at the samples that are asked for
    about: IntArray  # (K, 3) samples before, at and after each keyframe
    transition: Array  # (K-1, 15, 15), in the frame in which the track begins
    sums: Mapping[str, Array]
    matrices: Array  # (K-1, 9, 18) of scale and misalignment of gyro and accelerometer


def preintegrate_imu(setup: Setup, bias: tuple[Array, Array]) -> PreintegratedImu:
    """The IMU preintegrated from keyframe to keyframe, without a bias of gyro (3,) and accelerometer (3,)."""
    track = setup.imu
    if bias[0].any() or bias[1].any():
        track = replace(track, gyro=track.gyro - bias[0], accel=track.accel - bias[1])
    path = preintegrate(track)
    raw = error_sums(track, path, setup.index[:-1], setup.index[1:])
    read = [readings.sample.ravel() for readings in setup.readings]
    about = three_samples(track, setup.index, num.FIX_SAMPLES_S, before=1)
    path = path.at(np.unique(np.concatenate([setup.index, about.ravel(), *read])))
    matrices = np.concatenate([one.reshape(-1, 9, 9) for one in (raw.gyro_matrix, raw.accel_matrix)], axis=2)
    return PreintegratedImu(bias, path, about, raw.transition, raw.noise, matrices)


def linearise(
    setup: Setup,
    pim: PreintegratedImu,
    states: States,
    noise: ProcessNoise,
    scale: Mapping[str, float],
    weights: Mapping[str, Array],
    slow: Mapping[str, float],
    accepted: Sequence[Candidate] = (),
    *,
    sizes: Array = _NOTHING,
) -> Problem:
    """The linear problem about the states. The sizes of what is accepted follow the constants.

    sizes: (m,) what they were found to be so far, where they were.
    """
    turn = _turn(setup, pim, states)
    floor = np.diag(np.repeat(num.STEP_FLOOR, 3) ** 2)
    covariance, sums = np.tile(floor, (len(pim.transition), 1, 1)), _sums(setup, pim)
    for cause, own in MOVED.items():
        covariance[:, own, own] += noise.density(cause) ** 2 * sums[cause]
    if setup.broken.any():
        lasted = np.diff(setup.t)[setup.broken][:, None]
        unheard = np.minimum(lasted / healthy.BIAS_RENEWED_S, 1.0)
        wander = [w * (1 + lasted) for w in healthy.UNHEARD_MOTION] + [w * unheard for w in healthy.BIAS_SIGMA]
        wide = np.concatenate([np.repeat(one, 3, axis=1) for one in wander], axis=1)
        covariance[setup.broken] += wide[:, :, None] ** 2 * np.eye(STATES)
    if setup.switched.any():  # the biases are those of another IMU, which may be at fault
        for kind, block in (("gyro_bias", GYRO_BIAS), ("accel_bias", ACCEL_BIAS)):
            covariance[setup.switched, block, block] += hypothesis_of(kind).prior ** 2 * np.eye(3)
    back = turn.swapaxes(-1, -2)
    shift = _shift(pim, states, turn)
    keeps, wanders = _slow_motion(setup, slow)
    transition = _with_receiver_motion(_beside(turn @ pim.transition @ back, keeps), setup)
    weight = _beside(turn @ _inverse(covariance) @ back, 1.0 / wanders)
    constants = np.zeros((*weight.shape[:2], CONSTANT_STATES))
    constants[:, :9, _MATRICES] = turn[:, :9, :9] @ pim.matrices
    motion = Motion(np.empty(weight.shape[:2]), transition, constants, weight)  # whose residual comes last
    turned, variance = turn[:, ATTITUDE, ATTITUDE].copy(), np.diagonal(covariance, axis1=1, axis2=2).copy()
    del turn, covariance, back  # the solution needs the memory
    at = _kinematics(setup, pim, states)
    measurements = []
    for readings in setup.readings:
        one = measure(readings, at, setup.slow)
        sigma, robust = one.sigma * scale[one.name], weights.get(one.name, one.weight)
        measurements.append(replace(one, sigma=sigma, weight=robust))
    problem = Problem(setup.t, states, setup.gravity, motion, tuple(measurements), _prior(setup, states, slow), noise,
                      turned, sums, variance, setup.aliased, setup.others, setup.shock_rate,
                      setup.relative_noise)  # fmt: skip
    for candidate in accepted:
        problem = with_candidate(problem, candidate)
    problem = about_sizes(problem, accepted, sizes, partial(_compass_in_field, setup, at))
    _predict(setup, pim, states, problem.motion, shift, sizes)
    return problem


def _compass_in_field(setup: Setup, at: Kinematics, field: Array) -> Measurement:
    """The measurement of a compass, were the Earth's field (3,) µT that."""
    constants = at.states.constants.copy()
    constants[CONSTANTS["earth_field"][0]] = field
    there = replace(at, states=replace(at.states, constants=constants))
    return measure(next(one for one in setup.readings if one.name == "compass"), there, setup.slow)


def measure(one: Readings, at: Kinematics, slow: Mapping[str, slice]) -> Measurement:
    """The measurement factor of an aiding sensor about its states; weights 1.

    slow: places of the slow errors of all aiding sensors among its states: its own adds to what it reads.
    """
    states, sensor = at.states, SENSORS[one.name]
    h = np.zeros((*one.value.shape, STATES + states.slow.shape[1]))
    h_c = np.zeros((*one.value.shape, CONSTANT_STATES))
    predicted = sensor.predict(one, at)
    for name, derivative in predicted.derivatives.items():
        if name in _BLOCKS:
            h[:, :, _BLOCKS[name]] = derivative
        else:
            h_c[:, :, CONSTANTS[name][0]] = derivative
    residual = one.value - predicted.value
    for name in (one.name, *(name for name, (velocity, *_) in RECEIVER_MOTION.items() if velocity == one.name)):
        if (place := slow.get(name)) is not None:
            h[:, :, place] = np.eye(place.stop - place.start)
            residual -= states.slow[one.keyframe, place.start - STATES : place.stop - STATES]
    return Measurement(one.name, one.t, one.keyframe, residual, h, h_c, one.sigma, np.ones(len(one.t)), sensor.unit)


def _sums(setup: Setup, pim: PreintegratedImu) -> Mapping[str, Array]:
    """Cause → (K-1, n, n) per squared density, larger where the IMU scatters more than it usually does."""
    times = zip(NOISES[:2], setup.relative_noise.T, strict=True)
    return {**pim.sums, **{cause: value[:, None, None] ** 2 * pim.sums[cause] for cause, value in times}}


def _turn(setup: Setup, pim: PreintegratedImu, states: States) -> Array:
    """(K-1, 15, 15) from the frame in which the track begins to NED, at each interval's start."""
    start = setup.index[:-1]
    q = pim.preintegration.q[pim.preintegration.row(start)]
    matrix = quaternion.to_matrix(quaternion.multiply(states.q_ned_frd[:-1], quaternion.conjugate(q)))
    turn = np.tile(np.eye(STATES), (len(start), 1, 1))
    for block in (ATTITUDE, VELOCITY, POSITION):
        turn[:, block, block] = matrix
    return turn


_MATRICES = slice(CONSTANTS["gyro_matrix"][0].start, CONSTANTS["accel_matrix"][0].stop)
"""Scale and misalignment of both sensors among the constants of a flight."""


def _shift(pim: PreintegratedImu, states: States, turn: Array) -> Array:
    """(K-1, 9) in NED: what attitude, velocity and position gain where the states have other biases."""
    bias = np.concatenate((states.gyro_bias[:-1] - pim.bias[0], states.accel_bias[:-1] - pim.bias[1]), axis=1)
    shift = pim.transition[:, :9, 9:] @ bias[..., None]
    shift += (pim.matrices @ states.constants[_MATRICES])[..., None]
    return np.asarray((turn[:, :9, :9] @ shift)[..., 0])


def _predict(setup: Setup, pim: PreintegratedImu, states: States, motion: Motion, shift: Array, sizes: Array) -> None:
    """Fill in the residual of the motion, and make Φ and G its derivatives where it is large.

    shift: (K-1, 9) in NED, what the states say beside the path; sizes: (m,) of what is accepted, whose columns are the
    last of G. With E = exp(shift) q_k q_{k+1}*, the turn that is left, a = log E, an error x_k turns what is predicted
    and all of the shift with it, and J_r(a) times the residual is the same residual: it is linear in x_{k+1} with -1,
    in x_k with R(a)ᵀ, in the shift with R(a)ᵀ J_l(shift) (J. Solà 2017, §4.3.4; J_l, J_r: Jacobians of exp).
    """
    columns = motion.constants[:, :9, CONSTANT_STATES:]
    if sizes.any():
        shift = shift + columns @ sizes
    residual, transition = motion.residual, motion.transition
    residual[:, :STATES] = _motion_residual(setup, pim, states, shift)
    residual[:, STATES:] = (transition[:, STATES:, STATES:] @ states.slow[:-1, :, None])[..., 0] - states.slow[1:]
    for block in (VELOCITY, POSITION):
        transition[:, block, ATTITUDE] -= skew(shift[:, block])
    back = quaternion.to_matrix(quaternion.exp(-residual[:, ATTITUDE]))
    pushed = back @ left_jacobian(shift[:, ATTITUDE])
    transition[:, ATTITUDE, ATTITUDE] = back
    transition[:, ATTITUDE, GYRO_BIAS] = pushed @ transition[:, ATTITUDE, GYRO_BIAS]
    motion.constants[:, ATTITUDE] = pushed @ motion.constants[:, ATTITUDE]
    scale = np.linalg.inv(left_jacobian(-residual[:, ATTITUDE]))
    motion.weight[:, ATTITUDE] = scale.swapaxes(-1, -2) @ motion.weight[:, ATTITUDE]
    motion.weight[:, :, ATTITUDE] = motion.weight[:, :, ATTITUDE] @ scale
    if sizes.any():
        residual[:, :9] -= columns @ sizes


def _motion_residual(setup: Setup, pim: PreintegratedImu, states: States, shift: Array) -> Array:
    """(K-1, 15) the IMU's prediction from each keyframe less the next keyframe's nominal state."""
    start, end = setup.index[:-1], setup.index[1:]
    q, v, p = pim.preintegration.carry(
        start, end, states.q_ned_frd[:-1], states.velocity[:-1], states.position[:-1], gravity=setup.gravity
    )
    q = quaternion.multiply(quaternion.exp(shift[:, :3]), q)
    angle = quaternion.log(quaternion.multiply(q, quaternion.conjugate(states.q_ned_frd[1:])))
    v, p = v + shift[:, 3:6] - states.velocity[1:], p + shift[:, 6:9] - states.position[1:]
    walks = (bias[:-1] - bias[1:] for bias in (states.gyro_bias, states.accel_bias))
    return np.concatenate((angle, v, p, *walks), axis=1)


def _kinematics(setup: Setup, pim: PreintegratedImu, states: States) -> Kinematics:
    track, index, s = setup.imu, setup.index, states
    samples = pim.about
    when = track.t[samples] - setup.t[:, None]
    _, velocity, position = pim.preintegration.carry(
        index, samples, s.q_ned_frd, s.velocity, s.position, gravity=setup.gravity
    )
    velocity -= s.velocity[:, None]
    position -= s.position[:, None] + s.velocity[:, None] * when[..., None]
    beside_gap = np.concatenate(([False], setup.broken)) | np.concatenate((setup.broken, [False]))
    imu_known = (when[:, 2] - when[:, 0] < num.GAP_S) & ~beside_gap  # across a gap the IMU tells nothing
    velocity *= imu_known[:, None, None]
    position *= imu_known[:, None, None]
    velocity[..., 2] -= setup.gravity * when
    position[..., 2] -= 0.5 * setup.gravity * when**2
    rate = track.gyro[index] - s.gyro_bias
    return Kinematics(s, pim.preintegration, index, setup.t, rate, when, velocity, position, imu_known, setup.gravity)


def _slow_motion(setup: Setup, slow: Mapping[str, float]) -> tuple[Array, Array]:
    """(K-1, S) what is left of a slow error after each interval, and the variance that it gains in it."""
    lasted = np.diff(setup.t)[:, None]
    time = _of_slow_errors(setup, {name: time for name, (_, _, time) in SLOW.items()})
    keeps = np.exp(-lasted / time)
    return keeps, _of_slow_errors(setup, slow) ** 2 * (1.0 - keeps**2)


def _with_receiver_motion(transition: Array, setup: Setup) -> Array:
    """The same where the error of a receiver's position grows by that of its motion, while both decay."""
    lasted = np.diff(setup.t)
    for name, (_, position, _) in RECEIVER_MOTION.items():
        if name in setup.slow:
            moved, by = (range(setup.slow[one].start, setup.slow[one].stop) for one in (position, name))
            fades, own = (1.0 / SLOW[one][2] for one in (position, name))
            grown = (np.exp(-fades * lasted) - np.exp(-own * lasted)) / (own - fades)
            for i, j in zip(moved, by, strict=True):
                transition[:, i, j] = grown
    return transition


def _of_slow_errors(setup: Setup, each: Mapping[str, float]) -> Array:
    """(S,) what each aiding sensor has, for every component of its slow error."""
    return np.repeat([each[name] for name in setup.slow], [place.stop - place.start for place in setup.slow.values()])


def _beside(blocks: Array, diagonal: Array) -> Array:
    """Blocks (N, i, i) and beside them a diagonal (N, j): (N, i + j, i + j)."""
    count, states, more = *blocks.shape[:2], diagonal.shape[1]
    out = np.zeros((count, states + more, states + more))
    out[:, :states, :states] = blocks
    np.einsum("kii->ki", out)[:, states:] = diagonal
    return out


def _prior(setup: Setup, states: States, slow: Mapping[str, float]) -> Prior:
    """Position, velocity and attitude are free: their priors only keep the step finite (Levenberg)."""
    residual = np.zeros(STATES)
    residual[GYRO_BIAS], residual[ACCEL_BIAS] = -states.gyro_bias[0], -states.accel_bias[0]
    residual = np.concatenate((residual, -states.slow[0]))
    sigma = np.concatenate((np.repeat([1.0, 30.0, 100.0], 3), setup.bias_sigma, _of_slow_errors(setup, slow)))
    return Prior(residual, sigma, setup.constants - states.constants, setup.constants_sigma)


def _inverse(covariance: Array) -> Array:
    scale = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    return scaled(inverses(scaled(covariance, scale, scale)), scale, scale)
