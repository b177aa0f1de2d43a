"""What one IMU interval adds: body increments (dq, dv, dp) without gravity, for all intervals at once.

A step starts from the identity, not from q_n, so every increment depends on its own samples alone and all of them are
computed as arrays; `companion.strapdown.dead_reckon` then multiplies and sums them up. The integrators are steps over
an interval or a piece of it, in one table (`METHODS`).

Between two samples the signal is a line through them (`middle="linear"`) or the cubic through the four samples around
(`middle="cubic"`): on smooth motion RK4 is of order 2 with the line and 4 with the cubic (docs/mathematics.md). The
cubic is written in Newton's form for unequally spaced times: the line plus a bend made of the second divided
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

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.model import Array, DataError, ImuTrack, SettingsError
from companion.strapdown import _components as components
from companion.strapdown import quaternion

MIDDLES: Final = ("linear", "cubic")
"""Interpolations between two samples."""

_UNEVEN: Final = 30.0
"""An interval this many times as long as a neighbour gets the line: across a gap, or beside two samples sent in one
burst, the cubic would multiply the noise of the readings (by about 3/16 of the ratio)."""


@dataclass(frozen=True, slots=True, eq=False)
class _Signal:
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
        line = np.subtract(self.end, self.start, out=components.empty(*self.start.shape))
        line *= fraction
        line += self.start
        if self.before is None or self.after is None or self.bend0 is None or self.bend1 is None:
            return line
        h = self.dt
        scale = fraction * (1.0 - fraction) * h * h / (self.before + h + self.after)
        weight0, weight1 = scale * ((1.0 - fraction) * h + self.after), scale * (fraction * h + self.before)
        line -= components.times(weight0, self.bend0)
        line -= components.times(weight1, self.bend1)
        return line


def _signal_of(imu: ImuTrack, first: int, last: int, middle: str) -> _Signal:
    """The signal in intervals first..last-1 of a track, i.e. between samples first..last."""
    if middle == "linear":
        part = slice(first, last + 1)
        x = _rows(imu, part)
        t = imu.t[part]
        return _Signal(t[1:] - t[:-1], x[:, :-1], x[:, 1:])
    part = slice(max(first - 1, 0), last + 2)
    t, x = imu.t[part], _rows(imu, part)
    if first == 0:
        t, x = _continued(imu, t, x, slice(None, 4), at_start=True)
    if last == len(imu) - 1:
        t, x = _continued(imu, t, x, slice(-4, None), at_start=False)
    h = t[1:] - t[:-1]
    slope = np.subtract(x[:, 1:], x[:, :-1], out=components.empty(6, len(h)))
    slope /= h
    bend = np.subtract(slope[:, 1:], slope[:, :-1], out=components.empty(6, len(h) - 1))
    bend /= h[:-1] + h[1:]
    bend0, bend1 = bend[:, :-1], bend[:, 1:]
    if h.max() > _UNEVEN * h.min():
        even = ~_uneven(h)[1:-1]
        bend0, bend1 = bend0 * even, bend1 * even
    return _Signal(h[1:-1], x[:, 1:-2], x[:, 2:-1], h[:-2], h[2:], bend0, bend1)


def _uneven(dt: Array) -> npt.NDArray[np.bool_]:
    """Which of the intervals (n,) are too long beside a neighbour for the cubic."""
    mark = np.zeros(len(dt), dtype=np.bool_)
    mark[1:] |= dt[1:] > _UNEVEN * dt[:-1]
    mark[:-1] |= dt[:-1] > _UNEVEN * dt[1:]
    return mark


def _rows(imu: ImuTrack, part: slice) -> Array:
    """The samples of a part of the track, component-first (6, n) and contiguous: views would be strided."""
    x = components.empty(6, len(imu.t[part]))
    x[:3], x[3:] = imu.gyro[part].T, imu.accel[part].T
    return x


def _continued(imu: ImuTrack, t: Array, x: Array, nearest: slice, *, at_start: bool) -> tuple[Array, Array]:
    """Times and samples with one more, extrapolated by the polynomial through the nearest four (or all there are)."""
    nodes = imu.t[nearest]
    if len(nodes) > 2 and _uneven(np.diff(nodes)).any():
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


_EXACT: Final = 1e-9  # s, far below any clock's step

_JOINED: Final = 0.25
"""Two intervals join where the gap or overlap between them is at most this share of the time between their middles.
Elsewhere (a sample lost, or a log that has every hundredth) a mean is no more than a reading at its middle."""


@dataclass(frozen=True, slots=True, eq=False)
class _Pieces:
    """The way from the middle of each sample's interval to that of the next: n ways between n + 1 samples."""

    beginning: _Signal  # (n + 1) to the middle of each sample's interval
    rest: _Signal  # (n) from the middle on
    turn: Array  # (3, n) rad, rotation vector over the whole interval of which `rest` is the second half
    gap: _Signal | None  # (n) from the end of an interval to the start of the next; None where they join exactly


