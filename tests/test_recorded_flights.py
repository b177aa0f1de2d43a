"""Real recordings, whole: the reckoning against an independent oracle, the drift against independent figures."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import companion as c
from tests.oracle import scalar_rk4
from tests.recordings import BUNDLED, whole

pytestmark = pytest.mark.slow


def test_the_bundled_hover_equals_a_scalar_loop() -> None:
    flight = c.open_log(BUNDLED / "copter-hover-100hz.tlog")[0]
    imu = flight.imu("RAW_IMU")
    assert flight.attitude
    imu = imu[int(np.searchsorted(imu.t, flight.attitude.t[0])) :]
    start = c.NavState(imu.t[0], flight.attitude.q_ned_frd[0], np.array([0.1, -0.2, 0.3]), np.array([1.0, 2.0, -3.0]))
    ours = c.dead_reckon(imu, start, method="rk4", middle="linear")
    q, v, p = scalar_rk4(imu, start, "linear")
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
    row = c.drift(flight, horizons=(horizon,), imu="RAW_IMU", how=c.Integration(middle="linear")).rows[0]
    assert row.attitude_deg
    assert row.velocity_mps
    assert row.position_m
    return np.array([row.attitude_deg.median, row.velocity_mps.median, row.position_m.median])


@pytest.mark.parametrize("horizon", [5, 10, 30])
@pytest.mark.parametrize("name", INDEPENDENT)
def test_drift_agrees_with_independent_figures(name: str, horizon: int) -> None:
    """Attitude, velocity and position together within 3 %, on one and the same grid of windows.

    Where the independent windows began is not known to the second, and with five windows of 30 s, some of them over
    flips, it matters: grids that begin up to 1.5 s after the position does, at each of its samples, are tried.
    """
    flight = c.open_log(whole(f"sitl/{name}.tlog"))[0]
    position = flight.position
    assert position
    found = []
    for begin in position.t[0] + np.arange(0, 1.51, 0.05):
        late = position.t >= begin
        later = c.PositionTrack(position.t[late], position.position[late], position.velocity[late], position.source)
        found.append(medians(replace(flight, position=later), horizon) / INDEPENDENT[name][horizon] - 1)
    best = min(found, key=lambda off: float(np.abs(off).max()))
    assert np.abs(best).max() < 0.03
