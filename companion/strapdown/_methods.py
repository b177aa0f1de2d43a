"""The integrators: one step over an interval or a piece of it, the one table of them, and the settings that choose."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from companion.model import Array, DataError, ImuTrack, SettingsError
from companion.strapdown import _components as rows
from companion.strapdown._signal import MIDDLES, UNEVEN, Signal, uneven

Step = Callable[[Signal, float, float], tuple[Array, Array, Array]]
"""(signal of n intervals, begin, end as fractions of them) → dq (4, n) not normalised, dv (3, n), dp (3, n)."""


@dataclass(frozen=True, slots=True)
class Method:
    """One integrator."""

    title: str  # as people choose it
    order: int  # of convergence with the cubic; with the line 2 at most (docs/mathematics.md)
    looks_inside: bool  # whether it takes the signal between two samples, so that `middle` changes its result
    step: Step


def _euler(signal: Signal, begin: float, end: float) -> tuple[Array, Array, Array]:
    """Euler: everything as at the start of the interval."""
    h = (end - begin) * signal.dt
    x = signal.at(begin)
    dv = h * x[3:]
    return one_and(0.5 * h * x[:3]), dv, 0.5 * h * dv


def _midpoint(signal: Signal, begin: float, end: float) -> tuple[Array, Array, Array]:
    """Midpoint: the mean rate turns; the mean of both specific forces, each in its own attitude, accelerates."""
    h = (end - begin) * signal.dt
    x0, x1 = signal.at(begin), signal.at(end)
    dq = one_and(0.25 * h * (x0[:3] + x1[:3]))
    dv = 0.5 * h * (x0[3:] + rows.rotate(dq[0], dq[1:], x1[3:]))
    return dq, dv, 0.5 * h * dv


def _rk4(signal: Signal, begin: float, end: float) -> tuple[Array, Array, Array]:
    """RK4 of attitude, velocity and position, in one step that starts from the identity (docs/mathematics.md).

    The accelerations use the same intermediate q1, q2, q3 as the attitude; those are not of unit length, `rotate` takes
    the rotation they stand for. Position: its slopes k are those of the velocity equation, so
    dp = h²/6 (a0 + a1 + a2) (docs/mathematics.md).
    """
    h = (end - begin) * signal.dt
    x0, xm, x1 = signal.at(begin), signal.at(0.5 * (begin + end)), signal.at(end)
    dq, (w, v) = rk4_attitude(h, x0[:3], xm[:3], x1[:3])
    f = np.empty_like(v)
    f[:, :2], f[:, 2] = xm[3:, None], x1[3:]
    f = rows.rotate(w, v, f)
    f0, middle = x0[3:], f[:, 0] + f[:, 1]
    dv = (h / 6.0) * (f0 + 2.0 * middle + f[:, 2])
    dp = (h * h / 6.0) * (f0 + middle)
    return dq, dv, dp


def rk4_attitude(h: Array, w0: Array, wm: Array, w1: Array) -> tuple[Array, tuple[Array, Array]]:
    """dq (4, n), not normalised, and the intermediate q1, q2, q3 up to their length: scalars (3, n), vectors (3, 3, n).

    With a = h/4 w0, m = h/2 wm, b = h/2 w1 the products h k of the step are
    hk1 = [0, 2a], hk2 = q1 ⊗ [0, m], hk3 = q2 ⊗ [0, m], hk4 = q3 ⊗ [0, b], and with s = a·m, μ = m·m/2, since m x m = 0
    and (a x m) x m = s m - 2μ a:
    q1 = [1, a], hk2 = [-s, m + a x m]; 2 q2 = [2 - s, m + a x m], hk3 = [-μ, e] with e = m - μ a;
    q3 = [1 - μ, e], hk4 = [-e·b, (1 - μ) b + e x b].
    """
    quarter, half = 0.25 * h, 0.5 * h
    a, m, b = quarter * w0, half * wm, half * w1
    s, mu = rows.dot(a, m), 0.5 * rows.dot(m, m)
    k2 = m + rows.cross(a, m)
    e = m - mu * a
    w, v = np.empty((3, len(h))), np.empty((3, 3, len(h)))
    w[0], w[1], w[2] = 1.0, 2.0 - s, 1.0 - mu
    v[:, 0], v[:, 1], v[:, 2] = a, k2, e
    dq = np.empty((4, len(h)))
    dq[0] = 1.0 - (2.0 * (s + mu) + rows.dot(e, b)) / 6.0
    dq[1:] = (2.0 * (a + k2 + e) + w[2] * b + rows.cross(e, b)) / 6.0
    return dq, (w, v)


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
        if np.abs(imu.gyro).max() * longest > np.pi / np.sqrt(3.0):
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
