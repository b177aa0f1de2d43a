"""Where a vehicle stands still, by its IMU, its GPS and its motors."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from companion.constants import healthy, num
from companion.model import STANDARD_GRAVITY, Array, Flight, GpsTrack, ImuTrack, integrated, ned_from_geodetic


def at_rest(flight: Flight, track: ImuTrack, t: Array) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Mean rates (K, 3) about keyframes t (K,) and their 1σ (K,), rad/s, and whether the vehicle rests there (K,).

    A hover can be quieter than a bench, and an IMU cannot tell them apart: so the vehicle has to say that its motors
    are off, and the GPS must not see it move.
    """
    armed = flight.armed(t, t + 1.0)
    index = np.searchsorted(track.t, t)
    half = max(2, round(0.25 * track.rate_hz))
    low, high = np.maximum(index - half, 0), np.minimum(index + half, len(track))
    count = (high - low)[:, None]
    mean, spread = [], []
    for values in (track.gyro, track.accel):
        first, second = (np.concatenate([np.zeros((1, 3)), np.cumsum(v, axis=0)]) for v in (values, values**2))
        average = (first[high] - first[low]) / count
        variance = (second[high] - second[low]) / count - average**2
        mean.append(average)
        spread.append(np.sqrt(np.maximum(variance, 0.0)).max(axis=1))
    still = np.zeros(len(t), np.bool_) if armed is None else ~armed  # where nothing is said of them, motors may run
    steps = (track.gyro_step, track.accel_step)
    for quiet, step, most in zip(spread, steps, healthy.REST_CHANGE, strict=True):
        still &= quiet < min(most, max(healthy.REST_LOUDER * float(np.percentile(quiet, 10.0)), 0.6 * step, 0.2 * most))
    force = np.linalg.norm(mean[1], axis=1)
    still &= np.abs(force - STANDARD_GRAVITY) < healthy.REST_FORCE * STANDARD_GRAVITY
    still &= np.abs((mean[0] * mean[1]).sum(axis=1)) < healthy.REST_TURN_RPS * force
    for gps in flight.gps[:1]:
        speed = np.linalg.norm(gps.velocity[:, :2], axis=1)
        good = np.isfinite(speed) & (gps.fix_type >= 3)
        if good.sum() > 1:
            still &= np.interp(t, gps.t[good], speed[good]) < healthy.REST_MPS
            still &= ~_drifting(gps, good, t, still)
    # the neighbours have to rest too: nothing begins or ends here
    calm = still.copy()
    calm[1:] &= still[:-1]
    calm[:-1] &= still[1:]
    own = [values * np.sqrt(2.0 / count[:, 0]) for values in spread]
    calm &= _change(mean[1], still) < healthy.REST_FORCE_SIGMAS * own[1]  # else gravity turns
    return mean[0], np.maximum(own[0], 0.5 * _change(mean[0], still)), np.asarray(calm)


def _drifting(
    gps: GpsTrack, good: npt.NDArray[np.bool_], t: Array, still: npt.NDArray[np.bool_]
) -> npt.NDArray[np.bool_]:
    """(K,) where what an IMU takes for rest is a steady motion, as a boat's: the GPS moves by what its velocity says.

    A receiver at rest wanders too, and not as its velocity says. good: its fixes; still: (K,) by the IMU at t (K,).
    """
    when, velocity = gps.t[good], gps.velocity[good, :2]
    latitude, longitude = gps.latitude[good], gps.longitude[good]
    level = np.zeros(len(when))
    place = ned_from_geodetic(latitude, longitude, level, (float(latitude[0]), float(longitude[0]), 0.0))[:, :2]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(np.int8))).reshape(-1, 2)
    ends = np.clip(np.searchsorted(when, t[edges - [0, 1]]), 0, len(when) - 1)
    by_velocity, by_position = (both[ends[:, 1]] - both[ends[:, 0]] for both in (integrated(when, velocity), place))
    far = np.linalg.norm(by_velocity, axis=1)
    drifts = (far > healthy.REST_DRIFT_M) & (
        np.linalg.norm(by_position - by_velocity, axis=1) < healthy.REST_DRIFT_CONFIRMED * far
    )
    out = np.zeros(len(t), np.bool_)
    for first, last in edges[drifts].tolist():
        out[first:last] = True
    return out


def _change(means: Array, still: npt.NDArray[np.bool_]) -> Array:
    """(K,) by how much the means (K, 3) of neighbours at rest differ.

    A vehicle that sways on its legs, or is carried, is as quiet for a moment as one that stands. Half of what its rate
    changes by is how far it may be from a bias.
    """
    padded = np.full((len(means) + 2 * num.REST_NEIGHBOURS, 3), np.nan)
    padded[num.REST_NEIGHBOURS : len(means) + num.REST_NEIGHBOURS][still] = means[still]
    highest, lowest = means.copy(), means.copy()
    for first in range(2 * num.REST_NEIGHBOURS + 1):
        near = padded[first : first + len(means)]
        np.fmax(highest, near, out=highest)
        np.fmin(lowest, near, out=lowest)
    return np.where(still, (highest - lowest).max(axis=1), 0.0)
