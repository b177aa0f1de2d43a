"""Where both trajectories are farthest apart: what a picture of the whole flight has to point at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.view.moment import Footage


@dataclass(frozen=True, slots=True)
class Worst:
    """The stretch of a replay that ends farthest apart."""

    start_s: float  # boot clock: where the reckoning last started from the autopilot
    end_s: float  # where they are farthest apart
    apart_m: float


def worst_stretch(film: Footage) -> Worst | None:
    """The instant at which IMU and autopilot are farthest apart, and the stretch that leads there.

    Only where the autopilot's state is known. None where the log has no position, or they never part.
    """
    replay = film.replay
    known = np.flatnonzero(replay.reference_valid)
    if not replay.has_position or not len(known):
        return None
    at = int(known[np.argmax(film.errors.position_m[known])])
    apart = float(film.errors.position_m[at])
    if apart <= 0.0:
        return None
    end = float(replay.t[at])
    before = replay.anchors[replay.anchors < end]
    start = float(before[-1]) if len(before) else film.start
    return Worst(start, end, apart)
