"""The linear system of the smoother: keyframes in a chain, the constants of the flight beside them.

Every piece of knowledge is a factor: a residual `r + J x` with a covariance. The IMU joins neighbouring keyframes
(x_{k+1} = Φ x_k + G c + r + noise), a measurement sees one keyframe and the constants, a prior sees one of them. The
sum of all squared residuals is least where A x + B c = b and Bᵀ x + C c = b_c: A is block-tridiagonal, and the border
(B, C) is eliminated by its Schur complement.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from companion.constants import num
from companion.estimation.block_tridiagonal import Factor, crossed, factorise, gram, roots
from companion.model import Array, IntArray

if TYPE_CHECKING:
    from companion.estimation.differences import Differences
    from companion.estimation.model import ProcessNoise, States
    from companion.noise import Aliased


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """What the IMU says between neighbouring keyframes: residual = r + Φ x_k + G c - x_{k+1}."""

    residual: Array  # (K-1, n) predicted less nominal
    transition: Array  # (K-1, n, n) Φ
    constants: Array  # (K-1, n, C) G
    weight: Array  # (K-1, n, n) inverse of the process noise Q


@dataclass(frozen=True, slots=True, eq=False)
class Measurement:
    """M readings of one aiding sensor: residual = r - H x_k - H_c c."""

    name: str
    t: Array  # (M,) s, of the readings
    keyframe: IntArray  # (M,), each once
    residual: Array  # (M, d) measured less what the nominal states predict
    states: Array  # (M, d, n) H
    constants: Array  # (M, d, C) H_c
    sigma: Array  # (M, d) 1σ, with the learned scale; robust weights not in it
    weight: Array  # (M,) robust, 1 for what is believed
    unit: str = ""

    @property
    def information(self) -> Array:
        """(M, d) the inverse variances."""
        return np.asarray(self.weight[:, None] / self.sigma**2)


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """What is believed beforehand about the first keyframe and the constants: residual = r - x."""

    residual: Array  # (n,)
    sigma: Array  # (n,)
    constants_residual: Array  # (C,)
    constants_sigma: Array  # (C,)


@dataclass(frozen=True, eq=False)
class Problem:
    """The problem made linear about the present states, and its solution, which is made when it is asked for."""

    t: Array  # (K,) s
    states: States  # about which
    gravity: float  # m/s²
    motion: Motion
    measurements: tuple[Measurement, ...]
    prior: Prior
    noise: ProcessNoise  # that the motion is made of
    turn: Array  # (K-1, 3, 3) from the frame of the sums to NED
    sums: Mapping[str, Array]  # cause → (K-1, n, n) of MOVED in the frame of the sums, per squared density
    variance: Array  # (K-1, 15) of the process noise in the frame of the sums
    aliased: Mapping[str, Aliased]  # kind → what motion faster than the sampling may read like
    others: tuple[Differences, ...]  # what the other IMUs read more
    shock_rate: Array  # (K-1, 2) see `Setup`
    relative_noise: Array  # (K-1, 2) by which gyro and accelerometer scatter more in an interval, see `Setup`

    @cached_property
    def solution(self) -> Solution:
        """Raises numpy.linalg.LinAlgError where something is not determined by any factor."""
        return solve(len(self.t), self.motion, self.measurements, self.prior)

    def measurement(self, name: str) -> Measurement | None:
        """The measurements of an aiding sensor."""
        return next((one for one in self.measurements if one.name == name), None)

    def well_observed(self, name: str) -> Measurement | None:
        """The same of an aiding sensor that was heard often enough to show a change; None otherwise."""
        one = self.measurement(name)
        return one if one is not None and len(one.t) >= num.KIND_MIN_READINGS else None

    def with_residuals(
        self, motion: Array, measured: Iterable[Array], prior: tuple[Array, ...], apart: Iterable[Mapping[str, Array]]
    ) -> Problem:
        """N data sets: of motion (K-1, n, N), each sensor (M, d, N), states (n, N), constants (C, N), other IMUs."""
        read, others = zip(self.measurements, measured, strict=True), zip(self.others, apart, strict=True)
        return replace(
            self,
            motion=replace(self.motion, residual=motion),
            measurements=tuple(replace(one, residual=own) for one, own in read),
            prior=replace(self.prior, residual=prior[0], constants_residual=prior[1]),
            others=tuple(replace(one, value=own) for one, own in others),
        )

    def drawn(self, rng: np.random.Generator, count: int) -> Problem:
        """Data sets of the noise of motion and aiding sensors, the first keyframe and the constants as believed."""
        weight, prior = self.motion.weight, self.prior
        motion = roots(weight).swapaxes(-1, -2) @ rng.standard_normal((*weight.shape[:2], count))
        measured = [
            rng.standard_normal((*one.residual.shape, count)) / np.sqrt(np.maximum(one.information, 1e-300))[..., None]
            for one in self.measurements
        ]
        nothing = np.zeros((len(prior.sigma), count)), np.zeros((len(prior.constants_sigma), count))
        return self.with_residuals(motion, measured, nothing, [one.value for one in self.others])


@dataclass(frozen=True, eq=False)
class Solution:
    """The least-squares solution, and what is needed to ask it further questions."""

    motion: Motion
    diagonal: Array  # (K, n, n) blocks of A; those right of them are -(W Φ)'
    factor: Factor
    x: Array  # (K, n)
    c: Array  # (C,)
    border: Array  # (K, n, C) Y = A⁻¹ B
    constants_covariance: Array  # (C, C)

    @property
    def marginals(self) -> Array:
        """(K, n, n) blocks of A⁻¹ on the diagonal: the covariances of the keyframes, the constants known."""
        return self._inverted[0]

    @property
    def disturbances(self) -> tuple[Array, Array]:
        """e (K-1, n) and D (K-1, n, n): the smoothed disturbance of every interval, and its variance.

        Of N data sets e is (K-1, n, N).

        e = W r̂, D = W - W cov(r̂) W. A shock u to the states at the end of an interval would raise twice the logarithm
        of the likelihood by e' D⁻¹ e, and its size is D⁻¹ e, of the components that it moves (de Jong, Penzer 1998).
        """
        return self._inverted[1:]

    @cached_property
    def _inverted(self) -> tuple[Array, Array, Array]:
        """Both, together: the blocks beside the diagonal are let go at once."""
        blocks = self.factor.inverse_blocks()
        w = self.motion.weight
        e = applied(w, motion_residual(self.motion, self))
        d = np.empty_like(w)
        for first in range(0, len(w), num.BATCH):
            part = slice(first, first + num.BATCH)
            d[part] = w[part] - w[part] @ motion_residual_covariance(self.motion, self, blocks, part) @ w[part]
        own, left = np.diagonal(w, axis1=1, axis2=2), np.diagonal(d, axis1=1, axis2=2)
        known = (left > num.ROUNDING * own).astype(np.float64)  # else nothing but rounding is left of the difference
        d *= known[:, :, None]
        d *= known[:, None, :]
        return blocks[0], e * known.reshape(*known.shape, *[1] * (e.ndim - 2)), d

    def redrawn(self, other: Problem) -> Solution:
        """That of N data sets, other residuals of the same problem: x (K, n, N) and c (C, N)."""
        prior, weighted = other.prior, other.motion.weight @ other.motion.residual
        rhs = np.zeros((*self.x.shape, weighted.shape[-1]))
        rhs[0] = prior.residual / prior.sigma[:, None] ** 2
        inner = prior.constants_residual / prior.constants_sigma[:, None] ** 2
        rhs[:-1] -= other.motion.transition.swapaxes(-1, -2) @ weighted
        rhs[1:] += weighted
        inner -= np.tensordot(other.motion.constants, weighted, axes=((0, 1), (0, 1)))
        for one in other.measurements:
            own = one.information[..., None] * one.residual
            rhs[one.keyframe] += one.states.swapaxes(-1, -2) @ own  # each keyframe once
            inner += np.tensordot(one.constants, own, axes=((0, 1), (0, 1)))
        border = self.border
        c = self.constants_covariance @ (inner - np.tensordot(border, rhs, axes=((0, 1), (0, 1))))
        return replace(self, motion=other.motion, x=self.factor.solve(rhs) - border @ c, c=c)

    def covariances(self) -> Array:
        """Covariance (K, n, n) of every keyframe, the constants unknown."""
        out = self.marginals.copy()
        for first in range(0, len(out), num.BATCH):
            y = self.border[first : first + num.BATCH]
            out[first : first + num.BATCH] += _times(y, self.constants_covariance) @ y.swapaxes(-1, -2)
        return out


def solve(count: int, motion: Motion, measurements: Sequence[Measurement], prior: Prior) -> Solution:
    """The errors x of the `count` keyframes and c of the constants that fit all factors best.

    Raises numpy.linalg.LinAlgError where something is not determined by any factor.
    """
    constants, states = len(prior.constants_sigma), len(prior.sigma)
    diagonal = np.zeros((count, states, states))
    border = np.zeros((count, states, constants + 1))  # B, and beside it the right-hand side
    inner = np.zeros((constants, constants + 1))
    inner[:, :-1] = np.diag(prior.constants_sigma**-2.0)
    inner[:, -1] = prior.constants_residual * prior.constants_sigma**-2.0
    diagonal[0] += np.diag(prior.sigma**-2.0)
    border[0, :, -1] += prior.residual * prior.sigma**-2.0

    upper = np.empty((max(count - 1, 0), states, states))
    for first in range(0, count, num.BATCH):
        own, after = slice(first, min(first + num.BATCH, count - 1)), slice(first + 1, first + 1 + num.BATCH)
        phi, weight = motion.transition[own], motion.weight[own]
        beside = np.concatenate((motion.constants[own], -motion.residual[own, :, None]), axis=2)
        weighted, weighted_beside = weight @ phi, weight @ beside
        diagonal[own] += phi.swapaxes(-1, -2) @ weighted
        diagonal[after] += weight
        border[own] += phi.swapaxes(-1, -2) @ weighted_beside
        border[after] -= weighted_beside
        inner += crossed(beside, weighted_beside)[:-1]
        upper[own] = -weighted.swapaxes(-1, -2)

        own = slice(first, min(first + num.BATCH, count))
        h, beside = _whitened(own, measurements, states, constants)
        diagonal[own] += gram(h)
        border[own] += h.swapaxes(-1, -2) @ beside
        inner += crossed(beside, beside)[:-1]

    factor = factorise(diagonal, upper)
    del upper
    solved = factor.solve(border)
    y, x0 = solved[..., :-1], solved[..., -1]
    inner -= crossed(border, solved)[:-1]
    schur, b_c = inner[:, :-1], inner[:, -1]
    covariance = np.asarray(np.linalg.inv(0.5 * (schur + schur.T)), np.float64)
    c = covariance @ b_c
    return Solution(motion, diagonal, factor, x0 - y @ c, c, y, covariance)


def _whitened(own: slice, measurements: Sequence[Measurement], states: int, constants: int) -> tuple[Array, Array]:
    """H (k, D, n), and H_c with r (k, D, C + 1), of all aiding sensors at some keyframes, by σ; zero for no reading.

    An aiding sensor has one reading at a keyframe, and its keyframes ascend.
    """
    shape = own.stop - own.start, sum(one.residual.shape[1] for one in measurements)
    h, beside = np.zeros((*shape, states)), np.zeros((*shape, constants + 1))
    at = 0
    for one in measurements:
        part = slice(*np.searchsorted(one.keyframe, (own.start, own.stop)).tolist())
        root = np.sqrt(one.weight[part, None]) / one.sigma[part]
        place, here = slice(at, at + root.shape[1]), one.keyframe[part] - own.start
        h[here, place] = one.states[part] * root[..., None]
        beside[here, place, :-1] = one.constants[part] * root[..., None]
        beside[here, place, -1] = one.residual[part] * root
        at = place.stop
    return h, beside


def _times(a: Array, b: Array) -> Array:
    """a @ b of a (K, n, i) and one b (i, j), as one product."""
    return np.asarray((a.reshape(-1, a.shape[2]) @ b).reshape(*a.shape[:2], -1))


def applied(blocks: Array, x: Array) -> Array:
    """(K, i) products of blocks (K, i, j) and x (K, j); of N data sets at once, (K, j, N), (K, i, N)."""
    return np.asarray(blocks @ x if x.ndim > 2 else (blocks @ x[..., None])[..., 0])


def motion_residual(motion: Motion, solution: Solution) -> Array:
    """(K-1, n) what the solution leaves of the motion factors; of N data sets (K-1, n, N)."""
    return np.asarray(
        motion.residual + applied(motion.transition, solution.x[:-1]) + motion.constants @ solution.c - solution.x[1:]
    )


def measurement_residual(one: Measurement, solution: Solution) -> Array:
    """(M, d) what the solution leaves of an aiding sensor; of N data sets (M, d, N)."""
    return np.asarray(one.residual - applied(one.states, solution.x[one.keyframe]) - one.constants @ solution.c)


def squares(motion: Array, weight: Array, measured: Iterable[tuple[Array, Array]]) -> float:
    """The sum of the squares of residuals, each divided by its σ.

    motion (K-1, n) with weight (K-1, n, n); measured: residuals (M, d) of an aiding sensor and their inverse variances.
    """
    total = float(((weight @ motion[..., None])[..., 0] * motion).sum())
    return total + sum(float((left**2 * information).sum()) for left, information in measured)


def misfit(problem: Problem) -> float:
    """The sum of the squares of all that the solution leaves, each divided by its σ; priors left out."""
    measured = ((measurement_residual(one, problem.solution), one.information) for one in problem.measurements)
    return squares(motion_residual(problem.motion, problem.solution), problem.motion.weight, measured)


def motion_residual_covariance(motion: Motion, solution: Solution, blocks: tuple[Array, Array], part: slice) -> Array:
    """(K-1, n, n) posterior covariance of r + Φ x_k + G c - x_{k+1}, of some of the intervals.

    blocks: of A⁻¹, as `Factor.inverse_blocks` gives them.
    """
    own, beside = blocks
    phi = motion.transition[part]
    cross = phi @ beside[part]
    chain = phi @ own[:-1][part] @ phi.swapaxes(-1, -2) - cross - cross.swapaxes(-1, -2) + own[1:][part]
    y = solution.border
    constants = motion.constants[part] - phi @ y[:-1][part] + y[1:][part]
    return np.asarray(chain + _times(constants, solution.constants_covariance) @ constants.swapaxes(-1, -2))


def measurement_variance(one: Measurement, solution: Solution) -> Array:
    """(M, d) variance of the posterior of every component of H x + H_c c."""
    own = solution.marginals
    variance = np.empty(one.residual.shape)
    for first in range(0, len(variance), num.BATCH):
        part = slice(first, first + num.BATCH)
        h, k = one.states[part], one.keyframe[part]
        constants = one.constants[part] - h @ solution.border[k]
        variance[part] = np.einsum("kij,kij->ki", h @ own[k], h)
        variance[part] += np.einsum("kij,kij->ki", _times(constants, solution.constants_covariance), constants)
    return variance
