"""Findings about the samples themselves: too slow, missing, at wrong times."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from companion.analysis.comparison import Comparison
from companion.analysis.finding import Finding
from companion.model import Flight

_LOST = 8.0  # periods from which on an interval is a hole
_UNEVEN, _UNEVEN_S = 0.2, 0.004  # of a period, s
_MOVED_S, _SPOILT_S = 0.05, 0.1  # s
_LOW_HZ, _USELESS_HZ = 40.0, 10.0  # RAW_IMU is low-passed at 20 Hz: below twice that, motion aliases into the samples


def rate_warning(flight: Flight, rate_hz: float) -> str | None:
    """What to say above the drift of an IMU whose samples are far apart; None where they are not."""
    if rate_hz >= _LOW_HZ:
        return None
    if rate_hz < _USELESS_HZ:
        lost = "too low to integrate: motion between the samples is lost, and most of the drift is that"
    else:
        lost = "low: quick motion between the samples is lost, and the drift has a part of that"
    return f"{rate_hz:.0f} Hz is {lost}. {flight.how_to_record}."


def rate_findings(flight: Flight, comparison: Comparison, sampling_share: float) -> Iterator[Finding]:
    """The sample rate is too low for the motion: nothing else in the budget matters then."""
    track = comparison.track
    rate = track.rate_hz
    if rate < _USELESS_HZ or sampling_share > 0.5:
        yield Finding(
            "rate_too_low",
            "data",
            "error",
            float(track.t[0]),
            float(track.t[-1]),
            f"{track.source} at {rate:.1f} Hz"
            + (f"; sampling is {sampling_share:.0%} of the expected attitude error" if sampling_share > 0.05 else ""),
            f"{flight.how_to_record}.",
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
            (
                "Look at the link's quality, or use the on-board log. "
                if not flight.on_board
                else "The logger could not keep up: look at the card, and log less else. "
            )
            + "Windows over holes are left out.",
        )


def stamp_findings(
    flight: Flight, comparison: Comparison, lags: Sequence[tuple[float, float, float]]
) -> Iterator[Finding]:
    """The times themselves are wrong: uneven beyond what a link does, or running away from the attitude's.

    lags: (begin s, end s, lag s) of the IMU behind the attitude, part by part of the flight.
    """
    track = comparison.track
    period, interval = float(np.median(np.diff(track.t))), np.diff(track.t)
    off = np.abs(interval - np.maximum(1.0, np.round(interval / period)) * period)[interval < _LOST * period]
    uneven = float(np.percentile(off, 90))
    if uneven > max(_UNEVEN * period, _UNEVEN_S):
        yield Finding(
            "samples_irregular",
            "data",
            "warning" if uneven > 2 * _UNEVEN * period else "info",
            float(track.t[0]),
            float(track.t[-1]),
            f"one interval in ten is off by {uneven * 1e3:.0f} ms or more from multiples of {period * 1e3:.0f} ms",
            "The processor was too busy to sample evenly. Look at its load, and log less."
            if flight.on_board
            else "The autopilot stamps when it sends, not when it samples: a busy link or processor moves the samples. "
            "Ask for fewer messages, or use the on-board log.",
        )
    if len(lags) < 2:
        return
    first, last = lags[0], lags[-1]
    moved = last[2] - first[2]
    if abs(moved) > _MOVED_S:
        yield Finding(
            "clocks_diverge",
            "data",
            "error" if abs(moved) > _SPOILT_S else "warning",
            first[0],
            last[1],
            f"the IMU lags {first[2] * 1e3:.0f} ms behind the attitude at first and "
            f"{last[2] * 1e3:.0f} ms at last: their clocks run at different rates",
            "Both have to be stamped by one clock. Record the autopilot's own messages"
            + ("." if flight.on_board else ", or use the on-board log."),
        )
