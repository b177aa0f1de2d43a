"""Whether the last seconds of a flight differ from those before: a look that costs little, before a whole analysis."""

from __future__ import annotations

import numpy as np

from companion.analysis.comparison import Comparison, errors, windows
from companion.analysis.findings.stuck import STOPPED_S, STUCK_S, unchanged
from companion.analysis.navigation_error import length
from companion.model import Array, ImuTrack

_NEWEST_S, _WINDOW_S = 2.5, 1.0
_FEWEST = 8  # windows before the newest
_JUST_S = 0.6  # from when on an axis that stands still can be judged: later, it has been
_TIMES, _USUAL = 3.0, 90.0  # times that percentile of the windows before


def newest_stands_out(comparison: Comparison) -> bool:
    """Whether the autopilot's estimate has just stepped, IMU and autopilot part faster than before, or an axis stands.

    It says that something may have begun, not what.
    """
    since = float(comparison.track.t[-1]) - _NEWEST_S
    if any(len(steps) and steps[-1, 1] > since for steps in (comparison.attitude_steps, comparison.position_steps)):
        return True
    if _stands(comparison.track):
        return True
    chosen = windows(comparison, _WINDOW_S)
    window_errors = errors(comparison, chosen)
    new = window_errors.end_s > since
    if not new.any() or (~new).sum() < _FEWEST:
        return False
    parted = [window_errors.attitude, window_errors.velocity] if comparison.has_position else [window_errors.attitude]
    return any(
        float(size[new].max()) > _TIMES * float(np.percentile(size[~new], _USUAL)) for size in map(length, parted)
    )


def _stands(track: ImuTrack) -> bool:
    """Whether an axis has read the same for just so long that it can be judged, and never before for half as long."""
    return any(_has_stopped(track.t, readings) for readings in (track.gyro, track.accel))


def _has_stopped(t: Array, readings: Array) -> bool:
    if len(t) < 2:
        return False
    same = unchanged(readings)
    for axis in range(3):
        moves = np.flatnonzero(~same[:, axis]) + 1  # samples that read otherwise than the one before
        if len(moves) < 2:
            continue
        lasted = float(t[-1] - t[moves[-1]])
        if STOPPED_S < lasted < STUCK_S + _JUST_S and float(np.diff(t[moves]).max()) < 0.5 * lasted:
            return True
    return False
