"""What a row of `aiding_sensors.SENSORS` consists of: readings at keyframes, how they are taken and predicted.

Also here: where a vehicle stands still, by its IMU, its GPS and its motors; there it reads its own velocity and rate.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from companion.constants import healthy, num
from companion.model import (
    STANDARD_GRAVITY,
    Array,
    Flight,
    GpsTrack,
    ImuTrack,
    IntArray,
    Origin,
    integrated,
    nearest,
    ned_from_geodetic,
)
from companion.strapdown import Preintegration

if TYPE_CHECKING:  # whose constants are those of the rows
    from companion.estimation.model import States


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """The readings of one aiding sensor that stand at keyframes. Nothing in them depends on the estimate."""

    name: str
    t: Array  # (M,) s
    keyframe: IntArray  # (M,)
    value: Array  # (M, d) in the unit of the sensor
    sigma: Array  # (M, d) nominal 1σ
    sample: IntArray  # (M, 3) of the IMU, the last three by which the reading can be late; (M,) where none counts
    late: Array | float = 0.0  # (M,) s, by which they are known to be late beyond the constant latency
    latency_s: float = 0.0  # by which such readings usually are late

    def later(self, late: Array, t: Array) -> Readings:
        """The same where every reading is late by so much more, (M,) s, at the keyframes t (K,) where it is valid then.

        Of two at one keyframe the nearer stays.
        """
        late = self.late + late
        valid = self.t - late - self.latency_s
        k = nearest(t, valid)
        nearer = np.lexsort((np.abs(t[k] - valid), k))
        first = np.concatenate([[True], np.diff(k[nearer]) > 0])
        kept = nearer[first & (valid[nearer] >= t[0]) & (valid[nearer] <= t[-1])]
        return Readings(self.name, self.t[kept], k[kept], self.value[kept], self.sigma[kept], self.sample[kept],
                        late[kept], self.latency_s)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Kinematics:
    """What readings are predicted from: the states at the keyframes, and by the IMU how the vehicle came there.

    Three samples about each keyframe, where a fix was taken, and a parabola through them. What the IMU felt alone:
    gravity is not in it.
    """

    states: States
    path: Preintegration  # of the IMU, at the samples that readings need
    index: IntArray  # (K,) samples at which the keyframes stand
    t: Array  # (K,) s
    rate: Array  # (K, 3) FRD, rad/s
    when: Array  # (K, 3) s, of the samples, from the keyframe on
    velocity: Array  # (K, 3, 3) NED, m/s, at the samples less that at the keyframe
    position: Array  # (K, 3, 3) NED, m, at the samples less what the velocity at the keyframe makes of it
    imu_known: npt.NDArray[np.bool_]  # (K,) whether the IMU is there on both sides; else nothing is felt
    gravity: float


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """What a sensor should read, and by how much more if the states or the constants of the flight are off."""

    value: Array  # (M, d)
    derivatives: Mapping[str, Array]  # block of `States`, or one of its constants → (M, d, n)


@dataclass(frozen=True, eq=False)
class Intake:
    """What the readings of an aiding sensor are taken from."""

    flight: Flight
    imu: ImuTrack
    t: Array  # (K,) s, of the keyframes
    spacing: float  # s, between them
    gps: GpsTrack | None  # the receiver with the most fixes
    origin: Origin | None
    notes: list[str]  # to which a sensor adds that it cannot be used

    @cached_property
    def rest(self) -> tuple[IntArray, Array, Array]:
        """Keyframes (M,) at rest, the gyro's mean about each (M, 3) and its 1σ (M, 1), rad/s."""
        means, own, still = at_rest(self.flight, self.imu, self.t)
        k = np.flatnonzero(still).astype(np.intp)
        return k, means[k], own[k, None]


