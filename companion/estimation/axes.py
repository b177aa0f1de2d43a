"""Axes of an IMU that are mirrored or exchanged: which way to read it fits the other aiding sensors?

A smoother that is told a wrong axis takes what contradicts it for noise, far more than the readings themselves scatter
by. Then the IMU is read in other ways. The one that makes all aiding sensors likeliest is true, if they are far
likelier so than by any single error of another kind. To the IMU alone, axes exchanged twice are a board that is
turned, which only the compass contradicts.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from companion.constants import healthy, num
from companion.estimation.hypotheses import hypothesis_of
from companion.estimation.iteration import Adaptation, Start, estimate, in_noise, likelihood, start_of
from companion.estimation.model import BestEstimate
from companion.estimation.setup import Setup, guesses, set_up
from companion.estimation.smoother import boundary, next_adaptation
from companion.model import STANDARD_GRAVITY, Array, Flight, NoEstimateError
from companion.strapdown import quaternion

Motion = tuple[tuple[Array, Array], tuple[Array, Array]]
"""Of gyro and accelerometer: what the estimate's motion has and what was read, (K-1, 3) each."""


@dataclass(frozen=True, slots=True)
class Reading:
    """Another way to read the IMU, and how much better it fits."""

    words: str
    fits: float  # how much likelier all aiding sensors are, as a factor by which the IMU's noise would be less


def _mirrored(axis: int) -> Array:
    return np.diag(np.where(np.arange(3) == axis, -1.0, 1.0))


def _exchanged(axis: int) -> Array:
    return np.eye(3)[[[0, 2, 1], [2, 1, 0], [1, 0, 2]][axis]]


WAYS: Mapping[str, tuple[Array, Array]] = {
    **{f"gyro {name} is mirrored": (_mirrored(i), np.eye(3)) for i, name in enumerate("xyz")},
    **{f"accelerometer {name} is mirrored": (np.eye(3), _mirrored(i)) for i, name in enumerate("xyz")},
    **{f"axes {name} are exchanged": (_exchanged(i), _exchanged(i)) for i, name in enumerate(("y and z", "x and z",
                                                                                             "x and y"))},
}  # fmt: skip
"""In words → how the readings (gyro, accelerometer) have to be turned, (3, 3) each."""


def followed(best: BestEstimate, motion: Motion) -> tuple[Array, Array]:
    """(3,), (3,) the part of what an axis of gyro and accelerometer reads that the estimate's motion has: about 1.

    By regression over the intervals between keyframes, biases taken off, where nothing of the IMU was explained that
    surely began in flight: a mirrored axis has -1 where the aiding sensors tell the motion. 1 for an axis that reads
    hardly more than its noise.
    """
    seconds = np.diff(best.t)[:, None]
    plain = np.ones(len(seconds), np.bool_)
    for one in best.explained:
        # else an axis that is read wrongly looks like it
        began = one.onset - num.ONSET_SIGMAS * one.onset_sigma > best.t[0]
        if began and hypothesis_of(one.kind).device == "imu":
            plain &= (best.t[1:] < one.onset) | (best.t[:-1] > one.end)
    if plain.sum() < num.AXIS_MIN_INTERVALS:
        plain[:] = True
    parts = []
    noises = zip((best.noise.gyro_noise, best.noise.accel_noise), best.spectral, strict=True)
    for (moved, read), noise in zip(motion, map(min, noises), strict=True):
        square = (read[plain] ** 2).sum(axis=0)
        above_noise = square > num.AXIS_SIGNAL_SIGMAS**2 * noise**2 * (1.0 / seconds[plain]).sum()
        parts.append(np.where(above_noise, (moved * read)[plain].sum(axis=0) / np.maximum(square, 1e-300), 1.0))
    return parts[0], parts[1]


def motion_between(best: BestEstimate) -> Motion:
    """Mean rate and specific force (K-1, 3) of every interval: of the estimate's motion, and as read.

    FRD at the start of the interval; the readings without bias, scale error and misalignment as they are estimated.
    """
    seconds, q, start, path = np.diff(best.t)[:, None], best.q_ned_frd, best.index[:-1], best.path

    def turned(q: Array) -> Array:
        return quaternion.log(quaternion.multiply(quaternion.conjugate(q[:-1]), q[1:])) / seconds

    force = np.diff(best.velocity, axis=0) / seconds - [0.0, 0.0, best.gravity]
    read = quaternion.rotate(quaternion.conjugate(path.q[start]), np.diff(path.v[best.index], axis=0) / seconds)
    return ((turned(q), turned(path.q[best.index])), (quaternion.rotate(quaternion.conjugate(q[:-1]), force), read))


