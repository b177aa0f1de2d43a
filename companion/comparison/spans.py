"""Spans of a flight: where something lasts, from when to when, and readings that do not change."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from companion.constants import check
from companion.model import Array, BoolArray, IntArray

Span = tuple[float, float]
"""From when to when, s, boot clock."""


def ends_of(t: Array) -> Span:
    """The first and the last of times (N,), s."""
    return float(t[0]), float(t[-1])


def run_edges(flags: BoolArray) -> tuple[IntArray, IntArray]:
    """First and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return edges[::2], edges[1::2] - 1


def runs(flags: BoolArray) -> Iterator[tuple[int, int]]:
    """The same, run by run."""
    yield from zip(*(edge.tolist() for edge in run_edges(flags)), strict=True)


def spans(t: Array, flags: BoolArray) -> list[Span]:
    """From when to when each is; t: (N,) s."""
    return [(float(t[first]), float(t[last])) for first, last in runs(flags)]


def standing_still(same: BoolArray, t: Array, least_s: float) -> list[tuple[int, int]]:
    """First and last of the samples at t (N,) that do not change for longer than so many s; same: (N-1,) neighbours."""
    first, last = run_edges(same)
    long = t[last + 1] - t[first] > least_s
    return list(zip(first[long].tolist(), (last[long] + 1).tolist(), strict=True))


def grouped(t: Array, at: IntArray, apart_s: float = check.GROUPED_S) -> list[IntArray]:
    """Indices of times t (N,), those that are close together as one group."""
    return np.split(at, np.flatnonzero(np.diff(t[at]) > apart_s) + 1) if len(at) else []


def unchanged(readings: Array) -> BoolArray:
    """Where each of readings (N, 3) is the one before, (N-1, 3). Floats flicker in their last digits."""
    change = np.abs(np.diff(readings, axis=0))
    if not len(change):
        return np.zeros((0, 3), np.bool_)
    nothing = np.full(3, check.STUCK_CHANGE * np.median(change, axis=0).max())
    own = check.STUCK_CHANGE * np.quantile(change, check.STUCK_USUAL, axis=0)
    usual = np.quantile(readings, (1.0 - check.STUCK_USUAL, check.STUCK_USUAL), axis=0)
    moves = np.ptp(usual, axis=0) > check.STUCK_SWING * nothing
    nothing[moves] = np.minimum(nothing, own)[moves]  # the others may be shaken alone
    return np.asarray(change <= np.maximum(nothing, check.FLOAT32_BITS * np.abs(readings[1:])))
