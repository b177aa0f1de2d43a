"""What is fixed while the smoother iterates: keyframes, the readings that stand at them, and the first guess."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from companion.constants import check, healthy, num, priors
from companion.estimation.aiding_sensors import FIXED, RECEIVER_MOTION, SENSORS, SLOW
from companion.estimation.differences import Differences, in_blocks, weighed
from companion.estimation.earth_field import EarthField, field_at
from companion.estimation.model import CONSTANT_STATES, CONSTANTS, STATES, States
from companion.estimation.readings import Intake, Readings, receiver_of
from companion.model import (
    Array,
    BoolArray,
    Flight,
    GpsTrack,
    ImuTrack,
    IntArray,
    NoEstimateError,
    Origin,
    counted,
    interpolated,
    longest_step,
    nearest,
)
from companion.noise import (
    Aliased,
    aliasing,
    broken_intervals,
    lost_by_clipping,
    lost_in_gaps,
    relative_scatter,
    restored,
    scatter_between_samples,
    spectral_noise,
    undelayed,
)
from companion.strapdown import preintegrate, quaternion

Span = tuple[float, float]  # s, boot clock


@dataclass(frozen=True, slots=True, eq=False)
class Setup:
    """The problem: everything but the states."""

    imu: ImuTrack  # at the times that it speaks of, as before its low-pass
    index: IntArray  # (K,) samples at which keyframes stand
    t: Array  # (K,) s
    broken: BoolArray  # (K-1,) whether the IMU has a gap between two keyframes
    switched: BoolArray  # (K-1,) whether the readings are those of another IMU from then on
    readings: tuple[Readings, ...]
    origin: Origin | None
    gravity: float
    constants: Array  # (C,) prior means
    constants_sigma: Array  # (C,)
    spectral_noise: tuple[float, float]  # rad/s/√Hz, m/s²/√Hz: priors by spectra; see `healthy.GYRO_SHARE`
    scatter: tuple[float, float]  # the same of their noisiest axes, by second differences
    aliased: Mapping[str, Aliased]  # kind → what motion faster than the sampling may read like
    notes: tuple[str, ...]
    slow: Mapping[str, slice]  # aiding sensor → place of its slow error among the states of a keyframe
    relative_noise: Array  # (K-1, 2) gyro's and accelerometer's in each interval, in times its median in the flight
    others: tuple[Differences, ...]  # what the other IMUs read more
    shock_rate: Array  # (K-1, 2) of gyro and accelerometer in each interval, in times that of the hypothesis
    bias_sigma: Array = field(default_factory=lambda: np.repeat(healthy.BIAS_SIGMA, 3))  # (6,) gyro, accelerometer


def set_up(
    flight: Flight,
    imu: str | None,
    gravity: float,
    span: Span | None,
    untrusted: Sequence[Span] = (),
    keyframes: int = num.KEYFRAMES,
) -> Setup:
    """The problem of a flight. Raises NoEstimateError where its IMU cannot carry one.

    untrusted: stretches (s) in which the IMU's readings are none: stuck, frozen, at the end of the range.
    keyframes: about so many, as far as they may lie apart.
    """
    track = undelayed(flight.imu(imu))
    if span is not None:
        first, last = np.searchsorted(track.t, span)
        track = track[int(first) : int(last)]
    if len(track) < num.MIN_SAMPLES or track.rate_hz < num.MIN_RATE_HZ:
        raise NoEstimateError(
            track.source,
            f"it has {counted(len(track), 'sample')} at {track.rate_hz:.1f} Hz, and {num.MIN_SAMPLES} at "
            f"{num.MIN_RATE_HZ:g} Hz or more are needed",
            f"{flight.how_to_record}.",
        )
    if (median_g := float(np.median(np.linalg.norm(track.accel, axis=1))) / gravity) > healthy.MAX_MEDIAN_G:
        why = f"its accelerometer reads {median_g:.3g} g most of the time, of other units it seems"
        raise NoEstimateError(track.source, why, "Try another IMU: --imu.")
    gps = receiver_of(flight, track.t)
    lasts = float(track.t[-1] - track.t[0])
    spacing = float(np.clip(lasts / keyframes, *num.KEYFRAME_SPACING_S))
    spacing = max(spacing, lasts / num.MAX_KEYFRAMES, 1.5 / track.rate_hz)
    index = _keyframes(track, gps.t[gps.fix_type >= 3] - healthy.GPS_LATENCY_S if gps is not None else None, spacing)
    t = track.t[index]
    notes: list[str] = []
    origin = _origin(flight, gps)
    readings = _readings(Intake(flight, track, t, spacing, gps, origin, notes))
    constants = _constants(field_at(origin, flight.epoch), readings)
    longest = longest_step(track.t)
    broken = broken_intervals(flight, track, index, longest, untrusted)
    if broken.any():
        notes.append(f"{int(broken.sum())} gaps in {track.source}: the estimate begins anew after each")
    noise, aliased = spectral_noise(track, longest), aliasing(track, index, longest)
    scattering = relative_scatter(track, t, longest)
    gyro, accel = (scatter_between_samples(read, track.rate_hz) for read in (track.gyro, track.accel))
    scattering[:, 1] = np.hypot(scattering[:, 1], lost_by_clipping(flight, track, t, accel))
    scattering = np.hypot(scattering, lost_in_gaps(track, t, longest, (gyro, accel)))
    others = weighed(in_blocks(flight, flight.imu(imu), (float(track.t[0]), float(track.t[-1])), untrusted))
    shock_rate = _shock_rate(track, index, scattering)
    track = restored(track, np.diff(track.t) > longest)
    switched = np.diff(track.instance_at(t)) != 0
    return Setup(track, index, t, broken, switched, tuple(readings), origin, gravity, *constants, noise, (gyro, accel),
                 aliased, tuple(notes), _slow_places(readings), scattering, others, shock_rate)  # fmt: skip


def _shock_rate(track: ImuTrack, index: IntArray, scattering: Array) -> Array:
    """(K-1, 2) how often each sensor misses a motion between samples (K,), in times the rate.

    Where it stands at the largest or smallest that it reads in the flight, as at the end of a range, or is shaken:
    seldom where it does neither.
    """
    out = np.empty_like(scattering)
    for column, readings in enumerate((track.gyro, track.accel)):
        at_end = (readings == readings.max(axis=0)) | (readings == readings.min(axis=0))
        stands = (at_end[1:] & at_end[:-1]).any(axis=1)
        striking = np.logical_or.reduceat(np.append(stands, False), index[:-1])
        striking |= scattering[:, column] >= check.STRIKING_SCATTER
        out[:, column] = np.where(striking, 1.0, priors.CALM_SHOCK_RATE)
    return out


def _keyframes(track: ImuTrack, epochs: Array | None, spacing: float) -> IntArray:
    """Samples at the times of GPS fixes, thinned to the spacing and filled where there are none for longer."""
    if epochs is None or not len(epochs):
        times = _between(track.t, track.t[0], track.t[-1], max(spacing, num.NO_GPS_SPACING_S))
    else:
        inside = epochs[(epochs >= track.t[0]) & (epochs <= track.t[-1])]
        slot = np.floor((inside - inside[:1]) / spacing + 0.5)  # of the fixes' own phase: two may not share one
        thinned = inside[np.diff(slot, prepend=-1.0) > 0]
        ends = np.concatenate([[track.t[0]], thinned, [track.t[-1]]])
        longest = max(2.5 * spacing, 0.5)
        fill = [_between(track.t, a, b, (b - a) / (np.floor((b - a) / longest) + 1.0))
                for a, b in pairwise(ends.tolist()) if b - a > longest]  # fmt: skip
        times = np.sort(np.concatenate([ends, *fill]))
    index = np.unique(np.concatenate([[0], nearest(track.t, times), [len(track) - 1]]))
    close = np.diff(track.t[index], prepend=-np.inf) < 0.4 * spacing
    close[-1] = False
    return np.asarray(index[~close], dtype=np.intp)


def _origin(flight: Flight, gps: GpsTrack | None) -> Origin | None:
    """The zero of the position: the flight's own where it states one, else the first fix."""
    if gps is None:
        return flight.origin
    fixed = np.flatnonzero((gps.fix_type >= 3) & np.isfinite(gps.latitude) & np.isfinite(gps.height))
    if flight.origin is not None and flight.origin.t is None:
        return flight.origin
    if not len(fixed):
        return None
    i = int(fixed[0])
    return Origin(float(gps.latitude[i]), float(gps.longitude[i]), float(gps.height[i]), float(gps.t[i]))


