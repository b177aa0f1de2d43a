"""The factorisation by blocks against dense NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from companion.estimation.block_tridiagonal import factorise, inverses
from companion.model import Array

BLOCK = 4


def made(count: int) -> tuple[Array, Array, Array]:
    """A positive definite block-tridiagonal matrix of very different scales: its blocks, and the whole."""
    rng = np.random.default_rng(count)
    root = np.zeros((count * BLOCK, count * BLOCK))
    for k in range(count):
        row = slice(k * BLOCK, (k + 1) * BLOCK)
        root[row, row] = np.tril(rng.normal(size=(BLOCK, BLOCK))) + 3.0 * np.eye(BLOCK)
        if k:
            root[row, (k - 1) * BLOCK : k * BLOCK] = rng.normal(size=(BLOCK, BLOCK))
    scale = np.tile(10.0 ** np.arange(-3, BLOCK - 3), count)
    whole = scale[:, None] * (root @ root.T) * scale
    blocks = whole.reshape(count, BLOCK, count, BLOCK).swapaxes(1, 2)
    index = np.arange(count)
    return blocks[index, index], blocks[index[:-1], index[1:]], whole


@pytest.mark.parametrize("count", [*range(1, 31), 120])
def test_solution_determinant_and_inverse_are_those_of_the_dense_matrix(count: int) -> None:
    diagonal, upper, whole = made(count)
    factor = factorise(diagonal, upper)

    rhs = np.random.default_rng(0).normal(size=(count, BLOCK, 3))
    dense = np.linalg.solve(whole, rhs.reshape(-1, 3)).reshape(rhs.shape)
    np.testing.assert_allclose(factor.solve(rhs), dense, rtol=1e-8, atol=1e-10 * np.abs(dense).max())

    product = rhs.reshape(-1, 3).T @ dense.reshape(-1, 3)
    np.testing.assert_allclose(factor.product(rhs), product, rtol=1e-8, atol=1e-10 * np.abs(product).max())

    inverse = np.linalg.inv(whole).reshape(count, BLOCK, count, BLOCK).swapaxes(1, 2)
    own, beside = factor.inverse_blocks()
    index = np.arange(count)
    for found, expected in ((own, inverse[index, index]), (beside, inverse[index[:-1], index[1:]])):
        assert found.shape == expected.shape
        scale = np.sqrt(np.einsum("kii->ki", inverse[index, index]))
        size = scale[: len(found), :, None] * scale[-len(found) :, None, :] if len(found) else 1.0
        np.testing.assert_allclose(found / size, expected / size, atol=1e-8)


def test_an_unknown_that_nothing_determines_is_an_error() -> None:
    diagonal, upper, _ = made(5)
    diagonal[2, 1, :] = diagonal[2, :, 1] = 0.0
    with pytest.raises(np.linalg.LinAlgError, match="not determined"):
        factorise(diagonal, upper)


@pytest.mark.parametrize("count", [0, 1, 23, 24, 511, 513])
def test_many_blocks_are_inverted_as_few_are(count: int) -> None:
    root = np.random.default_rng(count).normal(size=(count, 15, 20))
    blocks = root @ root.swapaxes(-1, -2)
    found = inverses(blocks)
    np.testing.assert_array_equal(found, found.swapaxes(-1, -2))
    np.testing.assert_allclose(found @ blocks, np.broadcast_to(np.eye(15), blocks.shape), atol=1e-8)


@pytest.mark.parametrize("count", [1, 100])
def test_what_is_not_positive_definite_has_no_inverse(count: int) -> None:
    blocks = np.tile(np.eye(3), (count, 1, 1))
    blocks[-1, 2, 2] = -1.0
    with pytest.raises(np.linalg.LinAlgError):
        inverses(blocks)
