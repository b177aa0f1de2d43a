"""From increments to a trajectory: the attitude as a running product, velocity and position as running sums.

Nothing loops over samples: the running product is a prefix scan, and the work is done in chunks that fit the
processor's cache. `preintegrate` does the same without gravity and without a start, and its result serves every anchor,
horizon and window (docs/mathematics.md).

Also here: dead reckoning of samples as they arrive: the same numbers as `dead_reckon` over all of them at once; and
normal gravity of the WGS-84 ellipsoid, for those who do not take the standard 9.80665 m/s². ArduPilot's and PX4's
estimators and ArduPilot's SITL use the standard value, so it is the default everywhere. The real one differs by up to
0.03 m/s² (0.3 %) with latitude and 3.1e-6 m/s² per metre of height: over 30 s that is 12 m down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from companion.model import (
    ECCENTRICITY_SQUARED,
    SEMI_MAJOR_AXIS,
    STANDARD_GRAVITY,
    Array,
    DataError,
    ImuTrack,
    NavState,
    Trajectory,
    check_number,
    floats,
    is_number,
)
from companion.strapdown import _components as components
from companion.strapdown import quaternion
from companion.strapdown._components import running_product
from companion.strapdown.increments import Scheme, chunks, require_samples, scheme_for

SAME_TIME = 5e-7
"""s. MAVLink's finest clock counts microseconds: times closer than half a tick are the same time."""


def bend(moved: Array, at_start: Array, at_end: Array, u: Array) -> Array:
    """How far a cubic Hermite is from the straight line (N, 3), at the parts u (N, 1) of the interval.

    moved: over the interval; at_start, at_end: what it would be at the rates of both ends. So that large coordinates
    lose no digits.
    """
    return np.asarray(u * (1 - u) * ((1 - u) * (at_start - moved) + u * (moved - at_end)))


def sample_at(samples: Array, t: float) -> int | None:
    """Which of the samples at times (N,) is at a time; None where none is."""
    near = int(np.searchsorted(samples, t - SAME_TIME))
    return near if near < len(samples) and abs(samples[near] - t) <= SAME_TIME else None


@dataclass(frozen=True, slots=True, eq=False)
class Preintegration:
    """One gravity-free pass over a track from identity at rest at the origin: Q, V, P of docs/mathematics.md.

    N rows, one for each sample of the track, or for some of them: `row` tells which.
    """

    t: Array  # (N,) s
    q: Array  # (N, 4) wxyz, body at t_i to body at t_0, unit length
    v: Array  # (N, 3) in the body frame at t_0, m/s, without gravity
    p: Array  # (N, 3) in the body frame at t_0, m, without gravity
    notes: tuple[str, ...] = ()  # what was done differently from what was requested, and why
    samples: npt.NDArray[np.intp] | None = None  # (N,) of the track, ascending; None: all of them

    def at(self, samples: npt.NDArray[np.intp]) -> Preintegration:
        """The same at some samples alone, ascending, each once: an hour at 100 Hz takes 30 MB, its seconds 0.3."""
        i = self.row(samples)
        return Preintegration(self.t[i], self.q[i], self.v[i], self.p[i], self.notes, samples)

    def row(self, sample: npt.ArrayLike) -> npt.NDArray[np.intp]:
        """The rows of samples, of any shape. Raises IndexError for one that was not kept."""
        index = np.asarray(sample, dtype=np.intp)
        if self.samples is None:
            return index
        row = np.searchsorted(self.samples, index)
        if not np.array_equal(self.samples[np.minimum(row, len(self.samples) - 1)], index):
            raise IndexError("the preintegration was not kept at this sample")
        return np.asarray(row)

    def carry(
        self,
        start_index: npt.ArrayLike,
        end_index: npt.ArrayLike,
        q: Array,
        velocity: Array,
        position: Array,
        *,
        gravity: float = STANDARD_GRAVITY,
    ) -> tuple[Array, Array, Array]:
        """The states at samples `end_index` of integrations that start at samples `start_index` with given states.

        start_index: shape S, any; q: S + (4,) NED from FRD, velocity, position: S + (3,) NED in m/s and m;
        end_index: shape S, or S + H for several ends of each start (a window with its horizons, or one anchor, S = (),
        with all samples up to the next). Ends before the start integrate backwards. gravity: m/s², down.
        Returns (q_ned_frd, velocity, position) of shape end_index.shape + (4,), (3,), (3,).

        A few operations an end, whatever lies between: `q_e = c ⊗ Q_e` with `c = q ⊗ Q_k⁻¹`, and the velocity and
        position differences turned by c. A window over a gap in the samples gives numbers too; leave it out.

        Raises ValueError for shapes that do not fit and IndexError for samples that do not exist.
        """
        start, end = self.row(start_index), self.row(end_index)
        for name, values, width in (("q", q, 4), ("velocity", velocity, 3), ("position", position, 3)):
            if np.shape(values) != (*start.shape, width):
                raise ValueError(f"{name} must have shape {(*start.shape, width)}, got {np.shape(values)}")
        if end.shape[: start.ndim] != start.shape:
            raise ValueError(f"end_index must have shape {start.shape} or that and more axes, got {end.shape}")
        each = (..., *(None,) * (end.ndim - start.ndim), slice(None))  # one start for all its ends
        c = quaternion.multiply(q, quaternion.conjugate(self.q[start]))[each]
        v0, p0, velocity, position = self.v[start][each], self.p[start][each], velocity[each], position[each]
        tau = (self.t[end] - self.t[start][each[:-1]])[..., None]
        down = np.array([0.0, 0.0, gravity])
        q_end = quaternion.multiply(c, self.q[end])
        v_end = velocity + quaternion.rotate(c, self.v[end] - v0) + down * tau
        p_end = position + velocity * tau + 0.5 * down * tau**2 + quaternion.rotate(c, self.p[end] - p0 - v0 * tau)
        return q_end, v_end, p_end


