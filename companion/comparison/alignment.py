"""Initial alignment without the autopilot: where an IMU at rest points, and where it says it points later.

Roll and pitch are those that put the mean specific force upright, the gyro's bias is its mean reading, and the heading
comes from the magnetometer where its declination is known, else from the autopilot: gravity says nothing about it.

Also here: where a vehicle stood still: what its IMU alone says about its tilt, its gyro bias and its noise.

An IMU cannot tell rest from even flight, and a simulated hover is quieter than a real bench. So the readings have to be
as quiet as this IMU gets, gravity has to be all that they feel, and what the autopilot knows must not speak against it:
a speed, or a height above the ground while armed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from companion.comparison.budget import persistent_step_error, turn_jacobian
from companion.comparison.imu_spec import ImuSpec, ReferenceSpec
from companion.comparison.reference import attitude_error, length, within, wrapped
from companion.comparison.spans import ends_of, runs
from companion.comparison.windows import Comparison
from companion.constants import check, harm, healthy, num
from companion.model import STANDARD_GRAVITY, Array, BoolArray, DataError, Flight, ImuTrack, IntArray, nearest
from companion.strapdown import Propagation, error_sums, propagate, quaternion


@dataclass(frozen=True, slots=True, eq=False)
class Rest:
    """A stretch at rest."""

    first: int  # sample
    last: int  # sample
    start_s: float  # boot clock
    end_s: float
    gyro: Array  # (3,) mean reading, rad/s, FRD: the bias
    gyro_sigma: Array  # (3,) standard error of it as the bias
    accel: Array  # (3,) mean reading, m/s²
    gyro_noise: float | None  # rad/s/√Hz, worst axis; None where the readings' steps hide it
    accel_noise: float | None  # m/s²/√Hz

    @property
    def duration_s(self) -> float:
        """s"""
        return self.end_s - self.start_s

    def of(self, track: ImuTrack) -> ImuTrack:
        """The samples of the track in it."""
        return track[self.first : self.last + 1]


@dataclass(frozen=True, slots=True, eq=False)
class _Blocks:
    """The track in short pieces, end to end: B of them."""

    edges: IntArray  # (B+1,) samples
    t: Array  # (B+1,) s
    gyro: Array  # (B, 3) means
    accel: Array  # (B, 3)
    gyro_spread: Array  # (B,) standard deviation of the samples, worst axis
    accel_spread: Array  # (B,)
    size: int  # samples of each


def rests(flight: Flight, track: ImuTrack, imu: ImuSpec) -> tuple[Rest, ...]:
    """Every stretch of three seconds or more in which the vehicle stood still, in order of time."""
    blocks = _blocks(track)
    if blocks is None:
        return ()
    still = _quiet(blocks, track, imu) & _possible(flight, blocks)
    return tuple(_rest(track, blocks, imu, first, last) for first, last in _stretches(still, blocks, track))


def why_none(flight: Flight, track: ImuTrack, imu: ImuSpec) -> str:
    """What the quietest moment of a flight without rest was like, in words."""
    blocks = _blocks(track)
    if blocks is None:
        return f"{track.source} has {len(track)} samples in {track.t[-1] - track.t[0]:.1f} s"
    i = int(np.argmin(blocks.gyro_spread / np.median(blocks.gyro_spread + 1e-12) + length(blocks.gyro)))
    turns = f"turns by {length(blocks.gyro[i]) * 1e3:.1f} mrad/s (spread {blocks.gyro_spread[i] * 1e3:.1f})"
    feels = f"feels {length(blocks.accel[i]):.2f} m/s² (spread {blocks.accel_spread[i]:.3f})"
    moment = f"the quietest moment, at {blocks.t[i]:.1f} s, {turns} and {feels}"
    quiet = _quiet(blocks, track, imu)
    if (quiet & _possible(flight, blocks)).any():
        return f"{moment}; no quiet stretch lasts {check.REST_MIN_S:g} s"
    return f"{moment}; the vehicle was moving or in the air whenever its IMU was quiet" if quiet.any() else moment


def _blocks(track: ImuTrack) -> _Blocks | None:
    size = max(check.REST_BLOCK_SAMPLES, round(check.REST_BLOCK_S * track.rate_hz))
    count = len(track) // size
    if count < 2:
        return None
    edges = np.arange(count + 1) * size
    part = slice(0, count * size)
    gyro, accel = (x[part].reshape(count, size, 3) for x in (track.gyro, track.accel))
    t, means = track.t[np.minimum(edges, len(track) - 1)], (gyro.mean(axis=1), accel.mean(axis=1))
    return _Blocks(edges, t, *means, gyro.std(axis=1).max(axis=1), accel.std(axis=1).max(axis=1), size)


def _quiet(blocks: _Blocks, track: ImuTrack, imu: ImuSpec) -> BoolArray:
    """Blocks in which the IMU is as quiet as it gets and feels gravity alone."""
    heavy = np.abs(length(blocks.accel) - STANDARD_GRAVITY)
    turning = length(blocks.gyro)
    most = imu.accel.offset + imu.accel.scale_tolerance * STANDARD_GRAVITY
    possible = (heavy < most) & (turning < 2.0 * imu.gyro.offset)
    quiet = possible & (np.diff(blocks.t) < 2.0 * blocks.size / max(track.rate_hz, 1e-9))  # no gap in it
    for spread, step, sheet, most in (
        (blocks.gyro_spread, track.gyro_step, imu.gyro.noise_density, healthy.REST_SPREAD[0]),
        (blocks.accel_spread, track.accel_step, imu.accel.noise_density, healthy.REST_SPREAD[1]),
    ):
        floor = float(np.percentile(spread, check.REST_QUIETEST))
        # a reading at the edge of a step flickers by half a step; a data sheet's noise is nobody's fault
        quiet &= spread < min(most, max(healthy.REST_LOUDER * floor, 0.55 * step, sheet * np.sqrt(0.5 * track.rate_hz)))
    return np.asarray(quiet)


def _possible(flight: Flight, blocks: _Blocks) -> BoolArray:
    """Blocks in which nothing that the autopilot knows speaks against rest."""
    begin, end = blocks.t[:-1], blocks.t[1:]
    fine = np.ones(len(begin), np.bool_)
    was_armed = flight.armed(begin, end)
    motors_off = np.zeros(len(begin), np.bool_) if was_armed is None else ~was_armed
    position = flight.position
    if position is not None and len(position) > 1:
        inside = (begin >= position.t[0]) & (end <= position.t[-1])
        speed = np.interp(0.5 * (begin + end), position.t, length(position.velocity))
        # an estimator that starts up may think that it moves
        fine &= ~inside | (speed < healthy.REST_MPS) | motors_off
        down = np.interp(0.5 * (begin + end), position.t, position.position[:, 2])
        if np.ptp(position.position[:, 2]) > harm.FLOWN_M:
            ground = float(position.position[:, 2].max()) - healthy.GROUND_M
            fine &= ~inside | (down > ground) | motors_off
    if was_armed is not None and was_armed.any():  # motors off and motors on are not the same
        loud = float(np.percentile(blocks.gyro_spread, 75.0))
        fine &= motors_off | (blocks.gyro_spread * healthy.REST_CONTRAST < loud)
    return np.asarray(fine)


def _stretches(still: BoolArray, blocks: _Blocks, track: ImuTrack) -> Iterator[tuple[int, int]]:
    """First and last block of each rest: cut where the mean reading steps, as when a calibration is saved."""
    same = still[:-1] & still[1:]
    for mean, spread, step, little in (
        (blocks.gyro, blocks.gyro_spread, track.gyro_step, 5e-4),
        (blocks.accel, blocks.accel_spread, track.accel_step, 0.02),
    ):
        noise = 6.0 * np.maximum(spread[:-1], spread[1:]) / np.sqrt(blocks.size)
        same &= np.abs(np.diff(mean, axis=0)).max(axis=1) < noise + 1.1 * step + little
    for first, last in runs(np.asarray(same)):
        if blocks.t[last + 2] - blocks.t[first] >= check.REST_MIN_S:
            yield first, last + 1


def _rest(track: ImuTrack, blocks: _Blocks, imu: ImuSpec, first: int, last: int) -> Rest:
    part = slice(int(blocks.edges[first]), int(blocks.edges[last + 1]))
    gyro, accel = track.gyro[part], track.accel[part]
    start, end = ends_of(track.t[part])
    gyro_noise = _density(gyro, track.gyro_step, track.rate_hz)
    density = imu.gyro.noise_density if gyro_noise is None else gyro_noise
    sigma = np.sqrt(density**2 / (end - start) + persistent_step_error(gyro, track.gyro_step) ** 2)
    mean_gyro, mean_accel = gyro.mean(axis=0), accel.mean(axis=0)
    accel_noise = _density(accel, track.accel_step, track.rate_hz)
    return Rest(part.start, part.stop - 1, start, end, mean_gyro, sigma, mean_accel, gyro_noise, accel_noise)


def _density(readings: Array, step: float, rate: float) -> float | None:
    """White-noise density of readings (N, 3) at rest, worst axis, less what the steps add; None where they hide it."""
    power = power_at_rest(readings, step, rate, 5)
    return None if power is None else float(np.sqrt(max(power - step**2 / (12.0 * rate), 0.0))) or None


def power_at_rest(readings: Array, step: float, rate: float, fewest: int) -> float | None:
    """The square of that density with the steps; None where they hide the noise, or with fewer clusters.

    From neighbouring clusters (Allan's deviation times the root of the cluster's length), so that a filter that makes
    samples alike does not make the sensor look better.
    """
    if step and float(readings.std(axis=0).max()) < check.HIDING_STEPS * step:
        return None
    size = max(1, round(check.REST_CLUSTER_S * rate))
    count = len(readings) // size
    if count < fewest:
        return None
    means = readings[: count * size].reshape(count, size, 3).mean(axis=1)
    return float((0.5 * np.diff(means, axis=0) ** 2).mean(axis=0).max()) * size / rate


@dataclass(frozen=True, slots=True)
class Later:
    """The attitude reckoned from rest, held against the autopilot's."""

    since_s: float  # since the end of the rest
    tilt_deg: float  # error about the horizontal
    heading_deg: float  # about down, without sign
    expected_tilt_deg: float  # 1σ
    expected_heading_deg: float


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """An IMU aligned by itself at rest."""

    rest: Rest
    q_ned_frd: Array  # (4,) wxyz, at the end of the rest
    heading_from: str  # "magnetometer", "autopilot" or "nothing"
    tilt_sigma: float  # rad, each axis
    heading_sigma: float  # rad
    accel_bias: Array  # (3,) m/s²: what the mean reading is longer than gravity, along it
    magnetic_rad: float | None  # heading by the magnetometer, with the declination where it is known; None without one
    magnetic_error_rad: float | None  # that less the autopilot's
    declination_rad: float  # 0 where it is not known
    later: tuple[Later, ...]  # after num.ALIGNED_LATER_S and at the end of the track, as far as it goes without a gap
    notes: tuple[str, ...]

    def freed(self, track: ImuTrack) -> ImuTrack:
        """The track without the biases that the rest shows."""
        return replace(track, gyro=track.gyro - self.rest.gyro, accel=track.accel - self.accel_bias)


