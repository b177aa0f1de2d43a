"""What a row of `aiding_sensors.SENSORS` consists of: readings at keyframes, how they are taken and predicted."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from companion.estimation.rest import at_rest
from companion.estimation.system import Index
from companion.model import Array, Flight, GpsTrack, ImuTrack, Origin, nearest
from companion.strapdown import Preintegration

if TYPE_CHECKING:  # whose constants are those of the rows
    from companion.estimation.model import States


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """The readings of one aiding sensor that stand at keyframes. Nothing in them depends on the estimate."""

    name: str
    t: Array  # (M,) s
    keyframe: Index  # (M,)
    value: Array  # (M, d) in the unit of the sensor
    sigma: Array  # (M, d) nominal 1σ
    sample: Index  # (M, 3) of the IMU, the last three by which the reading can be late; (M,) where none counts
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
    index: Index  # (K,) samples at which the keyframes stand
    t: Array  # (K,) s
    rate: Array  # (K, 3) FRD, rad/s
    when: Array  # (K, 3) s, of the samples, from the keyframe on
    velocity: Array  # (K, 3, 3) NED, m/s, at the samples less that at the keyframe
    position: Array  # (K, 3, 3) NED, m, at the samples less what the velocity at the keyframe makes of it
    imu_known: npt.NDArray[np.bool_]  # (K,) whether the IMU is there on both sides; else nothing is felt
    gravity: float

    def moved(self, change: Array, k: Index, late: Array) -> tuple[Array, Array]:
        """One of the changes (M, 3), and how fast it goes on (M, 3), `late` (M,) s after the keyframes k (M,)."""
        return through(self.when[k], change[k], late)


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
    def rest(self) -> tuple[Index, Array, Array]:
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
        """Of readings (N, d) at times (N,) s the nearest to each keyframe t (K,), each once.

        Where one is valid within half a spacing (s). own: (N,) 1σ that the sensor states, NaN or 0 where it states
        none: believed down to a twentieth of the nominal one.
        """
        sigma = np.full(len(value), self.nominal)
        if own is not None:
            sigma = np.where(np.isfinite(own) & (own > 0), np.maximum(own, 0.05 * self.nominal), self.nominal)
        valid = when - self.latency_s
        i = np.clip(np.searchsorted(valid, t), 1, max(len(valid) - 1, 1))
        i = i - (t - valid[i - 1] < valid[np.minimum(i, len(valid) - 1)] - t)
        near = np.abs(valid[i] - t) <= 0.5 * spacing + 1e-3
        k = np.flatnonzero(near).astype(np.intp)
        i = i[near]
        once = np.concatenate([[True], np.diff(i) > 0]) if len(i) else np.zeros(0, np.bool_)
        k, i = k[once], i[once]
        unused = np.zeros(len(i), np.intp)
        sigma = np.repeat(sigma[i, None], value.shape[1], axis=1)
        return Readings(self.name, when[i], k, value[i], sigma, unused, latency_s=self.latency_s)

    def at(self, t: Array, keyframe: Index, value: Array, sigma: Array | None = None) -> Readings:
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


def three_samples(track: ImuTrack, samples: Index, apart_s: float, *, before: int) -> Index:
    """(K, 3) samples so long apart, so many of them before each of (K,); at the ends as near to that as can be."""
    count = len(track)
    apart = min(max(1, round(apart_s * track.rate_hz)), (count - 1) // 2)
    first = np.clip(samples - before * apart, 0, count - 1 - 2 * apart)
    return np.asarray(first[:, None] + apart * np.arange(3))