def _readings(intake: Intake) -> list[Readings]:
    """Those of every sensor that the flight has, in the order of the rows."""
    taken = {name: row.read(row, intake) for name, row in SENSORS.items() if row.read is not None}
    readings = [one for name, one in taken.items() if one is not None and len(one.t) > (SENSORS[name].device != "rest")]
    if not any(SENSORS[one.name].device == "gps" for one in readings):
        gps = intake.flight.gps
        why = f"none of the {len(gps)} has {num.MIN_FIXES} fixes in the IMU's time: " if gps else ""
        known = "attitude only, from gravity and compass; position and velocity are not known"
        intake.notes.append(f"no GPS: {why}{known}")
        every = np.arange(len(intake.t), dtype=np.intp)
        readings.insert(0, SENSORS["calm"].at(intake.t, every, np.zeros((len(every), 3))))
    return readings


def _slow_places(readings: Sequence[Readings]) -> dict[str, slice]:
    """Aiding sensor → place of its slow error among the states of a keyframe, behind those of the motion."""
    places, at = dict[str, slice](), STATES
    for one in readings:
        if one.name in SLOW:
            places[one.name] = slice(at, at + one.value.shape[1])
            at = places[one.name].stop
    for name, (velocity, position, _) in RECEIVER_MOTION.items():
        if velocity in places and position in places:
            places[name] = slice(at, at + places[position].stop - places[position].start)
            at = places[name].stop
    return places