def align(flight: Flight, comparison: Comparison, imu: ImuSpec, autopilot: ReferenceSpec | None = None) -> Alignment:
    """Align the IMU of a comparison in the flight's first rest, and integrate its attitude from there to the end.

    Raises DataError when the vehicle never rests.
    """
    autopilot = autopilot or ReferenceSpec()
    track = comparison.track
    at_rest = rests(flight, track, imu)
    if not at_rest:
        why = f"no rest of three seconds to align {track.source} in: {why_none(flight, track, imu)}"
        remedy = "Use --anchor autopilot, or a log that begins before take-off."
        raise DataError(f"vehicle {flight.vehicle}, boot {flight.boot}: {why}. {remedy}")
    rest, notes = at_rest[0], list[str]()
    f = rest.accel
    roll, pitch = float(np.arctan2(-f[1], -f[2])), float(np.arctan2(f[0], np.hypot(f[1], f[2])))
    level = quaternion.from_euler(roll, pitch, 0.0)
    steps = persistent_step_error(rest.of(track).accel, track.accel_step)
    gravity = comparison.how.gravity
    tilt_sigma = float(np.hypot(imu.accel.residual_bias, steps[:2].max()) / gravity)
    magnetic = _magnetic_heading(flight, rest, level)
    yaw_reference = None
    if comparison.reference.attitude_known[rest.last]:
        yaw_reference = _heading_from(comparison.reference.at(np.array([rest.last])).q_ned_frd[0], level)
    source, yaw, heading_sigma = "nothing", 0.0, healthy.UNKNOWN_HEADING_RAD
    if magnetic is not None:
        magnetic += flight.declination
    if magnetic is not None and flight.declination != 0.0:
        source, yaw, heading_sigma = "magnetometer", magnetic, healthy.MAGNETIC_HEADING_RAD
        notes.append(f"declination {np.degrees(flight.declination):.1f}°, by the vehicle's parameters")
    elif yaw_reference is not None:
        source, yaw, heading_sigma = "autopilot", yaw_reference, autopilot.heading
        if magnetic is not None:
            notes.append("the magnetic declination is not known: the heading is the autopilot's at the end of the rest")
    elif magnetic is not None:
        source, yaw, heading_sigma = "magnetometer", magnetic, healthy.UNDECLINED_HEADING_RAD
        notes.append("the magnetic declination is not known: the heading is magnetic")
    apart = None
    if magnetic is not None and yaw_reference is not None:
        apart = float(wrapped(np.array(magnetic - yaw_reference)))
    q, bias = quaternion.from_euler(roll, pitch, float(yaw)), f * (1.0 - gravity / float(np.linalg.norm(f)))
    known = magnetic, apart, flight.declination
    aligned = Alignment(rest, q, source, tilt_sigma, heading_sigma, bias, *known, later=(), notes=())
    later, cut = _later(aligned, comparison, imu, autopilot)
    return replace(aligned, later=later, notes=(*notes, *cut))


