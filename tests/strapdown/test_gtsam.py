"""GTSAM's preintegration as an oracle (Forster et al. 2017; Lupton & Sukkarieh 2012). Optional: `pip install gtsam`.

GTSAM holds a measurement over an interval (given here the mean of both ends) and turns it with the attitude at the
interval's start, so it is of order 1 in the interval h, against our 2 and 4: the difference must be halved with h, and
Richardson's extrapolation of GTSAM to h = 0 must meet our trajectory. Covariances and Jacobians differ by as much,
half an interval's turn of w h / 2 = 1 %.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from companion.model import Array
from companion.strapdown import motions, preintegrate, propagate, quaternion
from companion.strapdown.motions import Motion

gtsam = pytest.importorskip("gtsam", reason="gtsam is not installed: pip install gtsam")

ORDER = np.r_[0:3, 6:9, 3:6]  # GTSAM: attitude, position, velocity
GYRO_NOISE, ACCEL_NOISE, GYRO_WALK, ACCEL_WALK = 1e-3, 1e-2, 1e-3, 1e-2


def integrated(motion: Motion, first: int, last: int, *, combined: bool = False) -> Any:
    kind = gtsam.PreintegrationCombinedParams if combined else gtsam.PreintegrationParams
    params = kind.MakeSharedD(9.80665)
    params.setGyroscopeCovariance(np.eye(3) * GYRO_NOISE**2)
    params.setAccelerometerCovariance(np.eye(3) * ACCEL_NOISE**2)
    params.setIntegrationCovariance(np.zeros((3, 3)))
    if combined:
        params.setBiasOmegaCovariance(np.eye(3) * GYRO_WALK**2)
        params.setBiasAccCovariance(np.eye(3) * ACCEL_WALK**2)
    made = gtsam.PreintegratedCombinedMeasurements if combined else gtsam.PreintegratedImuMeasurements
    out = made(params, gtsam.imuBias.ConstantBias())
    for i in range(first, last):
        gyro, accel = (0.5 * (x[i] + x[i + 1]) for x in (motion.gyro, motion.accel))
        out.integrateMeasurement(accel, gyro, motion.t[i + 1] - motion.t[i])
    return out


def left_jacobian(vector: Array) -> Array:
    """∂ of the world-frame error by the rotation vector: Exp(θ + dθ) = Exp(J_l(θ) dθ) Exp(θ)."""
    angle = float(np.linalg.norm(vector))
    k = np.cross(vector / angle, np.eye(3)).T
    s, c = np.sin(angle) / angle, (1 - np.cos(angle)) / angle
    return np.asarray(np.eye(3) + c * k + (1 - s) * k @ k)


def ours(motion: Motion, first: int, last: int) -> Any:
    path = preintegrate(motion.imu, middle="linear")
    return propagate(motion.imu, path, [first], [last], quaternion.IDENTITY[None], np.zeros((1, 3)), gravity=0.0)


WINDOWS = [(0, 1.0), (0.7, 2.2), (1.9, 4.0)]


def window(rate: int, span: tuple[float, float]) -> tuple[Motion, int, int]:
    return motions.coning(np.arange(4 * rate + 1) / rate), round(span[0] * rate), round(span[1] * rate)


@pytest.mark.parametrize("span", WINDOWS)
def test_increments_over_windows(span: tuple[float, float]) -> None:
    differences = []
    for rate in (400, 800):
        motion, first, last = window(rate, span)
        theirs = integrated(motion, first, last)
        path = preintegrate(motion.imu)
        q, v, p = path.carry(first, last, quaternion.IDENTITY, np.zeros(3), np.zeros(3), gravity=0.0)
        turned = quaternion.multiply(quaternion.from_matrix(theirs.deltaRij().matrix()), quaternion.conjugate(q))
        differences.append(np.stack((quaternion.log(turned), theirs.deltaVij() - v, theirs.deltaPij() - p)))
    coarse, fine = (np.linalg.norm(difference, axis=1) for difference in differences)
    np.testing.assert_allclose(coarse / fine, 2.0, rtol=0.1)
    extrapolated = np.linalg.norm(2 * differences[1] - differences[0], axis=1)
    assert (extrapolated < [2e-4, 1e-3, 1e-3]).all()  # rad, m/s, m: the order 2 that is left


@pytest.mark.parametrize("span", WINDOWS)
def test_covariance_of_the_noises(span: tuple[float, float]) -> None:
    motion, first, last = window(200, span)
    theirs = integrated(motion, first, last)
    turn = np.eye(9)
    turn[:3, :3] = left_jacobian(gtsam.Rot3.Logmap(theirs.deltaRij()))
    expected = turn @ theirs.preintMeasCov()[np.ix_(ORDER, ORDER)] @ turn.T
    found = ours(motion, first, last).covariance(gyro_noise=GYRO_NOISE, accel_noise=ACCEL_NOISE)[0, :9, :9]
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(scale, scale), expected / np.outer(scale, scale), atol=0.02)


@pytest.mark.parametrize("span", WINDOWS)
def test_covariance_with_walking_biases(span: tuple[float, float]) -> None:
    motion, first, last = window(200, span)
    theirs = integrated(motion, first, last, combined=True)
    order = np.concatenate((ORDER, np.r_[12:15, 9:12]))
    turn = np.eye(15)
    turn[:3, :3] = left_jacobian(gtsam.Rot3.Logmap(theirs.deltaRij()))
    expected = turn @ theirs.preintMeasCov()[np.ix_(order, order)] @ turn.T
    expected[:9, 9:] *= -1.0  # GTSAM's navigation error is estimate minus truth, its bias error truth minus estimate
    expected[9:, :9] *= -1.0
    densities = {
        "gyro_noise": GYRO_NOISE,
        "accel_noise": ACCEL_NOISE,
        "gyro_walk": GYRO_WALK,
        "accel_walk": ACCEL_WALK,
    }
    found = ours(motion, first, last).covariance(**densities)[0]
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(scale, scale), expected / np.outer(scale, scale), atol=0.02)


@pytest.mark.parametrize("span", WINDOWS)
def test_bias_jacobians(span: tuple[float, float]) -> None:
    """`predict` applies GTSAM's own first-order bias Jacobians; the bias raised is ours, true minus used."""
    motion, first, last = window(400, span)
    theirs = integrated(motion, first, last)
    found = ours(motion, first, last).transition[0, :9, 9:]
    step, rest = 1e-4, gtsam.NavState()
    columns = []
    for axis in np.eye(6):
        ends = []
        for sign in (1, -1):
            bias = gtsam.imuBias.ConstantBias(sign * step * axis[3:], sign * step * axis[:3])
            ends.append(theirs.predict(rest, bias))
        q = [quaternion.from_matrix(end.attitude().matrix()) for end in ends]
        turn = quaternion.log(quaternion.multiply(q[0], quaternion.conjugate(q[1])))
        moved = [ends[0].velocity() - ends[1].velocity(), ends[0].position() - ends[1].position()]
        columns.append(np.concatenate((turn, *moved)) / (2 * step))
    expected = np.stack(columns, axis=1)
    for block in (slice(0, 3), slice(3, 6), slice(6, 9)):
        for cause in (slice(0, 3), slice(3, 6)):
            size = max(np.abs(expected[block, cause]).max(), 1e-3)
            assert np.abs(found[block, cause] - expected[block, cause]).max() < 5e-3 * size
