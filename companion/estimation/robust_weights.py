"""Redescending weights of readings, and of process noise, that their own neighbours contradict (P. J. Huber 1981)."""

from __future__ import annotations

import numpy as np

from companion.constants import num
from companion.estimation.linearisation import Linear
from companion.estimation.model import ATTITUDE, VELOCITY
from companion.estimation.spectrum import neighbourhoods
from companion.estimation.system import measurement_residual
from companion.model import Array


def outlier_weights(linear: Linear) -> dict[str, Array]:
    """Weights of readings that their own neighbours contradict: they count linearly, not by their square.

    Readings that are off together keep their weight: whether it is they that are wrong is for the hypotheses to say.
    """
    return {
        one.name: _beside_neighbours(measurement_residual(one, linear.solution) / one.sigma)
        for one in linear.measurements
        if len(one.t) > num.HUBER_SPAN
    }


def shocks(linear: Linear) -> Array:
    """(K-1, 2) times by which the noise of gyro and accelerometer is larger in intervals that their neighbours
    contradict: a touch of the ground, a clipped or an aliased manoeuvre. What lasts, as a bias does, is none.
    """
    e, d = linear.solution.disturbances
    out = np.ones((len(e), 2))
    if len(e) <= num.HUBER_SPAN:
        return out
    for column, block in enumerate((ATTITUDE, VELOCITY)):
        known = np.diagonal(d, axis1=1, axis2=2)[:, block]
        sigma = np.sqrt(np.where(known > 0.0, known, np.inf))
        out[:, column] = _beside_neighbours(e[:, block] / sigma) ** -0.5
    return out


def _beside_neighbours(values: Array) -> Array:
    """(M,) weights of normalised values (M, d): 1 where they are near the median of those around them."""
    half = num.HUBER_SPAN // 2
    typical = np.partition(neighbourhoods(values, num.HUBER_SPAN), half, axis=-1)[..., half]
    size = np.abs(values - typical).max(axis=1)
    return np.asarray(np.minimum(1.0, num.HUBER / np.maximum(size, 1e-9)) ** 2)