def _heading_from(q: Array, level: Array) -> float:
    """rad, about down, that turns an attitude of heading zero (4,) as near as can be to another (4,).

    Of a nose that points up the yaw angles of the two, with their rolls, may be any and mean nothing beside each other.
    """
    turn = quaternion.multiply(q, quaternion.conjugate(level))
    return float(2.0 * np.arctan2(turn[3], turn[0]))


def _magnetic_heading(flight: Flight, rest: Rest, level: Array) -> float | None:
    """rad, tilt-compensated; None without a magnetometer at rest."""
    field = flight.series.get("magnetometer")
    if field is None:
        return None
    values = field.values[within(field.t, (rest.start_s, rest.end_s))]
    values = values[np.isfinite(values).all(axis=1)]
    if not len(values) or not values.any():
        return None
    north, east, _ = quaternion.rotate(level, values.mean(axis=0))
    return float(np.arctan2(-east, north))


def _later(
    aligned: Alignment, comparison: Comparison, imu: ImuSpec, autopilot: ReferenceSpec
) -> tuple[tuple[Later, ...], list[str]]:
    track, start = aligned.freed(comparison.track), aligned.rest.last
    path = comparison.how.preintegrate(track)
    last, notes = len(track) - 1, []
    gaps = np.flatnonzero(comparison.gaps[start:])
    if len(gaps):
        last = start + int(gaps[0])
        notes.append(f"reckoned to {track.t[last]:.1f} s: the IMU has a gap there")
    known = np.flatnonzero(comparison.reference.attitude_known[: last + 1])
    if not len(known) or known[-1] <= start or len(track) < 2:
        return (), notes
    last = int(known[-1])
    times = track.t[start] + np.array(num.ALIGNED_LATER_S)
    index = nearest(track.t, times[times < track.t[last]])
    index = np.unique(np.append(index[comparison.reference.attitude_known[index]], last))
    index = index[index > start]
    begin = np.full(len(index), start)
    q0 = np.tile(aligned.q_ned_frd, (len(index), 1))
    zero = np.zeros((len(index), 3))
    q, _, _ = path.carry(begin, index, q0, zero, zero)
    error = attitude_error(comparison.reference.at(index).q_ned_frd, q)
    # an hour in one piece takes 400 MB: each goes on from the one before it
    steps = np.union1d(index, np.arange(start + num.SAMPLES_AT_ONCE, last, num.SAMPLES_AT_ONCE))
    sums = error_sums(track, path, np.full(len(steps), start), steps)[steps.searchsorted(index)]
    growth = propagate(track, path, begin, index, q0, zero, gravity=comparison.how.gravity, sums=sums)
    covariance = _covariance(aligned, comparison.track, growth, imu, autopilot)
    paths = (comparison.path, comparison.coarse(begin, index))
    ends = [p.carry(begin, index, q0, zero, zero)[0] for p in paths]
    sampling = attitude_error(ends[0], ends[1])  # of the other middle sample: an embedded pair
    covariance = covariance + sampling[:, :, None] * sampling[:, None, :]
    between = comparison.reference.interpolation_error(index, comparison.path).attitude
    covariance = covariance + between[:, None, None] ** 2 * np.eye(3)
    spread = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    since, off = track.t[index] - track.t[start], (length(error[:, :2]), np.abs(error[:, 2]))
    expected = np.hypot(spread[:, 0], spread[:, 1]), spread[:, 2]
    rows = np.column_stack([since, *map(np.degrees, (*off, *expected))])
    return tuple(Later(*row) for row in rows.tolist()), notes


