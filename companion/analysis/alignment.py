"""Initial alignment without the autopilot: where an IMU at rest points, and where it says it points later.

Roll and pitch are those that put the mean specific force upright, the gyro's bias is its mean reading, and the heading
comes from the magnetometer where its declination is known, else from the autopilot: gravity says nothing about it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from companion.analysis.budget import persistent_step_error, turn_jacobian
from companion.analysis.comparison import Comparison
from companion.analysis.imu_spec import ImuSpec, ReferenceSpec
from companion.analysis.reference import attitude_error, length
from companion.analysis.rest import Rest, rests, why_none
from companion.constants import healthy, num
from companion.model import Array, DataError, Flight, ImuTrack, nearest
from companion.strapdown import Propagation, preintegrate, propagate, quaternion


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
        raise DataError(
            f"vehicle {flight.vehicle}, boot {flight.boot}: no rest of three seconds to align {track.source} in: "
            f"{why_none(flight, track, imu)}. Use --anchor autopilot, or a log that begins before take-off."
        )
    rest = at_rest[0]
    notes: list[str] = []
    f = rest.accel
    roll, pitch = np.arctan2(-f[1], -f[2]), np.arctan2(f[0], np.hypot(f[1], f[2]))
    level = quaternion.from_euler(float(roll), float(pitch), 0.0)
    steps = persistent_step_error(track.accel[rest.first : rest.last + 1], track.accel_step)
    gravity = comparison.how.gravity
    tilt_sigma = float(np.hypot(imu.accel.residual_bias, steps[:2].max()) / gravity)
    magnetic = _magnetic_heading(flight, rest, level)
    yaw_reference = None
    if comparison.reference.attitude_known[rest.last]:
        yaw_reference = float(quaternion.to_euler(comparison.reference.q_ned_frd[rest.last])[2])
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
    aligned = Alignment(
        rest=rest,
        q_ned_frd=quaternion.from_euler(float(roll), float(pitch), float(yaw)),
        heading_from=source,
        tilt_sigma=tilt_sigma,
        heading_sigma=heading_sigma,
        accel_bias=f * (1.0 - gravity / float(np.linalg.norm(f))),
        magnetic_rad=magnetic,
        declination_rad=flight.declination,
        magnetic_error_rad=None
        if magnetic is None or yaw_reference is None
        else float((magnetic - yaw_reference + np.pi) % (2.0 * np.pi) - np.pi),
        later=(),
        notes=tuple(notes),
    )
    later, cut = _later(aligned, comparison, imu, autopilot)
    return replace(aligned, later=later, notes=(*aligned.notes, *cut))


def _magnetic_heading(flight: Flight, rest: Rest, level: Array) -> float | None:
    """rad, tilt-compensated; None without a magnetometer at rest."""
    field = flight.series.get("magnetometer")
    if field is None:
        return None
    values = field.values[(field.t >= rest.start_s) & (field.t <= rest.end_s)]
    values = values[np.isfinite(values).all(axis=1)]
    if not len(values) or not values.any():
        return None
    north, east, _ = quaternion.rotate(level, values.mean(axis=0))
    return float(np.arctan2(-east, north))


def _later(
    aligned: Alignment, comparison: Comparison, imu: ImuSpec, autopilot: ReferenceSpec
) -> tuple[tuple[Later, ...], list[str]]:
    track, start = aligned.freed(comparison.track), aligned.rest.last
    path = preintegrate(
        track, method=comparison.how.method, middle=comparison.how.middle, segments=comparison.how.segments
    )
    last, notes = len(track) - 1, []
    gaps = np.flatnonzero(comparison.gaps[start:])
    if len(gaps):
        last = start + int(gaps[0])
        notes.append(f"reckoned to {track.t[last]:.1f} s: the IMU has a gap there")
    known = np.flatnonzero(comparison.reference.attitude_known[: last + 1])
    if not len(known) or known[-1] <= start or len(track) < 2:
        return (), notes
    last = int(known[-1])
    wanted = track.t[start] + np.array(num.ALIGNED_LATER_S)
    index = nearest(track.t, wanted[wanted < track.t[last]])
    index = np.unique(np.append(index[comparison.reference.attitude_known[index]], last))
    index = index[index > start]
    begin = np.full(len(index), start)
    q0 = np.tile(aligned.q_ned_frd, (len(index), 1))
    zero = np.zeros((len(index), 3))
    q, _, _ = path.carry(begin, index, q0, zero, zero)
    error = attitude_error(comparison.reference.q_ned_frd[index], q)
    growth = propagate(track, path, begin, index, q0, zero, gravity=comparison.how.gravity)
    covariance = _covariance(aligned, comparison.track, growth, imu, autopilot)
    paths = (comparison.path, comparison.coarse(begin, index))
    ends = [p.carry(begin, index, q0, zero, zero)[0] for p in paths]
    sampling = attitude_error(ends[0], ends[1])  # of the other middle sample: an embedded pair
    covariance = covariance + sampling[:, :, None] * sampling[:, None, :]
    between = comparison.reference.interpolation_error(index, comparison.path).attitude
    covariance = covariance + between[:, None, None] ** 2 * np.eye(3)
    spread = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    rows = zip(
        (track.t[index] - track.t[start]).tolist(),
        np.degrees(length(error[:, :2])).tolist(),
        np.degrees(np.abs(error[:, 2])).tolist(),
        np.degrees(np.hypot(spread[:, 0], spread[:, 1])).tolist(),
        np.degrees(spread[:, 2]).tolist(),
        strict=True,
    )
    return tuple(Later(*row) for row in rows), notes


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
