"""Symmetric positive definite block-tridiagonal systems by odd-even (cyclic) reduction, all blocks of a level at once.

Every second unknown is eliminated, which leaves a system of the same kind of half the size; so K blocks need log₂ K
steps of array arithmetic and no loop over blocks. Going back up gives the solution and the blocks of the inverse on the
diagonal and beside it, the marginal covariances. Sources: G. H. Golub and C. F. Van Loan, Matrix Computations, §4.5;
K. Takahashi et al. (1973) for the inverse on the pattern of the matrix.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from companion.constants import num
from companion.model import Array


@dataclass(frozen=True, slots=True, eq=False)
class _Level:
    """What eliminating the odd blocks of one level leaves behind. K blocks, of which M = K // 2 are odd."""

    inverse: Array  # (M, n, n) of the diagonal blocks that were eliminated
    left: Array  # (M, n, n) inverse times the coupling to the block before
    right: Array  # (M, n, n) and to the one after; the last is zero where there is none

    def parts(self, even: int) -> Iterator[tuple[slice, slice, slice]]:
        """Odd blocks that stay in cache together, those with a block after them, and these, of `even` in all."""
        for first in range(0, len(self.left), num.CACHED_BLOCKS):
            last = min(first + num.CACHED_BLOCKS, len(self.left))
            joined = min(last, even - 1)
            yield slice(first, last), slice(first, joined), slice(first + 1, joined + 1)

    def eliminate(self, odd: Array, even: Array) -> None:
        """Take out of the even rows (of some right-hand sides) what the odd ones say; in place."""
        for part, joined, after in self.parts(len(even)):
            even[part] -= self.left[part].swapaxes(-1, -2) @ odd[part]
            even[after] -= self.right[joined].swapaxes(-1, -2) @ odd[joined]


@dataclass(frozen=True, slots=True, eq=False)
class Factor:
    """A factorised block-tridiagonal matrix A of K blocks of n."""

    levels: Sequence[_Level]
    last: Array  # (1, n, n) inverse of what remains
    scale: Array  # (K, n) the unknowns' scale: A was divided by it on both sides

    def solve(self, rhs: Array) -> Array:
        """x (K, n, m) with A x = rhs (K, n, m)."""
        scale = (1.0 / self.scale)[..., None]
        x = rhs * scale
        views = [x]  # every level's part of the same memory, in which first the right-hand side stands
        for level in self.levels:
            odd, even = views[-1][1::2], views[-1][0::2]
            level.eliminate(odd, even)
            views.append(even)
        views[-1][:] = self.last @ views[-1]
        for level, view in zip(reversed(self.levels), reversed(views[:-1]), strict=True):
            odd, even = view[1::2], view[0::2]
            for part, joined, after in level.parts(len(even)):
                odd[part] = level.inverse[part] @ odd[part]
                odd[part] -= level.left[part] @ even[part]
                odd[joined] -= level.right[joined] @ even[after]
        x *= scale
        return x

    def product(self, x: Array) -> Array:
        """(m, m) of xᵀ A⁻¹ x, x (K, n, m), summed over all unknowns: half a solution tells it."""
        even = x * (1.0 / self.scale)[..., None]
        out = np.zeros((x.shape[2], x.shape[2]))
        for level in self.levels:
            odd, even = even[1::2], even[0::2]
            level.eliminate(odd, even)
            out += sum(crossed(odd[part], level.inverse[part] @ odd[part]) for part, _, _ in level.parts(len(even)))
        return out + crossed(even, self.last @ even)

    def inverse_blocks(self) -> tuple[Array, Array]:
        """The blocks (K, n, n) on the diagonal of A⁻¹ and (K-1, n, n) right of it: [k, k] and [k, k + 1]."""
        n = self.scale.shape[1]
        diagonal, beside = self.last.copy(), np.zeros((0, n, n))
        for level in reversed(self.levels):
            odd, even = len(level.left), len(diagonal)
            wider, between = np.empty((odd + even, n, n)), np.empty((odd + even - 1, n, n))
            wider[0::2] = diagonal
            for part, joined, after in level.parts(even):
                left, right, there = level.left[part], level.right[part], joined.stop - joined.start
                cross, next_one = np.zeros((2, *left.shape))  # the last odd block may have no neighbour after it
                cross[:there], next_one[:there] = beside[joined], diagonal[after]
                to_left = -(left @ diagonal[part] + right @ cross.swapaxes(-1, -2))
                to_right = -(left @ cross + right @ next_one)
                own = level.inverse[part] - to_left @ left.swapaxes(-1, -2) - to_right @ right.swapaxes(-1, -2)
                wider[1::2][part] = own
                between[0::2][part] = to_left.swapaxes(-1, -2)
                between[1::2][joined] = to_right[:there]
            diagonal, beside = wider, between
        s = self.scale
        return scaled(diagonal, s, s, out=diagonal), scaled(beside, s[:-1], s[1:], out=beside)