def _covariance(
    aligned: Alignment, track: ImuTrack, growth: Propagation, imu: ImuSpec, autopilot: ReferenceSpec
) -> Array:
    """(E, 3, 3) rad², of the attitude's error at the ends, the autopilot's own included."""
    bias, gyro = growth.transition[:, :3, 9:12], growth.gyro_matrix[:, :3]
    # the rest shows the bias, less what its steps hide; in flight the steps take something else
    steps = persistent_step_error(track.gyro, track.gyro_step)
    bias = bias * np.sqrt(aligned.rest.gyro_sigma**2 + steps**2 + num.EARTH_RATE_RPS**2)
    scale = gyro[:, :, np.arange(3), np.arange(3)] * imu.gyro.scale
    turned = turn_jacobian(growth)[:, :3] * autopilot.misalignment
    late = growth.time_offset[:, :3, None] * autopilot.time_offset
    density = max(imu.gyro.noise_density, aligned.rest.gyro_noise or 0.0)
    constant = [np.square([aligned.tilt_sigma] * 2 + [aligned.heading_sigma])]
    constant += [np.square([autopilot.tilt] * 2 + [autopilot.heading]), np.full(3, autopilot.attitude_noise**2)]
    total = np.diag(np.sum(constant, axis=0)) + density**2 * growth.noise["gyro_noise"][:, :3, :3]
    total = total + imu.gyro.bias_walk**2 * growth.noise["gyro_walk"][:, :3, :3]
    for jacobian in (bias, scale, turned, late):
        total = total + jacobian @ jacobian.swapaxes(1, 2)
    return np.asarray(total)
