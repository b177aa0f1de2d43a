"""Single samples that those around them contradict: damage, left out and counted, and never what a sensor can read.

A shock or a spike of an IMU is a reading, however odd its neighbours find it: of an IMU only what no part can read is
left out. A place, a pressure, a field or an attitude that is elsewhere for one sample and back at once is damage where
it is further away than the vehicle can have gone in that time.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from companion.model import STANDARD_GRAVITY, Array, counted

BoolArray = npt.NDArray[np.bool_]
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