def joined(imu: ImuTrack, first: int, last: int) -> npt.NDArray[np.bool_]:
    """Where between samples first..last the intervals of neighbours join, (last - first,)."""
    if imu.interval is None:
        return np.zeros(last - first, np.bool_)
    own, t = imu.interval[first : last + 1], imu.t[first : last + 1]
    h = t[1:] - t[:-1]
    return np.asarray(np.abs(h - 0.5 * (own[:-1] + own[1:])) <= _JOINED * h)


def _pieces(imu: ImuTrack, first: int, last: int) -> _Pieces:
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
    x[:3] -= components.cross(x[:3], slope[:3]) * own * own / 12.0
    reach = slope * own / 2.0
    before, after = x - reach, x + reach
    apart = t[1:] - t[:-1] - 0.5 * (own[:-1] + own[1:])
    return _Pieces(
        _Signal(own / 2.0, before, x),
        _Signal(own[:-1] / 2.0, x[:, :-1], after[:, :-1]),
        turn,
        # Of an interval that is not known, as the first may be, nothing follows for the others.
        _Signal(apart, after[:, :-1], before[:, 1:]) if np.nanmax(np.abs(apart), initial=0.0) > _EXACT else None,
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


Moved = tuple[Array, Array]
"""dq (4, n), and dv and dp side by side, (3, 2, n): both are turned by the same attitudes."""

Step = Callable[[_Signal, float, float], Moved]
"""(signal of n intervals, begin, end as fractions of them) → what they add, dq not normalised."""


@dataclass(frozen=True, slots=True)
class Method:
    """One integrator."""

    title: str  # as people choose it
    order: int  # of convergence with the cubic; with the line 2 at most (docs/mathematics.md)
    looks_inside: bool  # whether it takes the signal between two samples, so that `middle` changes its result
    step: Step


def _euler(signal: _Signal, begin: float, end: float) -> Moved:
    """Euler: everything as at the start of the interval."""
    h = (end - begin) * signal.dt
    x = signal.at(begin)
    return _one_and(0.5 * h * x[:3]), _uniform(h, h * x[3:])


def _uniform(h: Array, dv: Array) -> Array:
    """dv beside the dp of an acceleration that is the same all the while."""
    return np.stack((dv, 0.5 * h * dv), axis=1)


def _midpoint(signal: _Signal, begin: float, end: float) -> Moved:
    """Midpoint: the mean rate turns; the mean of both specific forces, each in its own attitude, accelerates."""
    h = (end - begin) * signal.dt
    x0, x1 = signal.at(begin), signal.at(end)
    dq = _one_and(0.25 * h * (x0[:3] + x1[:3]))
    return dq, _uniform(h, 0.5 * h * (x0[3:] + components.rotate(dq[0], dq[1:], x1[3:])))


def _rk4(signal: _Signal, begin: float, end: float) -> Moved:
    """RK4 of attitude, velocity and position, in one step that starts from the identity (docs/mathematics.md).

    The accelerations a0, a1, a2, a3 use the same intermediate q1, q2, q3 as the attitude; those are not of unit length,
    `change` takes the rotation they stand for. Position: its slopes k are those of the velocity equation, so with
    b = a1 + a2, dv = h/6 (a3 + b + a0 + b) and dp = h²/6 (a0 + b) (docs/mathematics.md).
    """
    h = (end - begin) * signal.dt
    x0, xm, x1 = signal.at(begin), signal.at(0.5 * (begin + end)), signal.at(end)
    dq, (q1, q2, q3) = rk4_attitude(h, x0[:3], xm[:3], x1[:3])
    moves, sixth = components.empty(3, 2, len(h)), components.times(1.0 / 6.0, h)
    dv, dp = moves[:, 0], moves[:, 1]
    np.add(xm[3:], xm[3:], out=dp)
    dp += components.change(*q1, xm[3:])
    dp += components.change(*q2, xm[3:])
    np.add(x1[3:], dp, out=dv)
    dv += components.change(*q3, x1[3:])
    dp += x0[3:]
    dv += dp
    dv *= sixth
    dp *= np.multiply(sixth, h, out=sixth)
    return dq, moves


def rk4_attitude(
    h: Array, w0: Array, wm: Array, w1: Array
) -> tuple[Array, tuple[tuple[float, Array], tuple[Array, Array], tuple[Array, Array]]]:
    """dq (4, n), not normalised, and the intermediate q1, q2, q3 up to their length: scalar and vector (3, n) of each.

    With a = h/4 w0, m = h/2 wm, b = h/2 w1 the products h k of the step are
    hk1 = [0, 2a], hk2 = q1 ⊗ [0, m], hk3 = q2 ⊗ [0, m], hk4 = q3 ⊗ [0, b], and with s = a·m, μ = m·m/2, since m x m = 0
    and (a x m) x m = s m - 2μ a:
    q1 = [1, a], hk2 = [-s, m + a x m]; 2 q2 = [2 - s, m + a x m], hk3 = [-μ, e] with e = m - μ a;
    q3 = [1 - μ, e], hk4 = [-e·b, (1 - μ) b + e x b].
    Written in place: a new array a term would take as long as its numbers.
    """
    half = components.times(0.5, h)
    m, b = components.times(half, wm), components.times(half, w1)
    a = components.times(np.multiply(0.5, half, out=half), w0)
    s, mu = components.dot(a, m), components.dot(m, m)
    mu *= 0.5
    k2, e = components.cross(a, m), components.times(mu, a)
    k2 += m
    np.subtract(m, e, out=e)
    w2, w3, dq = components.empty(len(h)), components.empty(len(h)), components.empty(4, len(h))
    np.subtract(2.0, s, out=w2)
    np.subtract(1.0, mu, out=w3)
    s += mu
    s *= 2.0
    s += components.dot(e, b)
    s *= -1.0 / 6.0
    np.add(1.0, s, out=dq[0])
    turn = np.add(a, k2, out=dq[1:])
    turn += e
    turn *= 2.0
    turn += components.cross(e, b)
    b *= w3
    turn += b
    turn *= 1.0 / 6.0
    return dq, ((1.0, a), (w2, k2), (w3, e))


def _one_and(vector: Array) -> Array:
    """The quaternion [1, vector], (4, n)."""
    return np.concatenate((np.ones((1, vector.shape[1])), vector))


METHODS: Final[Mapping[str, Method]] = {
    "euler": Method("Euler (simplest)", 1, looks_inside=False, step=_euler),
    "midpoint": Method("Midpoint", 2, looks_inside=False, step=_midpoint),
    "rk4": Method("RK4 (most exact)", 4, looks_inside=True, step=_rk4),
}
"""Name → integrator, by rising order."""


@dataclass(frozen=True, slots=True)
class Scheme:
    """Integration options: the method, the interpolation between samples, and the substeps of an interval."""

    method: str
    middle: str
    segments: int

    @property
    def looks_ahead(self) -> bool:
        """Whether an interval needs the sample after it: where a method looks inside an interval, and by the cubic."""
        return self.middle == "cubic" and (METHODS[self.method].looks_inside or self.segments > 1)

    def notes_on(self, imu: ImuTrack) -> tuple[str, ...]:
        """What the numbers of this scheme on this track do not show."""
        notes = []
        if self.looks_ahead and len(imu) in (2, 3):
            shape = "the line" if len(imu) == 2 else "the parabola"
            notes.append(
                f"the cubic needs 4 samples and the track has {len(imu)}: {shape} through them was used instead"
            )
        if len(imu) < 2:
            return ()
        # Both bounds are cheap; only a track that breaks one is looked at step by step.
        dt = imu.t[1:] - imu.t[:-1]
        longest = dt.max()
        if self.looks_ahead and longest > _UNEVEN * dt.min():
            notes.append(
                f"more than {_UNEVEN:g} times as long as a neighbour: {int(_uneven(dt).sum())} of {len(dt)} intervals "
                "(a gap, or a burst of samples); linearly interpolated there"
            )
        if max(imu.gyro.max(), -imu.gyro.min()) * longest > np.pi / np.sqrt(3.0):
            rate = np.linalg.norm(imu.gyro, axis=1)
            fast = int((np.maximum(rate[:-1], rate[1:]) * dt > np.pi).sum())
            if fast:
                notes.append(
                    f"{fast} of {len(dt)} intervals turn by more than π: samples that far apart do not determine "
                    "the attitude; record at a higher rate or leave these intervals out"
                )
        return tuple(notes)


def scheme_for(method: str, middle: str, segments: int) -> Scheme:
    """The scheme with these settings. Raises SettingsError if one of them is no good."""
    if method not in METHODS:
        raise SettingsError(f"unknown method {method!r}: choose one of {', '.join(METHODS)}")
    if middle not in MIDDLES:
        raise SettingsError(f"unknown middle {middle!r}: choose one of {', '.join(MIDDLES)}")
    if not isinstance(segments, int) or segments < 1:
        raise SettingsError(f"segments must be 1 or more, got {segments}")
    return Scheme(method, middle, segments)


def require_samples(imu: ImuTrack) -> None:
    """Raises DataError for a track without samples."""
    if len(imu) == 0:
        raise DataError("the IMU track has no samples; an integration needs at least one")


CHUNK: Final = 8192
"""Intervals handled at a time: the working arrays of a chunk stay in the processor's cache."""


@dataclass(frozen=True, slots=True, eq=False)
class Increments:
    """Rotation, velocity and position of each IMU interval, in the body frame at its start, without gravity.

    `q_{i+1} = q_i ⊗ dq_i`, `v_{i+1} = v_i + C(q_i) dv_i + g h_i`, `p_{i+1} = p_i + h_i v_i + C(q_i) dp_i + ½ g h_i²`.
    """

    dt: Array  # (N-1,) s, h_i
    dq: Array  # (N-1, 4) wxyz, unit length, w >= 0
    dv: Array  # (N-1, 3) FRD at the start of the interval, m/s
    dp: Array  # (N-1, 3) FRD at the start of the interval, m
    notes: tuple[str, ...] = ()  # what was done differently from what was requested, and why


def increments(imu: ImuTrack, *, method: str = "rk4", middle: str = "cubic", segments: int = 1) -> Increments:
    """The body increments of the N-1 intervals between N samples.

    method: "euler" (samples at the start of the interval), "midpoint" (means of both ends) or "rk4".
    middle: what the signal is between two samples, "linear" or "cubic" (one-sided at the two ends of the track; with
    three samples the parabola and with two the line through them, as `notes` then states). Euler and midpoint look
    inside an interval only with segments > 1.
    segments: equal pieces into which each interval is divided (docs/mathematics.md), without normalisation in between.
    Increments lead from one sample's time to the next, also where a sample is the mean over an interval around it.

    Raises SettingsError for an unknown method or middle and fewer than one segment, DataError for a track without
    samples.
    """
    scheme = scheme_for(method, middle, segments)
    require_samples(imu)
    n = len(imu) - 1
    dq, dv, dp = np.empty((n, 4)), np.empty((n, 3)), np.empty((n, 3))
    for first, _, (q, moves) in chunks(imu, 0, n, scheme):
        part = slice(first, first + q.shape[1])
        dq[part], dv[part], dp[part] = q.T, moves[:, 0].T, moves[:, 1].T
    return Increments(np.diff(imu.t), dq, dv, dp, scheme.notes_on(imu))


def dense_attitude(
    imu: ImuTrack, q_ned_frd: Array, fractions: Array, *, middle: str = "cubic", segments: int = 1
) -> Array:
    """Attitudes inside every interval (docs/mathematics.md, "Inside an interval"): (N-1, F, 4).

    q_ned_frd: (N, 4) attitudes at the samples, fractions: (F,) each in 0..1 of the interval. RK4 on the whole segments
    up to the fraction and on the rest of the one in which it lies. Raises ValueError as `increments` does, and for
    fractions outside 0..1.
    """
    scheme_for("rk4", middle, segments)
    require_samples(imu)
    fractions = np.asarray(fractions, dtype=np.float64)
    if not ((fractions >= 0) & (fractions <= 1)).all():
        raise ValueError(f"fractions must lie in 0..1 of an interval, got {fractions.min():g} to {fractions.max():g}")
    if np.shape(q_ned_frd) != (len(imu), 4):
        raise ValueError(f"q_ned_frd must have shape ({len(imu)}, 4), one per sample, got {np.shape(q_ned_frd)}")
    if len(imu) == 1:
        return np.empty((0, len(fractions), 4))
    signal = _signal_of(imu, 0, len(imu) - 1, middle)
    turned = [components.unit(_attitude(signal, np.full(len(imu) - 1, u), segments)).T for u in fractions]
    return quaternion.multiply(q_ned_frd[:-1, None], np.stack(turned, axis=1))


def chunks(imu: ImuTrack, start: int, stop: int, scheme: Scheme) -> Iterator[tuple[int, Array, Moved]]:
    """(first interval, dt (n,), what they add) of cache-sized runs of the intervals start..stop-1.

    Component-first, for `dead_reckon`. Samples before and after a run still shape the cubic at its ends, so the cutting
    does not change the numbers.
    """
    middle = scheme.middle if scheme.looks_ahead else "linear"  # the same numbers where nothing looks inside
    for first in range(start, stop, CHUNK):
        last = min(first + CHUNK, stop)
        join = joined(imu, first, last) if scheme.looks_ahead and imu.interval is not None else np.False_
        if join.all():
            dq, moves = _of_means(imu, first, last, scheme)
        else:
            dq, moves = _increments(_signal_of(imu, first, last, middle), scheme.method, scheme.segments)
            if join.any():
                q, of_means = _of_means(imu, first, last, scheme)
                dq, moves = np.where(join, q, dq), np.where(join, of_means, moves)
        yield first, imu.t[first + 1 : last + 1] - imu.t[first:last], (dq, moves)


def _of_means(imu: ImuTrack, first: int, last: int, scheme: Scheme) -> Moved:
    """What is added between samples that are means over joining intervals."""
    way = _pieces(imu, first, last)
    before, before_moves = _increments(way.beginning, scheme.method, scheme.segments)
    _, moves = _increments(way.rest, scheme.method, scheme.segments)
    back = before[:, :-1] * np.array([1.0, -1.0, -1.0, -1.0])[:, None]
    own = components.product(back, quaternion.exp(way.turn.T).T), moves
    if way.gap is not None:
        own = _then(own, way.gap.dt, _increments(way.gap, scheme.method, scheme.segments))
    q, moves = _then(own, way.beginning.dt[1:], (before[:, 1:], before_moves[..., 1:]))
    return components.unit(q), moves


def _then(one: Moved, dt: Array, other: Moved) -> Moved:
    """Increments followed by others that take dt (n,) s."""
    (q, moves), (dq, further) = one, other
    further = components.rotate(q[0], q[1:, None], further)
    further += moves
    further[:, 1] += dt * moves[:, 0]
    return components.product(q, dq), further


def _increments(signal: _Signal, method: str, segments: int) -> Moved:
    """What every interval adds: the method on each segment, segments composed in order."""
    step = METHODS[method].step
    q, moves = step(signal, 0.0, 1.0 / segments)
    for i in range(1, segments):
        q, moves = _then((q, moves), signal.dt / segments, step(signal, i / segments, (i + 1) / segments))
    return components.unit(q), moves


def _attitude(signal: _Signal, fraction: Array, segments: int) -> Array:
    """Attitude (4, n) at a fraction (n,) of each interval: RK4 over its segments, cut short where the fraction lies."""
    q = _one_and(np.zeros((3, len(fraction))))
    for i in range(segments):
        begin, end = np.minimum(i / segments, fraction), np.minimum((i + 1) / segments, fraction)
        w0, wm, w1 = (signal.at(at)[:3] for at in (begin, 0.5 * (begin + end), end))
        dq, _ = rk4_attitude((end - begin) * signal.dt, w0, wm, w1)
        q = components.product(q, dq)
    return q