def _constants(earth: EarthField | None, readings: list[Readings]) -> tuple[Array, Array]:
    mean, sigma = np.zeros(CONSTANT_STATES), np.empty(CONSTANT_STATES)
    for place, width in CONSTANTS.values():
        sigma[place] = width
    mean[CONSTANTS["gps_latency"][0]] = healthy.GPS_LATENCY_S
    field = CONSTANTS["earth_field"][0]
    if earth is not None:
        mean[field], sigma[field] = earth.ned * num.MICROTESLA, earth.sigma * num.MICROTESLA
    else:
        size = [float(np.median(np.linalg.norm(one.value, axis=1))) for one in readings if one.name == "compass"]
        # the dip is not known, nor on which half of the Earth it is: only that north is magnetic north
        mean[field], sigma[field] = np.array([0.5, 0.0, 0.6]) * (size[0] if size else 50.0), [20.0, 8.0, 40.0]
    for one in readings:
        if SENSORS[one.name].offset:
            mean[CONSTANTS[f"{one.name}_offset"][0]] = one.value[0, 0]
    return mean, sigma


def first_guess(setup: Setup, flight: Flight) -> States:
    """Where the iteration begins: the autopilot's attitude where there is one, else gravity and compass."""
    count, attitude = len(setup.t), flight.attitude
    if attitude is not None and len(attitude) > 1:
        i = np.clip(np.searchsorted(attitude.t, setup.t, side="right") - 1, 0, len(attitude) - 2)
        u = np.clip((setup.t - attitude.t[i]) / (attitude.t[i + 1] - attitude.t[i]), 0.0, 1.0)
        q = quaternion.slerp(attitude.q_ned_frd[i], attitude.q_ned_frd[i + 1], u)
    else:
        q = _triad(setup)
    position, velocity = np.zeros((count, 3)), np.zeros((count, 3))
    for one in setup.readings:
        if one.name in FIXED:
            observed, axes = FIXED[one.name]
            (position if observed == "position" else velocity)[:, axes] = interpolated(setup.t, one.t, one.value)
    return States(q, velocity, position, np.zeros((count, 3)), np.zeros((count, 3)), setup.constants.copy(),
                  np.zeros((count, sum(p.stop - p.start for p in setup.slow.values()))))  # fmt: skip


