"""From samples of any format to tracks: in order of time, of things that can be, and not contradicted by neighbours.

Also here: single samples that those around them contradict: damage, left out and counted, and never what a sensor can
read.

A shock or a spike of an IMU is a reading, however odd its neighbours find it: of an IMU only what no part can read is
left out. A place, a pressure, a field or an attitude that is elsewhere for one sample and back at once is damage where
it is further away than the vehicle can have gone in that time.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from companion.model import (
    STANDARD_GRAVITY,
    Array,
    AttitudeTrack,
    BiasTrack,
    BoolArray,
    ImuTrack,
    Origin,
    PositionTrack,
    SensorInUse,
    counted,
    interpolated,
    ned_from_geodetic,
)

Ranges = tuple[float | None, float | None]
"""Of a gyro, rad/s, and an accelerometer, m/s²; None where it is not known."""

FASTEST, STRONGEST = float(np.radians(4000.0)), 40.0 * STANDARD_GRAVITY
"""rad/s and m/s²: the most that any part reads (ICM-45686, ADIS16470)."""

_TURNED = 2.0  # times an axis' range, on an axis of the body: a diagonal of three axes is 1.7, and calibration scales
_ASTRAY_TIMES = 10.0  # nearer to each other than to what lies between them
PLACE = 10.0  # m or m/s
HEIGHT = 30.0  # m, by pressure: a gust of 25 m/s at an open sensor is as much
_TURN = float(np.radians(10.0))  # beside what the rates explain
_RATES_TIMES = 3.0  # between two samples a vehicle may turn faster than at both of them


def finite_rows(*columns: Array) -> BoolArray:
    """Which rows of arrays, each (N, k), are finite in all of them."""
    good = np.ones(len(columns[0]), np.bool_)
    for one in columns:
        if not np.isfinite(one).all():  # row by row takes ten times as long
            good &= np.isfinite(one).all(axis=1)
    return good


def not_zero(gyro: Array, accel: Array) -> BoolArray:
    """Which samples of an IMU, (N, 3) each, are not zero throughout: a driver that has no reading gives zeros."""
    return np.asarray(gyro.any(axis=1) | accel.any(axis=1))


def readable(gyro: Array, accel: Array, ranges: Ranges = (None, None)) -> BoolArray:
    """Which readings of an IMU, (N, 3) rad/s and m/s² in the body frame, a part of these ranges can give."""
    good = np.ones(len(gyro), np.bool_)
    for values, known, most in ((gyro, ranges[0], FASTEST), (accel, ranges[1], STRONGEST)):
        limit = _TURNED * (known or most)
        if len(values) and not (values.max() <= limit and values.min() >= -limit):  # NaN is not either
            good &= (np.abs(values) <= limit).all(axis=1)
    return good


def lone(places: Array, least: float | Array = PLACE) -> BoolArray:
    """Which of (N, k) places those before and after contradict, which agree ten times better with each other.

    least: the distance from them, that is no damage yet; one, or one for each sample (N,). For places and velocities
    m or m/s.
    """
    off = np.zeros(len(places), np.bool_)
    nearest = np.min(least, initial=np.inf) / np.sqrt(places.shape[1])
    bent = np.abs(places[1:-1] - 0.5 * (places[2:] + places[:-2])) > nearest
    if not bent.any():  # as in most logs
        return off
    i = np.flatnonzero(bent.any(axis=1)) + 1
    before, after = places[i - 1], places[i + 1]
    astray = _norm(places[i] - 0.5 * (before + after))
    off[i] = astray > np.maximum(np.broadcast_to(least, len(places))[i], _ASTRAY_TIMES * _norm(after - before))
    return _single(off)


def lone_fields(t: Array, field: Array) -> BoolArray:
    """Which of a compass' readings (N, 3) at times t (N,) s are further off than the fastest turn between samples.

    Motors may add as much again as the Earth's field is; the readings are in any unit.
    """
    strength = float(np.median(np.linalg.norm(field, axis=1))) if len(field) else 0.0
    turn = np.minimum(FASTEST * _around(t), np.pi)
    return lone(field, strength * (1.0 + 2.0 * np.sin(0.5 * turn)))


def lone_turns(t: Array, q: Array, rates: Array | None) -> BoolArray:
    """Which attitudes (N, 4) turn away for one sample and back, by more than the rates (N, 3) rad/s there explain.

    q: of unit length, either sign; t: (N,) s; rates: the autopilot's own, None where it tells none.
    """
    off = np.zeros(len(t), np.bool_)
    far = np.abs(np.einsum("ij,ij->i", q[1:], q[:-1])) < np.cos(0.5 * _TURN)
    far = far[1:] & far[:-1]
    if not far.any():  # as in most logs
        return off
    back = np.abs(np.einsum("ij,ij->i", q[2:], q[:-2])) > np.cos(0.5 * np.pi / _ASTRAY_TIMES)
    i = np.flatnonzero(far & back) + 1
    away = np.minimum(_angle(q[i], q[i - 1]), _angle(q[i], q[i + 1]))
    rate = np.full(len(i), FASTEST)
    if rates is not None and rates.any():
        rate = _RATES_TIMES * np.max([_norm(rates[i + k]) for k in (-1, 0, 1)], axis=0)
    explained = _TURN + rate * _around(t)[i]
    off[i] = away > np.maximum(explained, _ASTRAY_TIMES * _angle(q[i - 1], q[i + 1]))
    return _single(off)


def uncontradicted(name: str, notes: list[str], *astray: BoolArray, what: str = "sample") -> BoolArray:
    """Which of N samples are astray in none of the ways, each (N,). What is left out is added to the notes."""
    off = np.logical_or.reduce(astray)
    if off.any():
        notes.append(f"{name}: {counted(int(off.sum()), what)} left out that those before and after contradict")
    return np.asarray(~off)


def _single(off: BoolArray) -> BoolArray:
    """Those alone: of several beside each other it is not known which are right."""
    return off & ~np.roll(off, 1) & ~np.roll(off, -1) if off.any() else off


def _norm(vectors: Array) -> Array:
    """(N,) the lengths of (N, k)."""
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))


def _around(t: Array) -> Array:
    """(N,) s: the longer of the steps before and after each sample; nothing is said of the first and last."""
    step = np.diff(t, prepend=np.nan, append=np.nan)
    return np.asarray(np.fmax(step[1:], step[:-1]))


def _angle(a: Array, b: Array) -> Array:
    """(N,) rad between attitudes (N, 4)."""
    return np.asarray(2.0 * np.arccos(np.minimum(np.abs(np.einsum("ij,ij->i", a, b)), 1.0)))


Index = npt.NDArray[np.int64] | slice

_UNIT = 0.1  # by which a quaternion's length may differ from one


def increasing(t: Array, good: BoolArray) -> Index:
    """The good samples in order of device time, the first of those that share one: echoes fall out.

    Indices, or where nothing is to be done a slice, so that nothing is copied.
    """
    if good.all() and (t[1:] > t[:-1]).all():
        return slice(None)
    index = np.flatnonzero(good)
    order = index[np.argsort(t[index], kind="stable")]
    return order[np.diff(t[order], prepend=-np.inf) > 0]


def continuous(q: Array) -> Array:
    """Quaternions (N, 4) of about unit length, made so, with the sign that follows on: q and -q are one attitude."""
    q = q / _norm(q)[:, None]
    turned_over = np.einsum("ij,ij->i", q[1:], q[:-1]) < 0
    if turned_over.any():
        q[1:] *= np.where(np.cumsum(turned_over) % 2, -1.0, 1.0)[:, None]
    return np.asarray(q)


def attitudes(t: Array, q: Array, good: BoolArray | bool = True) -> tuple[Index, Array, Array]:
    """Which quaternions (N, 4) at times t (N,) are attitudes; their times, and they themselves, continuous."""
    keep = increasing(t, np.asarray(good & np.isfinite(t) & (np.abs(_norm(q) - 1.0) < _UNIT)))  # which no NaN is
    return keep, t[keep], continuous(q[keep])


def attitude_track(source: str, t: Array, q: Array, rates: Array | None, notes: list[str]) -> AttitudeTrack | None:
    """Of `attitudes`, without those that turn away and back in a way that the rates (N, 3) do not explain.

    None for fewer than two samples. rates: rad/s; where None, those between the attitudes.
    """
    kept = uncontradicted(source, notes, lone_turns(t, q, rates))
    if not kept.all():
        t, q, rates = t[kept], continuous(q[kept]), None if rates is None else rates[kept]
    if len(t) < 2:
        return None
    return AttitudeTrack(t, q, _turning(t, q) if rates is None else rates, source)


def _turning(t: Array, q: Array) -> Array:
    """Body rates (N, 3) between attitudes q (N, 4) of about unit length at times t (N,), interpolated to t."""
    a, b = q[:-1], q[1:]
    w = np.einsum("ij,ij->i", a, b)
    v = a[:, :1] * b[:, 1:] - b[:, :1] * a[:, 1:] - np.cross(a[:, 1:], b[:, 1:])
    size = np.linalg.norm(v, axis=1)
    angle = 2.0 * np.arctan2(size, np.abs(w)) * np.where(w < 0.0, -1.0, 1.0)
    rate = v * (angle / np.where(size > 0.0, size, 1.0) / np.diff(t))[:, None]
    return interpolated(t, 0.5 * (t[1:] + t[:-1]), rate)


def position_track(
    source: str, t: Array, position: Array, velocity: Array, good: BoolArray | bool, notes: list[str]
) -> PositionTrack | None:
    """NED (N, 3) m and m/s at times t (N,) s; None for fewer than two samples."""
    keep = increasing(t, np.asarray(good & np.isfinite(t) & finite_rows(position, velocity)))
    t, position, velocity = t[keep], position[keep], velocity[keep]
    kept = uncontradicted(source, notes, lone(position), lone(velocity))
    if not kept.all():
        t, position, velocity = t[kept], position[kept], velocity[kept]
    return PositionTrack(t, position, velocity, source) if len(t) > 1 else None


def imu_track(
    source: str,
    t: Array,
    gyro: Array,
    accel: Array,
    good: BoolArray,
    notes: list[str],
    ranges: Ranges | None = (None, None),
    interval: Array | None = None,
) -> ImuTrack:
    """The good readings (N, 3) rad/s and m/s² at times t (N,) s that a part of these ranges can give.

    What is left out is noted. ranges: None for readings of which the format holds no others. interval: (N,) s.
    """
    sensed = good & np.isfinite(t)
    if ranges is not None:
        sensed &= readable(gyro, accel, ranges)
    if odd := int(good.sum() - sensed.sum()):
        notes.append(f"{source}: {counted(odd, 'sample')} left out as no reading of an IMU")
    keep = increasing(t, sensed)
    own = None if interval is None else interval[keep]
    known = ranges or (None, None)
    return ImuTrack(t[keep], gyro[keep], accel[keep], source, interval=own, gyro_range=known[0], accel_range=known[1])


def bias_track(
    source: str, t: Array, columns: tuple[Array, ...], good: BoolArray, core: int, imu_instance: int | None
) -> BiasTrack:
    """The good estimates at times t (N,) s. columns: of gyro and accelerometer, and 1σ of both, (N, 3) each."""
    keep = increasing(t, good)
    gyro, accel, gyro_sigma, accel_sigma = (one[keep] for one in columns)
    return BiasTrack(t[keep], gyro, accel, gyro_sigma, accel_sigma, source, core, imu_instance)


def in_use(source: str, t: Array, instance: npt.NDArray[np.int64], good: BoolArray | bool = True) -> SensorInUse | None:
    """The sensor that is used from each change on: its number (N,) at times t (N,) s; None where nothing is good."""
    keep = increasing(t, np.asarray(good & np.isfinite(t)))
    t, instance = t[keep], instance[keep]
    change = np.flatnonzero(np.diff(instance, prepend=-1))
    return SensorInUse(t[change], instance[change], source) if len(change) else None


def commonest(values: npt.NDArray[Any]) -> int:
    """The number that most of (N,) are; 0 of none."""
    numbers, counts = np.unique(values, return_counts=True)
    return int(numbers[np.argmax(counts)]) if len(numbers) else 0


def majority(*columns: npt.NDArray[Any]) -> BoolArray:
    """(N,) which rows are those that occur most."""
    _, which, counts = np.unique(np.column_stack(columns), axis=0, return_inverse=True, return_counts=True)
    return np.asarray(which.ravel() == np.argmax(counts))


def place(latitude: float, longitude: float, height: float, t: float | None = None) -> Origin:
    """Degrees and m, as logs have them."""
    return Origin(float(np.radians(latitude)), float(np.radians(longitude)), float(height), t)


def ned_about(origin: Origin, latitude: Array, longitude: Array, height: Array) -> Array:
    """NED (N, 3) m about an origin, of places (N,) in rad, rad and m."""
    return ned_from_geodetic(latitude, longitude, height, (origin.latitude, origin.longitude, origin.height))
