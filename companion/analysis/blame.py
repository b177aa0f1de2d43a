"""Gyro and attitude disagree: which of the two turned? What gravity, and the autopilot's own rates, say of it.

With one IMU an attitude that drifts looks like a biased gyro. Two witnesses tell them apart. Gravity: an attitude that
leans over sees the vehicle accelerate sideways where its velocity does not change, by 0.17 m/s² for each degree. The
autopilot's own rates (ATTITUDE's rollspeed, pitchspeed, yawspeed: its gyro less the bias that it believes in): an
attitude that turns where neither they nor the IMU do is moved by something else, a compass or a GPS.
"""

from __future__ import annotations

import numpy as np

from companion.analysis.compare import attitude_error, length
from companion.analysis.reference import Limits, nearest
from companion.analysis.residuals import Residuals
from companion.strapdown import preintegrate, quaternion
from companion.tracks import STANDARD_GRAVITY, Array, AttitudeTrack, ImuTrack

_RATE_HZ = 10.0  # below it the rates between two attitudes are not known
_LEAN = np.radians(1.5)  # the attitude has to lean by this much for gravity to tell
_SHARE = 0.35  # by which two rates may differ and be the same


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
    where it turns too little about the horizontal, or forces and turns have nothing to do with one another.
    """
    if last - first < 2 or not found.force.any():
        return None
    part = slice(first, last + 1)
    q = found.q_ned_frd[part]
    turn = (
        quaternion.rotate(q, found.rate[part])
        * np.diff(found.begin[first : last + 2], append=found.end[last])[: last - first + 1, None]
    )
    turned = np.concatenate([np.zeros((1, 3)), np.cumsum(turn, axis=0)[:-1]])[:, :2]
    felt = quaternion.rotate(q, found.force[part])
    lean = np.column_stack([-felt[:, 1], felt[:, 0]]) / STANDARD_GRAVITY
    turned, lean = turned - turned.mean(axis=0), lean - lean.mean(axis=0)
    power = float((turned**2).sum())
    if length(np.ptp(turned, axis=0)) < _LEAN:
        return None
    share = float((turned * lean).sum()) / power
    rest = float(((lean - share * turned) ** 2).sum())
    # scattered forces say nothing: the share has to be known to a quarter
    return share if rest / max(1, 2 * len(turned) - 3) < (0.25**2) * power else None


def attitude_turned(found: Residuals, own: Array, first: int, last: int) -> bool:
    """Whether it was the attitude that turned against the gyro in windows first to last."""
    share = leaning(found, first, last)
    if share is not None and not 0.3 < share < 0.6:
        return share > 0.5
    part = slice(first, last + 1)
    known = np.isfinite(own[part]).all(axis=1)
    if known.sum() < 2:
        return False
    gyro, autopilot = np.median(found.rate[part][known], axis=0), np.median(own[part][known], axis=0)
    return bool(length(gyro - autopilot) < _SHARE * length(gyro))
