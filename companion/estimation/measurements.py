"""What each aiding sensor measures of the keyframes, linear in their errors: GPS, compass, barometer, rest.

With C = C(q_ned_frd) at the keyframe, m the Earth's field in NED, h the hard and S the soft iron, l the lever arm and τ
the latency:

    position  z = p + C l + v (t - t_k - τ)            velocity  z = v + a (t - t_k - τ) + C (ω × l)
    compass   z = (I + S) C(t - τ_m)ᵀ m + h                barometer z = -p_down + offset
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from companion.constants import healthy, num
from companion.estimation.model import (
    ATTITUDE,
    CONSTANT_STATES,
    CONSTANTS,
    GYRO_BIAS,
    POSITION,
    STATES,
    VELOCITY,
    States,
)
from companion.estimation.system import Index, Measurement
from companion.model import Array, GpsTrack, ImuTrack, nearest, ned_from_geodetic
from companion.strapdown import Preintegration, quaternion, skew

NOMINAL: Mapping[str, float] = {
    "gps_position": 1.0,  # m, horizontal
    "gps_height": 1.5,  # m
    "gps_velocity": 0.2,  # m/s
    "gps_climb": 0.3,  # m/s
    "compass": 1.0,  # µT
    "barometer": 0.5,  # m
    "rest_velocity": 0.02,  # m/s
    "rest_rate": 2e-4,  # rad/s
    "calm": 45.0,  # m/s: of a velocity that wanders by 5 m/s within 20 s, as white noise every half second says it
}
"""Aiding sensor → 1σ before anything is learned, where the vehicle states none."""

LEAST: Mapping[str, float] = {
    "gps_position": 0.1, "gps_height": 0.15, "gps_velocity": 0.04, "gps_climb": 0.06, "compass": 0.8, "barometer": 0.1,
    "calm": 20.0,
}  # fmt: skip
"""Aiding sensor → the least 1σ that may be learned: below it are errors of the model, as of soft iron and timing."""

SLOW: Mapping[str, tuple[float, float, float]] = {
    "gps_position": (0.12, 2.0, 60.0), "gps_height": (0.5, 2.0, 60.0), "gps_velocity": (0.035, 2.5, 10.0),
    "gps_climb": (0.045, 2.0, 10.0), "compass": (0.4, 2.0, 40.0), "barometer": (0.8, 1.5, 60.0),
}  # fmt: skip
"""Aiding sensor → the error that each component has beside white noise, first-order Gauss-Markov (P. S. Maybeck 1979,
§4.11): the median of its 1σ in its unit, the factor of its spread (1σ), and the correlation time in s. Of ten healthy
flights of six real vehicles."""

UNITS: Mapping[str, str] = {
    "gps_position": "m", "gps_height": "m", "gps_velocity": "m/s", "gps_climb": "m/s", "compass": "µT",
    "barometer": "m", "rest_velocity": "m/s", "rest_rate": "rad/s", "calm": "m/s",
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """The readings of one aiding sensor that stand at keyframes. Nothing in them depends on the estimate."""

    name: str
    t: Array  # (M,) s
    keyframe: Index  # (M,)
    value: Array  # (M, d) in the unit of UNITS
    sigma: Array  # (M, d) nominal 1σ
    sample: Index  # (M, 3) of the IMU, the last three by which the reading can be late; (M,) where none counts
    late: Array | float = 0.0  # (M,) s, by which they are known to be late beyond the constant latency

    def later(self, late: Array, t: Array) -> Readings:
        """The same where every reading is late by so much more, (M,) s: at those of the keyframes t (K,) it speaks of.

        Of two that speak of one keyframe the nearer stays.
        """
        late = self.late + late
        spoke = self.t - late - _usual_latency(self.name)
        k = nearest(t, spoke)
        nearer = np.lexsort((np.abs(t[k] - spoke), k))
        first = np.concatenate([[True], np.diff(k[nearer]) > 0])
        kept = nearer[first & (spoke[nearer] >= t[0]) & (spoke[nearer] <= t[-1])]
        return Readings(self.name, self.t[kept], k[kept], self.value[kept], self.sigma[kept], self.sample[kept],
                        late[kept])  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Kinematics:
    """What measurements need of the IMU at each keyframe, beside the states: how the vehicle came there.

    Three samples about each keyframe, where a fix was taken; a parabola through them tells the rest. What the IMU felt
    alone: gravity is not in it.
    """

    t: Array  # (K,) s
    rate: Array  # (K, 3) FRD, rad/s
    when: Array  # (K, 3) s, of the samples, from the keyframe on
    velocity: Array  # (K, 3, 3) NED, m/s, at the samples less that at the keyframe
    position: Array  # (K, 3, 3) NED, m, at the samples less what the velocity at the keyframe makes of it
    imu_known: npt.NDArray[np.bool_]  # (K,) whether the IMU is there on both sides; else nothing is felt
    gravity: float

    def moved(self, change: Array, k: Index, late: Array) -> tuple[Array, Array]:
        """One of the changes (M, 3), and how fast it goes on (M, 3), `late` (M,) s after the keyframes k (M,)."""
        return _through(self.when[k], change[k], late)


def _through(when: Array, change: Array, late: Array) -> tuple[Array, Array]:
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


def gps_readings(track: GpsTrack, t: Array, origin: tuple[float, float, float], spacing: float) -> Iterator[Readings]:
    """A GpsTrack at keyframes t (K,): every reading within half a spacing of one, the nearest to each."""
    ned = ned_from_geodetic(track.latitude, track.longitude, track.height, origin)
    # where there is no height the horizontal position is still one: of the origin's height
    flat = ned_from_geodetic(track.latitude, track.longitude, np.full(len(track), origin[2]), origin)
    horizontal = np.where(np.isfinite(ned[:, :2]), ned[:, :2], flat[:, :2])
    for name, value, own in (
        ("gps_position", horizontal, track.horizontal_sigma),
        ("gps_height", ned[:, 2:], track.vertical_sigma),
        ("gps_velocity", track.velocity[:, :2], track.speed_sigma),
        ("gps_climb", track.velocity[:, 2:], track.speed_sigma),
    ):
        good = np.isfinite(value).all(axis=1) & (track.fix_type >= 3)
        if good.sum() < 2:
            continue
        sigma = np.where(np.isfinite(own) & (own > 0), np.maximum(own, 0.05 * NOMINAL[name]), NOMINAL[name])
        sigma = np.repeat(sigma[:, None], value.shape[1], axis=1)
        yield _at_keyframes(name, track.t[good], value[good], sigma[good], t, spacing)


def vector_readings(name: str, when: Array, value: Array, t: Array, spacing: float) -> Readings:
    """Readings (M, d) of an aiding sensor with the nominal σ at keyframes t (K,)."""
    return _at_keyframes(name, when, value, np.full(value.shape, NOMINAL[name]), t, spacing)


def averaged(one: Readings, when: Array, value: Array, half_s: Array) -> Readings:
    """Readings (M, d) that are each the mean of those at times `when` (N,) within half_s (M,) of it, either way alike.

    What scatters from one to the next is less by the root of their number; what changes evenly meanwhile cancels.
    """
    i = np.searchsorted(when, one.t)
    n = np.minimum(i - np.searchsorted(when, one.t - half_s), np.searchsorted(when, one.t + half_s, "right") - 1 - i)
    sums = np.concatenate([np.zeros((1, 1 + value.shape[1])), np.cumsum(np.column_stack([when, value]), axis=0)])
    mean = (sums[i + n + 1] - sums[i - n]) / (2 * n + 1)[:, None]
    return replace(one, t=mean[:, 0], value=mean[:, 1:])


def _at_keyframes(name: str, when: Array, value: Array, sigma: Array, t: Array, spacing: float) -> Readings:
    """The reading that speaks of the time nearest to each keyframe, where one is near enough."""
    spoke = when - _usual_latency(name)
    i = np.clip(np.searchsorted(spoke, t), 1, max(len(spoke) - 1, 1))
    i = i - (t - spoke[i - 1] < spoke[np.minimum(i, len(spoke) - 1)] - t)
    near = np.abs(spoke[i] - t) <= 0.5 * spacing + 1e-3
    k = np.flatnonzero(near).astype(np.intp)
    i = i[near]
    once = np.concatenate([[True], np.diff(i) > 0]) if len(i) else np.zeros(0, np.bool_)  # a reading counts once
    k, i = k[once], i[once]
    return Readings(name, when[i], k, value[i], sigma[i], np.zeros(len(i), np.intp))


def slow_places(readings: Sequence[Readings]) -> dict[str, slice]:
    """Aiding sensor → place of its slow error among the states of a keyframe, behind those of the motion."""
    places, at = dict[str, slice](), STATES
    for one in readings:
        if one.name in SLOW:
            places[one.name] = slice(at, at + one.value.shape[1])
            at = places[one.name].stop
    return places


def three_samples(track: ImuTrack, samples: Index, apart_s: float, *, before: int) -> Index:
    """(K, 3) samples so long apart, so many of them before each of (K,); at the ends as near to that as can be."""
    count = len(track)
    apart = min(max(1, round(apart_s * track.rate_hz)), (count - 1) // 2)
    first = np.clip(samples - before * apart, 0, count - 1 - 2 * apart)
    return np.asarray(first[:, None] + apart * np.arange(3))


def _usual_latency(name: str) -> float:
    return healthy.GPS_LATENCY_S if name.startswith("gps") else 0.0


def measure(one: Readings, states: States, at: Kinematics, path: Preintegration, index: Index) -> Measurement:
    """The measurement factor of an aiding sensor about the present states; weights 1."""
    count, d = one.value.shape
    h, h_c = np.zeros((count, d, STATES)), np.zeros((count, d, CONSTANT_STATES))
    k = one.keyframe
    if one.name.startswith("gps"):
        predicted = _gps(one, states, at, h, h_c)
    elif one.name == "compass":
        predicted = _compass(one, states, path, index, h, h_c)
    elif one.name == "barometer":
        h[:, 0, POSITION.start + 2] = -1.0
        h_c[:, 0, CONSTANTS["barometer_offset"][0]] = 1.0
        predicted = (states.constant("barometer_offset")[0] - states.position[k, 2])[:, None]
    elif one.name == "rest_rate":
        h[:, :, GYRO_BIAS] = np.eye(3)
        predicted = states.gyro_bias[k]
    else:  # rest_velocity, calm
        h[:, :, VELOCITY] = np.eye(3)
        predicted = states.velocity[k]
    return Measurement(one.name, one.t, k, one.value - predicted, h, h_c, one.sigma, np.ones(count), UNITS[one.name])


def _gps(one: Readings, states: States, at: Kinematics, h: Array, h_c: Array) -> Array:
    """Where the vehicle was, or how fast, when the fix was taken."""
    k = one.keyframe
    lever = states.constant("lever_arm")
    imu_known = at.imu_known[k]  # else a velocity that nobody tells would go with the latency
    late = one.t - one.late - at.t[k] - np.where(imu_known, states.constant("gps_latency")[0], healthy.GPS_LATENCY_S)
    matrix = quaternion.to_matrix(states.q_ned_frd[k])
    rows = slice(2, 3) if one.name in ("gps_height", "gps_climb") else slice(0, 2)
    if one.name in ("gps_position", "gps_height"):
        arm = matrix @ lever
        force_part, goes_on = at.moved(at.position, k, late)
        value = states.position[k] + states.velocity[k] * late[:, None] + force_part + arm
        value[:, 2] += 0.5 * at.gravity * late**2
        h[:, :, POSITION] = np.eye(3)[rows]
        h[:, :, VELOCITY] = late[:, None, None] * np.eye(3)[rows]
        change, of_arm = states.velocity[k] + goes_on, matrix
        change[:, 2] += at.gravity * late
    else:
        arm = np.einsum("kij,kj->ki", matrix, quaternion.cross(at.rate[k], lever))
        force_part, goes_on = at.moved(at.velocity, k, late)
        value = states.velocity[k] + force_part + arm
        value[:, 2] += at.gravity * late
        h[:, :, VELOCITY] = np.eye(3)[rows]
        h[:, :, GYRO_BIAS] = (matrix @ skew(lever))[:, rows]
        change, of_arm = goes_on, matrix @ skew(at.rate[k])
        change[:, 2] += at.gravity
    h[:, :, ATTITUDE] = -skew(arm)[:, rows]
    # What the IMU felt in between turns with the heading: on a circle a latency is told by nothing else. Its tilt is
    # left to the motion, which has the same noise: of a noisy IMU the fix would tell a tilt that is none.
    h[:, :, ATTITUDE.stop - 1] -= skew(force_part)[:, rows, 2]
    h_c[:, :, CONSTANTS["gps_latency"][0]] = -(imu_known[:, None] * change[:, rows])[..., None]
    h_c[:, :, CONSTANTS["lever_arm"][0]] = of_arm[:, rows]
    return np.asarray(value[:, rows])


def _compass(one: Readings, states: States, path: Preintegration, index: Index, h: Array, h_c: Array) -> Array:
    """The field when the reading was taken: the IMU turns the keyframe's attitude until then, and says how fast."""
    start, samples = path.row(index[one.keyframe]), path.row(one.sample)
    turned = quaternion.log(quaternion.multiply(quaternion.conjugate(path.q[start])[:, None], path.q[samples]))
    when = path.t[samples]
    across_gap = when[:, 2] - when[:, 0] > num.GAP_S
    turned[across_gap] = turned[across_gap, 2:]
    angle, rate = _through(when, turned, one.t - states.constant("compass_latency"))
    q = quaternion.multiply(states.q_ned_frd[one.keyframe], quaternion.exp(angle))
    matrix = quaternion.to_matrix(q).swapaxes(-1, -2)
    field = states.constant("earth_field")
    iron = np.eye(3) + states.constant("soft_iron").reshape(3, 3)
    h[:, :, ATTITUDE] = iron @ matrix @ skew(field)
    h_c[:, :, CONSTANTS["earth_field"][0]] = iron @ matrix
    h_c[:, :, CONSTANTS["hard_iron"][0]] = np.eye(3)
    force_part = matrix @ field
    h_c[:, :, CONSTANTS["soft_iron"][0]] = np.einsum("ij,mk->mijk", np.eye(3), force_part).reshape(-1, 3, 9)
    across = quaternion.cross(angle, rate)
    rate = rate - quaternion.cross(angle, rate - across / 3.0) / 2.0  # of the body, not of the rotation vector
    h_c[:, :, CONSTANTS["compass_latency"][0]] = iron @ quaternion.cross(rate, force_part)[..., None]
    return np.asarray(force_part @ iron.T + states.constant("hard_iron"))
