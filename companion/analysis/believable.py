"""Whether an IMU reads what it is accused of: what has only begun may be taken for something that cannot be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from companion.analysis.finding import Cause
from companion.analysis.verdict import Verdict, stated_cause
from companion.model import STANDARD_GRAVITY, Flight


def believable(verdict: Verdict, flight: Flight) -> Verdict:
    """The verdict without an accelerometer that is off by more than gravity, and does not read so.

    A vehicle that leans may hide less than that from it. What has just begun may look so: a position that has jumped by
    50 m two seconds ago, as a push of 25 m/s².
    """
    absurd = [f for f in verdict.findings if f.severity == "error" and _does_not_read(stated_cause(f), flight)]
    if not absurd:
        return verdict
    left = tuple(f for f in verdict.findings if f not in absurd)
    if any(f.severity == "error" and f.side != "data" for f in left):
        return replace(verdict, findings=left)
    since = f"{absurd[0].start_s:.1f} s"
    words = f"the sensors differ since {since}, and it is not known yet which of them is wrong"
    return Verdict("insufficient_data", f"Cannot tell: {words}.", left, probability=verdict.probability)


def _does_not_read(cause: Cause, flight: Flight) -> bool:
    """Whether it says of an accelerometer what its readings do not show."""
    if cause.kind != "accel_bias" or cause.size is None or cause.size < STANDARD_GRAVITY:
        return False
    track = next((one for one in flight.imus.values() if cause.imu in (None, one.instance)), flight.imu())
    after = track.t > cause.onset_s
    if not after.any() or after.all():
        return False
    changed = float(np.linalg.norm(track.accel[after].mean(axis=0) - track.accel[~after].mean(axis=0)))
    return changed < cause.size - STANDARD_GRAVITY