@dataclass(frozen=True, slots=True)
class AidingSensor:
    """All that is known of an aiding sensor: the readings of one name, of which a device may have several."""

    name: str
    device: str  # "gps", "compass", "barometer", "rangefinder"; "rest", "calm": the vehicle itself
    unit: str
    nominal: float  # 1σ before anything is learned, where the vehicle states none, in the unit
    predict: Callable[[Readings, Kinematics], Prediction]
    read: Callable[[AidingSensor, Intake], Readings | None] | None = None  # None: made where the smoother is set up
    least: float = 0.0  # 1σ that may be learned: below it are errors of the model, as of soft iron and timing
    # The error beside white noise, first-order Gauss-Markov (P. S. Maybeck 1979, §4.11), of each component: the median
    # of its 1σ, the factor of its spread (1σ), and the correlation time in s
    slow: tuple[float, float, float] | None = None
    # A further one, of a motion that the sensor sees: the readings that go by its integral, and the same of it
    motion: tuple[str, tuple[float, float, float]] | None = None
    offset: float = 0.0  # 1σ, before the flight, of a constant of the flight that adds to what it reads; 0: none
    latency_s: float = 0.0  # by which readings usually are late
    height: bool = False  # whether it reads the height above a fixed place, and nothing else

    def at_keyframes(self, when: Array, value: Array, t: Array, spacing: float, own: Array | None = None) -> Readings:
        """Of readings (N, d), two or more, at times (N,) s the nearest to each keyframe t (K,), each once.

        Where one is valid within half a spacing (s). own: (N,) 1σ that the sensor states, NaN or 0 where it states
        none: believed down to a twentieth of the nominal one.
        """
        sigma = np.full(len(value), self.nominal)
        if own is not None:
            sigma = np.where(np.isfinite(own) & (own > 0), np.maximum(own, 0.05 * self.nominal), self.nominal)
        valid = when - self.latency_s
        i = nearest(valid, t)
        k = np.flatnonzero(np.abs(valid[i] - t) <= 0.5 * spacing + 1e-3)
        k = k[np.diff(i[k], prepend=-1) > 0]
        i, unused = i[k], np.zeros(len(k), np.intp)
        sigma = np.repeat(sigma[i, None], value.shape[1], axis=1)
        return Readings(self.name, when[i], k, value[i], sigma, unused, latency_s=self.latency_s)

    def at(self, t: Array, keyframe: IntArray, value: Array, sigma: Array | None = None) -> Readings:
        """Readings (M, d) that are made at keyframes (M,), at times t (M,) s."""
        sigma = np.full(value.shape, self.nominal) if sigma is None else sigma
        return Readings(self.name, t, keyframe, value, sigma, keyframe)


def through(when: Array, change: Array, late: Array) -> tuple[Array, Array]:
    """Parabolas through changes (M, 3, 3) at three times (M, 3) s: what they say at (M,) s, and how fast it goes on."""
    within = np.clip(late, when[:, 0], when[:, 2])  # a parabola says nothing beyond its samples
    beyond, late = (late - within)[:, None], within[:, None]
    share, slope = np.empty(when.shape), np.empty(when.shape)
    for own, one, other in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        apart = (when[:, own] - when[:, one]) * (when[:, own] - when[:, other])
        share[:, own] = ((late[:, 0] - when[:, one]) * (late[:, 0] - when[:, other])) / apart
        slope[:, own] = (2.0 * late[:, 0] - when[:, one] - when[:, other]) / apart
    changed, goes_on = np.einsum("mj,mji->mi", share, change), np.einsum("mj,mji->mi", slope, change)
    return changed + goes_on * beyond, goes_on


