"""Samples that are means over intervals which join on to one another: integrals of what the sensor felt, not readings.

A flight controller integrates its sensor at the full rate and hands out `delta_angle / dt` and `delta_velocity / dt`
(PX4 `modules/sensors/Integrator.hpp`): between them nothing is lost, so what turns and accelerates the body over an
interval is known, whatever happened inside. The curve through the means taken as readings would not turn by it.

The rotation over an interval is the sample's. Where inside it the body turns and what that makes of the velocity is the
line's whose mean is the sample, with the slope of the parabola through the neighbours' means. On smooth motion that is
of order 4 in the interval (3 where intervals are unequal), and of the attitude nothing adds up.

States stand at the samples' times, in the middle of their intervals, as those of readings do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.model import Array, ImuTrack
from companion.strapdown import _components as rows
from companion.strapdown._signal import Signal

EXACT: Final = 1e-9  # s, far below any clock's step

JOINED: Final = 0.25
"""Two intervals join where the gap or overlap between them is at most this share of the time between their middles.
Elsewhere (a sample lost, or a log that has every hundredth) a mean is no more than a reading at its middle."""


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """The way from the middle of each sample's interval to that of the next: n ways between n + 1 samples."""

    beginning: Signal  # (n + 1) to the middle of each sample's interval
    rest: Signal  # (n) from the middle on
    turn: Array  # (3, n) rad, rotation vector over the whole interval of which `rest` is the second half
    gap: Signal | None  # (n) from the end of an interval to the start of the next; None where they join exactly


def joined(imu: ImuTrack, first: int, last: int) -> npt.NDArray[np.bool_]:
    """Where between samples first..last the intervals of neighbours join, (last - first,)."""
    if imu.interval is None:
        return np.zeros(last - first, np.bool_)
    own, t = imu.interval[first : last + 1], imu.t[first : last + 1]
    h = t[1:] - t[:-1]
    return np.asarray(np.abs(h - 0.5 * (own[:-1] + own[1:])) <= JOINED * h)


def pieces(imu: ImuTrack, first: int, last: int) -> Pieces:
    """The signal between samples first..last of a track of means."""
    if imu.interval is None:
        raise ValueError("the samples of this track are readings of an instant, not means over intervals")
    begin, end = max(first - 1, 0), min(last + 1, len(imu) - 1)
    part = slice(begin, end + 1)
    t, own = imu.t[part], imu.interval[part]
    x = np.concatenate((imu.gyro[part].T, imu.accel[part].T))
    slope = _slopes(t, own, x, joined(imu, begin, end), at_start=begin == 0, at_end=end == len(imu) - 1)
    here = slice(first - begin, last - begin + 1)
    t, own, x, slope = t[here], own[here], x[:, here], slope[:, here]
    turn = x[:3, :-1] * own[:-1]
    # A rotation vector has its coning in it, and a line of this mean would add that of its own: take it off.
    x[:3] -= rows.cross(x[:3], slope[:3]) * own * own / 12.0
    reach = slope * own / 2.0
    before, after = x - reach, x + reach
    apart = t[1:] - t[:-1] - 0.5 * (own[:-1] + own[1:])
    return Pieces(
        Signal(own / 2.0, before, x),
        Signal(own[:-1] / 2.0, x[:, :-1], after[:, :-1]),
        turn,
        Signal(apart, after[:, :-1], before[:, 1:]) if np.abs(apart).max() > EXACT else None,
    )


def _slopes(t: Array, own: Array, x: Array, join: npt.NDArray[np.bool_], *, at_start: bool, at_end: bool) -> Array:
    """Slopes (6, n) over the intervals `own` (n,) of means x (6, n): of the parabola with the means of three of them.

    One-sided at an end of the track; beside a hole the line's to the other side, between two holes zero. Written with
    the parabola's second derivative, for which the means of unequal intervals count (Colella & Woodward 1984, eq. 1.7,
    in other words).
    """
    slope = np.zeros_like(x)
    if len(t) < 2:
        return slope
    h = t[1:] - t[:-1]
    rise, wider = (x[:, 1:] - x[:, :-1]) / h, (own[1:] - own[:-1]) / 6.0
    slope[:, 1:] = np.where(join, rise, 0.0)
    slope[:, :-1] = np.where(join, rise, slope[:, :-1])
    both = join[:-1] & join[1:]
    if not both.any():
        return slope
    bend = (rise[:, 1:] - rise[:, :-1]) / (h[1:] + h[:-1] + wider[1:] - wider[:-1])
    slope[:, 1:-1] = np.where(both, rise[:, :-1] + bend * (h - wider)[:-1], slope[:, 1:-1])
    if at_start and both[0]:
        slope[:, 0] = rise[:, 0] - bend[:, 0] * (h + wider)[0]
    if at_end and both[-1]:
        slope[:, -1] = rise[:, -1] + bend[:, -1] * (h - wider)[-1]
    return slope