def other_reading(
    flight: Flight,
    best: BestEstimate,
    *,
    gravity: float = STANDARD_GRAVITY,
    span: tuple[float, float] | None = None,
    untrusted: Sequence[tuple[float, float]] = (),
    differ: bool = True,
) -> Reading | None:
    """The way to read the IMU that fits far better than as it is; None where there is none.

    flight, gravity, span, untrusted: as the best estimate was made of, which has explained what it can by errors that
    come and go; the other way has to do without. Where the others contradict the IMU all the time, or the compass
    turned in flight by about a right angle, every way is tried, for the estimate may have followed the IMU astray; else
    none that leaves the axes alone that are not followed, and nothing where all are. Of a long flight the part is taken
    in which they are followed least. differ: whether IMU and autopilot do, which take turns and forces for the same
    with the right axes alone: where they do not, or it is not known, only such a compass tells of wrong ones.
    """
    at_right_angle = _compass_at_right_angle(best)
    if not (differ or at_right_angle):
        return None
    motion, astray = motion_between(best), best.contradicted or at_right_angle
    gyro, accel = (astray | (part < healthy.AXIS_FOLLOWED) for part in followed(best, motion))
    if not (gyro.any() or accel.any()) or not (astray or _spared(motion, gyro, accel) > num.AXIS_GAIN):
        return None
    ways = {words: turn for words, turn in WAYS.items() if _touches(turn[0], gyro) or _touches(turn[1], accel)}
    part = _least_followed(best.t, motion) if best.t[-1] - best.t[0] > num.AXIS_SPAN_S else span
    track = flight.imu(best.imu.source)

    def begun(turn: tuple[Array, Array]) -> tuple[Setup, Start]:
        """Where to begin with readings that are turned."""
        turned = replace(track, gyro=track.gyro @ turn[0].T, accel=track.accel @ turn[1].T)
        other = replace(flight, imus={**flight.imus, track.source: turned})
        with boundary(track.source):
            setup = set_up(other, track.source, gravity, part, untrusted, num.AXIS_KEYFRAMES)
            *_, unaided = guesses(setup, flight)
            return setup, start_of(setup, unaided)

    tried = dict[str, _Tried]()
    for words, turn in ways.items():
        with contextlib.suppress(NoEstimateError):
            tried[words] = _gone_on(*begun(turn), num.AXIS_TRIAL_PASSES)
    words = max(tried, key=lambda name: tried[name].likelihood, default="")
    try:
        as_it_is = _gone_on(*begun((np.eye(3), np.eye(3))))  # with nothing explained, as the others
        read_so = _gone_on(tried[words].setup, tried[words].settled) if tried else as_it_is
    except NoEstimateError:
        return None
    if not np.isfinite(as_it_is.likelihood) or read_so.fits_beside(as_it_is.likelihood) <= num.AXIS_CLEARLY_BETTER:
        return None
    fits = read_so.fits_beside(_likeliest(as_it_is))
    return Reading(words, fits) if fits > num.AXIS_CLEARLY_BETTER else None


@dataclass(frozen=True, slots=True, eq=False)
class _Tried:
    """How far the estimate of readings has come, and how likely it makes all aiding sensors."""

    setup: Setup
    settled: Start
    likelihood: float

    def fits_beside(self, likelihood: float) -> float:
        """How many times less noise of the IMU would be as much likelier: that aiding sensors fit worse, costs."""
        return in_noise(self.likelihood - likelihood, len(self.setup.t) - 1)


def _gone_on(setup: Setup, start: Start, passes: int = num.SMOOTHER_PASSES) -> _Tried:
    with boundary(setup.imu.source):
        settled, linear = estimate(setup, start, polish=np.inf, passes=passes)
    return _Tried(setup, settled, likelihood(settled, linear))


def _likeliest(tried: _Tried) -> float:
    """How likely readings make the aiding sensors where one error, no other way to read them, explains what it can.

    Of a few seconds of flight, a moment's shock is less noise by as much as axes that are exchanged.
    """
    setup, start = tried.setup, tried.settled
    with contextlib.suppress(NoEstimateError), boundary(setup.imu.source):
        settled, linear = estimate(setup, start)
        adaptation = next_adaptation(setup, start, settled, linear, ())
        without = likelihood(settled, linear)
        if not isinstance(adaptation, Adaptation):
            return without
        return max(without, likelihood(adaptation.settled, adaptation.linear))
    return tried.likelihood


def _compass_at_right_angle(best: BestEstimate) -> bool:
    """Whether a compass turned in flight by an angle that is nearer to a right one than to none."""
    return any(
        hypothesis_of(one.kind).turns_compass and bool((np.abs(one.size) > 0.25 * np.pi).any())
        for one in best.explained
    )


def _spared(motion: Motion, gyro: npt.NDArray[np.bool_], accel: npt.NDArray[np.bool_]) -> float:
    """How many times less noise both sensors would need at best, if the axes named (3,) were not off at all."""
    ratio = 1.0
    for (moved, read), axes in zip(motion, (gyro, accel), strict=True):
        off = ((moved - read) ** 2).sum(axis=0)
        ratio *= float(off.sum() / max(off[~axes].sum(), 1e-9 * off.sum(), 1e-300))
    return float(ratio**0.25)


def _touches(turn: Array, axes: npt.NDArray[np.bool_]) -> bool:
    """Whether a turn changes any of the axes (3,)."""
    return bool((axes & (np.diag(turn) < 1.0)).any())


def _least_followed(t: Array, motion: Motion) -> tuple[float, float]:
    """The boot times (s), of those of keyframes (K,), between which motion and readings differ most."""
    off = sum(((m - r) ** 2).sum(axis=1) / ((m - r) ** 2).mean() for m, r in motion)
    total = np.concatenate([[0.0], np.cumsum(off * np.diff(t))])
    end = np.searchsorted(t, t + num.AXIS_SPAN_S, side="right") - 1
    first = int(np.argmax(total[end] - total))
    return float(t[first]), float(t[end[first]])
