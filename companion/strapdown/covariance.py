"""The growth of errors of the start and of the IMU to the end of a window, cause by cause (docs/mathematics.md).

Errors are truth minus estimate in the world frame: `q_true = Exp(φ) ⊗ q`, δv, δp; biases δb = true minus used. With
`a = C(q) f` the specific force in NED: φ' = -C(q) δw, δv' = -[a]x φ - C(q) δf, δp' = δv. φ only accumulates, so an
error of the gyro or accelerometer at time s has a closed form at the end T (impulse responses, with dV = V(T) - V(s)
and dP = P(T) - P(s) - V(s) (T - s) of the specific force alone):

    gyro:  (-C, [dV]x C, [dP]x C)        accelerometer:  (0, -C, -(T - s) C)

Everything is an integral of these: a constant bias (of the response itself), white noise (of its square), scale and
misalignment (of its product with the reading), and a bias that walks (of the square of the integral from s on).

Also here: integrals over batches of windows, for `covariance`: W windows of n samples, samples last, trapezoidal.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from companion.model import STANDARD_GRAVITY, Array, ImuTrack, IntArray
from companion.strapdown import _components as components
from companion.strapdown import quaternion
from companion.strapdown.dead_reckon import Preintegration

_DIAGONAL = np.arange(3)


def skew(vector: Array) -> Array:
    """[x]x of vectors (..., 3): `skew(a) @ b == cross(a, b)`."""
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    out = np.zeros((*vector.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out


def left_jacobian(turn: Array) -> Array:
    """(N, 3, 3) J_l of exp at rotation vectors (N, 3), rad: exp(a + δ) = exp(J_l δ) exp(a) (J. Solà 2017, §4.3.4)."""
    angle = np.maximum(np.linalg.norm(turn, axis=1), 1e-4)[:, None, None]  # below it both quotients are at their limits
    across = skew(turn)
    once, twice = (1.0 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) + once * across + twice * (across @ across))


def trapezoid(t: Array) -> Array:
    """Weights (W, n) of the trapezoidal rule over times (W, n)."""
    half = 0.5 * np.diff(t, axis=1)
    weight = np.zeros_like(t)
    weight[:, :-1] += half
    weight[:, 1:] += half
    return weight


def from_here_on(response: Array, t: Array) -> tuple[Array, Array]:
    """∫ from s to T of the response (W, m, 3, n), at every s, and from the start (W, m, 3)."""
    out = np.empty_like(response)
    out[..., 0] = 0.0
    pieces = out[..., 1:]
    np.add(response[..., :-1], response[..., 1:], out=pieces)
    pieces *= 0.5 * np.diff(t, axis=1)[:, None, None]
    np.cumsum(pieces, axis=-1, out=pieces)
    total = out[..., -1].copy()
    np.subtract(total[..., None], out, out=out)
    return out, total


def moments(response: Array, weight: Array) -> tuple[Array, Array]:
    """∫ J ds (W, m, 3) and ∫ J Jᵀ ds (W, m, m) of responses (W, m, 3, n) with weights (W, n)."""
    weighted = response * weight[:, None, None]
    flat = (len(response), response.shape[1], -1)
    return weighted.sum(axis=-1), np.asarray(weighted.reshape(flat) @ response.reshape(flat).swapaxes(-1, -2))


def outer(response: Array, reading: Array) -> Array:
    """Σ over samples of response (W, m, 3, n) times readings (W, n, k): (W, m, 3, k)."""
    windows, m, _, n = response.shape
    return np.asarray((response.reshape(windows, m * 3, n) @ reading).reshape(windows, m, 3, -1))


def responses(q: Array, moved: Array, left: Array) -> Array:
    """Impulse responses (W, 12, 3, n): -C, -(T - s) C, [dV]x C and [dP]x C, of which the first two are the
    accelerometer's and all but the second the gyro's; from q (W, n, 4), dV and dP (W, 6, n), T - s (W, n).
    """
    windows, _, n = moved.shape
    out = np.empty((windows, 12, 3, n))
    minus = out[:, :3]
    np.negative(components.matrix(np.moveaxis(q, -1, 0)).transpose(2, 0, 1, 3), out=minus)
    np.multiply(minus, left[:, None, None], out=out[:, 3:6])
    for first, along in ((6, moved[:, :3]), (9, moved[:, 3:])):
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            cross = out[:, first + i]
            np.multiply(along[:, None, k], minus[:, j], out=cross)
            cross -= along[:, None, j] * minus[:, k]
    return out


def of_turns(moved: Array, weight: Array, own: Array) -> Array:
    """∫ J Jᵀ ds (W, 9, 9) of the gyro's response: with C Cᵀ = I and [a]x [b]x = b aᵀ - (a·b) I the sums of dV, dP and
    their products are all that it takes. own: (W, 3, 3) of the attitude.
    """
    weighted = moved * weight[:, None]
    sides = skew(weighted.sum(axis=-1).reshape(-1, 2, 3))
    products = weighted @ moved.swapaxes(-1, -2)
    out = np.empty((len(moved), 9, 9))
    out[:, :3, :3] = own
    for i, block in enumerate((slice(3, 6), slice(6, 9))):
        out[:, :3, block], out[:, block, :3] = sides[:, i], -sides[:, i]
        for j, beside in enumerate((slice(3, 6), slice(6, 9))):
            product = products[:, 3 * j : 3 * j + 3, 3 * i : 3 * i + 3]
            along = np.diagonal(product, axis1=1, axis2=2)
            out[:, block, beside] = -product
            # a·b less each own product, without taking it off: along dV itself next to nothing is left.
            out[:, block, beside][:, _DIAGONAL, _DIAGONAL] = along[:, [1, 2, 0]] + along[:, [2, 0, 1]]
    return out


BATCH = 1 << 12
"""Samples of windows handled at a time, so that the working arrays stay in the cache."""

ATTITUDE, VELOCITY, POSITION, GYRO_BIAS, ACCEL_BIAS = (slice(i, i + 3) for i in range(0, 15, 3))
"""Places in the 15-state error (φ, δv, δp, δb_g, δb_a): rad, m/s, m, rad/s, m/s²; the first nine in NED."""


@dataclass(frozen=True, slots=True, eq=False)
class Propagation:
    """Error growth over W windows. State: (φ, δv, δp in NED, δb_g, δb_a in FRD); the order of the slices above."""

    duration: Array  # (W,) s
    transition: Array  # (W, 15, 15) error at the end per error at the start, biases constant
    noise: Mapping[str, Array]  # cause: (W, 15, 15) covariance at the end per squared density; gyro_noise, accel_noise,
    #                             gyro_walk, accel_walk
    gyro_matrix: Array  # (W, 9, 3, 3) per element [i, j] of an error matrix E: δw_i = Σ E_ij w_j (scale, misalignment)
    accel_matrix: Array  # (W, 9, 3, 3) the same for the accelerometer
    time_offset: Array  # (W, 9) per second by which the IMU's times lag behind the reference's
    gravity: Array  # (W, 9) per m/s² of gravity, down

    def covariance(self, *, start: Array | None = None, **densities: float) -> Array:
        """At the end, (W, 15, 15).

        start: (15, 15) or (W, 15, 15) covariance at the start. densities: of the causes in `noise`, in rad/s/√Hz and
        m/s²/√Hz of white noise, rad/s/√s and m/s²/√s of the bias walks.
        """
        total = sum(density**2 * self.noise[cause] for cause, density in densities.items())
        if start is not None:
            total = total + self.transition @ start @ self.transition.swapaxes(-1, -2)
        return np.asarray(total)


def propagate(
    imu: ImuTrack,
    path: Preintegration,
    start_index: npt.ArrayLike,
    end_index: npt.ArrayLike,
    q_ned_frd: Array,
    velocity: Array,
    *,
    gravity: float = STANDARD_GRAVITY,
    sums: Sums | None = None,
) -> Propagation:
    """The error growth over windows between samples start_index (W,) and end_index (W,) of a track.

    path: `preintegrate(imu)`. q_ned_frd (W, 4), velocity (W, 3): NED states at the starts, as for `carry`; the velocity
    matters for the time offset alone. sums: `error_sums` of these windows, where they are known. The integrals are
    trapezoids over the samples, their error of order 2 in the interval. Raises ValueError for shapes that do not match
    and windows that end before they start.
    """
    start, end = np.asarray(start_index, dtype=np.intp), np.asarray(end_index, dtype=np.intp)
    if start.ndim != 1 or end.shape != start.shape:
        raise ValueError(f"start_index and end_index must have the same shape (W,), got {start.shape} and {end.shape}")
    if np.shape(q_ned_frd) != (len(start), 4) or np.shape(velocity) != (len(start), 3):
        raise ValueError(
            f"q_ned_frd and velocity must have shapes ({len(start)}, 4) and ({len(start)}, 3), "
            f"got {np.shape(q_ned_frd)} and {np.shape(velocity)}"
        )
    if len(start) and not ((start >= 0) & (end >= start) & (end < len(imu))).all():
        raise ValueError(f"windows must lie in the track of {len(imu)} samples and end no earlier than they start")
    return _in_ned(sums or error_sums(imu, path, start, end), imu, path, start, end, q_ned_frd, velocity, gravity)


MOVED: Mapping[str, slice] = {
    "gyro_noise": slice(0, 9), "accel_noise": slice(3, 9), "gyro_walk": slice(0, 12), "accel_walk": slice(3, 15),
}  # fmt: skip
"""Cause of noise → the errors that it moves: no others lie between them, and none of them grows into others."""


@dataclass(frozen=True, slots=True, eq=False)
class Sums:
    """The same as in `Propagation`, with the first nine errors in the body frame at the start of the track."""

    transition: Array
    noise: dict[str, Array]  # (W, n, n) of what the cause moves
    gyro_matrix: Array
    accel_matrix: Array

    def __getitem__(self, rows: IntArray) -> Sums:
        """Those of some windows, copied."""
        noise = {cause: covariance[rows] for cause, covariance in self.noise.items()}
        return Sums(self.transition[rows], noise, self.gyro_matrix[rows], self.accel_matrix[rows])

    def __setitem__(self, rows: IntArray, new: Sums) -> None:
        self.transition[rows], self.gyro_matrix[rows] = new.transition, new.gyro_matrix
        self.accel_matrix[rows] = new.accel_matrix
        for cause, covariance in self.noise.items():
            covariance[rows] = new.noise[cause]

    def then(self, after: Sums) -> Sums:
        """Of each window and, behind it, the one of `after` that begins where it ends."""
        grown = after.transition

        def arrived(matrix: Array) -> Array:
            return np.asarray((grown[:, :9, :9] @ matrix.reshape(-1, 9, 9)).reshape(-1, 9, 3, 3))

        return Sums(
            grown @ self.transition,
            {cause: _carried(grown, p, MOVED[cause]) + after.noise[cause] for cause, p in self.noise.items()},
            arrived(self.gyro_matrix) + after.gyro_matrix,
            arrived(self.accel_matrix) + after.accel_matrix,
        )


def _carried(matrix: Array, covariance: Array, own: slice) -> Array:
    """(W, n, n) covariance of some errors after a matrix (W, 15, 15) that mixes them with no others."""
    part = matrix[:, own, own]
    return np.asarray(part @ covariance @ part.swapaxes(-1, -2))


def error_sums(imu: ImuTrack, path: Preintegration, start: IntArray, end: IntArray, *, step_s: float = 0.0) -> Sums:
    """What of the error growth over windows between samples start (W,) and end (W,) needs no state at the start.

    Of windows that begin at the same sample each goes on from where the one before it ends: no sample is read twice.
    step_s: the trapezoids may be so long, where the samples are closer.
    """
    if (every := int(step_s * imu.rate_hz)) > 1:
        imu, path, start, end = _thinned(imu, path, start, end, every)
    count = len(start)
    raw = Sums(
        np.tile(np.eye(15), (count, 1, 1)),
        {cause: np.zeros((count, own.stop - own.start, own.stop - own.start)) for cause, own in MOVED.items()},
        np.zeros((count, 9, 3, 3)),
        np.zeros((count, 9, 3, 3)),
    )
    ascending = np.lexsort((end, start))
    number = np.arange(count)
    begins = np.append(True, np.diff(start[ascending]) != 0)[:count]
    later = number[~begins]
    own = start.copy()
    own[ascending[later]] = end[ascending[later - 1]]

    order = np.argsort(end - own, kind="stable")  # windows of like length share a batch
    samples = np.cumsum((end - own + 1)[order])
    at = 0
    while at < count:
        already = samples[at - 1] if at else 0
        stop = max(int(np.searchsorted(samples, already + BATCH, side="right")), at + 1)
        _integrate(raw, order[at:stop], imu, path, own[order[at:stop]], end[order[at:stop]])
        at = stop

    place = number - np.maximum.accumulate(np.where(begins, number, 0))  # among those that begin together
    for following in range(1, int(place.max(initial=0)) + 1):
        here = np.flatnonzero(place == following)
        raw[ascending[here]] = raw[ascending[here - 1]].then(raw[ascending[here]])
    return raw


def _thinned(
    imu: ImuTrack, path: Preintegration, start: IntArray, end: IntArray, every: int
) -> tuple[ImuTrack, Preintegration, IntArray, IntArray]:
    """The windows over every so many samples and all at which one begins or ends, with means of the readings."""
    kept = np.unique(np.concatenate((np.arange(0, len(imu), every), start, end)))
    about = np.maximum(kept - every // 2, 0)
    many = np.maximum(np.diff(about, append=len(imu)), 1)[:, None]
    gyro, accel = (np.add.reduceat(readings, about) / many for readings in (imu.gyro, imu.accel))
    first, last = kept.searchsorted(start), kept.searchsorted(end)
    return ImuTrack(imu.t[kept], gyro, accel), path.at(kept), first, last


def joined(pieces: Sums, first: IntArray, last: IntArray) -> Sums:
    """The sums over windows (W,) of adjacent pieces: each from piece `first` up to `last`, which is not in it.

    Any window has one piece at least.
    """
    whole = pieces[first]
    for further in range(1, int((last - first).max(initial=0))):
        longer = np.flatnonzero(last - first > further)
        whole[longer] = whole[longer].then(pieces[first[longer] + further])
    return whole


def _integrate(out: Sums, batch: IntArray, imu: ImuTrack, path: Preintegration, start: IntArray, end: IntArray) -> None:
    """Fills rows `batch`. Shorter windows are padded with their last sample: intervals of length zero."""
    index = np.minimum(start[:, None] + np.arange((end - start).max() + 1), end[:, None])
    t = path.t.take(index)
    left = t[:, -1:] - t  # T - s
    v, p = (np.moveaxis(x.take(index, axis=0), -1, 1) for x in (path.v, path.p))
    moved = np.empty((len(batch), 6, t.shape[1]))  # dV, dP, samples last: sums then run over contiguous memory
    np.subtract(v[..., -1:], v, out=moved[:, :3])
    np.subtract(p[..., -1:] - p, v * left[:, None], out=moved[:, 3:])
    weight = trapezoid(t)
    duration = left[:, 0]
    own = duration[:, None, None] * np.eye(3)

    transition = out.transition
    transition[batch, VELOCITY, ATTITUDE] = -skew(moved[:, :3, 0])
    transition[batch, POSITION, ATTITUDE] = -skew(moved[:, 3:, 0])
    transition[batch, POSITION, VELOCITY] = own
    out.noise["gyro_noise"][batch] = of_turns(moved, weight, own)
    for power, (i, j) in enumerate(((0, 0), (0, 3), (3, 3)), start=1):  # velocity and position
        # C Cᵀ = I: of the accelerometer's response only ∫1, ∫(T - s) and ∫(T - s)² remain.
        grown = (duration**power / power)[:, None, None] * np.eye(3)
        for at, beside in {(i, j), (j, i)}:
            out.noise["accel_noise"][batch, at : at + 3, beside : beside + 3] = grown

    response = responses(path.q.take(index, axis=0), moved, left)
    matrix = outer(
        response, weight[..., None] * np.concatenate([x.take(index, axis=0) for x in (imu.gyro, imu.accel)], axis=2)
    )
    out.gyro_matrix[batch], out.accel_matrix[batch, 3:] = matrix[:, _OF_GYRO, :, :3], matrix[:, _OF_ACCEL, :, 3:]
    step, total = from_here_on(response, t)
    crossed, square = moments(step, weight)
    for cause, rows_of, bias in (("gyro_walk", _OF_GYRO, GYRO_BIAS), ("accel_walk", _OF_ACCEL, ACCEL_BIAS)):
        first, count = MOVED[cause].start, len(rows_of)
        nav, of_bias = slice(0, count), slice(bias.start - first, bias.stop - first)
        transition[batch, first : first + count, bias] = total[:, rows_of]
        noise = out.noise[cause]
        noise[batch, nav, nav] = square[:, rows_of[:, None], rows_of]
        noise[batch, nav, of_bias] = crossed[:, rows_of]
        noise[batch, of_bias, nav] = crossed[:, rows_of].swapaxes(-1, -2)
        noise[batch, of_bias, of_bias] = own


_OF_ACCEL, _OF_GYRO = np.arange(6), np.append(np.arange(3), np.arange(6, 12))
"""Rows of the responses: both have -C."""


def _in_ned(
    raw: Sums,
    imu: ImuTrack,
    path: Preintegration,
    start: IntArray,
    end: IntArray,
    q: Array,
    velocity: Array,
    gravity: float,
) -> Propagation:
    """The sums turned into NED, and the responses that need the state at the start."""
    c = quaternion.multiply(q, quaternion.conjugate(path.q[start]))
    turn = np.tile(np.eye(15), (len(start), 1, 1))
    for block in (ATTITUDE, VELOCITY, POSITION):
        turn[:, block, block] = quaternion.to_matrix(c)
    turn9 = turn[:, :9, :9]
    transition = turn @ raw.transition @ turn.swapaxes(-1, -2)
    noise = {cause: np.zeros((len(start), 15, 15)) for cause in MOVED}
    for cause, own in MOVED.items():
        noise[cause][:, own, own] = _carried(turn, raw.noise[cause], own)

    duration = (path.t[end] - path.t[start])[:, None]
    down = np.array([0.0, 0.0, 1.0])
    _, v_end, _ = path.carry(start, end, q, velocity, np.zeros_like(velocity), gravity=gravity)

    def rates(i: IntArray, attitude: Array, speed: Array) -> Array:
        force = quaternion.rotate(attitude, imu.accel[i]) + gravity * down
        return np.concatenate((quaternion.rotate(attitude, imu.gyro[i]), force, speed), axis=1)

    begin, arrive = rates(start, q, velocity), rates(end, quaternion.multiply(c, path.q[end]), v_end)
    return Propagation(
        duration[:, 0],
        transition,
        noise,
        (turn9 @ raw.gyro_matrix.reshape(-1, 9, 9)).reshape(-1, 9, 3, 3),
        (turn9 @ raw.accel_matrix.reshape(-1, 9, 9)).reshape(-1, 9, 3, 3),
        # The estimate is the truth of a moment ago, begun from the truth of now: the rates of change at the end, less
        # what those at the start grow into.
        arrive - (transition[:, :9, :9] @ begin[..., None])[..., 0],
        np.concatenate((0 * down * duration, duration * down, 0.5 * duration**2 * down), axis=1),
    )
