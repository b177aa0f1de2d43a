"""Which of overlapping spans of bytes to keep."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from companion.mavlink.crc import Index


def first_come(start: Index, end: Index) -> npt.NDArray[np.bool_]:
    """Mask (N,) of the spans `[start, end)`, sorted by start, that do not begin inside an earlier one of the mask."""
    keep = np.ones(len(start), bool)
    if not (start[1:] < end[:-1]).any():
        return keep
    inside = start[1:] < np.maximum.accumulate(end)[:-1]
    involved = np.zeros(len(start), bool)
    involved[1:] |= inside
    involved[:-1] |= inside  # whatever overlaps, and the span before it; the rest is never looked at one by one
    reached = 0
    index = np.flatnonzero(involved)
    for at, begin, stop in zip(index.tolist(), start[index].tolist(), end[index].tolist(), strict=True):
        if begin < reached:
            keep[at] = False
        else:
            reached = stop
    return keep
