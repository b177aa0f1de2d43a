"""Vector and quaternion algebra on component-first arrays, the layout of the integration kernels; running products.

A vector is (3, n), a quaternion (4, n): every operation then runs over contiguous memory, which is what makes NumPy
fast. Public functions of the package take and give (n, 3) and (n, 4).

A running product has no loop over samples: it is associative, so it is computed in blocks (prefix scan, Blelloch 1990):
inside all blocks at once, one position after the other; then the running product of the blocks' totals; then each block
turned by all before it. A quaternion is held there as the pair of complex numbers α = w + ix, β = y + iz, i.e.
q = α + βj. As jα = α*j, the product with q' = α' + β'j is (αα' - ββ'*) + (αβ' + βα'*)j, which is the row (α, β) times
the matrix [[α', β'], [-β'*, α'*]]: two calls of NumPy a step instead of the 28 that the real components need.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from companion.model import Array

_LINE = 8
"""Doubles in a line of the cache, and in the widest register."""

_FEW = 64
"""Numbers that are not worth a line of the cache, and quaternions that are multiplied one by one: a call of NumPy takes
as long as two products of Python's numbers."""


def empty(*shape: int) -> Array:
    """An array that begins at a line of the cache, as NumPy's own do by chance alone.

    A store across two lines takes twice as long, and of 8 doubles at a time all are or none: kernels write here.
    """
    size = math.prod(shape)
    if size < _FEW:  # of a live stream: to find the line takes longer than what it spares
        return np.empty(shape)
    room = np.empty(size + _LINE)
    begin = -(room.__array_interface__["data"][0] // room.itemsize) % _LINE
    return room[begin : begin + size].reshape(shape)


def times(a: float | Array, b: Array) -> Array:
    """a b, in the shape of b."""
    out = empty(*b.shape)
    np.multiply(a, b, out=out)
    return out


def dot(a: Array, b: Array) -> Array:
    """a · b, (n,)."""
    terms = times(a, b)
    total: Array = terms[0]
    total += terms[1]
    total += terms[2]
    return total


def cross(a: Array, b: Array) -> Array:
    """a x b, in the shape of b, (3, n)."""
    out, less = empty(*b.shape), empty(*b.shape[1:])
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(a[j], b[k], out=out[i])
        np.multiply(a[k], b[j], out=less)
        out[i] -= less
    return out


def rotate(w: float | Array, v: Array, f: Array) -> Array:
    """C(q) f for q = (w, v) of any length: the rotation that q stands for is that of q / |q|."""
    turn = change(w, v, f)
    turn += f
    return turn


def change(w: float | Array, v: Array, f: Array) -> Array:
    """C(q) f - f of the same."""
    turn = cross(v, f)
    turn += times(w, f)
    turn = cross(v, turn)
    scale = dot(v, v)
    scale += times(w, w) if isinstance(w, np.ndarray) else w * w
    turn *= np.divide(2.0, scale, out=scale)
    return turn


def product(a: Array, b: Array) -> Array:
    """Hamilton product a ⊗ b of (4, ...) arrays, broadcasting after the first axis."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    out = np.empty((4, *np.broadcast_shapes(aw.shape, bw.shape)))
    out[0] = aw * bw - ax * bx - ay * by - az * bz
    out[1] = aw * bx + ax * bw + ay * bz - az * by
    out[2] = aw * by - ax * bz + ay * bw + az * bx
    out[3] = aw * bz + ax * by - ay * bx + az * bw
    return out


def unit(q: Array) -> Array:
    """q / |q| on (4, n), with w >= 0: the same rotation, and running products keep a continuous sign."""
    scale = _square(q)
    np.divide(1.0, np.sqrt(scale, out=scale), out=scale)
    return times(np.copysign(scale, q[0], out=scale), q)


def unit_again(q: Array) -> Array:
    """q / |q| where rounding alone has moved |q| from one: 1 / |q| is a step of Newton's from there."""
    scale = _square(q)
    scale *= -0.5
    scale += 1.5
    return times(scale, q)


def _square(q: Array) -> Array:
    """|q|² of (4, n)."""
    terms = times(q, q)
    total: Array = terms[0]
    total += terms[1]
    total += terms[2]
    total += terms[3]
    return total


def matrix(q: Array) -> Array:
    """C(q), (3, 3, ...), of unit quaternions (4, ...)."""
    w, x, y, z = q
    out = np.empty((3, 3, *w.shape))
    out[0, 0], out[0, 1], out[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    out[1, 0], out[1, 1], out[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    out[2, 0], out[2, 1], out[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return out


Complex = npt.NDArray[np.complex128]


def running_product(start: Array, q: Array) -> Array:
    """start ⊗ q_0, start ⊗ q_0 ⊗ q_1, ...: component-first, (4,) and (4, n) to (4, n)."""
    n = q.shape[1]
    if n <= _FEW:
        return _one_by_one(start, q)
    # A position in the block costs two calls, another block only its share of them: short blocks, many of them; of a
    # whole chunk (2^13) as many as fill lines of the cache.
    length = max(16, 1 << round(np.log2(n) / 2 - 1.5))
    blocks = -(-n // length)
    if n < blocks * length:
        q = np.concatenate((q, np.zeros((4, blocks * length - n))), axis=1)  # what pads the last block reaches no other
    w, x, y, z = q.reshape(4, blocks, length).transpose(0, 2, 1)
    factor, inner, terms = _complex(length, 2, 2, blocks), _complex(length, 2, blocks), _complex(2, 2, blocks)
    _set(factor[:, 0, 0], w, x)
    _set(factor[:, 0, 1], y, z)
    np.negative(np.conjugate(factor[:, 0, 1], out=factor[:, 1, 0]), out=factor[:, 1, 0])
    np.conjugate(factor[:, 0, 0], out=factor[:, 1, 1])
    inner[0] = factor[0, 0]
    for i in range(1, length):
        np.multiply(inner[i - 1][:, None], factor[i], out=terms)
        np.add(terms[0], terms[1], out=inner[i])

    before = np.empty((4, blocks))  # the product of all before each block
    (w, y), (x, z) = inner[-1, :, :-1].real, inner[-1, :, :-1].imag
    before[:, 0], before[:, 1:] = start, unit_again(running_product(start, np.stack((w, x, y, z))))
    pair = _complex(2, blocks)
    _set(pair, before[0::2], before[1::2])
    other = np.conjugate(inner, out=_complex(length, 2, blocks))
    other *= pair[1]
    inner *= pair[0]
    inner[:, 0] -= other[:, 1]
    inner[:, 1] += other[:, 0]
    out = empty(4, blocks, length)
    out[0::2], out[1::2] = inner.real.transpose(1, 2, 0), inner.imag.transpose(1, 2, 0)
    return out.reshape(4, -1)[:, :n]


def _one_by_one(start: Array, q: Array) -> Array:
    w, x, y, z = start.tolist()
    a, b = complex(w, x), complex(y, z)
    out = []
    for w, x, y, z in q.T.tolist():
        c, d = complex(w, x), complex(y, z)
        a, b = a * c - b * d.conjugate(), a * d + b * c.conjugate()
        out.append((a.real, a.imag, b.real, b.imag))
    return np.array(out).reshape(-1, 4).T


def _complex(*shape: int) -> Complex:
    """As `empty`."""
    return empty(*shape[:-1], 2 * shape[-1]).view(np.complex128)


def _set(out: Complex, real: Array, imag: Array) -> None:
    out.real, out.imag = real, imag
