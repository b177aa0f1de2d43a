"""What one IMU interval adds: body increments (dq, dv, dp) without gravity, for all intervals at once.

A step starts from the identity, not from q_n, so every increment depends on its own samples alone and all
of them are computed as arrays; `companion.strapdown.dead_reckon` then multiplies and sums them up. Between two
samples the signal is a line through them (`middle="linear"`) or the cubic through the four samples around
(`middle="cubic"`): on smooth motion RK4 is of order 2 with the line and 4 with the cubic (docs/mathematics.md).
Where samples are means over joining intervals (`ImuTrack.interval`), "cubic" is what conserves their integrals
(`companion.strapdown._signal`).

Also here: the integrators: one step over an interval or a piece of it, the one table of them, and the settings that
choose.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from companion.model import Array, DataError, ImuTrack, SettingsError
from companion.strapdown import _components as rows
from companion.strapdown import quaternion
from companion.strapdown._signal import MIDDLES, UNEVEN, Signal, joined, pieces, signal_of, uneven

Moved = tuple[Array, Array]
"""dq (4, n), and dv and dp side by side, (3, 2, n): both are turned by the same attitudes."""

Step = Callable[[Signal, float, float], Moved]
"""(signal of n intervals, begin, end as fractions of them) → what they add, dq not normalised."""


@dataclass(frozen=True, slots=True)
class Method:
    """One integrator."""

    title: str  # as people choose it
    order: int  # of convergence with the cubic; with the line 2 at most (docs/mathematics.md)
    looks_inside: bool  # whether it takes the signal between two samples, so that `middle` changes its result
    step: Step


def _euler(signal: Signal, begin: float, end: float) -> Moved:
    """Euler: everything as at the start of the interval."""
    h = (end - begin) * signal.dt
    x = signal.at(begin)
    return one_and(0.5 * h * x[:3]), _uniform(h, h * x[3:])


def _uniform(h: Array, dv: Array) -> Array:
    """dv beside the dp of an acceleration that is the same all the while."""
    return np.stack((dv, 0.5 * h * dv), axis=1)


def _midpoint(signal: Signal, begin: float, end: float) -> Moved:
    """Midpoint: the mean rate turns; the mean of both specific forces, each in its own attitude, accelerates."""
    h = (end - begin) * signal.dt
    x0, x1 = signal.at(begin), signal.at(end)
    dq = one_and(0.25 * h * (x0[:3] + x1[:3]))
    return dq, _uniform(h, 0.5 * h * (x0[3:] + rows.rotate(dq[0], dq[1:], x1[3:])))


def _rk4(signal: Signal, begin: float, end: float) -> Moved:
    """RK4 of attitude, velocity and position, in one step that starts from the identity (docs/mathematics.md).

    The accelerations a0, a1, a2, a3 use the same intermediate q1, q2, q3 as the attitude; those are not of unit length,
    `change` takes the rotation they stand for. Position: its slopes k are those of the velocity equation, so with
    b = a1 + a2, dv = h/6 (a3 + b + a0 + b) and dp = h²/6 (a0 + b) (docs/mathematics.md).
    """
    h = (end - begin) * signal.dt
    x0, xm, x1 = signal.at(begin), signal.at(0.5 * (begin + end)), signal.at(end)
    dq, (q1, q2, q3) = rk4_attitude(h, x0[:3], xm[:3], x1[:3])
    moves, sixth = rows.empty(3, 2, len(h)), rows.times(1.0 / 6.0, h)
    dv, dp = moves[:, 0], moves[:, 1]
    np.add(xm[3:], xm[3:], out=dp)
    dp += rows.change(*q1, xm[3:])
    dp += rows.change(*q2, xm[3:])
    np.add(x1[3:], dp, out=dv)
    dv += rows.change(*q3, x1[3:])
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
    half = rows.times(0.5, h)
    m, b = rows.times(half, wm), rows.times(half, w1)
    a = rows.times(np.multiply(0.5, half, out=half), w0)
    s, mu = rows.dot(a, m), rows.dot(m, m)
    mu *= 0.5
    k2, e = rows.cross(a, m), rows.times(mu, a)
    k2 += m
    np.subtract(m, e, out=e)
    w2, w3, dq = rows.empty(len(h)), rows.empty(len(h)), rows.empty(4, len(h))
    np.subtract(2.0, s, out=w2)
    np.subtract(1.0, mu, out=w3)
    s += mu
    s *= 2.0
    s += rows.dot(e, b)
    s *= -1.0 / 6.0
    np.add(1.0, s, out=dq[0])
    turn = np.add(a, k2, out=dq[1:])
    turn += e
    turn *= 2.0
    turn += rows.cross(e, b)
    b *= w3
    turn += b
    turn *= 1.0 / 6.0
    return dq, ((1.0, a), (w2, k2), (w3, e))


def one_and(vector: Array) -> Array:
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
        if self.looks_ahead and longest > UNEVEN * dt.min():
            notes.append(
                f"more than {UNEVEN:g} times as long as a neighbour: {int(uneven(dt).sum())} of {len(dt)} intervals "
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
    signal = signal_of(imu, 0, len(imu) - 1, middle)
    turned = [rows.unit(_attitude(signal, np.full(len(imu) - 1, u), segments)).T for u in fractions]
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
            dq, moves = _increments(signal_of(imu, first, last, middle), scheme.method, scheme.segments)
            if join.any():
                q, of_means = _of_means(imu, first, last, scheme)
                dq, moves = np.where(join, q, dq), np.where(join, of_means, moves)
        yield first, imu.t[first + 1 : last + 1] - imu.t[first:last], (dq, moves)


def _of_means(imu: ImuTrack, first: int, last: int, scheme: Scheme) -> Moved:
    """What is added between samples that are means over joining intervals."""
    way = pieces(imu, first, last)
    before, before_moves = _increments(way.beginning, scheme.method, scheme.segments)
    _, moves = _increments(way.rest, scheme.method, scheme.segments)
    back = before[:, :-1] * np.array([1.0, -1.0, -1.0, -1.0])[:, None]
    own = rows.product(back, quaternion.exp(way.turn.T).T), moves
    if way.gap is not None:
        own = _then(own, way.gap.dt, _increments(way.gap, scheme.method, scheme.segments))
    q, moves = _then(own, way.beginning.dt[1:], (before[:, 1:], before_moves[..., 1:]))
    return rows.unit(q), moves


def _then(one: Moved, dt: Array, other: Moved) -> Moved:
    """Increments followed by others that take dt (n,) s."""
    (q, moves), (dq, further) = one, other
    further = rows.rotate(q[0], q[1:, None], further)
    further += moves
    further[:, 1] += dt * moves[:, 0]
    return rows.product(q, dq), further


def _increments(signal: Signal, method: str, segments: int) -> Moved:
    """What every interval adds: the method on each segment, segments composed in order."""
    step = METHODS[method].step
    q, moves = step(signal, 0.0, 1.0 / segments)
    for i in range(1, segments):
        q, moves = _then((q, moves), signal.dt / segments, step(signal, i / segments, (i + 1) / segments))
    return rows.unit(q), moves


def _attitude(signal: Signal, fraction: Array, segments: int) -> Array:
    """Attitude (4, n) at a fraction (n,) of each interval: RK4 over its segments, cut short where the fraction lies."""
    q = one_and(np.zeros((3, len(fraction))))
    for i in range(segments):
        begin, end = np.minimum(i / segments, fraction), np.minimum((i + 1) / segments, fraction)
        w0, wm, w1 = (signal.at(at)[:3] for at in (begin, 0.5 * (begin + end), end))
        dq, _ = rk4_attitude((end - begin) * signal.dt, w0, wm, w1)
        q = rows.product(q, dq)
    return q
