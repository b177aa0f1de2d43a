"""Integrals over batches of windows, for `covariance`: W windows of n samples, samples last, trapezoidal."""

from __future__ import annotations

import numpy as np

from companion.model import Array
from companion.strapdown import _components as rows

_DIAGONAL = np.arange(3)


def skew(vector: Array) -> Array:
    """[x]x of vectors (..., 3): `skew(a) @ b == cross(a, b)`."""
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    out = np.zeros((*vector.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out


def trapezoid(t: Array) -> Array:
    """Weights (W, n) of the trapezoidal rule over times (W, n)."""
    half = 0.5 * np.diff(t, axis=1)
    weight = np.zeros_like(t)
    weight[:, :-1] += half
    weight[:, 1:] += half
    return weight


def from_here_on(response: Array, t: Array) -> tuple[Array, Array]:
    """∫ from s to T of the response (W, m, 3, n), at every s, and from the start (W, m, 3)."""
    out = np.empty_like(response)
    out[..., 0] = 0.0
    pieces = out[..., 1:]
    np.add(response[..., :-1], response[..., 1:], out=pieces)
    pieces *= 0.5 * np.diff(t, axis=1)[:, None, None]
    np.cumsum(pieces, axis=-1, out=pieces)
    total = out[..., -1].copy()
    np.subtract(total[..., None], out, out=out)
    return out, total


def moments(response: Array, weight: Array) -> tuple[Array, Array]:
    """∫ J ds (W, m, 3) and ∫ J Jᵀ ds (W, m, m) of responses (W, m, 3, n) with weights (W, n)."""
    weighted = response * weight[:, None, None]
    flat = (len(response), response.shape[1], -1)
    return weighted.sum(axis=-1), np.asarray(weighted.reshape(flat) @ response.reshape(flat).swapaxes(-1, -2))


def outer(response: Array, reading: Array) -> Array:
    """Σ over samples of response (W, m, 3, n) times readings (W, n, k): (W, m, 3, k)."""
    windows, m, _, n = response.shape
    return np.asarray((response.reshape(windows, m * 3, n) @ reading).reshape(windows, m, 3, -1))


def responses(q: Array, moved: Array, left: Array) -> Array:
    """Impulse responses (W, 12, 3, n): -C, -(T - s) C, [dV]x C and [dP]x C, of which the first two are the
    accelerometer's and all but the second the gyro's; from q (W, n, 4), dV and dP (W, 6, n), T - s (W, n).
    """
    windows, _, n = moved.shape
    out = np.empty((windows, 12, 3, n))
    minus = out[:, :3]
    np.negative(rows.matrix(np.moveaxis(q, -1, 0)).transpose(2, 0, 1, 3), out=minus)
    np.multiply(minus, left[:, None, None], out=out[:, 3:6])
    for first, along in ((6, moved[:, :3]), (9, moved[:, 3:])):
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            cross = out[:, first + i]
            np.multiply(along[:, None, k], minus[:, j], out=cross)
            cross -= along[:, None, j] * minus[:, k]
    return out


def of_turns(moved: Array, weight: Array, own: Array) -> Array:
    """∫ J Jᵀ ds (W, 9, 9) of the gyro's response: with C Cᵀ = I and [a]x [b]x = b aᵀ - (a·b) I the sums of dV, dP and
    their products are all that it takes. own: (W, 3, 3) of the attitude.
    """
    weighted = moved * weight[:, None]
    sides = skew(weighted.sum(axis=-1).reshape(-1, 2, 3))
    products = weighted @ moved.swapaxes(-1, -2)
    out = np.empty((len(moved), 9, 9))
    out[:, :3, :3] = own
    for i, block in enumerate((slice(3, 6), slice(6, 9))):
        out[:, :3, block], out[:, block, :3] = sides[:, i], -sides[:, i]
        for j, beside in enumerate((slice(3, 6), slice(6, 9))):
            product = products[:, 3 * j : 3 * j + 3, 3 * i : 3 * i + 3]
            along = np.diagonal(product, axis1=1, axis2=2)
            out[:, block, beside] = -product
            # a·b less each own product, without taking it off: along dV itself next to nothing is left.
            out[:, block, beside][:, _DIAGONAL, _DIAGONAL] = along[:, [1, 2, 0]] + along[:, [2, 0, 1]]
    return out
