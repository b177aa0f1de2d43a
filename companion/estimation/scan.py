"""Every explanation at once on a grid of onsets.

The flight is cut at some keyframes. Between two cuts every keyframe is eliminated, together with the columns of what
explanations would change in this stretch alone, evenly or growing (with the time since the cut). That leaves a small
system for the keyframes at the cuts, and the gradient b and information V of every column. A step, ramp, pulse or creep
between any two cuts is a sum of such columns, so its b and V are sums too.

Also here: score statistics of hypotheses at times between the cuts of the grid.

At the solution without a hypothesis, with b = Sᵀ W r and V = Sᵀ W S less what the states can make up for, twice the
logarithm of the likelihood ratio is bᵀ V⁻¹ b, and u = V⁻¹ b ± V⁻¹: none needs a smoother of its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from companion.constants import num
from companion.estimation.block_tridiagonal import crossed, factorise, gram, roots, scaled
from companion.estimation.hypotheses import HYPOTHESES, Hypothesis, Signature
from companion.estimation.model import VELOCITY
from companion.estimation.shapes import SLOPED, activation
from companion.estimation.system import Problem, Solution, applied, measurement_residual, motion_residual
from companion.model import Array, IntArray


def jumps(problem: Problem, hypothesis: Hypothesis) -> Array:
    """(J,) s: times at which the readings of an aiding sensor step against the estimate, the largest first."""
    signature = hypothesis.signature(problem)
    one = problem.measurement(next(iter(signature.measurements), "")) if signature is not None else None
    if one is None or len(one.t) < 10:
        return np.zeros(0)
    step = np.linalg.norm(np.diff(measurement_residual(one, problem.solution) / one.sigma, axis=0), axis=1)
    unusual = np.flatnonzero(step > num.JUMP_STEPS * np.median(step) + 1e-9)
    order = unusual[np.argsort(-step[unusual])][: num.MAX_JUMPS]
    return np.asarray(0.5 * (one.t[order] + one.t[order + 1]))


def velocity_impulses(problem: Problem) -> Array:
    """(J,) s: keyframes before which the velocity changes most beyond what the IMU felt, the most unlikely first."""
    e, d = problem.solution.disturbances
    e, d = e[:, VELOCITY], d[:, VELOCITY, VELOCITY]
    unlikely = np.einsum("ki,ki->k", e, np.linalg.solve(d + 1e-12 * np.eye(3), e[..., None])[..., 0])
    at = np.flatnonzero((unlikely >= np.roll(unlikely, 1)) & (unlikely >= np.roll(unlikely, -1)))
    return np.asarray(problem.t[at[np.argsort(-unlikely[at])][: num.MAX_JUMPS]] + 1e-3)


@dataclass(frozen=True, slots=True, eq=False)
class Factors:
    """N factors that an explanation of m unknowns changes, and how, fully at work."""

    measured: str  # empty for the motion
    keyframe: IntArray  # (N,) that each of them sees, of the motion the first of two
    start: Array  # (N,) s
    stop: Array  # (N,) s, the same for a reading
    rows: Array  # (N, 15, m) what couples the unknowns to the states
    next_rows: Array | None  # (N, 15, m) and to those of the keyframe after
    border: Array  # (N, C, m) and to the constants
    b: Array  # (N, m); of D data sets (N, m, D)
    v: Array  # (N, m, m)


def changed(problem: Problem, signature: Signature) -> Iterator[Factors]:
    """The factors that a signature changes."""
    motion, solution = problem.motion, problem.solution

    def of(measured: str, keyframe: IntArray, times: tuple[Array, Array], jacobians: tuple[Array, Array], s: Array,
           ws: Array, left: Array, next_rows: Array | None = None) -> Factors:  # fmt: skip
        rows, border = (one.swapaxes(-1, -2) @ ws for one in jacobians)
        return Factors(measured, keyframe, *times, rows, next_rows, border, applied(ws.swapaxes(-1, -2), left),
                       s.swapaxes(-1, -2) @ ws)  # fmt: skip

    if (s := signature.motion) is not None:
        ws, jacobians = motion.weight @ s, (motion.transition, motion.constants)
        between = problem.t[:-1], problem.t[1:]
        yield of("", np.arange(len(s)), between, jacobians, s, ws, -motion_residual(motion, solution), -ws)
    for name, s in signature.measurements.items():
        one = problem.measurement(name)
        assert one is not None
        ws, jacobians = one.information[..., None] * s, (one.states, one.constants)
        yield of(name, one.keyframe, (one.t, one.t), jacobians, s, ws, measurement_residual(one, solution))


def score(
    problem: Problem, hypothesis: Hypothesis, shape: str, onset: Array, end: Array | None = None
) -> tuple[Array, Array] | None:
    """The gradient b (T, m) and the information V (T, m, m) of a kind and shape from onsets (T,) to ends (T,) s.

    Of D data sets, see `Solution.redrawn`, b is (T, m, D). None where the flight has nothing that it would change.
    """
    end = np.full(len(onset), np.inf) if end is None else end
    signature = hypothesis.of(problem)
    if signature is None:
        return None
    factors = tuple(changed(problem, signature))
    together = max(num.WEIGH_MIN, num.WEIGH_SIZE // (len(problem.t) * signature.unknowns))
    return _gradient_and_information(problem.solution, factors, hypothesis, shape, onset, end, together)


def _gradient_and_information(
    solution: Solution,
    factors: Sequence[Factors],
    hypothesis: Hypothesis,
    shape: str,
    onset: Array,
    end: Array,
    together: int,
) -> tuple[Array, Array]:
    """The gradient b (T, m) and the information V (T, m, m) of an explanation from onsets (T,) to ends (T,) s.

    Whatever lasts from a moment to another is the sum of what lasts between those that lie between them, so 49 pairs of
    7 onsets and 7 ends cost as much as 13 stretches. together: at most so many of these at a time.
    """
    moments = np.unique(np.concatenate((onset, end)))
    tries, pieces = len(onset), len(moments) - 1
    if pieces > together and tries > 1:
        halves = (
            _gradient_and_information(solution, factors, hypothesis, shape, onset[part], end[part], together)
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
        share = activation(hypothesis.shape_at(one.measured, shape), moments[:-1], moments[1:], one.start, one.stop)
        b += np.tensordot(share, one.b, axes=1)
        v += np.tensordot((within @ share) ** 2, one.v, axes=1)
        border += np.tensordot(share, one.border, axes=1).swapaxes(0, 1)
        for piece, own in enumerate(share):
            some = np.flatnonzero(own)
            part, keyframe = own[some, None, None], one.keyframe[some]
            column[keyframe, :, piece] += one.rows[some] * part
            if one.next_rows is not None:
                column[keyframe + 1, :, piece] += one.next_rows[some] * part
    flat = column.reshape(count, states, pieces * m)
    rest = border.reshape(-1, pieces * m) - crossed(solution.border, flat)
    made_up = solution.factor.product(flat) + rest.T @ (solution.constants_covariance @ rest)
    beside = np.tensordot(within, made_up.reshape(pieces, m, pieces, m), axes=1)  # (T, m, P, m)
    return np.tensordot(within, b, axes=1), v - np.einsum("tipj,tp->tij", beside, within)


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """What every kind's columns say: S stretches, G columns for each of its m unknowns."""

    problem: Problem
    cuts: Array  # (S,) s, where stretches begin
    columns: Mapping[Hypothesis, tuple[Array, Array]]  # b (S, G, m) or (S, G, m, D), and V (S, G, m, S, G, m)

    def score(
        self, row: Hypothesis, shape: str, onset: IntArray, end: IntArray | None = None
    ) -> tuple[Array, Array] | None:
        """Gradient b (T, m) and information V (T, m, m) of a hypothesis and shape between cuts, by their numbers (T,).

        Of D data sets b is (T, m, D). None where the flight has nothing that it would change.
        """
        if row not in self.columns or not len(onset):
            return None
        end = np.full(len(onset), len(self.cuts)) if end is None else end
        b, v = self.columns[row]
        groups = [self._shares(row.shape_at(group, shape), onset, end) for group in ("", *row.integrated[:1])]
        share = np.concatenate([one[:, :, : row.basis_order] for one in groups], axis=2).reshape(len(onset), -1)
        m = b.shape[2]
        beside = (share @ v.reshape(share.shape[1], -1)).reshape(len(onset), m, -1, m)
        return np.tensordot(share, b.reshape(-1, *b.shape[2:]), axes=1), np.einsum("tmqn,tq->tmn", beside, share)

    def _shares(self, shape: str, onset: IntArray, end: IntArray) -> Array:
        """(T, S, 2) how much of the even and of the growing column of every stretch a shape has."""
        stretch, cuts = np.arange(len(self.cuts)), self.cuts
        begun, ended = stretch >= onset[:, None], stretch >= end[:, None]
        activation = (begun & ~ended).astype(np.float64)
        if shape not in SLOPED:
            return np.stack((activation, np.zeros_like(activation)), axis=2)
        reached = np.minimum(cuts, np.append(cuts, np.inf)[end][:, None]) - cuts[onset][:, None]
        return np.stack((begun * reached, activation), axis=2)


