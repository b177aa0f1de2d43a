"""Gyro and attitude disagree: which of the two turned? What gravity, and the autopilot's own rates, say of it.

With one IMU an attitude that drifts looks like a biased gyro. Two witnesses tell them apart. Gravity: an attitude that
leans over sees the vehicle accelerate sideways where its velocity does not change, by 0.17 m/s² for each degree. The
autopilot's own rates (ATTITUDE's rollspeed, pitchspeed, yawspeed: its gyro less the bias that it believes in): an
attitude that turns where neither they nor the IMU do is moved by something else, a compass or a GPS.
"""

from __future__ import annotations

import numpy as np

from companion.analysis.compare import attitude_error, length
from companion.analysis.findings.residuals import Residuals
from companion.analysis.reference import Limits, nearest
from companion.strapdown import preintegrate, quaternion
from companion.tracks import STANDARD_GRAVITY, Array, AttitudeTrack, ImuTrack

_RATE_HZ = 10.0  # below it the rates between two attitudes are not known
_TURNED = np.radians(60.0)  # the heading has to change by this much to tell the world from the body
_LEAN = np.radians(1.5)  # the attitude has to lean by this much for gravity to tell
_FORCE, _SCATTER = 0.3, 0.005  # g, what may be fixed in the body, and what a window's force scatters by
_SHARE = 0.6  # of the gyro's difference that the autopilot's own rates may leave open


def in_world(found: Residuals, value: Array, first: int, last: int) -> bool:
    """Whether a vector of the body, in windows first to last, stands still in the world while the vehicle turns."""
    part = slice(first, last + 1)
    q, body = found.q_ned_frd[part], value[part]
    nose = quaternion.rotate(q, np.broadcast_to([1.0, 0.0, 0.0], (len(q), 3)))
    heading = np.unwrap(np.arctan2(nose[:, 1], nose[:, 0]))
    world = quaternion.rotate(q, body)
    if np.ptp(heading) < _TURNED:
        return False
    scatter = [float(np.median(length(x - np.median(x, axis=0)))) for x in (world, body)]
    return scatter[0] < 0.5 * scatter[1]


def own_rates(attitude: AttitudeTrack, found: Residuals, limits: Limits) -> Array:
    """(W, 3) rad/s, FRD: what the autopilot's own rates turned more than its attitude; NaN where that is not known."""
    unknown = np.full((len(found), 3), np.nan)
    if len(attitude) < 3 or not attitude.rates.any() or 1 / np.median(np.diff(attitude.t)) < _RATE_HZ:
        return unknown
    path = preintegrate(ImuTrack(attitude.t, attitude.rates, np.zeros_like(attitude.rates)), middle="linear")
    i, j = nearest(attitude.t, found.begin), nearest(attitude.t, found.end)
    q = attitude.q_ned_frd
    turned = quaternion.multiply(quaternion.conjugate(path.q[i]), path.q[j])
    error = attitude_error(q[j], quaternion.multiply(q[i], turned))
    span = (attitude.t[j] - attitude.t[i])[:, None]
    holes = np.concatenate([[0], np.cumsum(np.diff(attitude.t) > limits.hole(attitude.t))])
    good = (holes[j] == holes[i])[:, None] & (span > 0)
    rate = -quaternion.rotate(quaternion.conjugate(q[i]), error) / np.where(span > 0, span, 1.0)
    return np.where(good, rate, unknown)


def leaning(found: Residuals, first: int, last: int) -> float | None:
    """Part of the turn between gyro and attitude, over windows first to last, that gravity puts on the attitude.

    1: the attitude leans over as much as it turns against the gyro. 0: it stays upright, and the gyro is wrong. None
    where the windows do not tell. A force that is fixed in the body is neither: a trim, or the accelerometer's bias.
    """
    if last - first < 2 or not found.force.any():
        return None
    part = slice(first, last + 1)
    q, body = found.q_ned_frd[part], quaternion.to_matrix(found.q_ned_frd[part])
    lasted = np.diff(found.begin[first : last + 2], append=found.end[last])[: last - first + 1, None]
    turn = quaternion.rotate(q, found.rate[part]) * lasted
    turned = np.concatenate([np.zeros((1, 3)), np.cumsum(turn, axis=0)[:-1]])[:, :2]
    if length(np.ptp(turned, axis=0)) < _LEAN:
        return None
    # what leans by φ feels (g φ_y, -g φ_x) too much
    felt = np.einsum("wij,wj->wi", body, found.force[part])[:, :2] / STANDARD_GRAVITY
    leant = np.column_stack([turned[:, 1], -turned[:, 0]])
    known = np.concatenate(
        [leant[:, :, None], np.broadcast_to(np.eye(2), (len(q), 2, 2)), body[:, :2]], axis=2
    ).reshape(-1, 6)
    information = known.T @ known + np.diag([0, 0, 0, *[_FORCE**-2.0 * _SCATTER**2] * 3])
    x = np.linalg.lstsq(information, known.T @ felt.ravel(), rcond=None)[0]
    rest = float(((felt.ravel() - known @ x) ** 2).sum()) / max(1, len(known) - 4)
    spread = np.sqrt(max(rest, _SCATTER**2) * np.linalg.pinv(information)[0, 0])
    return float(x[0]) if spread < 0.2 else None


def attitude_turned(found: Residuals, own: Array, first: int, last: int) -> bool:
    """Whether it was the attitude that turned against the gyro in windows first to last."""
    if in_world(found, found.rate, first, last):
        return True  # a gyro turns with the vehicle, and its bias with it
    share = leaning(found, first, last)
    if share is not None and not 0.3 < share < 0.6:
        return share > 0.5
    part = slice(first, last + 1)
    known = np.isfinite(own[part]).all(axis=1)
    if known.sum() < 2:
        return False
    gyro, autopilot = np.median(found.rate[part][known], axis=0), np.median(own[part][known], axis=0)
    return bool(length(gyro - autopilot) < _SHARE * length(gyro))