def dead_reckon(
    imu: ImuTrack,
    start: NavState,
    *,
    method: str = "rk4",
    middle: str = "cubic",
    segments: int = 1,
    gravity: float = STANDARD_GRAVITY,
) -> Trajectory:
    """Dead reckoning from `start` over the samples of `imu`: attitude, velocity and position at their times.

    start.t must be the time of a sample (within half a microsecond), as a rule the first: there the trajectory begins,
    with `start` as its first row. Samples before it only shape the cubic, so a track is continued from a state in its
    middle as in one run. method, middle, segments: see `increments`. gravity: m/s², along NED's down.

    With the cubic the last interval of a track is one-sided. Whoever integrates a track piece by piece and wants the
    numbers of the whole uses `DeadReckoner`, or gives each piece one sample more at both ends.

    Raises SettingsError for an unknown method or middle; DataError for a track without samples and for a start that is
    not finite, whose quaternion is not of unit length (to 1e-3), or whose time is not that of a sample.

    >>> import numpy as np
    >>> from companion import ImuTrack, NavState, dead_reckon
    >>> t = np.linspace(0.0, 2.0, 201)  # two seconds of 1 m/s² forward, level
    >>> imu = ImuTrack(t, gyro=np.zeros((201, 3)), accel=np.tile([1.0, 0.0, -9.80665], (201, 1)))
    >>> start = NavState(0.0, np.array([1.0, 0.0, 0.0, 0.0]), velocity=np.zeros(3), position=np.zeros(3))
    >>> [round(float(x), 9) + 0.0 for x in dead_reckon(imu, start).end.position]
    [2.0, 0.0, 0.0]
    """
    scheme = scheme_for(method, middle, segments)
    require_samples(imu)
    check_number("gravity", gravity)
    first = start_index(imu, start)
    q, v, p = run(imu, first, len(imu) - 1, checked(start), gravity, scheme)
    return Trajectory(imu.t[first:], q, v, p, scheme.notes_on(imu))


def preintegrate(imu: ImuTrack, *, method: str = "rk4", middle: str = "cubic", segments: int = 1) -> Preintegration:
    """One pass over a track without gravity and without a start, from which `carry` gives every window.

    Raises as `increments` does.
    """
    scheme = scheme_for(method, middle, segments)
    require_samples(imu)
    origin = NavState(float(imu.t[0]), quaternion.IDENTITY, np.zeros(3), np.zeros(3))
    q, v, p = run(imu, 0, len(imu) - 1, origin, 0.0, scheme)
    return Preintegration(imu.t, q, v, p, scheme.notes_on(imu))


