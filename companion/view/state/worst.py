"""Where both trajectories are farthest apart: what a picture of the whole flight has to point at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.analysis import Replay


@dataclass(frozen=True, slots=True)
class Worst:
    """The stretch of a replay that ends farthest apart."""

    start_s: float  # boot clock: where the reckoning last started from the autopilot
    end_s: float  # where they are farthest apart
    apart_m: float


def worst_stretch(replay: Replay) -> Worst | None:
    """The instant at which IMU and autopilot are farthest apart, and the stretch that leads there.

    Only where the autopilot's state is known. None where the log has no position, or they never part.
    """
    known = np.flatnonzero(replay.reference_valid)
    if not replay.has_position or not len(known):
        return None
    distances = np.linalg.norm(np.nan_to_num(replay.position_error[known]), axis=1)
    at, apart = int(known[np.argmax(distances)]), float(distances.max())
    if apart <= 0.0:
        return None
    end = float(replay.t[at])
    before = replay.anchors[replay.anchors < end]
    start = float(before[-1]) if len(before) else float(replay.t[0])
    return Worst(start, end, apart)
