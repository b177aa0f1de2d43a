"""Integrals over batches of windows, for `covariance`: W windows of n samples, samples last, trapezoidal."""

from __future__ import annotations

import numpy as np

from companion.model import Array


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


def square(response: Array, weight: Array) -> Array:
    """∫ J Jᵀ ds, (W, m, m), of responses (W, m, 3, n) with weights (W, n)."""
    flat = (len(response), response.shape[1], -1)
    return np.asarray((response * weight[:, None, None]).reshape(flat) @ response.reshape(flat).swapaxes(-1, -2))


def from_here_on(response: Array, t: Array) -> tuple[Array, Array]:
    """∫ from s to T of the response (W, m, 3, n), at every s, and from the start (W, m, 3)."""
    pieces = response[..., :-1] + response[..., 1:]
    pieces *= 0.5 * np.diff(t, axis=1)[:, None, None]
    out = np.zeros_like(response)
    np.cumsum(pieces, axis=-1, out=out[..., 1:])
    total = out[..., -1].copy()
    np.subtract(total[..., None], out, out=out)
    return out, total


def outer(response: Array, reading: Array) -> Array:
    """Σ over samples of response (W, m, 3, n) times reading (W, n, 3): (W, m, 3, 3)."""
    windows, m, _, n = response.shape
    return np.asarray((response.reshape(windows, m * 3, n) @ reading).reshape(windows, m, 3, 3))
