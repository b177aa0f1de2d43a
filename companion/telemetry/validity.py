"""What an estimator itself says that it knows: its position counts where it calls it valid.

ESTIMATOR_STATUS_FLAGS and EKF_STATUS_FLAGS (MAVLink common.xml, ardupilotmega.xml) and the solution status of
ArduPilot's records (nav_filter_status in `AP_NavEKF/AP_Nav_Common.h`) have the same bits. PX4 sends LOCAL_POSITION_NED
all the same, and ArduPilot until it stops aiding, 8 s after it has lost its position.
"""

from __future__ import annotations

import numpy as np

from companion.model import Array, PositionTrack, Series, rows
from companion.telemetry.outliers import BoolArray

_POSITION = 0b11000  # horizontal position, relative or absolute


def has_position(t: Array, told: Array, flags: Array) -> BoolArray:
    """(N,) whether the horizontal position is valid at times t (N,) s, by flags (M,) at times told (M,).

    The flags hold until the next; the first also before. Flags that are not known say nothing.
    """
    known = np.isfinite(told) & np.isfinite(flags)
    told, flags = told[known], flags[known]
    if not len(told):
        return np.ones(len(t), np.bool_)
    last = np.maximum(np.searchsorted(told, t, side="right") - 1, 0)
    return np.asarray((flags[last].astype(np.int64) & _POSITION) != 0)


def valid_position(track: PositionTrack | None, status: Series | None, notes: list[str]) -> PositionTrack | None:
    """The position where the estimator's status calls it valid; None where it does for fewer than two samples."""
    if track is None or status is None or "flags" not in status.columns:
        return track
    valid = has_position(track.t, status.t, status["flags"])
    if valid.all():
        return track
    lost = f"{np.count_nonzero(~valid)} of {len(track)}"
    notes.append(f"{track.source}: {lost} samples left out: {status.source} says that the position is not valid")
    kept = rows(track, valid)
    return kept if len(kept) > 1 else None
