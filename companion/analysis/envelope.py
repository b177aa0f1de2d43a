"""How far a replay's two trajectories should be apart: the budget from each anchor on, as a line over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.analysis.assessment import Assessment
from companion.analysis.budget import ATTITUDE, POSITION, VELOCITY, budget
from companion.analysis.comparison import Windows, windows
from companion.analysis.expected import expected_over
from companion.analysis.replay import Replay
from companion.model import Array, nearest

_POINTS = 2400
_LONGEST_S = 120.0
"""Beyond it the error is no longer linear in its causes, and its covariance says nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class Expectation:
    """The expected error of a replay, at times of its own. At an anchor it steps: just before it, and at it."""

    t: Array  # (M,) s, boot clock, increasing strictly
    covariance: Array  # (M, 9, 9) of rotation vector rad, velocity m/s and position m, NED, autopilot minus IMU

    @property
    def lengths(self) -> tuple[Array, Array, Array]:
        """1σ (root mean square) of the error's length, each (M,): attitude °, velocity m/s, position m."""
        squares = (np.trace(self.covariance[:, b, b], axis1=1, axis2=2) for b in (ATTITUDE, VELOCITY, POSITION))
        attitude, velocity, position = (np.sqrt(np.maximum(square, 0.0)) for square in squares)
        return np.degrees(attitude), velocity, position


def expected_since_anchor(assessment: Assessment, shown: Replay) -> Expectation | None:
    """What the budget allows `shown` to be off by: a replay of the track that was assessed, integrated alike.

    None where it runs on for longer than two minutes from an anchor, has more anchors than can be worked out, or began
    from rest: the budget is of windows that begin from the autopilot's state.
    """
    if shown.from_rest:
        return None
    ends = np.append(shown.anchors[1:], shown.t[-1])
    if np.max(ends - shown.anchors) > _LONGEST_S or 3 * len(shown.anchors) > _POINTS:
        return None
    t = assessment.comparison.track.t
    steps = np.linspace(0.0, 1.0, _POINTS // len(shown.anchors)) ** 1.5
    wanted = shown.anchors[:, None] + steps * (ends - shown.anchors)[:, None]
    start = np.repeat(nearest(t, shown.anchors), len(steps))
    end = np.maximum(nearest(t, wanted.ravel()), start)
    allowed = budget(assessment.comparison, Windows(0.0, start, end, {}), assessment.figures, assessment.autopilot)
    times = t[end].reshape(wanted.shape).copy()
    times[:-1, -1] -= 1e-6  # the last before the next anchor
    times, first = np.unique(times.ravel(), return_index=True)
    return Expectation(times, allowed.total[first])


def expected_by_age(assessment: Assessment, ages_s: Sequence[float]) -> Array:
    """What the budget allows so long after an anchor, (A, 4): s, and 1σ of the error's length: °, m/s, m.

    The median over the windows of each length; lengths without a window are left out, and what the flight has no
    position for is 0.
    """
    rows = []
    for age in ages_s:
        one = expected_over(
            assessment.comparison, windows(assessment.comparison, age), assessment.figures, assessment.autopilot
        )
        if one is not None:
            rows.append((age, one.attitude_deg, one.velocity_mps or 0.0, one.position_m or 0.0))
    return np.array(rows, dtype=np.float64).reshape(-1, 4)
