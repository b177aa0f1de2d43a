"""The signal between two samples of the IMU: a line, the cubic through four samples, or the one that conserves means.

The cubic is written in Newton's form for unequally spaced times: the line plus a bend made of the second divided
differences at both ends of the interval. At the ends of a track a fourth sample is missing; the track is continued by
one sample that lies on the cubic of the nearest four, which makes the same formula the one-sided cubic.

Samples may be means over intervals which join on to one another: integrals of what the sensor felt, not readings. A
flight controller integrates its sensor at the full rate and hands out `delta_angle / dt` and `delta_velocity / dt`
(PX4 `modules/sensors/Integrator.hpp`): between them nothing is lost, so what turns and accelerates the body over an
interval is known, whatever happened inside. The curve through the means taken as readings would not turn by it. The
rotation over an interval is the sample's. Where inside it the body turns and what that makes of the velocity is the
line's whose mean is the sample, with the slope of the parabola through the neighbours' means. On smooth motion that is
of order 4 in the interval (3 where intervals are unequal), and of the attitude nothing adds up. States stand at the
samples' times, in the middle of their intervals, as those of readings do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.model import Array, ImuTrack
from companion.strapdown import _components as rows

MIDDLES: Final = ("linear", "cubic")
"""Interpolations between two samples."""

UNEVEN: Final = 30.0
"""An interval this many times as long as a neighbour gets the line: across a gap, or beside two samples sent in one
burst, the cubic would multiply the noise of the readings (by about 3/16 of the ratio)."""


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """Gyro (rows 0-2, rad/s) and accelerometer (rows 3-5, m/s²) inside each of n intervals, component-first."""

    dt: Array  # (n,) s
    start: Array  # (6, n) the sample at the start of the interval
    end: Array  # (6, n) the sample at its end
    before: Array | None = None  # (n,) s, the interval before; None: linear
    after: Array | None = None  # (n,) s, the interval after
    bend0: Array | None = None  # (6, n) second divided difference around `start`
    bend1: Array | None = None  # (6, n) the same around `end`

    def at(self, fraction: float | Array) -> Array:
        """The signal (6, n) at a fraction 0..1 of each interval; a number or one per interval."""
        if isinstance(fraction, float) and fraction in (0.0, 1.0):
            return self.end if fraction else self.start
        line = np.subtract(self.end, self.start, out=rows.empty(*self.start.shape))
        line *= fraction
        line += self.start
        if self.before is None or self.after is None or self.bend0 is None or self.bend1 is None:
            return line
        h = self.dt
        scale = fraction * (1.0 - fraction) * h * h / (self.before + h + self.after)
        weight0, weight1 = scale * ((1.0 - fraction) * h + self.after), scale * (fraction * h + self.before)
        line -= rows.times(weight0, self.bend0)
        line -= rows.times(weight1, self.bend1)
        return line


def signal_of(imu: ImuTrack, first: int, last: int, middle: str) -> Signal:
    """The signal in intervals first..last-1 of a track, i.e. between samples first..last."""
    if middle == "linear":
        part = slice(first, last + 1)
        x = _rows(imu, part)
        t = imu.t[part]
        return Signal(t[1:] - t[:-1], x[:, :-1], x[:, 1:])
    part = slice(max(first - 1, 0), last + 2)
    t, x = imu.t[part], _rows(imu, part)
    if first == 0:
        t, x = _continued(imu, t, x, slice(None, 4), at_start=True)
    if last == len(imu) - 1:
        t, x = _continued(imu, t, x, slice(-4, None), at_start=False)
    h = t[1:] - t[:-1]
    slope = np.subtract(x[:, 1:], x[:, :-1], out=rows.empty(6, len(h)))
    slope /= h
    bend = np.subtract(slope[:, 1:], slope[:, :-1], out=rows.empty(6, len(h) - 1))
    bend /= h[:-1] + h[1:]
    bend0, bend1 = bend[:, :-1], bend[:, 1:]
    if h.max() > UNEVEN * h.min():
        even = ~uneven(h)[1:-1]
        bend0, bend1 = bend0 * even, bend1 * even
    return Signal(h[1:-1], x[:, 1:-2], x[:, 2:-1], h[:-2], h[2:], bend0, bend1)


def uneven(dt: Array) -> npt.NDArray[np.bool_]:
    """Which of the intervals (n,) are too long beside a neighbour for the cubic."""
    mark = np.zeros(len(dt), dtype=np.bool_)
    mark[1:] |= dt[1:] > UNEVEN * dt[:-1]
    mark[:-1] |= dt[:-1] > UNEVEN * dt[1:]
    return mark


def _rows(imu: ImuTrack, part: slice) -> Array:
    """The samples of a part of the track, component-first (6, n) and contiguous: views would be strided."""
    x = rows.empty(6, len(imu.t[part]))
    x[:3], x[3:] = imu.gyro[part].T, imu.accel[part].T
    return x


def _continued(imu: ImuTrack, t: Array, x: Array, nearest: slice, *, at_start: bool) -> tuple[Array, Array]:
    """Times and samples with one more, extrapolated by the polynomial through the nearest four (or all there are)."""
    nodes = imu.t[nearest]
    if len(nodes) > 2 and uneven(np.diff(nodes)).any():
        nearest = slice(None, 2) if at_start else slice(-2, None)
        nodes = imu.t[nearest]
    when = 2.0 * nodes[0] - nodes[1] if at_start else 2.0 * nodes[-1] - nodes[-2]
    apart = nodes[:, None] - nodes
    np.fill_diagonal(apart, 1.0)
    reach = np.repeat((when - nodes)[None], len(nodes), axis=0)
    np.fill_diagonal(reach, 1.0)
    sample = _rows(imu, nearest) @ (reach / apart).prod(axis=1)
    if at_start:
        return np.concatenate(([when], t)), np.concatenate((sample[:, None], x), axis=1)
    return np.concatenate((t, [when])), np.concatenate((x, sample[:, None]), axis=1)


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

    One-sided at an end of the track; beside a gap the line's to the other side, between two gaps zero. Written with
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
