"""How far the IMU's clock is behind the attitude's, part by part of a flight: whether the two run alike."""

from __future__ import annotations

import numpy as np

from companion.analysis.comparison import Comparison
from companion.analysis.reference import BoolArray
from companion.model import Array
from companion.strapdown import quaternion

_PARTS = 3
_GRID_S, _TURN_S, _MOST_S = 0.04, 0.2, 1.0  # s
_TURNING = 0.05  # rad/s, root mean square: less does not tell a lag
_SHARP = 0.1  # part of the power, and of what is left beside it, that the best lag may leave
_ASIDE = 5  # shifts
_MOST_POINTS = 10  # of the grid for each sample


def lags(comparison: Comparison) -> list[tuple[float, float, float]]:
    """(begin s, end s, lag s) of each third of the flight that turns enough to tell, by the best match of the turns."""
    track, reference = comparison.track, comparison.reference
    if track.rate_hz < 1 / _TURN_S or track.t[-1] - track.t[0] < _PARTS * 4 * _MOST_S:
        return []
    if (track.t[-1] - track.t[0]) / _GRID_S > _MOST_POINTS * len(track):
        return []  # mostly holes
    grid = np.arange(track.t[0] + _TURN_S, track.t[-1] - _TURN_S, _GRID_S)
    ends = [np.clip(np.searchsorted(track.t, grid + half), 0, len(track) - 1) for half in (-_TURN_S / 2, _TURN_S / 2)]
    good = reference.attitude_known[ends[0]] & reference.attitude_known[ends[1]] & (ends[1] > ends[0])
    span = np.maximum(track.t[ends[1]] - track.t[ends[0]], 1e-9)[:, None]
    turned = [
        quaternion.log(quaternion.multiply(quaternion.conjugate(q[ends[0]]), q[ends[1]])) / span
        for q in (comparison.path.q, reference.q_ned_frd)
    ]
    by_part = []
    for part in np.array_split(np.arange(len(grid)), _PARTS):
        lag = _best(turned[0][part], turned[1][part], np.asarray(good[part]))
        if lag is not None:
            by_part.append((float(grid[part[0]]), float(grid[part[-1]]), lag))
    return by_part


def _best(gyro: Array, attitude: Array, good: BoolArray) -> float | None:
    """The shift, s, that leaves the least between two rates (N, 3); None where none stands out."""
    most = round(_MOST_S / _GRID_S)
    inner = slice(most, len(gyro) - most)
    seen, known = attitude[inner] - attitude[inner].mean(axis=0), good[inner]  # a constant rate fits any lag
    gyro = gyro - gyro[inner].mean(axis=0)
    power = float(np.median((seen[known] ** 2).sum(axis=1))) if known.any() else 0.0
    if power < _TURNING**2:
        return None
    left = np.array(
        [
            np.median(((gyro[most + k : len(gyro) - most + k][known] - seen[known]) ** 2).sum(axis=1))
            for k in range(-most, most + 1)
        ]
    )
    k = int(np.argmin(left))
    aside = left[max(0, k - _ASIDE) : k + _ASIDE + 1][[0, -1]].min()
    if not _ASIDE <= k <= 2 * most - _ASIDE or left[k] > _SHARP * power or left[k] > _SHARP * aside:
        return None
    below, at, above = left[k - 1 : k + 2]
    return float((k - most + 0.5 * (below - above) / max(below - 2 * at + above, 1e-12)) * _GRID_S)
