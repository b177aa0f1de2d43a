"""What readings at the end of an accelerometer's range take from a velocity, by the vehicle's own counters."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from companion.constants import healthy
from companion.model import Array, Flight, ImuTrack, Series, of_kind


def lost_by_clipping(flight: Flight, track: ImuTrack, t: Array, density: float) -> Array:
    """(K-1,) how noisy clipped readings make the velocity between times t (K,), s; zero without counters.

    In times of a white noise of some density, m/s²/√Hz.
    """
    lost = np.zeros(len(t) - 1)
    for series in of_kind(flight.series, "vibration"):
        for name, when, clipped in clip_counters(series):
            axis = name.removeprefix("clips_")
            if axis == str(track.instance) or (not axis.isdigit() and series.instance == track.instance):
                lost = np.maximum(lost, healthy.CLIPPED_MPS * np.diff(np.interp(t, when, clipped)))
    return lost / (max(density, healthy.MIN_DENSITY["accel"]) * np.sqrt(np.diff(t)))


def clip_counters(series: Series) -> Iterator[tuple[str, Array, Array]]:
    """Every counter of a "vibration" series that is told: its column, times (N,) s, readings since the first (N,).

    One that begins anew is not counted backwards.
    """
    for name in (column for column in series.columns if column.startswith("clips_")):
        known = np.isfinite(series[name])
        if known.any():
            grown = np.maximum(np.diff(series[name][known]), 0.0)
            yield name, series.t[known], np.concatenate([[0.0], np.cumsum(grown)])
