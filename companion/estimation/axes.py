"""Axes of an IMU that are mirrored or exchanged: which way to read it fits the other witnesses?

A smoother that is told a wrong axis takes what contradicts it for noise, far more than the readings themselves scatter
by. Then the IMU is read in other ways, and the one that needs the least noise is the one that is true.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.estimation.model import BestEstimate, ProcessNoise
from companion.estimation.setup import first_guess, set_up
from companion.estimation.smoother import estimate, start_of
from companion.model import STANDARD_GRAVITY, Array, DataError, Flight

_BEYOND = 1.5  # times what the readings scatter by: more is learned of no sensor whose axes are right
_CLEARLY = 2.0  # times less noise, in every interval and on every axis: chance has no part in it


@dataclass(frozen=True, slots=True)
class Reading:
    """Another way to read the IMU, and how much better it fits."""

    words: str
    fits: float  # how many times less noise it needs


def _mirrored(axis: int) -> Array:
    return np.diag(np.where(np.arange(3) == axis, -1.0, 1.0))


def _exchanged(axis: int) -> Array:
    return np.eye(3)[[[0, 2, 1], [2, 1, 0], [1, 0, 2]][axis]]


WAYS: Mapping[str, tuple[Array, Array]] = {
    **{f"gyro {name} is mirrored": (_mirrored(i), np.eye(3)) for i, name in enumerate("xyz")},
    **{f"accelerometer {name} is mirrored": (np.eye(3), _mirrored(i)) for i, name in enumerate("xyz")},
    **{f"axes {name} are exchanged": (_exchanged(i), _exchanged(i)) for i, name in enumerate(("y and z", "x and z",
                                                                                             "x and y"))},
}  # fmt: skip
"""In words → how the readings (gyro, accelerometer) have to be turned, (3, 3) each."""


def contradicted(best: BestEstimate) -> bool:
    """Whether far more noise was learned of gyro or accelerometer than their readings scatter by."""
    learned = (best.noise.gyro_noise, best.noise.accel_noise)
    return any(one > _BEYOND * scatter for one, scatter in zip(learned, best.scatter, strict=True))


def other_reading(
    flight: Flight,
    best: BestEstimate,
    *,
    gravity: float = STANDARD_GRAVITY,
    span: tuple[float, float] | None = None,
    untrusted: Sequence[tuple[float, float]] = (),
) -> Reading | None:
    """The way to read the IMU that fits far better than as it is; None where there is none.

    flight, gravity, span, untrusted: as the best estimate was made of, which has explained what it can by errors that
    come and go; the other way has to do without. Nothing is tried where nothing contradicts.
    """
    if not contradicted(best):
        return None

    def needed(turn: tuple[Array, Array]) -> float:
        track = flight.imu(best.imu.source)
        turned = replace(track, gyro=track.gyro @ turn[0].T, accel=track.accel @ turn[1].T)
        setup = set_up(
            replace(flight, imus={**flight.imus, track.source: turned}), track.source, gravity, span, untrusted
        )
        try:
            settled, _ = estimate(setup, start_of(setup, first_guess(setup, flight)))
        except (DataError, np.linalg.LinAlgError):
            return np.inf
        return _size(settled.noise)

    with np.errstate(over="ignore", invalid="ignore"):
        noise = {words: needed(turn) for words, turn in WAYS.items()}
    words = min(noise, key=lambda name: noise[name])
    fits = _size(best.noise) / noise[words]
    return Reading(words, fits) if fits > _CLEARLY else None


def _size(noise: ProcessNoise) -> float:
    """The geometric mean of what both sensors need."""
    return float(np.sqrt(noise.gyro_noise * noise.accel_noise))
