"""Vector and quaternion algebra on component-first arrays, the layout of the integration kernels.

A vector is (3, n), a quaternion (4, n): every operation then runs over contiguous memory, which is what makes NumPy
fast. Public functions of the package take and give (n, 3) and (n, 4).
"""

from __future__ import annotations

import numpy as np

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