def scan(problem: Problem, stretches: int, hypotheses: Sequence[Hypothesis] = HYPOTHESES) -> Scan:
    """The hypotheses that the flight has something to say of, between cuts into at most so many stretches."""
    length = -(-len(problem.t) // stretches)
    cuts = problem.t[::length]
    signatures = [(hypothesis, whole) for hypothesis in hypotheses if (whole := hypothesis.of(problem)) is not None]
    columns: dict[Hypothesis, tuple[Array, Array]] = {}
    together = max(num.SCAN_MIN_KINDS, num.SCAN_SIZE // len(problem.t))
    for first in range(0, len(signatures), together):
        columns |= _columns_of(problem, cuts, length, dict(signatures[first : first + together]))
    return Scan(problem, cuts, columns)


def _columns_of(
    problem: Problem, cuts: Array, length: int, signatures: Mapping[Hypothesis, Signature]
) -> dict[Hypothesis, tuple[Array, Array]]:
    """The columns of some kinds; cuts (S,) s, the beginnings of stretches of so many keyframes."""
    solution = problem.solution
    columns = {hypothesis: (1 + bool(hypothesis.integrated)) * hypothesis.basis_order for hypothesis in signatures}
    stack = _Stack.empty(len(cuts), length, sum(columns[k] * s.unknowns for k, s in signatures.items()), solution)
    places, at = {}, 0
    for hypothesis, whole in signatures.items():
        m = whole.unknowns
        for factors in changed(problem, whole):
            beyond = hypothesis.basis_order * m * (factors.measured in hypothesis.integrated)
            stack.add(factors, cuts, at + beyond, hypothesis.basis_order)
        places[hypothesis] = slice(at, at + columns[hypothesis] * m)
        at = places[hypothesis].stop
    beside = stack.beside_constants(solution)
    inside, at_cuts, inverse = _eliminated(solution, stack, places.values())
    known = solution.constants_covariance
    out = {}
    for (hypothesis, place), taken in zip(places.items(), inside, strict=True):
        r, own = at_cuts[:, :, place], beside[:, :, place]
        v = -(r.swapaxes(-1, -2)[:, None] @ (inverse @ r[None]))  # (S, S, p, p)
        v -= own.swapaxes(-1, -2)[:, None] @ (known @ own)[None]
        each = np.arange(len(cuts))
        v[each, each] += stack.v[:, place, place] - taken
        shape = (len(cuts), columns[hypothesis], -1)
        m = signatures[hypothesis].unknowns
        both = v.transpose(0, 2, 1, 3).reshape(*shape[:2], m, *shape[:2], m)
        out[hypothesis] = stack.b[:, place].reshape(*shape[:2], m, *stack.b.shape[2:]), both
    return out


@dataclass(frozen=True, slots=True, eq=False)
class _Stack:
    """The columns of all kinds side by side, p of them, each repeated in every stretch of L keyframes."""

    own: Array  # (S L, n, p) at the keyframes of the stretch
    last: Array  # (S, n, p) at the keyframe with which the next one begins
    border: Array  # (S, C, p) beside the constants
    b: Array  # (S, p); of D data sets (S, p, D)
    v: Array  # (S, p, p) of the factors themselves

    @classmethod
    def empty(cls, stretches: int, length: int, width: int, solution: Solution) -> _Stack:
        """Columns that change nothing."""
        states = solution.x.shape[1]
        return cls(
            np.zeros((stretches * length, states, width)),
            np.zeros((stretches, states, width)),
            np.zeros((stretches, solution.border.shape[2], width)),
            np.zeros((stretches, width, *solution.x.shape[2:])),
            np.zeros((stretches, width, width)),
        )

    def add(self, factors: Factors, cuts: Array, at: int, basis_order: int) -> None:
        """Columns that change some factors, from place `at` on: evenly, and growing where there are two moments."""
        m, length = factors.rows.shape[2], len(self.own) // len(cuts)
        stretch = factors.keyframe // length
        among = (stretch == np.arange(len(cuts))[:, None]).astype(np.float64)
        since = 0.5 * (factors.start + factors.stop) - cuts[stretch]
        final = (factors.keyframe + 1) % length == 0
        for one in range(basis_order):
            here, share = slice(at + one * m, at + (one + 1) * m), since**one
            self.own[factors.keyframe, :, here] += factors.rows * share[:, None, None]
            if factors.next_rows is not None:
                beyond = factors.next_rows * share[:, None, None]
                self.own[factors.keyframe[~final] + 1, :, here] += beyond[~final]
                self.last[stretch[final], :, here] += beyond[final]
            self.border[:, :, here] += np.tensordot(among * share, factors.border, axes=1)
            self.b[:, here] += np.tensordot(among * share, factors.b, axes=1)
            for other in range(basis_order):
                there = slice(at + other * m, at + (other + 1) * m)
                self.v[:, here, there] += np.tensordot(among * share * since**other, factors.v, axes=1)

    def beside_constants(self, solution: Solution) -> Array:
        """(S, C, p) what the columns say of the constants, the states being free."""
        y, length = solution.border, len(self.own) // len(self.last)
        out = self.border.copy()
        for stretch, first in enumerate(range(0, len(y), length)):
            within = y[first : first + length]
            out[stretch] -= np.tensordot(within, self.own[first : first + len(within)], axes=((0, 1), (0, 1)))
        after = y[length::length]
        out[: len(after)] -= after.swapaxes(-1, -2) @ self.last[: len(after)]
        return out


def _eliminated(solution: Solution, stack: _Stack, places: Iterable[slice]) -> tuple[list[Array], Array, Array]:
    """What eliminating the keyframes inside every stretch takes from the information (S, p, p) of columns in places.

    And what it leaves of the columns (S, 2 n, p), at the first keyframe of the stretch and at that of the next, and the
    inverse (S, S, 2 n, 2 n) of the system of those keyframes. The columns are used up: they are of no use any more.
    """
    count, (_, width) = len(stack.last), stack.last.shape[1:]
    length = len(stack.own) // count
    states = solution.x.shape[1]
    s = np.ones((count * length + 1, states))
    s[: len(solution.factor.scale)] = solution.factor.scale
    stack.own[:] /= s[:-1, :, None]
    r, last = stack.own.reshape(count, length, states, width), stack.last / s[length::length, :, None]
    d_0, u_0 = _blocks(solution, s, 0, length)
    first, after, columns = slice(0, states), slice(states, 2 * states), slice(2 * states, None)
    total = np.zeros((count, states, 2 * states + width))
    # what is still to be eliminated: its coupling to the first keyframe, itself, and the columns
    to_first, own, column = u_0.swapaxes(-1, -2), np.zeros_like(d_0), np.zeros_like(last)
    for k in range(1, length):
        d, u = _blocks(solution, s, k, length)
        beside = roots(d + own) @ np.concatenate((to_first, u, r[:, k] + column), axis=2)
        taken = beside[:, :, : 2 * states].swapaxes(-1, -2) @ beside
        total += taken[:, first]
        to_first, own, column = -taken[:, after, first], -taken[:, after, after], -taken[:, after, columns]
        r[:, k] = beside[:, :, columns]
    inside = r[:, 1:].reshape(count, -1, width)
    squares = [gram(inside[:, :, place]) for place in places]
    diagonal = np.concatenate((d_0 - total[:, :, first], np.eye(states)[None]))
    diagonal[1:] += own
    left = np.concatenate((r[:, 0] - total[:, :, columns], last + column), axis=1)
    return squares, left, _inverse(diagonal, to_first.swapaxes(-1, -2))


def _inverse(diagonal: Array, upper: Array) -> Array:
    """(S, S, 2n, 2n) of the inverse of S + 1 block-tridiagonal blocks of n, the parts of every two neighbours."""
    count, n = diagonal.shape[:2]
    every = np.eye(count * n).reshape(count, n, count * n)
    inverse = factorise(diagonal, upper).solve(every).reshape(count * n, count * n)
    return sliding_window_view(inverse, (2 * n, 2 * n))[::n, ::n]


def _blocks(solution: Solution, s: Array, k: int, length: int) -> tuple[Array, Array]:
    """Of the keyframe of number k in each of the S stretches of so many: its diagonal block and the one right of it.

    (S, n, n), divided by their scales s (S L + 1, n). After the last keyframe stand some that nothing is said of.
    """
    here, after = s[:-1][k::length], s[1:][k::length]
    states = s.shape[1]
    d, u = np.tile(np.eye(states), (len(here), 1, 1)), np.zeros((len(here), states, states))
    motion = solution.motion
    right = -(motion.weight[k::length] @ motion.transition[k::length]).swapaxes(-1, -2)
    for out, blocks, columns in ((d, solution.diagonal[k::length], here), (u, right, after)):
        some = slice(len(blocks))
        scaled(blocks, here[some], columns[some], out=out[some])
    return d, u
