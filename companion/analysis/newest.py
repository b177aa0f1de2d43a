"""Whether the last seconds of a flight differ from those before: a look that costs little, before a whole analysis."""

from __future__ import annotations

import numpy as np

from companion.analysis.compare import length
from companion.analysis.comparison import Comparison, errors, windows

_NEWEST_S, _WINDOW_S = 2.5, 1.0
_FEWEST = 8  # windows before the newest
_TIMES, _USUAL = 3.0, 90.0  # times that percentile of the windows before


def newest_stands_out(comparison: Comparison) -> bool:
    """Whether the autopilot's estimate has just stepped, or IMU and autopilot part faster than they did before.

    It says that something may have begun, not what.
    """
    since = float(comparison.track.t[-1]) - _NEWEST_S
    if any(len(steps) and steps[-1, 1] > since for steps in (comparison.attitude_steps, comparison.position_steps)):
        return True
    chosen = windows(comparison, _WINDOW_S)
    found = errors(comparison, chosen)
    new = found.end_s > since
    if not new.any() or (~new).sum() < _FEWEST:
        return False
    parted = [found.attitude, found.velocity] if comparison.has_position else [found.attitude]
    return any(
        float(size[new].max()) > _TIMES * float(np.percentile(size[~new], _USUAL)) for size in map(length, parted)
    )
