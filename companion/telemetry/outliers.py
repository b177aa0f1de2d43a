"""Single samples that those around them contradict: damage, left out and counted, and never what a sensor can read."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from companion.model import Array

BoolArray = npt.NDArray[np.bool_]

_ASTRAY, _ASTRAY_TIMES = 10.0, 10.0  # m or m/s


def finite_rows(*columns: Array) -> BoolArray:
    """Which rows of arrays, each (N, k), are finite in all of them."""
    good = np.ones(len(columns[0]), np.bool_)
    for one in columns:
        if not np.isfinite(one).all():  # row by row takes ten times as long
            good &= np.isfinite(one).all(axis=1)
    return good


def lone(places: Array) -> BoolArray:
    """Which of (N, k) places, m or m/s, those before and after contradict: damage, for nothing jumps there and back.

    They agree with each other ten times better than with what lies between them.
    """
    off = np.zeros(len(places), np.bool_)
    bent = np.abs(places[1:-1] - 0.5 * (places[2:] + places[:-2])) > _ASTRAY / np.sqrt(places.shape[1])
    if not bent.any():  # as in most logs
        return off
    i = np.flatnonzero(bent.any(axis=1)) + 1
    apart = np.linalg.norm(places[i + 1] - places[i - 1], axis=1)
    astray = np.linalg.norm(places[i] - 0.5 * (places[i + 1] + places[i - 1]), axis=1)
    off[i] = astray > np.maximum(_ASTRAY, _ASTRAY_TIMES * apart)
    return off & ~np.roll(off, 1) & ~np.roll(off, -1)  # one alone: of several it is not known which are right


def uncontradicted(name: str, notes: list[str], *places: Array, what: str = "samples") -> BoolArray:
    """Which rows of places, each (N, k) in m or m/s, are not `lone`. What is left out is added to the notes."""
    astray = np.logical_or.reduce([lone(one) for one in places])
    if astray.any():
        notes.append(f"{name}: {astray.sum()} {what} left out that those before and after contradict")
    return np.asarray(~astray)
