"""Time stamps that leave the flight's own course, as one flipped bit makes them: what carries one is left out, counted.

A .bin and a .ulg have no checksum, and a frame with a right one may still lie: one such time makes a flight of
thousands of years, and every grid over it larger than memory. What the autopilot itself does to its clock stays: gaps,
reboots, steps back, and packets that come late or twice.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from companion.model import Array, weighted_median

BoolArray = npt.NDArray[np.bool_]

LONGEST_WAIT_S = 1.0
"""From a measurement to its record: a second time in a record, that of its sample, is no more than this off the first,
which is the one that is checked."""

_NEIGHBOURS = 2  # on either side; together with its own, the median of five times stays at every step that lasts
_SURE = 3 * _NEIGHBOURS + 1  # samples of a stream that say by themselves where the flight was
_PASSES = 5  # a burst of wrong times thins out from its edges
_PERIODS = 3.0


@dataclass(frozen=True, slots=True)
class Course:
    """How far a time may be off the times around it."""

    disorder_s: float  # from the median of its neighbours in the stream, and no less than three median periods
    before_s: float  # the first samples of a stream may lie before what all streams cover
    after_s: float  # and its last behind it
    away_s: float  # from the median of all streams: what is further off is of another clock


ON_BOARD = Course(disorder_s=1.0, before_s=np.inf, after_s=600.0, away_s=86400.0)
"""A logger writes what it measures, in order; first of all what was said last, perhaps when the board had just booted
(PX4: test_motor at 0 s). It has one clock, and no flight lasts a day; UNIX time is 20,000 times as far away."""

ON_LINK = Course(disorder_s=10.0, before_s=600.0, after_s=600.0, away_s=np.inf)
"""Routers deliver packets late and twice, radios hand out what they had buffered minutes before a flight."""


def off_course(streams: Mapping[str, Array], course: Course) -> dict[str, BoolArray]:
    """Which samples leave the flight's course, (N,) for each stream that has such: its times (N,) s, in file order.

    Per stream: those that stand apart from the median of five, while the stream goes on as before. The first and last
    two of a stream, where nothing follows, and all of a stream of less than seven: those that lie further from what the
    other samples of all streams cover than any silence is long. In between, no sample of a stream whose times only rise
    is ever left out, however long its gaps are.
    """
    middle = _middle([t for t in streams.values() if len(t)]) if np.isfinite(course.away_s) else np.nan
    apart = {name: _apart(t, _elsewhere(t, middle, course.away_s), course.disorder_s) for name, t in streams.items()}
    covered = np.array([_core(t[~apart[name]]) for name, t in streams.items() if (~apart[name]).sum() >= _SURE])
    for name, t in streams.items():
        if len(covered):
            kept = np.flatnonzero(~apart[name])
            if len(kept) >= _SURE:
                kept = np.concatenate([kept[:_NEIGHBOURS], kept[-_NEIGHBOURS:]])
            ends = t[kept][:, None]
            near = (ends >= covered[:, 0] - course.before_s) & (ends <= covered[:, 1] + course.after_s)
            apart[name][kept[~near.any(axis=1)]] = True
    return {name: mask for name, mask in apart.items() if mask.any()}


def left_out(streams: Mapping[str, Array], apart: Mapping[str, BoolArray]) -> list[str]:
    """A note for each stream that `off_course` found such samples in."""
    return [
        f"{name}: {int(mask.sum())} of {len(mask)} left out: their time stamps leave the flight's course "
        f"(the first says {streams[name][mask][0]:.6g} s)"
        for name, mask in apart.items()
    ]


def _middle(streams: list[Array]) -> float:
    """The median of the streams' medians, each with the weight of its samples."""
    if not streams:
        return 0.0
    return weighted_median(np.array([np.median(t) for t in streams]), np.array([float(len(t)) for t in streams]))


def _core(t: Array) -> tuple[float, float]:
    """What a stream covers for certain: without its first and last two."""
    inner = t[_NEIGHBOURS:-_NEIGHBOURS]
    return float(inner.min()), float(inner.max())


def _elsewhere(t: Array, middle: float, away_s: float) -> BoolArray:
    """Which of the times (N,) are none, or further than `away_s` from the middle."""
    return np.asarray(~(np.abs(t - middle) < away_s) if np.isfinite(away_s) else ~np.isfinite(t))


def _apart(t: Array, elsewhere: BoolArray, disorder_s: float) -> BoolArray:
    """Which of the times (N,) are `elsewhere`, or stand apart from the median of five around them."""
    apart = elsewhere.copy()
    if not apart.any() and not (t[1:] < t[:-1]).any():  # as of most streams
        return apart
    for _ in range(_PASSES):
        kept = np.flatnonzero(~apart) if apart.any() else None
        rest = t if kept is None else t[kept]
        falls = np.flatnonzero(rest[1:] < rest[:-1])
        if not len(falls):
            break
        reach = np.arange(1 - _NEIGHBOURS, _NEIGHBOURS + 1)  # from one before a fall's first sample to one behind
        index = np.unique(np.clip(falls[:, None] + reach, 0, len(rest) - 1))
        around = np.clip(index[:, None] + np.arange(-_NEIGHBOURS, _NEIGHBOURS + 1), 0, len(rest) - 1)
        off = np.abs(rest[index] - np.sort(rest[around], axis=1)[:, _NEIGHBOURS])
        if not (off > disorder_s).any():  # as of reboots alone: the median of all steps is not needed
            break
        away = off > max(disorder_s, _PERIODS * float(np.median(np.abs(np.diff(rest)))))
        if not away.any():
            break
        apart[index[away] if kept is None else kept[index[away]]] = True
    return apart
