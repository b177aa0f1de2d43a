"""The expected error as a line over a replay: it begins at each anchor and grows with the time since."""

from __future__ import annotations

import numpy as np

from companion.analysis.replay import Replay
from companion.analysis.verdict import Assessment
from companion.tracks import Array

_POINTS = 2000


def expected_since_anchor(found: Assessment, shown: Replay) -> tuple[Array, Array, Array, Array] | None:
    """(t s, attitude °, velocity m/s, position m), 1σ, at some times of the replay and at every anchor.

    Between the horizons of the assessment it is interpolated; None where the replay runs on for longer than the
    longest of them, or nothing was expected.
    """
    rows = [(row.horizon_s, e) for row, e in zip(found.drift.rows, found.expected, strict=True) if e is not None]
    if len(rows) < 2:
        return None
    horizons = np.array([horizon for horizon, _ in rows])
    if np.diff(np.append(shown.anchors, shown.t[-1])).max(initial=0.0) > 1.5 * horizons[-1]:
        return None
    some = shown.t[:: max(1, len(shown.t) // _POINTS)]
    t = np.unique(np.concatenate([some, shown.anchors, shown.anchors[1:] - 1e-6, shown.t[-1:]]))
    since = t - shown.anchors[np.searchsorted(shown.anchors, t, side="right") - 1]
    lines = []
    for name in ("attitude_deg", "velocity_mps", "position_m"):
        sigma = [getattr(expected, name) or 0.0 for _, expected in rows]
        # at the anchor both are the same; what little is expected there is that of the shortest horizon
        lines.append(np.interp(since, np.append(0.0, horizons), np.append(0.5 * sigma[0], sigma)))
    return t, lines[0], lines[1], lines[2]
