"""What may go wrong in a flight, each as a signature in the smoother's linear system, and which explains it best.

An explanation has a few unknown numbers u (a step of the gyro's bias: three) that would change the residuals of some
factors by S u from its onset on. At the solution without it, with b = -Sᵀ W r and V = Sᵀ W S less what the states can
make up for, twice the logarithm of the likelihood ratio is bᵀ V⁻¹ b, and u = V⁻¹ b ± V⁻¹: no explanation needs a
smoother of its own. All explanations compete at once, each pays for its unknowns and for the choice of its onset.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from companion.estimation.model import ACCEL_BIAS, ATTITUDE, GYRO_BIAS, STATES, VELOCITY
from companion.estimation.shapes import INTEGRAL, SLOPED, at_work
from companion.estimation.system import (
    Measurement,
    Motion,
    Solution,
    measurement_residual,
    motion_residual,
)
from companion.model import Array
from companion.strapdown import quaternion

_LIVELY = {GYRO_BIAS.start: 0.2, ACCEL_BIAS.start: 1.5}  # rad/s, m/s², root mean square
_UNUSUAL, _JUMPS = 8.0, 8  # a step of this many median steps, and how many are tried


@dataclass(frozen=True, slots=True, eq=False)
class Signature:
    """How one explanation of m unknowns changes the residuals, fully at work."""

    motion: Array | None  # (K-1, 15, m)
    measurements: Mapping[str, Array]  # witness → (M, d, m), as it adds to what is measured

    @property
    def unknowns(self) -> int:
        """m"""
        parts = (self.motion, *self.measurements.values())
        return int(next(part.shape[2] for part in parts if part is not None))


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """What signatures are made of."""

    t: Array  # (K,) s
    q_ned_frd: Array  # (K, 4)
    velocity: Array  # (K, 3) NED, m/s
    gravity: float  # m/s²
    motion: Motion
    measurements: tuple[Measurement, ...]

    def witness(self, name: str) -> Measurement | None:
        """The measurements of a witness."""
        return next((one for one in self.measurements if one.name == name), None)


@dataclass(frozen=True, slots=True)
class Kind:
    """One row of what may be wrong."""

    name: str
    side: str  # whose it is: "imu", "gps", "compass", "barometer"
    unit: str
    shapes: tuple[str, ...]
    prior: float  # 1σ of a size that may occur, in the unit; of a ramp reached within the flight
    least: float  # the smallest size that is called wrong: sensors in order change by less in a flight
    signature: Callable[[Problem], Signature | None]
    needs: str = ""  # the witness without which nothing can be said of it
    least_slow: float = 0.0  # the same of a ramp or creep, where that is more
    summed: tuple[str, ...] = ()  # witnesses that read the integral of what the others read

    def least_of(self, shape: str) -> float:
        """The smallest size that is called wrong; of what grows, at its end."""
        return max(self.least, self.least_slow) if shape in SLOPED else self.least

    def shape_at(self, witness: str, shape: str) -> str:
        """What a shape is for one of its witnesses."""
        return INTEGRAL[shape] if witness in self.summed else shape


def _bias(block: slice, *resting: str) -> Callable[[Problem], Signature | None]:
    """A bias u beside the one that the states have; witnesses at rest read it too."""

    def signature(problem: Problem) -> Signature | None:
        out = np.zeros((len(problem.t) - 1, STATES, 3))
        out[:, :9] = problem.motion.transition[:, :9, block]
        read = {n: np.tile(np.eye(3), (len(one.t), 1, 1)) for n in resting if (one := problem.witness(n)) is not None}
        return Signature(out, read)

    return signature


def _scale(block: slice) -> Callable[[Problem], Signature | None]:
    """Scale errors u: readings are off by u times what the states turned or were accelerated by.

    Not times the readings themselves, whose noise would explain itself.
    """

    def signature(problem: Problem) -> Signature | None:
        lasted = np.diff(problem.t)[:, None]
        q = problem.q_ned_frd
        if block == GYRO_BIAS:
            felt = quaternion.log(quaternion.multiply(quaternion.conjugate(q[:-1]), q[1:])) / lasted
        else:
            force = np.diff(problem.velocity, axis=0) / lasted - [0.0, 0.0, problem.gravity]
            felt = quaternion.rotate(quaternion.conjugate(q[:-1]), force)
        out = np.zeros((len(lasted), STATES, 3))
        lively = np.sqrt((felt**2).mean(axis=0)) > _LIVELY[block.start]  # else it is the noise that is scaled
        out[:, :9] = problem.motion.transition[:, :9, block] * (felt * lively)[:, None, :]
        return Signature(out, {})

    return signature


def _shock(block: slice) -> Callable[[Problem], Signature | None]:
    """A turn or a push u within a moment that the IMU has not felt."""

    def signature(problem: Problem) -> Signature | None:
        out = np.zeros((len(problem.t) - 1, STATES, 3))
        out[:, block] = np.eye(3)
        return Signature(out, {})

    return signature


def _shift(*names: str) -> Callable[[Problem], Signature | None]:
    """Measurements that are off by u, all their components."""

    def signature(problem: Problem) -> Signature | None:
        one = problem.witness(names[0])
        if one is None or len(one.t) < 8:
            return None
        return Signature(None, {one.name: np.tile(np.eye(one.residual.shape[1]), (len(one.t), 1, 1))})

    return signature


def _motion(problem: Problem) -> Signature | None:
    """GPS position and velocity that move together, as by spoofing: a velocity u."""
    ones = [problem.witness(name) for name in ("gps_velocity", "gps_position")]
    return Signature(None, {one.name: np.tile(np.eye(2), (len(one.t), 1, 1)) for one in ones if one is not None})


def _field(problem: Problem) -> Signature | None:
    """A field whose horizontal part is another in NED: the compass, or the iron around it, has turned."""
    one = problem.witness("compass")
    if one is None or len(one.t) < 8:
        return None
    matrix = quaternion.to_matrix(problem.q_ned_frd[one.keyframe]).swapaxes(-1, -2)
    return Signature(None, {"compass": matrix[:, :, :2]})


KINDS: tuple[Kind, ...] = (
    Kind("gyro_bias", "imu", "rad/s", ("step", "ramp", "pulse"), 0.03, 3e-3, _bias(GYRO_BIAS, "rest_rate")),
    Kind("accel_bias", "imu", "m/s²", ("step", "ramp", "pulse"), 1.0, 0.15, _bias(ACCEL_BIAS), "gps_position"),
    Kind("gyro_scale", "imu", "", ("step",), 0.3, 0.02, _scale(GYRO_BIAS), "gps_position"),
    Kind("accel_scale", "imu", "", ("step",), 0.3, 0.02, _scale(ACCEL_BIAS), "gps_position"),
    Kind("gyro_shock", "imu", "rad", ("shock",), 0.3, 0.035, _shock(ATTITUDE)),
    Kind("accel_shock", "imu", "m/s", ("shock",), 5.0, 0.5, _shock(VELOCITY), "gps_position"),
    # two fixes of a receiver of 2.5 m CEP, minutes apart, differ by less than 11 m in 99.9 % of cases; 3 σ in height
    Kind("gps_position", "gps", "m", ("step", "ramp", "pulse", "creep"), 50.0, 6.0, _shift("gps_position"),
         least_slow=11.0),
    Kind("gps_height", "gps", "m", ("step", "ramp", "pulse"), 50.0, 5.0, _shift("gps_height"), least_slow=15.0),
    Kind("gps_motion", "gps", "m/s", ("step", "pulse"), 3.0, 0.5, _motion, "gps_position", summed=("gps_position",)),
    Kind("gps_velocity", "gps", "m/s", ("step", "ramp", "pulse"), 5.0, 0.5, _shift("gps_velocity")),
    Kind("compass_field", "compass", "µT", ("step", "ramp", "pulse", "creep"), 30.0, 3.0, _field),
    Kind("compass_iron", "compass", "µT", ("step",), 30.0, 4.0, _shift("compass")),
    Kind("barometer", "barometer", "m", ("step", "ramp", "pulse"), 20.0, 4.0, _shift("barometer")),
)  # fmt: skip
"""What may be wrong. An explanation that is not in this table does not exist."""


def kind_of(name: str) -> Kind:
    """The row of a kind. Raises KeyError for a name that is none."""
    return {kind.name: kind for kind in KINDS}[name]


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """One explanation, at every onset that was tried."""

    kind: Kind
    shape: str
    onset: Array  # (T,) s
    end: Array  # (T,) s, of a pulse; infinite for what stays
    gain: Array  # (T,) twice the log-likelihood ratio
    size: Array  # (T, m)
    covariance: Array  # (T, m, m)
    axis: npt.NDArray[np.intp]  # (T,) the one component that changes; -1 for all

    @property
    def best(self) -> int:
        """The onset with the greatest gain."""
        return int(np.argmax(self.gain))


def jumps(problem: Problem, solution: Solution, kind: Kind) -> Array:
    """(J,) s: times at which the readings of a witness step against what the estimate says, the largest first."""
    signature = kind.signature(problem)
    one = problem.witness(next(iter(signature.measurements), "")) if signature is not None else None
    if one is None or len(one.t) < 10:
        return np.zeros(0)
    step = np.linalg.norm(np.diff(measurement_residual(one, solution) / one.sigma, axis=0), axis=1)
    unusual = np.flatnonzero(step > _UNUSUAL * np.median(step) + 1e-9)
    order = unusual[np.argsort(-step[unusual])][:_JUMPS]
    return np.asarray(0.5 * (one.t[order] + one.t[order + 1]))


def pushes(problem: Problem, solution: Solution) -> Array:
    """(J,) s: keyframes before which the velocity changes most beyond what the IMU felt, the most unlikely first."""
    e, d = solution.disturbances
    e, d = e[:, VELOCITY], d[:, VELOCITY, VELOCITY]
    unlikely = np.einsum("ki,ki->k", e, np.linalg.solve(d + 1e-12 * np.eye(3), e[..., None])[..., 0])
    peak = (unlikely >= np.roll(unlikely, 1)) & (unlikely >= np.roll(unlikely, -1))
    at = np.flatnonzero(peak)
    return np.asarray(problem.t[at[np.argsort(-unlikely[at])][:_JUMPS]] + 1e-3)


def weigh(
    problem: Problem, solution: Solution, kind: Kind, shape: str, onset: Array, end: Array | None = None
) -> Candidate | None:
    """The likelihood of a kind and shape from onsets (T,) to ends (T,) s.

    None where the flight has nothing that it would change.
    """
    end = np.full(len(onset), np.inf) if end is None else end
    signature = kind.signature(problem)
    if signature is None or (kind.needs and problem.witness(kind.needs) is None):
        return None
    count, states = solution.x.shape
    tries = len(onset)
    m = signature.unknowns
    column = np.zeros((count, states, tries, m))
    border = np.zeros((solution.border.shape[2], tries, m))
    b, v = np.zeros((tries, m)), np.zeros((tries, m, m))
    motion = problem.motion
    if signature.motion is not None:
        share = at_work(shape, onset, end, problem.t[:-1], problem.t[1:])
        s, w = signature.motion, motion.weight
        ws = w @ s
        left = motion_residual(motion, solution)
        b -= share @ np.einsum("kim,ki->km", ws, left)
        v += np.einsum("tk,kmn->tmn", share**2, s.swapaxes(-1, -2) @ ws)
        column[:-1] += np.einsum("kim,tk->kitm", motion.transition.swapaxes(-1, -2) @ ws, share)
        column[1:] -= np.einsum("kim,tk->kitm", ws, share)
        border += np.einsum("kcm,tk->ctm", motion.constants.swapaxes(-1, -2) @ ws, share)
    for name, s in signature.measurements.items():
        one = problem.witness(name)
        assert one is not None
        share = at_work(kind.shape_at(name, shape), onset, end, one.t, one.t)
        ws = one.information[..., None] * s
        left = measurement_residual(one, solution)
        b += share @ np.einsum("fdm,fd->fm", ws, left)
        v += np.einsum("tf,fmn->tmn", share**2, s.swapaxes(-1, -2) @ ws)
        column[one.keyframe] += np.einsum("fim,tf->fitm", one.states.swapaxes(-1, -2) @ ws, share)
        border += np.einsum("fcm,tf->ctm", one.constants.swapaxes(-1, -2) @ ws, share)
    flat = column.reshape(count, states, tries * m)
    solved = solution.factor.solve(flat)
    y = solution.border.reshape(count * states, -1)
    rest = border - (y.T @ flat.reshape(count * states, -1)).reshape(border.shape)
    v -= _squares(column.reshape(-1, tries, m), solved.reshape(-1, tries, m))
    turned = np.tensordot(solution.constants_covariance, rest, axes=1)
    v -= _squares(rest, turned)
    return _candidate(kind, shape, problem, (onset, end), b, v)


def _squares(a: Array, b: Array) -> Array:
    """(T, m, m) Σ over the first axis of aᵀ b: a, b (N, T, m)."""
    return np.asarray(a.transpose(1, 2, 0) @ b.transpose(1, 0, 2))


def weigh_shocks(problem: Problem, solution: Solution, kind: Kind, shape: str, block: slice) -> Candidate:
    """Shocks to a block of the states at every keyframe at once, of which the disturbances tell: a shock to a bias is a
    step of it."""
    e, d = solution.disturbances
    if shape == "shock":
        middle = 0.5 * (problem.t[:-1] + problem.t[1:])
        return _candidate(kind, shape, problem, (middle, np.full(len(e), np.inf)), -e[:, block], d[:, block, block])
    return _candidate(kind, shape, problem, (problem.t[1:], np.full(len(e), np.inf)), -e[:, block], d[:, block, block])


def _candidate(kind: Kind, shape: str, problem: Problem, span: tuple[Array, Array], b: Array, v: Array) -> Candidate:
    """Sizes and gains, of all components together or of one alone, whichever pays more for its unknowns."""
    onset, end = span
    lasted = np.ones(len(onset))
    if shape in SLOPED:
        lasted = np.maximum(np.minimum(problem.t[-1], end) - onset, 1.0)
    prior = (lasted / kind.prior) ** 2
    m = b.shape[1]
    v = 0.5 * (v + v.swapaxes(-1, -2))
    values, vectors = np.linalg.eigh(v + prior[:, None, None] * np.eye(m))
    values = np.maximum(values, prior[:, None])  # rounding
    covariance = (vectors / values[:, None, :]) @ vectors.swapaxes(-1, -2)
    size = (covariance @ b[..., None])[..., 0]
    paid = np.log(values / prior[:, None]).sum(axis=1)  # Occam's factor: a size that could have been anything
    gain = (b * size).sum(axis=1) - paid
    own = np.maximum(np.diagonal(v, axis1=1, axis2=2), 0.0) + prior[:, None]
    alone = b**2 / own - np.log(own / prior[:, None]) - 2.0 * np.log(m)
    axis = alone.argmax(axis=1)
    rows = np.arange(len(b))
    better = (alone[rows, axis] > gain) & (m > 1)
    one_size, one_covariance = np.zeros_like(size), np.zeros_like(covariance)
    one_size[rows, axis] = b[rows, axis] / own[rows, axis]
    one_covariance[rows, axis, axis] = 1.0 / own[rows, axis]
    gain, size = np.where(better, alone[rows, axis], gain), np.where(better[:, None], one_size, size)
    matters = np.linalg.norm(size, axis=1) * lasted >= kind.least_of(shape)
    return Candidate(
        kind,
        shape,
        onset,
        end,
        np.where(matters, gain, 0.0),
        size,
        np.where(better[:, None, None], one_covariance, covariance),
        np.where(better, axis, -1),
    )
