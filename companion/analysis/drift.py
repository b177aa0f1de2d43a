"""Drift: how far the IMU's reckoning is from the autopilot after a horizon, from many anchors.

For each horizon the flight is cut into windows end to end. Each window starts from the autopilot's own state at an IMU
sample (the anchor), is integrated by itself, and is held against the autopilot at its end. This is the relative pose
error (RPE) of trajectory evaluation, with time as the step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from companion.analysis.compare import attitude_error, length
from companion.analysis.reference import (
    BoolArray,
    Limits,
    Reference,
    attitude_jumps,
    nearest,
    position_jumps,
    reference_at,
)
from companion.strapdown import Preintegration, preintegrate
from companion.tracks import STANDARD_GRAVITY, Array, Flight, ImuTrack

HORIZONS_S = (1.0, 2.0, 5.0, 10.0, 30.0)

IntArray = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Statistic:
    """Median, 95th percentile and worst of an error's length over windows."""

    median: float
    p95: float
    max: float


@dataclass(frozen=True, slots=True, eq=False)
class WindowErrors:
    """The error of every window that was used, autopilot minus IMU, at its end."""

    anchor_s: Array  # (W,) s, boot clock
    end_s: Array  # (W,)
    attitude: Array  # (W, 3) rotation vector in NED, rad
    velocity: Array  # (W, 3) NED m/s; meaningless when the flight has no position
    position: Array  # (W, 3) NED m, likewise


@dataclass(frozen=True, slots=True, eq=False)
class DriftRow:
    """Drift at one horizon: None where no window was used, or (velocity, position) the flight has no position."""

    horizon_s: float
    windows: int  # used
    excluded: Mapping[str, int]  # windows left out, by reason
    attitude_deg: Statistic | None
    velocity_mps: Statistic | None
    position_m: Statistic | None
    errors: WindowErrors


@dataclass(frozen=True, slots=True, eq=False)
class Drift:
    """The drift table of a flight, and with what it was made."""

    imu: str
    method: str
    middle: str
    rows: tuple[DriftRow, ...]
    notes: tuple[str, ...] = ()


def drift(
    flight: Flight,
    *,
    horizons: Sequence[float] = HORIZONS_S,
    method: str = "rk4",
    middle: str = "cubic",
    segments: int = 1,
    imu: str | None = None,
    gravity: float = STANDARD_GRAVITY,
    limits: Limits | None = None,
) -> Drift:
    """The drift of the flight's IMU against its autopilot after each horizon (s).

    Windows with a hole in the IMU samples, with an unknown state at an end, or over a jump of the autopilot's attitude
    or position are left out and counted. A flight that has a position is judged where it has one: before, the
    estimator is still starting up. One without any is compared in attitude alone. One pass over the samples serves
    every window.

    Raises DataError when the flight has no usable IMU or no attitude, ValueError for an unknown method or a horizon
    that is not positive.
    """
    track, attitude = flight.imu(imu), flight.require_attitude()
    if not all(np.isfinite(h) and h > 0 for h in horizons):
        raise ValueError(f"horizons must be positive seconds, got {list(horizons)}")
    limits = limits or Limits()
    path = preintegrate(track, method=method, middle=middle, segments=segments)
    reference = reference_at(attitude, flight.position, track.t, limits)
    attitude_steps = attitude_jumps(attitude, limits)
    position_steps = position_jumps(flight.position, limits) if flight.position else np.zeros((0, 2))
    has_position = bool(reference.position_known.any())
    holes = np.diff(track.t) > limits.hole(track.t)
    rows = []
    for horizon in horizons:
        start, end = _windows(track, reference, horizon)
        reasons = {
            "imu_gap": _count_between(holes, start, end) > 0,
            "no_attitude": ~(reference.attitude_known[start] & reference.attitude_known[end]),
            "attitude_jump": _touched(attitude_steps, track.t, start, end),
        }
        if has_position:
            reasons |= {
                "no_position": ~(reference.position_known[start] & reference.position_known[end]),
                "position_jump": _touched(position_steps, track.t, start, end),
            }
        used, excluded = _leave_out(reasons, len(start))
        errors = _errors(path, reference, start[used], end[used], gravity)
        rows.append(
            DriftRow(
                horizon_s=float(horizon),
                windows=int(used.sum()),
                excluded=excluded,
                attitude_deg=_statistic(np.degrees(length(errors.attitude))),
                velocity_mps=_statistic(length(errors.velocity)) if has_position else None,
                position_m=_statistic(length(errors.position)) if has_position else None,
                errors=errors,
            )
        )
    return Drift(track.source, method, middle, tuple(rows), path.notes)


def _windows(track: ImuTrack, reference: Reference, horizon: float) -> tuple[IntArray, IntArray]:
    """Sample indices of anchors and ends: windows end to end over all of the flight that has an attitude.

    The grid stands on the first sample with a known position, so that none of the time with a position is given away.
    """
    known = np.flatnonzero(reference.attitude_known)
    if not len(known) or horizon < 0.5 * np.median(np.diff(track.t)):
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    first, last = track.t[known[0]], track.t[known[-1]]
    middle = track.t[np.argmax(reference.position_known)] if reference.position_known.any() else first
    slack = 1e-9 * horizon  # so that an end that falls on the last sample is kept in spite of rounding
    before, after = (int((span + slack) / horizon) for span in (middle - first, last - middle))
    index = nearest(track.t, middle + horizon * np.arange(-before, after + 1))
    apart = np.diff(index) > 0  # in a hole, or at a very low rate, two edges can fall on one sample
    return index[:-1][apart], index[1:][apart]


def _leave_out(reasons: Mapping[str, BoolArray], windows: int) -> tuple[BoolArray, dict[str, int]]:
    """Which windows remain, and how many fell to each reason; one that has several counts under the first."""
    used = np.ones(windows, np.bool_)
    counts: dict[str, int] = {}
    for reason, bad in reasons.items():
        if left_out := int((used & bad).sum()):
            counts[reason] = left_out
        used &= ~bad
    return used, counts


def _count_between(flags: BoolArray, start: IntArray, end: IntArray) -> IntArray:
    """How many of the flagged intervals lie between samples start and end."""
    running = np.concatenate([[0], np.cumsum(flags)])
    return np.asarray(running[end] - running[start])


def _touched(steps: Array, t: Array, start: IntArray, end: IntArray) -> BoolArray:
    """Whether one of the steps (J, 2), from s to s, lies in the window or is interpolated across at its ends."""
    over = np.searchsorted(steps[:, 1], t[start], side="right")
    to_come = len(steps) - np.searchsorted(steps[:, 0], t[end], side="left")
    return np.asarray(len(steps) - over - to_come > 0)


def _errors(path: Preintegration, reference: Reference, start: IntArray, end: IntArray, gravity: float) -> WindowErrors:
    q, velocity, position = path.carry(
        start, end, reference.q_ned_frd[start], reference.velocity[start], reference.position[start], gravity=gravity
    )
    return WindowErrors(
        anchor_s=reference.t[start],
        end_s=reference.t[end],
        attitude=attitude_error(reference.q_ned_frd[end], q),
        velocity=reference.velocity[end] - velocity,
        position=reference.position[end] - position,
    )


def _statistic(values: Array) -> Statistic | None:
    if not len(values):
        return None
    median, p95, worst = np.percentile(values, [50, 95, 100])
    return Statistic(float(median), float(p95), float(worst))
