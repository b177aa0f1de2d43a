"""Score statistics of hypotheses at times between the cuts of the grid.

At the solution without a hypothesis, with b = Sᵀ W r and V = Sᵀ W S less what the states can make up for, twice the
logarithm of the likelihood ratio is bᵀ V⁻¹ b, and u = V⁻¹ b ± V⁻¹: none needs a smoother of its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from companion.constants import num
from companion.estimation.explanations import Kind, Problem, Signature
from companion.estimation.model import VELOCITY
from companion.estimation.shapes import activation
from companion.estimation.system import Index, Solution, applied, measurement_residual, motion_residual
from companion.model import Array


def jumps(problem: Problem, solution: Solution, kind: Kind) -> Array:
    """(J,) s: times at which the readings of an aiding sensor step against the estimate, the largest first."""
    signature = kind.signature(problem)
    one = problem.measurement(next(iter(signature.measurements), "")) if signature is not None else None
    if one is None or len(one.t) < 10:
        return np.zeros(0)
    step = np.linalg.norm(np.diff(measurement_residual(one, solution) / one.sigma, axis=0), axis=1)
    unusual = np.flatnonzero(step > num.JUMP_STEPS * np.median(step) + 1e-9)
    order = unusual[np.argsort(-step[unusual])][: num.MAX_JUMPS]
    return np.asarray(0.5 * (one.t[order] + one.t[order + 1]))


def velocity_impulses(problem: Problem, solution: Solution) -> Array:
    """(J,) s: keyframes before which the velocity changes most beyond what the IMU felt, the most unlikely first."""
    at = _peaks(solution)
    return np.asarray(problem.t[at[: num.MAX_JUMPS]] + 1e-3)


def _peaks(solution: Solution) -> Index:
    """Keyframes after which the velocity is pushed, the most unlikely first."""
    e, d = solution.disturbances
    e, d = e[:, VELOCITY], d[:, VELOCITY, VELOCITY]
    unlikely = np.einsum("ki,ki->k", e, np.linalg.solve(d + 1e-12 * np.eye(3), e[..., None])[..., 0])
    at = np.flatnonzero((unlikely >= np.roll(unlikely, 1)) & (unlikely >= np.roll(unlikely, -1)))
    return np.asarray(at[np.argsort(-unlikely[at])])


@dataclass(frozen=True, slots=True, eq=False)
class Factors:
    """N factors that an explanation of m unknowns changes, and how, fully at work."""

    measured: str  # empty for the motion
    keyframe: Index  # (N,) that each of them sees, of the motion the first of two
    start: Array  # (N,) s
    stop: Array  # (N,) s, the same for a reading
    rows: Array  # (N, 15, m) what couples the unknowns to the states
    next_rows: Array | None  # (N, 15, m) and to those of the keyframe after
    border: Array  # (N, C, m) and to the constants
    b: Array  # (N, m); of D data sets (N, m, D)
    v: Array  # (N, m, m)


def changed(problem: Problem, solution: Solution, signature: Signature) -> Iterator[Factors]:
    """The factors that a signature changes."""
    motion, s = problem.motion, signature.motion
    if s is not None:
        ws = motion.weight @ s
        yield Factors(
            measured="",
            keyframe=np.arange(len(s)),
            start=problem.t[:-1],
            stop=problem.t[1:],
            rows=motion.transition.swapaxes(-1, -2) @ ws,
            next_rows=-ws,
            border=motion.constants.swapaxes(-1, -2) @ ws,
            b=-applied(ws.swapaxes(-1, -2), motion_residual(motion, solution)),
            v=s.swapaxes(-1, -2) @ ws,
        )
    for name, s in signature.measurements.items():
        one = problem.measurement(name)
        assert one is not None
        ws = one.information[..., None] * s
        yield Factors(
            measured=name,
            keyframe=one.keyframe,
            start=one.t,
            stop=one.t,
            rows=one.states.swapaxes(-1, -2) @ ws,
            next_rows=None,
            border=one.constants.swapaxes(-1, -2) @ ws,
            b=applied(ws.swapaxes(-1, -2), measurement_residual(one, solution)),
            v=s.swapaxes(-1, -2) @ ws,
        )


def score(
    problem: Problem, solution: Solution, kind: Kind, shape: str, onset: Array, end: Array | None = None
) -> tuple[Array, Array] | None:
    """The gradient b (T, m) and the information V (T, m, m) of a kind and shape from onsets (T,) to ends (T,) s.

    Of D data sets, see `Solution.redrawn`, b is (T, m, D). None where the flight has nothing that it would change.
    """
    end = np.full(len(onset), np.inf) if end is None else end
    signature = kind.of(problem)
    if signature is None:
        return None
    factors = tuple(changed(problem, solution, signature))
    return _told(solution, factors, kind, shape, onset, end, max(num.WEIGH_MIN, num.WEIGH_SIZE // len(problem.t)))


def _told(
    solution: Solution, factors: Sequence[Factors], kind: Kind, shape: str, onset: Array, end: Array, together: int
) -> tuple[Array, Array]:
    """The gradient b (T, m) and the information V (T, m, m) of an explanation from onsets (T,) to ends (T,) s.

    Whatever lasts from a moment to another is the sum of what lasts between those that lie between them, so 49 pairs of
    7 onsets and 7 ends cost as much as 13 stretches. together: at most so many of these at a time.
    """
    moments = np.unique(np.concatenate((onset, end)))
    tries, pieces = len(onset), len(moments) - 1
    if pieces > together and tries > 1:
        halves = (
            _told(solution, factors, kind, shape, onset[part], end[part], together)
            for part in (slice(tries // 2), slice(tries // 2, None))
        )
        b, v = (np.concatenate(one) for one in zip(*halves, strict=True))
        return b, v
    within = ((moments[:-1] >= onset[:, None]) & (moments[1:] <= end[:, None])).astype(np.float64)  # (T, P)
    (count, states), m = solution.x.shape[:2], factors[0].b.shape[1]
    column = np.zeros((count, states, pieces, m))
    border = np.zeros((solution.border.shape[2], pieces, m))
    b, v = np.zeros((pieces, *factors[0].b.shape[1:])), np.zeros((tries, m, m))
    for one in factors:
        share = activation(kind.shape_at(one.measured, shape), moments[:-1], moments[1:], one.start, one.stop)
        b += np.tensordot(share, one.b, axes=1)
        v += np.tensordot((within @ share) ** 2, one.v, axes=1)
        border += np.tensordot(share, one.border, axes=1).swapaxes(0, 1)
        column[one.keyframe] += one.rows[:, :, None, :] * share.T[:, None, :, None]
        if one.next_rows is not None:
            column[one.keyframe + 1] += one.next_rows[:, :, None, :] * share.T[:, None, :, None]
    flat = column.reshape(count * states, pieces * m)
    solved = solution.factor.solve(flat.reshape(count, states, pieces * m)).reshape(flat.shape)
    rest = border.reshape(-1, pieces * m) - solution.border.reshape(count * states, -1).T @ flat
    made_up = (flat.T @ solved + rest.T @ (solution.constants_covariance @ rest)).reshape(pieces, m, pieces, m)
    crossed = np.tensordot(within, made_up, axes=1)  # (T, m, P, m)
    return np.tensordot(within, b, axes=1), v - np.einsum("tipj,tp->tij", crossed, within)