def start_index(imu: ImuTrack, start: NavState) -> int:
    """The sample at which a state stands."""
    if not is_number(start.t):
        raise DataError(f"start.t must be the time of a sample, got {start.t!r}")
    near = sample_at(imu.t, start.t)
    if near is None:
        raise DataError(
            f"start.t = {start.t:.6f} s is not the time of a sample (track: {imu.t[0]:.6f} to {imu.t[-1]:.6f} s); "
            "take the state at a sample, or cut the track to begin where the state is"
        )
    return near


def checked(start: NavState) -> NavState:
    """The start with its quaternion exactly of unit length."""
    shapes = {"q_ned_frd": (4,), "velocity": (3,), "position": (3,)}
    q, v, p = (floats(f"start.{name}", getattr(start, name), shape) for name, shape in shapes.items())
    length = float(np.linalg.norm(q))
    if abs(length - 1.0) > 1e-3:
        raise DataError(f"start.q_ned_frd must be of unit length, got length {length:.6g}; normalise it")
    return NavState(start.t, q / length, v, p)


def run(
    imu: ImuTrack, first: int, last: int, start: NavState, gravity: float, scheme: Scheme
) -> tuple[Array, Array, Array]:
    """(q (N, 4), v (N, 3), p (N, 3)) at the samples first..last from the state at `first`, chunk by chunk."""
    n = last - first + 1
    q, v, p = np.empty((n, 4)), np.empty((n, 3)), np.empty((n, 3))
    q[0], v[0], p[0] = start.q_ned_frd, start.velocity, start.position
    for interval, h, (dq, moves) in chunks(imu, first, last, scheme):
        i, m = interval - first, len(h)
        part = slice(i + 1, i + 1 + m)
        attitude, velocity = components.empty(4, m + 1), components.empty(3, m + 1)
        attitude[:, 0], velocity[:, 0] = q[i], v[i]
        attitude[:, 1:] = running_product(q[i], dq)
        q[part] = attitude[:, 1:].T
        moved = components.rotate(attitude[0, :-1], attitude[1:, None, :-1], moves)
        down = gravity * h
        moved[2, 0] += down
        down *= 0.5 * h
        moved[2, 1] += down
        np.cumsum(moved[:, 0], axis=1, out=velocity[:, 1:])
        velocity[:, 1:] += v[i][:, None]
        v[part] = velocity[:, 1:].T
        moved[:, 1] += components.times(h, velocity[:, :-1])
        moved[:, 1].cumsum(axis=1, out=moved[:, 1])
        moved[:, 1] += p[i][:, None]
        p[part] = moved[:, 1].T
    return q, v, p


