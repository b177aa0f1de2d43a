"""What the IMU measures between its samples: a line, or the cubic through the four samples around.

The cubic is written in Newton's form for unequally spaced times: the line plus a bend made of the second divided
differences at both ends of the interval. At the ends of a track a fourth sample is missing; the track is continued by
one sample that lies on the cubic of the nearest four, which makes the same formula the one-sided cubic.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.model import Array, ImuTrack

MIDDLES: Final = ("linear", "cubic")
"""How the signal runs inside an interval."""

UNEVEN: Final = 30.0
"""An interval this many times as long as a neighbour gets the line: across a hole, or beside two samples sent in one
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
        line = self.start + fraction * (self.end - self.start)
        if self.before is None or self.after is None or self.bend0 is None or self.bend1 is None:
            return np.asarray(line)
        h = self.dt
        scale = fraction * (1.0 - fraction) * h * h / (self.before + h + self.after)
        weight0, weight1 = scale * ((1.0 - fraction) * h + self.after), scale * (fraction * h + self.before)
        return np.asarray(line - (weight0 * self.bend0 + weight1 * self.bend1))

    def take(self, index: npt.NDArray[np.intp]) -> Signal:
        """The signal in chosen intervals."""
        columns = (self.dt, self.start, self.end, self.before, self.after, self.bend0, self.bend1)
        return Signal(*(column if column is None else column[..., index] for column in columns))  # type: ignore[arg-type]


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
    slope = (x[:, 1:] - x[:, :-1]) / h
    bend = (slope[:, 1:] - slope[:, :-1]) / (h[:-1] + h[1:])
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
    x = np.empty((6, len(imu.t[part])))
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
