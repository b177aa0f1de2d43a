"""Findings about the samples themselves: too slow, missing, at wrong times, by a clock of their own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from companion.analysis.comparison import Comparison
from companion.analysis.finding import Finding
from companion.analysis.reference import BoolArray
from companion.constants import check, harm, healthy
from companion.model import Array, Flight, counted, median
from companion.strapdown import quaternion


def rate_warning(flight: Flight, rate_hz: float) -> str | None:
    """What to say above the drift of an IMU whose samples are far apart; None where they are not."""
    if rate_hz >= harm.LOW_RATE_HZ:
        return None
    if rate_hz < harm.USELESS_RATE_HZ:
        lost = "too low to integrate: motion between samples is lost and causes most of the drift"
    else:
        lost = "low: fast motion between samples is lost, which adds to the drift"
    return f"{rate_hz:.0f} Hz is {lost}. {flight.how_to_record}."


def rate_findings(flight: Flight, comparison: Comparison, sampling_share: float) -> Iterator[Finding]:
    """The sample rate is too low for the motion: nothing else in the budget matters then."""
    track = comparison.track
    rate = track.rate_hz
    if rate < harm.USELESS_RATE_HZ or sampling_share > 0.5:
        yield Finding(
            "rate_too_low",
            "data",
            "warning",
            float(track.t[0]),
            float(track.t[-1]),
            f"{track.source} at {rate:.1f} Hz is too slow"
            + (f"; sampling is {sampling_share:.0%} of the expected attitude error" if sampling_share > 0.05 else ""),
            f"{flight.how_to_record}.",
        )
    yield from _gap_findings(flight, comparison)


def _gap_findings(flight: Flight, comparison: Comparison) -> Iterator[Finding]:
    t = flight.imu(comparison.track.source).t  # with what is not judged
    gaps = np.flatnonzero(np.diff(t) > comparison.how.limits.longest_step(t))
    pauses = _paused(flight, t[gaps], t[gaps + 1])
    for paused, which in ((False, gaps[~pauses]), (True, gaps[pauses])):
        if not len(which):
            continue
        lengths = t[which + 1] - t[which]
        what, advice = counted(len(which), "gap"), "Check the link quality, or use the on-board log. "
        if paused:
            what, advice = counted(len(which), "pause") + " while disarmed", "Logging stops while disarmed. "
        elif flight.on_board:
            advice = "The logger could not keep up: check the SD card, or log fewer other messages. "
        yield Finding(
            "samples_missing",
            "data",
            "warning" if not paused and lengths.sum() > 0.01 * (t[-1] - t[0]) else "info",
            float(t[which[0]]),
            float(t[which[-1] + 1]),
            f"{comparison.track.source} has {what}, {lengths.sum():.1f} s in all, the longest {lengths.max():.2f} s",
            advice + "Windows over gaps are left out.",
        )


def _paused(flight: Flight, begin: Array, end: Array) -> BoolArray:
    """Which gaps (N,) of an on-board log are none of the logger's: the vehicle was not armed all the while.

    ArduPilot logs nothing then unless LOG_DISARMED says so, and begins with the next arming in the same file.
    """
    armed = flight.armed(begin, begin)
    if armed is None or not flight.on_board:
        return np.zeros(len(begin), np.bool_)
    changes = np.array([event.t for event in flight.events if event.kind in {"armed", "disarmed"}])
    return ~armed | (np.searchsorted(changes, end + check.ARMS_S, side="right") > np.searchsorted(changes, begin))


def stamp_findings(
    flight: Flight, comparison: Comparison, lags: Sequence[tuple[float, float, float]]
) -> Iterator[Finding]:
    """The times themselves are wrong: uneven beyond what a link does, or running away from the attitude's.

    lags: (begin s, end s, lag s) of the IMU behind the attitude, part by part of the flight.
    """
    track = comparison.track
    period, interval = float(np.median(np.diff(track.t))), np.diff(track.t)
    within = interval[interval < check.GAP_PERIODS * period]
    off = np.abs(within - np.maximum(1.0, np.round(within / period)) * period)
    uneven = float(np.percentile(off, 90))
    if uneven > max(healthy.UNEVEN_PERIOD * period, healthy.UNEVEN_S):
        yield Finding(
            "samples_irregular",
            "data",
            "warning" if uneven > 2 * healthy.UNEVEN_PERIOD * period else "info",
            float(track.t[0]),
            float(track.t[-1]),
            f"one interval in ten of {track.source} is off by {uneven * 1e3:.0f} ms or more from multiples of "
            f"{period * 1e3:.0f} ms",
            "The processor was too busy to sample evenly. Look at its load, and log less."
            if flight.on_board
            else "The autopilot timestamps on sending, not on sampling: a busy link or processor causes jitter. "
            "Ask for fewer messages, or use the on-board log.",
        )
    if len(lags) < 2:
        return
    first, last = lags[0], lags[-1]
    moved = last[2] - first[2]
    if abs(moved) > harm.CLOCK_MOVED_S:
        yield Finding(
            "clocks_diverge",
            "data",
            "error" if abs(moved) > harm.CLOCK_SPOILT_S else "warning",
            first[0],
            last[1],
            f"the IMU lags {first[2] * 1e3:.0f} ms behind the attitude at first and "
            f"{last[2] * 1e3:.0f} ms at last: their clocks run at different rates",
            "Both have to be stamped by one clock. Record the autopilot's own messages"
            + ("." if flight.on_board else ", or use the on-board log."),
        )


def lags(comparison: Comparison) -> list[tuple[float, float, float]]:
    """(begin s, end s, lag s) of each third of the flight that turns enough to tell, by the best match of the turns."""
    track, reference = comparison.track, comparison.reference
    if track.rate_hz < 1 / check.LAG_TURN_S or track.t[-1] - track.t[0] < check.LAG_PARTS * 4 * check.LAG_MAX_S:
        return []
    if (track.t[-1] - track.t[0]) / check.LAG_GRID_S > check.LAG_OVERSAMPLED * len(track):
        return []  # mostly gaps
    grid = np.arange(track.t[0] + check.LAG_TURN_S, track.t[-1] - check.LAG_TURN_S, check.LAG_GRID_S)
    half = check.LAG_TURN_S / 2
    ends = [np.clip(np.searchsorted(track.t, grid + one), 0, len(track) - 1) for one in (-half, half)]
    good = reference.attitude_known[ends[0]] & reference.attitude_known[ends[1]] & (ends[1] > ends[0])
    span = np.maximum(track.t[ends[1]] - track.t[ends[0]], 1e-9)[:, None]
    turned = [
        quaternion.log(quaternion.multiply(quaternion.conjugate(q[ends[0]]), q[ends[1]])) / span
        for q in (comparison.path.q, reference.q_ned_frd)
    ]
    by_part = []
    for part in np.array_split(np.arange(len(grid)), check.LAG_PARTS):
        lag = _best(turned[0][part], turned[1][part], np.asarray(good[part]))
        if lag is not None:
            by_part.append((float(grid[part[0]]), float(grid[part[-1]]), lag))
    return by_part


def _best(gyro: Array, attitude: Array, good: BoolArray) -> float | None:
    """The shift, s, that leaves the least between two rates (N, 3); None where none stands out."""
    most = round(check.LAG_MAX_S / check.LAG_GRID_S)
    inner = slice(most, len(gyro) - most)
    seen, known = attitude[inner] - attitude[inner].mean(axis=0), good[inner]  # a constant rate fits any lag
    gyro = gyro - gyro[inner].mean(axis=0)
    power = median((seen[known] ** 2).sum(axis=1)) if known.any() else 0.0
    if power < check.LAG_MIN_RPS**2:
        return None
    left = np.array(
        [
            median(((gyro[most + k : len(gyro) - most + k][known] - seen[known]) ** 2).sum(axis=1))
            for k in range(-most, most + 1)
        ]
    )
    k = int(np.argmin(left))
    shifts = check.LAG_ASIDE
    aside = left[max(0, k - shifts) : k + shifts + 1][[0, -1]].min()
    if not shifts <= k <= 2 * most - shifts or left[k] > check.LAG_SHARP * min(power, aside):
        return None
    below, at, above = left[k - 1 : k + 2]
    return float((k - most + 0.5 * (below - above) / max(below - 2 * at + above, 1e-12)) * check.LAG_GRID_S)
