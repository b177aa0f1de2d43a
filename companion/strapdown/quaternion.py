"""Unit quaternions as arrays: Hamilton's convention, `[w, x, y, z]` on the last axis.

`q_ned_frd` rotates body (FRD) vectors into the world (NED); products compose from right to left,
`q_ned_frd = q_ned_other ⊗ q_other_frd`. Every function works on arrays of shape (..., 4) and broadcasts.
Trawny & Roumeliotis ("Indirect Kalman Filter for 3D Attitude Estimation", 2005) write JPL quaternions of NED to FRD,
scalar last: the product is turned round there and the rotation too, so the numbers are the same in another order.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from companion.model import Array, DataError, floats
from companion.model import from_euler as _from_euler
from companion.strapdown import _components as components

from_euler = _from_euler
IDENTITY: Array = np.array([1.0, 0.0, 0.0, 0.0])
IDENTITY.setflags(write=False)


def multiply(a: Array, b: Array) -> Array:
    """Hamilton product a ⊗ b: first b, then a. Shapes (..., 4), broadcast against each other.

    As pairs of complex numbers w + ix, y + iz (see `_components`): a third of the time that the real components take.
    """
    (a0, a1), (b0, b1) = _pair(a), _pair(b)
    first = a0 * b0 - a1 * b1.conj()
    product = np.empty((*first.shape, 2), np.complex128)
    product[..., 0] = first
    product[..., 1] = a0 * b1 + a1 * b0.conj()
    return product.view(np.float64)


def _pair(q: Array) -> tuple[npt.NDArray[np.complex128], npt.NDArray[np.complex128]]:
    """w + ix and y + iz, each (...), of quaternions (..., 4)."""
    pairs = np.ascontiguousarray(q, np.float64).view(np.complex128)
    return pairs[..., 0], pairs[..., 1]


def conjugate(q: Array) -> Array:
    """The inverse rotation of a unit quaternion, (..., 4)."""
    return np.asarray(q * np.array([1.0, -1.0, -1.0, -1.0]))


def normalize(q: Array) -> Array:
    """q / |q|, (..., 4). Raises DataError for one of length zero or that is not finite: it stands for no rotation."""
    length = np.asarray(np.linalg.norm(q, axis=-1, keepdims=True))
    if not ((length > 0) & np.isfinite(length)).all():
        raise DataError("an attitude is no rotation: its quaternion has length zero, or is not finite")
    return np.asarray(q / length, dtype=np.float64)


def rotate(q: Array, vector: Array) -> Array:
    """C(q) vector: q (..., 4) of unit length, vector (..., 3), broadcast. With q_ned_frd: from FRD to NED."""
    w, axis = q[..., :1], q[..., 1:]
    turn = 2.0 * cross(axis, vector)
    return np.asarray(vector + w * turn + cross(axis, turn))


def cross(a: Array, b: Array) -> Array:
    """a × b, (..., 3): NumPy's own takes five times as long for a few vectors."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    x = ay * bz - az * by
    product = np.empty((*x.shape, 3), x.dtype)
    product[..., 0] = x
    product[..., 1] = az * bx - ax * bz
    product[..., 2] = ax * by - ay * bx
    return product


def to_matrix(q: Array) -> Array:
    """Rotation matrix C(q), (..., 3, 3), of unit quaternions (..., 4): `C(q) v == rotate(q, v)`."""
    return np.ascontiguousarray(np.moveaxis(components.matrix(np.moveaxis(q, -1, 0)), (0, 1), (-2, -1)))


def from_matrix(matrix: Array) -> Array:
    """Unit quaternions (..., 4), w >= 0, of rotation matrices (..., 3, 3); Shepperd's choice of the largest part."""
    m = np.asarray(matrix, dtype=np.float64)
    m00, m11, m22 = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    x, y, z = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    xy, yz, zx = m[..., 0, 1] + m[..., 1, 0], m[..., 1, 2] + m[..., 2, 1], m[..., 2, 0] + m[..., 0, 2]
    # 4 q_i q for i = w, x, y, z: four parallel vectors; the one with the largest own part loses no digits.
    candidates = np.stack(
        (
            np.stack((1 + m00 + m11 + m22, x, y, z), axis=-1),
            np.stack((x, 1 + m00 - m11 - m22, xy, zx), axis=-1),
            np.stack((y, xy, 1 - m00 + m11 - m22, yz), axis=-1),
            np.stack((z, zx, yz, 1 - m00 - m11 + m22), axis=-1),
        ),
        axis=-2,
    )
    own = np.diagonal(candidates, axis1=-2, axis2=-1)
    best = np.argmax(own, axis=-1)[..., None, None]
    q = normalize(np.take_along_axis(candidates, best, axis=-2)[..., 0, :])
    return np.where(q[..., :1] < 0, -q, q)


def exp(vector: Array) -> Array:
    """Unit quaternions (..., 4) of rotation vectors (..., 3) in rad: axis times angle."""
    half = 0.5 * np.linalg.norm(vector, axis=-1, keepdims=True)
    # np.sinc(x) = sin(πx)/(πx) knows the limit at zero.
    return np.concatenate((np.cos(half), 0.5 * np.sinc(half / np.pi) * vector), axis=-1)


def log(q: Array) -> Array:
    """Rotation vectors (..., 3) in rad of unit quaternions (..., 4); the shorter of the two ways, at most π."""
    w, axis = q[..., 0], q[..., 1:]
    sine = np.sqrt(np.einsum("...i,...i->...", axis, axis))
    small = sine < 1e-12  # there angle / sine = 2 to the last digit, and 0 / 0 is avoided
    scale = np.where(small, 2.0, 2.0 * np.arctan2(sine, np.abs(w)) / np.where(small, 1.0, sine))
    return np.asarray(axis * np.where(w < 0, -scale, scale)[..., None])


def slerp(a: Array, b: Array, fraction: npt.ArrayLike) -> Array:
    """From a (fraction 0) to b (fraction 1) at constant rate, the shorter way round.

    Shapes: a, b (..., 4), fraction (...); all broadcast. Outside 0..1 it extrapolates at the same rate.
    """
    step = log(multiply(conjugate(a), b))
    return multiply(a, exp(np.asarray(fraction, dtype=np.float64)[..., None] * step))


def to_euler(q: Array) -> Array:
    """Roll, pitch, yaw (..., 3) in rad of q_ned_frd (..., 4), as ATTITUDE has them.

    roll and yaw in -π..π, pitch in -π/2..π/2. For people and plots: at pitch ±90° roll and yaw are not unique, so
    nothing is integrated or interpolated in these angles. Raises DataError for what is no array of that shape.
    """
    w, x, y, z = np.moveaxis(floats("q_ned_frd", q, (*np.shape(q)[:-1], 4), finite=False), -1, 0)
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - x * z), -1.0, 1.0))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.stack((roll, pitch, yaw), axis=-1)


def continuous_sign(q: Array) -> Array:
    """The same rotations (N, 4) with the sign chosen so that neighbours along the track lie on the same side.

    q and -q are one rotation; interpolation and plots need a curve without jumps. The first row keeps its sign.
    """
    flips = np.einsum("ij,ij->i", q[1:], q[:-1]) < 0
    sign = np.where(np.cumsum(flips) % 2 == 1, -1.0, 1.0)
    return np.asarray(q * np.concatenate((np.ones(min(1, len(q))), sign))[:, None])