def three_samples(track: ImuTrack, samples: IntArray, apart_s: float, *, before: int) -> IntArray:
    """(K, 3) samples so long apart, so many of them before each of (K,); at the ends as near to that as can be."""
    count = len(track)
    apart = min(max(1, round(apart_s * track.rate_hz)), (count - 1) // 2)
    first = np.clip(samples - before * apart, 0, count - 1 - 2 * apart)
    return np.asarray(first[:, None] + apart * np.arange(3))


def receiver_of(flight: Flight, t: Array) -> GpsTrack | None:
    """The receiver with the most fixes from the first to the last of times t (N,), s; None where none has enough."""

    def fixes(one: GpsTrack) -> int:
        return int(((one.fix_type >= 3) & (one.t >= t[0]) & (one.t <= t[-1])).sum())

    best = max(flight.gps, key=fixes, default=None)
    return best if best is not None and fixes(best) >= num.MIN_FIXES else None


def at_rest(flight: Flight, track: ImuTrack, t: Array) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Mean rates (K, 3) about keyframes t (K,) and their 1σ (K,), rad/s, and whether the vehicle rests there (K,).

    A hover can be quieter than a bench, and an IMU cannot tell them apart: so the vehicle has to say that its motors
    are off, and the GPS must not see it move.
    """
    armed = flight.armed(t, t + 1.0)
    index = np.searchsorted(track.t, t)
    half = max(2, round(0.25 * track.rate_hz))
    low, high = np.maximum(index - half, 0), np.minimum(index + half, len(track))
    count = high - low
    mean, spread = np.empty((2, len(t), 3)), np.zeros((2, len(t)))
    for sensor, axis in np.ndindex(2, 3):  # an axis at a time: of a long flight the sums of all are more than the track
        values = (track.gyro, track.accel)[sensor][:, axis]
        first, second = (np.append(0.0, np.cumsum(v)) for v in (values, values**2))
        mean[sensor, :, axis] = (first[high] - first[low]) / count
        variance = (second[high] - second[low]) / count - mean[sensor, :, axis] ** 2
        spread[sensor] = np.maximum(spread[sensor], np.sqrt(np.maximum(variance, 0.0)))
    still = np.zeros(len(t), np.bool_) if armed is None else ~armed  # where nothing is said of them, motors may run
    steps = (track.gyro_step, track.accel_step)
    for quiet, step, most in zip(spread, steps, healthy.REST_CHANGE, strict=True):
        still &= quiet < min(most, max(healthy.REST_LOUDER * float(np.percentile(quiet, 10.0)), 0.6 * step, 0.2 * most))
    force = np.linalg.norm(mean[1], axis=1)
    still &= np.abs(force - STANDARD_GRAVITY) < healthy.REST_FORCE * STANDARD_GRAVITY
    still &= np.abs((mean[0] * mean[1]).sum(axis=1)) < healthy.REST_TURN_RPS * force
    if (gps := receiver_of(flight, track.t)) is not None:
        speed = np.linalg.norm(gps.velocity[:, :2], axis=1)
        good = np.isfinite(speed) & (gps.fix_type >= 3)
        if good.sum() > 1:
            still &= np.interp(t, gps.t[good], speed[good]) < healthy.REST_MPS
            still &= ~_drifting(gps, good, t, still)
    # the neighbours have to rest too: nothing begins or ends here
    calm = still.copy()
    calm[1:] &= still[:-1]
    calm[:-1] &= still[1:]
    own = spread * np.sqrt(2.0 / count)
    calm &= _change(mean[1], still) < healthy.REST_FORCE_SIGMAS * own[1]  # else gravity turns
    return mean[0], np.maximum(own[0], 0.5 * _change(mean[0], still)), np.asarray(calm)


def _drifting(
    gps: GpsTrack, good: npt.NDArray[np.bool_], t: Array, still: npt.NDArray[np.bool_]
) -> npt.NDArray[np.bool_]:
    """(K,) where what an IMU takes for rest is a steady motion, as a boat's: the GPS moves by what its velocity says.

    A receiver at rest wanders too, and not as its velocity says. good: its fixes; still: (K,) by the IMU at t (K,).
    """
    when, velocity = gps.t[good], gps.velocity[good, :2]
    latitude, longitude = gps.latitude[good], gps.longitude[good]
    level = np.zeros(len(when))
    place = ned_from_geodetic(latitude, longitude, level, (float(latitude[0]), float(longitude[0]), 0.0))[:, :2]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(np.int8))).reshape(-1, 2)
    ends = np.clip(np.searchsorted(when, t[edges - [0, 1]]), 0, len(when) - 1)
    by_velocity, by_position = (both[ends[:, 1]] - both[ends[:, 0]] for both in (integrated(when, velocity), place))
    far = np.linalg.norm(by_velocity, axis=1)
    apart = np.linalg.norm(by_position - by_velocity, axis=1)
    drifts = (far > healthy.REST_DRIFT_M) & (apart < healthy.REST_DRIFT_CONFIRMED * far)
    out = np.zeros(len(t), np.bool_)
    for first, last in edges[drifts].tolist():
        out[first:last] = True
    return out


def _change(means: Array, still: npt.NDArray[np.bool_]) -> Array:
    """(K,) by how much the means (K, 3) of neighbours at rest differ.

    A vehicle that sways on its legs, or is carried, is as quiet for a moment as one that stands. Half of what its rate
    changes by is how far it may be from a bias.
    """
    padded = np.full((len(means) + 2 * num.REST_NEIGHBOURS, 3), np.nan)
    padded[num.REST_NEIGHBOURS : len(means) + num.REST_NEIGHBOURS][still] = means[still]
    highest, lowest = means.copy(), means.copy()
    for first in range(2 * num.REST_NEIGHBOURS + 1):
        near = padded[first : first + len(means)]
        np.fmax(highest, near, out=highest)
        np.fmin(lowest, near, out=lowest)
    return np.where(still, (highest - lowest).max(axis=1), 0.0)