def guesses(setup: Setup, flight: Flight) -> Iterator[States]:
    """Where the iteration may begin, made as they are asked for: with the autopilot's attitude, at last without it.

    By gravity and compass alone, where there is one: an estimator that is far off leads to nowhere.
    """
    yield first_guess(setup, flight)
    if flight.attitude is not None and any(one.name == "compass" for one in setup.readings):
        yield first_guess(setup, replace(flight, attitude=None))


def _triad(setup: Setup) -> Array:
    """Attitudes (K, 4) from two directions, specific force and magnetic field (TRIAD; Black 1964).

    Both are means over some seconds of what the IMU reads, carried to one frame by the gyro; the force's in NED is what
    GPS says of the acceleration, less gravity. Heading zero at first without a compass.
    """
    track, index = setup.imu, setup.index
    q = preintegrate(track).q
    force = _sums_around(setup.t, track.t, quaternion.rotate(q, track.accel))
    low, high = np.maximum(setup.t - num.GUESS_S, setup.t[0]), np.minimum(setup.t + num.GUESS_S, setup.t[-1])
    force_ned = np.tile([0.0, 0.0, -setup.gravity], (len(index), 1))
    field, field_ned = np.array([[1.0, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]])
    for one in setup.readings:
        observed, axes = FIXED.get(one.name, ("", slice(0)))
        if observed == "velocity":
            gained = interpolated(high, one.t, one.value) - interpolated(low, one.t, one.value)
            force_ned[:, axes] += gained / (high - low)[:, None]
        if one.name == "compass":
            carried = quaternion.rotate(q[nearest(track.t, one.t)], one.value)
            total = _sums_around(setup.t, one.t, carried)
            read = total.any(axis=1, keepdims=True)
            field = np.where(read, total, interpolated(setup.t, one.t, carried))
            field_ned = setup.constants[CONSTANTS["earth_field"][0]][None]
    axes, axes_ned = _axes(force, field), _axes(force_ned, field_ned)
    start = quaternion.from_matrix(axes_ned @ axes.swapaxes(1, 2))
    return quaternion.multiply(start, q[index])


def _sums_around(at: Array, t: Array, values: Array) -> Array:
    """(K, 3) sums of values (N, 3) at times t (N,) not further than `num.GUESS_S` from each of at (K,), s."""
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(values, axis=0)])
    first, last = (np.searchsorted(t, at + apart) for apart in (-num.GUESS_S, num.GUESS_S))
    return np.asarray(total[last] - total[first])


def _axes(force: Array, field: Array) -> Array:
    """(K, 3, 3) whose columns are against the force, east of it by the field, and what makes it right-handed."""
    down = _unit(-force, otherwise=2)
    east = _unit(np.cross(down, np.broadcast_to(field, down.shape)), otherwise=1)
    return np.stack([np.cross(east, down), east, down], axis=2)


def _unit(vectors: Array, otherwise: int) -> Array:
    """Vectors (K, 3) of length one, and for those that have no direction that axis."""
    size = np.linalg.norm(vectors, axis=1)[:, None]
    return np.where(size > 0, vectors / np.where(size > 0, size, 1.0), np.eye(3)[otherwise])


def _between(t: Array, begin: float, end: float, step: float) -> Array:
    """Steps from `begin` to `end` that have a sample nearby: a gap of years takes no memory."""
    inside = t[np.searchsorted(t, begin) : np.searchsorted(t, end)]
    steps = np.unique(np.floor((inside - begin) / step + 0.5))
    times = begin + steps * step
    return np.asarray(times[times < end])
