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

import numpy as np
import numpy.typing as npt

from companion.model import Array


def dot(a: Array, b: Array) -> Array:
    """a · b, (n,)."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def cross(a: Array, b: Array) -> Array:
    """a x b, (3, n)."""
    out = np.empty_like(b)
    np.subtract(a[1] * b[2], a[2] * b[1], out=out[0])
    np.subtract(a[2] * b[0], a[0] * b[2], out=out[1])
    np.subtract(a[0] * b[1], a[1] * b[0], out=out[2])
    return out


def rotate(w: float | Array, v: Array, f: Array) -> Array:
    """C(q) f for q = (w, v) of any length: the rotation that q stands for is that of q / |q|."""
    turn = cross(v, f)
    turn += w * f
    turn = cross(v, turn)
    turn *= 2.0 / (w * w + dot(v, v))
    turn += f
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
    scale = np.copysign(1.0 / np.sqrt(q[0] * q[0] + dot(q[1:], q[1:])), q[0])
    return np.asarray(q * scale)


def matrix(q: Array) -> Array:
    """C(q), (3, 3, ...), of unit quaternions (4, ...)."""
    w, x, y, z = q
    out = np.empty((3, 3, *w.shape))
    out[0, 0], out[0, 1], out[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    out[1, 0], out[1, 1], out[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    out[2, 0], out[2, 1], out[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return out


Complex = npt.NDArray[np.complex128]


def running_product(q: Array) -> Array:
    """q_0, q_0 ⊗ q_1, q_0 ⊗ q_1 ⊗ q_2, ...: component-first, (4, n) to (4, n)."""
    pairs = np.empty((2, q.shape[1]), dtype=np.complex128)
    pairs.real, pairs.imag = q[0::2], q[1::2]
    pairs = _scan(pairs)
    out = np.empty_like(q)
    out[0::2], out[1::2] = pairs.real, pairs.imag
    return out


def _scan(q: Complex) -> Complex:
    """The running product of pairs (2, n)."""
    n = q.shape[1]
    # A position in the block costs two calls, another block only its share of them: short blocks, many of them.
    length = n if n <= 24 else max(16, int(np.sqrt(n) / 3))
    blocks = -(-n // length)
    padded = np.zeros((2, blocks * length), dtype=np.complex128)  # what pads the last block reaches no other
    padded[:, :n] = q
    alpha, beta = padded.reshape(2, blocks, length).transpose(0, 2, 1)
    factor = np.empty((length, 2, 2, blocks), dtype=np.complex128)
    factor[:, 0, 0], factor[:, 0, 1] = alpha, beta
    np.negative(factor[:, 0, 1].conj(), out=factor[:, 1, 0])
    np.conjugate(factor[:, 0, 0], out=factor[:, 1, 1])

    inner = np.empty((length, 2, blocks), dtype=np.complex128)
    inner[0] = factor[0, 0]
    terms = np.empty((2, 2, blocks), dtype=np.complex128)
    for i in range(1, length):
        np.multiply(inner[i - 1][:, None], factor[i], out=terms)
        np.add(terms[0], terms[1], out=inner[i])
    if blocks > 1:
        alpha, beta = _scan(inner[-1, :, :-1])
        own, other = inner[:, 0, 1:], inner[:, 1, 1:]
        turned = alpha * own - beta * other.conj()
        np.add(alpha * other, beta * own.conj(), out=other)
        own[...] = turned
    return inner.transpose(1, 2, 0).reshape(2, -1)[:, :n]
