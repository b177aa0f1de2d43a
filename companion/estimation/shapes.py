"""How what may be wrong comes and goes: steps, pulses, ramps, creeps (ramps to their end) and shocks."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from companion.model import Array

SLOPED = ("ramp", "creep")
"""Shapes whose size is per second."""

ENDING = ("pulse", "creep")
"""Shapes that have an end as well as an onset."""

INTEGRAL: Mapping[str, str] = {"step": "ramp", "pulse": "creep"}
"""Shape → that of its integral."""


def activation(shape: str, onset: Array, end: Array, start: Array, stop: Array) -> Array:
    """(T, F) how far an explanation from `onset` to `end` (T,) is at work between start and stop (F,), on average.

    A step, pulse or shock is 0 or 1, a ramp has the time since its onset, s, a creep that to its
    end; at an instant start == stop.
    """
    a, b = start[None] - onset[:, None], stop[None] - onset[:, None]
    if shape == "shock":
        return ((a <= 0) & (b > 0)).astype(np.float64)
    if shape in SLOPED:
        most = (end - onset)[:, None]
        return 0.5 * (np.clip(a, 0.0, most) + np.clip(b, 0.0, most))
    share = _begun(a, b)
    ends = np.isfinite(end)
    if ends.any():
        share[ends] -= _begun(start[None] - end[ends, None], stop[None] - end[ends, None])
    return share


def _begun(a: Array, b: Array) -> Array:
    """The part of the time from a to b that lies after zero."""
    return np.where(b > a, np.clip(b / np.where(b > a, b - a, 1.0), 0.0, 1.0), (a >= 0).astype(np.float64))
