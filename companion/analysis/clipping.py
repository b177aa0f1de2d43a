"""How often an accelerometer was at the end of its range, as the vehicle counts it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from companion.model import Series


@dataclass(frozen=True, slots=True)
class Clips:
    """One counter of a vehicle over a flight."""

    column: str
    readings: float  # by how much it grew
    start_s: float  # boot clock, where it began to grow, and where it ended; the first sample for both where it did not
    end_s: float


def clip_counts(series: Series) -> Iterator[Clips]:
    """Every counter of a "vibration" series that the vehicle tells. One that begins anew is not counted backwards."""
    for name in (column for column in series.columns if column.startswith("clips_")):
        known = np.isfinite(series[name])
        t, grown = series.t[known], np.maximum(np.diff(series[name][known]), 0.0)
        if len(t):
            at = np.flatnonzero(grown)
            first, last = (at[0], at[-1] + 1) if len(at) else (0, 0)
            yield Clips(name, float(grown.sum()), float(t[first]), float(t[last]))