def factorise(diagonal: Array, upper: Array) -> Factor:
    """The matrix with blocks diagonal (K, n, n) and upper (K-1, n, n), the block [k, k + 1], in factors.

    Raises numpy.linalg.LinAlgError where the matrix is not positive definite.
    """
    scale = np.sqrt(np.diagonal(diagonal, axis1=1, axis2=2))
    if not (np.isfinite(scale).all() and (scale > 0).all()):
        raise np.linalg.LinAlgError("the matrix is not positive definite: an unknown is not determined by anything")
    d = scaled(diagonal, scale, scale)
    u = scaled(upper, scale[:-1], scale[1:])
    levels: list[_Level] = []
    while len(d) > 1:
        odd, even = d[1::2], d[0::2].copy()
        before, after = u[0::2], np.zeros_like(odd)  # couplings [k - 1, k] and [k, k + 1] of every odd k
        after[: len(u) // 2] = u[1::2]
        inverse = inverses(odd)
        left, right = inverse @ before.swapaxes(-1, -2), inverse @ after
        even[: len(odd)] -= before @ left
        even[1:] -= (after.swapaxes(-1, -2) @ right)[: len(even) - 1]
        u = -(before @ right)[: len(even) - 1]
        d = even
        levels.append(_Level(inverse, left, right))
    return Factor(levels, inverses(d), scale)


def crossed(a: Array, b: Array) -> Array:
    """Σ over k of a_kᵀ b_k: a (K, n, i), b (K, n, j), the sum (i, j)."""
    return np.asarray(a.reshape(-1, a.shape[2]).T @ b.reshape(-1, b.shape[2]))


def scaled(blocks: Array, rows: Array, columns: Array, out: Array | None = None) -> Array:
    """Blocks (K, n, n) divided by scales (K, n) of their rows and columns, into `out` where it is given."""
    out = np.multiply(blocks, (1.0 / rows)[:, :, None], out=out)
    out *= (1.0 / columns)[:, None, :]
    return out


def inverses(blocks: Array) -> Array:
    """Inverses of positive definite blocks (M, n, n), by their roots: symmetric and positive definite too.

    Raises numpy.linalg.LinAlgError for what is not positive definite.
    """
    return gram(roots(blocks))


def gram(blocks: Array) -> Array:
    """The Gram matrices aᵀ a (M, n, n) of each of blocks (M, i, n)."""
    return np.asarray(blocks.swapaxes(-1, -2) @ blocks.copy())  # of one array with itself numpy takes twice as long


def roots(blocks: Array) -> Array:
    """R (M, n, n) with Rᵀ R the inverses of positive definite blocks (M, n, n).

    Raises numpy.linalg.LinAlgError for what is not positive definite.
    """
    for rounding in num.DIAGONAL_LOADING:  # the diagonal is about 1, and what is not observed is next to nothing
        with contextlib.suppress(np.linalg.LinAlgError):
            lower = np.linalg.cholesky(blocks + rounding * np.eye(blocks.shape[-1]))
            return _lower_inverses(np.asarray(lower, np.float64))
    raise np.linalg.LinAlgError("the matrix is not positive definite")


def _lower_inverses(lower: Array) -> Array:
    """Inverses of lower triangular blocks (M, n, n), by forward substitution of all blocks at once."""
    if len(lower) < num.SHORT_CHAIN_BLOCKS:
        return np.asarray(np.linalg.inv(lower))
    out = np.empty_like(lower)
    for first in range(0, len(lower), num.CACHED_BLOCKS):
        rows = np.ascontiguousarray(lower[first : first + num.CACHED_BLOCKS].transpose(1, 2, 0))
        inverse = np.zeros_like(rows)
        for i, row in enumerate(rows):
            inverse[i, i] = 1.0 / row[i]
            if i:
                inverse[i, :i] = np.einsum("jk,jmk->mk", row[:i] * -inverse[i, i], inverse[:i, :i])
        out[first : first + num.CACHED_BLOCKS] = inverse.transpose(2, 0, 1)
    return out
