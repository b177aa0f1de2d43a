"""Autopilot minus best estimate: how far the autopilot's own estimate was off, as the other sensors have it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.analysis.navigation_error import attitude_error, length
from companion.analysis.reference import Limits, reference_at
from companion.estimation import ATTITUDE, POSITION, VELOCITY, BestEstimate
from companion.model import Array, Flight

_BEGIN = 0.1  # of the flight: where both positions begin


@dataclass(frozen=True, slots=True)
class AutopilotError:
    """One quantity: size of the difference over the flight, and how well the best estimate knows it."""

    quantity: str  # "tilt", "heading", "velocity", "position"
    unit: str  # "rad", "m/s", "m"
    samples: int
    median: float
    p95: float
    worst: float
    worst_s: float  # s, boot clock, of the worst
    sigma: float  # 1σ of the best estimate at that time
    typical_sigma: float  # its median


def autopilot_error(
    flight: Flight,
    best: BestEstimate,
    limits: Limits = Limits(),  # noqa: B008  (frozen)
) -> tuple[AutopilotError, ...]:
    """The autopilot's estimate less the best estimate, at the keyframes at which the autopilot tells its state.

    Velocity and position need a GPS. Positions are compared from where both begin: their zeros need not be one place.
    Empty where the flight has no estimate of the autopilot's.
    """
    if flight.attitude is None or len(flight.attitude) < 2:
        return ()
    reference = reference_at(flight.attitude, flight.position, best.t, limits)
    turned = attitude_error(reference.q_ned_frd, best.q_ned_frd)
    tilt, heading, velocity, position = (
        best.sigma(ATTITUDE)[:, :2], best.sigma(ATTITUDE)[:, 2:], best.sigma(VELOCITY), best.sigma(POSITION)
    )  # fmt: skip
    rows = [
        ("tilt", "rad", length(turned[:, :2]), tilt, reference.attitude_known),
        ("heading", "rad", np.abs(turned[:, 2]), heading, reference.attitude_known),
    ]
    known = reference.position_known
    if "gps_position" in best.residuals and known.any():
        moved = reference.position - best.position
        begin = np.flatnonzero(known)[: max(5, int(_BEGIN * known.sum()))]
        rows.append(("velocity", "m/s", length(reference.velocity - best.velocity), velocity, known))
        rows.append(("position", "m", length(moved - np.median(moved[begin], axis=0)), position, known))
    return tuple(
        _summary(name, unit, best.t[known], size[known], length(sigma[known]))
        for name, unit, size, sigma, known in rows
        if known.any()
    )


def _summary(name: str, unit: str, t: Array, size: Array, sigma: Array) -> AutopilotError:
    worst = int(np.argmax(size))
    return AutopilotError(
        quantity=name,
        unit=unit,
        samples=len(size),
        median=float(np.median(size)),
        p95=float(np.percentile(size, 95.0)),
        worst=float(size[worst]),
        worst_s=float(t[worst]),
        sigma=float(sigma[worst]),
        typical_sigma=float(np.median(sigma)),
    )
