"""From samples of any format to tracks: in order of time, of things that can be, and not contradicted by neighbours."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from companion.model import (
    Array,
    AttitudeTrack,
    ImuTrack,
    Origin,
    PositionTrack,
    SensorInUse,
    counted,
    interpolated,
    ned_from_geodetic,
)
from companion.telemetry.outliers import BoolArray, Ranges, finite_rows, lone, lone_turns, readable, uncontradicted

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
    q = q / np.sqrt(np.einsum("ij,ij->i", q, q))[:, None]
    turned_over = np.einsum("ij,ij->i", q[1:], q[:-1]) < 0
    if turned_over.any():
        q[1:] *= np.where(np.cumsum(turned_over) % 2, -1.0, 1.0)[:, None]
    return np.asarray(q)


def attitudes(t: Array, q: Array, good: BoolArray | bool = True) -> tuple[Index, Array, Array]:
    """Which quaternions (N, 4) at times t (N,) are attitudes; their times, and they themselves, continuous."""
    length = np.sqrt(np.einsum("ij,ij->i", q, q))
    keep = increasing(t, np.asarray(good & np.isfinite(t) & (np.abs(length - 1.0) < _UNIT)))  # which no NaN is
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


def in_use(source: str, t: Array, instance: npt.NDArray[np.int64], good: BoolArray | bool = True) -> SensorInUse | None:
    """The sensor that is used from each change on: its number (N,) at times t (N,) s; None where nothing is good."""
    keep = increasing(t, np.asarray(good & np.isfinite(t)))
    t, instance = t[keep], instance[keep]
    change = np.flatnonzero(np.diff(instance, prepend=-1))
    return SensorInUse(t[change], instance[change], source) if len(change) else None


def commonest(values: npt.NDArray[Any], otherwise: int = 0) -> int:
    """The number that most of (N,) are."""
    numbers, counts = np.unique(values, return_counts=True)
    return int(numbers[np.argmax(counts)]) if len(numbers) else otherwise


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
