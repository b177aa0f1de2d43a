"""Real recordings, whole: the reckoning against an independent oracle, the drift against independent figures."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import companion as c
from tests.recordings import BUNDLED, shared

Vector = list[float]


def hamilton(a: Vector, b: Vector) -> Vector:
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return [
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    ]


def turned(q: Vector, v: Vector) -> Vector:
    """C(q) v, for q of any length."""
    norm = math.sqrt(sum(x * x for x in q))
    unit = [x / norm for x in q]
    return hamilton(hamilton(unit, [0.0, *v]), [unit[0], -unit[1], -unit[2], -unit[3]])[1:]


def plus(a: Vector, s: float, b: Vector) -> Vector:
    return [x + s * y for x, y in zip(a, b, strict=True)]


def scalar_rk4(imu: c.ImuTrack, start: c.NavState) -> tuple[list[Vector], list[Vector], list[Vector]]:
    """RK4 with a linear middle sample, one number at a time, as the equations of the first source text stand."""
    q, v, p = start.q_ned_frd.tolist(), start.velocity.tolist(), start.position.tolist()
    qs, vs, ps = [q], [v], [p]
    gravity = [0.0, 0.0, 9.80665]
    t, gyro, accel = imu.t.tolist(), imu.gyro.tolist(), imu.accel.tolist()
    for n in range(len(t) - 1):
        h = t[n + 1] - t[n]
        w0, w1, f0, f1 = gyro[n], gyro[n + 1], accel[n], accel[n + 1]
        wm, fm = ([(x + y) / 2 for x, y in zip(a, b, strict=True)] for a, b in ((w0, w1), (f0, f1)))
        identity = [1.0, 0.0, 0.0, 0.0]
        k1 = [x / 2 for x in hamilton(identity, [0.0, *w0])]
        q1 = plus(identity, h / 2, k1)
        k2 = [x / 2 for x in hamilton(q1, [0.0, *wm])]
        q2 = plus(identity, h / 2, k2)
        k3 = [x / 2 for x in hamilton(q2, [0.0, *wm])]
        q3 = plus(identity, h, k3)
        k4 = [x / 2 for x in hamilton(q3, [0.0, *w1])]
        a = [
            plus(turned(hamilton(q, stage), f), 1.0, gravity)
            for stage, f in ((identity, f0), (q1, fm), (q2, fm), (q3, f1))
        ]
        p = [p[i] + h * v[i] + h * h / 6 * (a[0][i] + a[1][i] + a[2][i]) for i in range(3)]
        v = [v[i] + h / 6 * (a[0][i] + 2 * a[1][i] + 2 * a[2][i] + a[3][i]) for i in range(3)]
        dq = [identity[i] + h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]) for i in range(4)]
        q = hamilton(q, dq)
        norm = math.sqrt(sum(x * x for x in q))
        q = [x / norm for x in q]
        qs.append(q)
        vs.append(v)
        ps.append(p)
    return qs, vs, ps


def test_the_bundled_hover_equals_a_scalar_loop() -> None:
    flight = c.open_log(BUNDLED / "copter-hover-100hz.tlog")[0]
    imu = flight.imu("RAW_IMU")
    assert flight.attitude
    imu = imu[int(np.searchsorted(imu.t, flight.attitude.t[0])) :]
    start = c.NavState(imu.t[0], flight.attitude.q_ned_frd[0], np.array([0.1, -0.2, 0.3]), np.array([1.0, 2.0, -3.0]))
    ours = c.reckon(imu, start, method="rk4", middle="linear")
    q, v, p = (np.array(x) for x in scalar_rk4(imu, start))
    assert len(ours) > 9000
    for mine, other in ((ours.q_ned_frd, q), (ours.velocity, v), (ours.position, p)):
        assert np.abs(np.abs(mine) - np.abs(other)).max() <= 1e-9 * np.abs(other).max()
    assert np.abs((ours.q_ned_frd * q).sum(axis=1)).min() > 1 - 1e-12


# Medians of an independent integrator (plain RK4, linear middle, RAW_IMU as it is, linear interpolation of ATTITUDE and
# LOCAL_POSITION_NED, windows end to end): attitude °, velocity m/s, position m after 5, 10 and 30 s.
INDEPENDENT = {
    "copter-hover-nodrift-100hz": {5: (0.029, 0.036, 0.105), 10: (0.019, 0.075, 0.38), 30: (0.11, 0.25, 3.6)},
    "copter-hover-100hz": {5: (0.50, 0.33, 0.75), 10: (1.04, 1.01, 4.1), 30: (2.8, 7.0, 75.0)},
    "copter-square-100hz": {5: (0.93, 0.35, 0.87), 10: (1.7, 0.96, 3.7), 30: (2.9, 2.5, 25.0)},
}


def medians(flight: c.Flight, horizon: float) -> np.ndarray[Any, np.dtype[np.float64]]:
    row = c.drift(flight, horizons=(horizon,), imu="RAW_IMU", middle="linear").rows[0]
    assert row.attitude_deg
    assert row.velocity_mps
    assert row.position_m
    return np.array([row.attitude_deg.median, row.velocity_mps.median, row.position_m.median])


@pytest.mark.parametrize("horizon", [5, 10, 30])
@pytest.mark.parametrize("name", INDEPENDENT)
def test_drift_agrees_with_independent_figures(name: str, horizon: int) -> None:
    """Within 15 %, or where the windows begin explains the difference.

    The independent windows began at another time. Where few windows make a median (3-5 of 30 s), or the error is a
    hundredth of a degree, that alone moves it by more: then the figure must lie among the medians of sixty grids that
    begin at other times.
    """
    flight = c.open_log(shared(f"sitl/{name}.tlog"))[0]
    theirs = np.array(INDEPENDENT[name][horizon])
    agrees = np.abs(medians(flight, horizon) / theirs - 1) < 0.15
    position = flight.position
    assert position
    grids = []
    for begin in position.t[0] + horizon * np.arange(60) / 60:
        late = position.t >= begin
        later = c.PositionTrack(position.t[late], position.position[late], position.velocity[late], position.source)
        grids.append(medians(replace(flight, position=later), horizon))
    explained = (np.min(grids, axis=0) * 0.85 < theirs) & (theirs < np.max(grids, axis=0) * 1.15)
    assert (agrees | explained).all()
    assert horizon == 30 or agrees[1:].all(), "velocity and position have windows enough at 5 and 10 s"