class DeadReckoner:
    """Continues a dead reckoning with every chunk of samples, however the stream is cut.

    Linear, Euler and midpoint answer up to the newest sample. The cubic through four samples needs the one after an
    interval, so there the answer is one sample late (10 ms at 100 Hz) and never revised; the first answer needs four
    samples. `behind` is the number of samples that wait, and `finish` answers them as the end of a track, one-sided.

    start: the state at one of the samples of the first push. method, middle, segments, gravity: see `dead_reckon`,
    which also lists the errors.
    """

    def __init__(
        self,
        start: NavState,
        *,
        method: str = "rk4",
        middle: str = "cubic",
        segments: int = 1,
        gravity: float = STANDARD_GRAVITY,
    ) -> None:
        check_number("gravity", gravity)
        self._state = checked(start)
        self._scheme = scheme_for(method, middle, segments)
        self._gravity = gravity
        self._held = ImuTrack(np.empty(0), np.empty((0, 3)), np.empty((0, 3)))  # what coming intervals need
        self._keep = 0  # the first sample of `_held` that is still needed
        self._at = 0  # the sample of `_held` at which the state stands
        self._begun = False  # whether the start has been answered

    @property
    def state(self) -> NavState:
        """The newest answered state."""
        return self._state

    @property
    def behind(self) -> int:
        """Samples received and not yet answered: 1 with the cubic once it runs, else 0."""
        return max(len(self._held) - 1 - self._at, 0)

    def push(self, chunk: ImuTrack) -> Trajectory:
        """The states that the chunk makes known, none twice; the very first row is the start. May have no components.

        Raises ValueError for samples not after those already pushed, and if the first push holds none at start.t.
        """
        held = _join(self._held, self._keep, chunk)
        at = self._at - self._keep
        if not self._begun and len(held):
            at = start_index(held, self._state)
        self._held, self._keep, self._at = held, 0, at
        last = len(held) - 1
        if self._scheme.looks_ahead:
            # The very first interval is one-sided, through the first four samples of the stream.
            last = last - 1 if self._at > 0 or len(held) >= 4 else 0
        return self._advance(last)

    def finish(self) -> Trajectory:
        """The states at the samples that still wait, with the last interval one-sided as at the end of a track."""
        return self._advance(len(self._held) - 1)

    def anchor(self, state: NavState) -> None:
        """Continue from another state at the time of `state`, e.g. from the autopilot's own estimate.

        Raises ValueError if it is for another time than the newest answer's, or not a valid start.
        """
        if abs(state.t - self._state.t) > SAME_TIME:
            raise ValueError(
                f"the reckoning stands at {self._state.t:.6f} s; an anchor at {state.t:.6f} s does not fit"
            )
        self._state = checked(state)

    def _advance(self, last: int) -> Trajectory:
        """The new states up to sample `last` of what is held; forgets what no coming interval needs."""
        held, first = self._held, self._at
        if len(held) == 0:
            return Trajectory(np.empty(0), np.empty((0, 4)), np.empty((0, 3)), np.empty((0, 3)))
        last, old = max(last, first), int(self._begun)  # the state's own row has been answered before
        q, v, p = run(held, first, last, self._state, self._gravity, self._scheme)
        self._state = NavState(float(held.t[last]), q[-1], v[-1], p[-1])
        self._begun = True
        # With the sample that waits the four that `finish` needs for its one-sided cubic.
        self._keep, self._at = max(last - 2, 0), last
        notes = self._scheme.notes_on(held) if last > first else ()
        return Trajectory(held.t[first + old : last + 1], q[old:], v[old:], p[old:], notes)


def _join(a: ImuTrack, keep: int, b: ImuTrack) -> ImuTrack:
    """The samples of `a` from `keep` on and those of `b` as one track. Raises ValueError if times do not increase."""
    if len(a) == 0:
        return b
    interval = None
    if a.interval is not None and b.interval is not None:
        interval = np.concatenate((a.interval[keep:], b.interval))
    pairs = ((a.t, b.t), (a.gyro, b.gyro), (a.accel, b.accel))
    t, gyro, accel = (np.concatenate((before[keep:], after)) for before, after in pairs)
    return ImuTrack(t, gyro, accel, b.source or a.source, interval=interval)


# NIMA TR8350.2 (2000), tables 3.1, 3.3 and 3.4
EQUATOR = 9.7803253359  # m/s²
SOMIGLIANA = 0.00193185265241
FLATTENING = 1 / 298.257223563
CENTRIFUGAL_RATIO = 0.00344978650684  # m = ω² a² b / GM


def normal_gravity(latitude: npt.ArrayLike, height: npt.ArrayLike = 0.0) -> Array:
    """Gravity in m/s² (down) at geodetic latitude (rad) and height above the ellipsoid (m), broadcast.

    Somigliana's formula on the ellipsoid and the second-order series in height (NIMA TR8350.2, eqs. 4-1 and 4-3); the
    latter holds to some 20 km. Raises ValueError for latitudes beyond the poles, as degrees would be.
    """
    latitude, height = np.asarray(latitude, dtype=np.float64), np.asarray(height, dtype=np.float64)
    if not (np.abs(latitude) <= np.pi / 2).all():
        raise ValueError(f"latitude must lie within ±π/2 rad, got {np.ravel(latitude)[:3]}; is it in degrees?")
    s2 = np.sin(latitude) ** 2
    surface = EQUATOR * (1 + SOMIGLIANA * s2) / np.sqrt(1 - ECCENTRICITY_SQUARED * s2)
    ratio = height / SEMI_MAJOR_AXIS
    slope = 1 + FLATTENING + CENTRIFUGAL_RATIO - 2 * FLATTENING * s2
    return np.asarray(surface * (1 - 2 * slope * ratio + 3 * ratio**2))
