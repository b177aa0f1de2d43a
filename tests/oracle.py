"""An independent integrator: the equations of docs/mathematics.md, one sample after the other."""

from __future__ import annotations

import math
from typing import cast

import numpy as np

from companion.model import STANDARD_GRAVITY, Array, ImuTrack, NavState

DOWN = np.array([0.0, 0.0, STANDARD_GRAVITY])


def scalar_rk4(imu: ImuTrack, start: NavState, middle: str) -> tuple[Array, Array, Array]:
    """docs/mathematics.md 000, one sample after the other, with matrices made from quaternions as the text has them."""

    def mul(a: Array, b: Array) -> Array:
        (s, x, y, z), (w, i, j, k) = a.tolist(), b.tolist()
        return np.array(
            [
                s * w - x * i - y * j - z * k,
                s * i + w * x + y * k - z * j,
                s * j + w * y + z * i - x * k,
                s * k + w * z + x * j - y * i,
            ]
        )

    def rotation(q: Array) -> Array:
        w, x, y, z = (q / math.sqrt(q @ q)).tolist()
        return np.array(
            [
                [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
            ]
        )

    def between(x: Array, i: int, when: float) -> Array:
        if middle == "linear":
            return np.asarray((x[i] + x[i + 1]) / 2)
        nodes = range(min(max(i - 1, 0), len(x) - 4), min(max(i - 1, 0), len(x) - 4) + 4)
        total = np.zeros(3)
        for j in nodes:
            weight = 1.0
            for k in nodes:
                if k != j:
                    weight *= (when - imu.t[k]) / (imu.t[j] - imu.t[k])
            total += weight * x[j]
        return total

    q, v, p = start.q_ned_frd, start.velocity, start.position
    out = [(q, v, p)]
    one = np.array([1.0, 0.0, 0.0, 0.0])
    for i in range(len(imu) - 1):
        h = imu.t[i + 1] - imu.t[i]
        when = imu.t[i] + h / 2
        w0, wm, w1 = imu.gyro[i], between(imu.gyro, i, when), imu.gyro[i + 1]
        f0, fm, f1 = imu.accel[i], between(imu.accel, i, when), imu.accel[i + 1]
        k1 = 0.5 * np.array([0.0, *w0])
        q1 = one + h / 2 * k1
        k2 = 0.5 * mul(q1, np.array([0.0, *wm]))
        q2 = one + h / 2 * k2
        k3 = 0.5 * mul(q2, np.array([0.0, *wm]))
        q3 = one + h * k3
        k4 = 0.5 * mul(q3, np.array([0.0, *w1]))
        a0 = rotation(q) @ f0 + DOWN
        a1 = rotation(mul(q, q1)) @ fm + DOWN
        a2 = rotation(mul(q, q2)) @ fm + DOWN
        a3 = rotation(mul(q, q3)) @ f1 + DOWN
        p = p + h * v + h * h / 6 * (a0 + a1 + a2)
        v = v + h / 6 * (a0 + 2 * a1 + 2 * a2 + a3)
        q = mul(q, one + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
        q = q / math.sqrt(q @ q)
        out.append((q, v, p))
    return cast("tuple[Array, Array, Array]", tuple(np.array(column) for column in zip(*out, strict=True)))
