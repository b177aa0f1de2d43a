"""Findings about the samples themselves: too slow, missing."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from companion.analysis.comparison import Comparison
from companion.analysis.finding import Finding


def rate_findings(comparison: Comparison, sampling_share: float) -> Iterator[Finding]:
    """The sample rate is too low for the motion: nothing else in the budget matters then."""
    track = comparison.track
    rate = track.rate_hz
    if rate < 10.0 or sampling_share > 0.5:
        yield Finding(
            "rate_too_low",
            "data",
            "error",
            float(track.t[0]),
            float(track.t[-1]),
            f"{track.source} at {rate:.1f} Hz"
            + (f"; sampling is {sampling_share:.0%} of the expected attitude error" if sampling_share > 0.05 else ""),
            "Record the IMU at 50-200 Hz (SRx_RAW_SENS, SET_MESSAGE_INTERVAL), or use the on-board log.",
        )
    holes = np.flatnonzero(comparison.holes)
    if len(holes):
        lost = float((track.t[holes + 1] - track.t[holes]).sum())
        yield Finding(
            "samples_missing",
            "data",
            "warning" if lost > 0.01 * (track.t[-1] - track.t[0]) else "info",
            float(track.t[holes[0]]),
            float(track.t[holes[-1] + 1]),
            f"{len(holes)} holes, {lost:.1f} s in all, the longest {np.diff(track.t).max():.2f} s",
            "Look at the link's quality, or use the on-board log. Windows over holes are left out.",
        )
