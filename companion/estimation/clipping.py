"""What readings at the end of an accelerometer's range take from a velocity, by the vehicle's own counters."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from companion.model import Array, Flight, ImuTrack, of_kind

_LOST = 0.04
"""m/s, 1σ of what a clipped reading takes: a quarter of 16 g, for a thousandth of a second. Both autopilots count raw
readings, at 1 kHz or more."""

_QUIETEST = 1e-4  # m/s²/√Hz: no accelerometer is, but a simulated one


def lost_by_clipping(flight: Flight, track: ImuTrack, t: Array, density: float) -> Array:
    """(K-1,) how noisy clipped readings make the velocity between times t (K,), s; zero without counters.

    In times of a white noise of some density, m/s²/√Hz.
    """
    lost = np.zeros(len(t) - 1)
    for when, count in _counters(flight, track):
        if len(when) > 1:
            clipped = np.concatenate([[0.0], np.cumsum(np.maximum(np.diff(count), 0.0))])
            lost = np.maximum(lost, _LOST * np.diff(np.interp(t, when, clipped)))
    return lost / (max(density, _QUIETEST) * np.sqrt(np.diff(t)))


def _counters(flight: Flight, track: ImuTrack) -> Iterator[tuple[Array, Array]]:
    """Times (N,) s and counts (N,) of each counter that is of this IMU."""
    for series in of_kind(flight.series, "vibration"):
        for name in series.columns:
            axis = name.removeprefix("clips_") if name.startswith("clips_") else ""
            of_imu = axis == str(track.instance) if axis.isdigit() else series.instance == track.instance
            if axis and of_imu:
                known = np.isfinite(series[name])
                yield series.t[known], series[name][known]
