"""Findings about readings that cannot be: frozen, stuck, at the end of the range."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from companion.analysis.comparison import Comparison
from companion.analysis.figures import ImuFigures, ReferenceFigures
from companion.analysis.finding import Finding, run_edges, runs
from companion.strapdown import quaternion
from companion.tracks import STANDARD_GRAVITY, Array, AttitudeTrack

_FROZEN_S = 0.5
_TOGETHER_S = 1.0  # shocks closer than this are one finding
_STUCK_S = 1.0
_TURN_PART = 0.14  # of a stretch, over which the attitude's turn is told: a step is in less than a fifth of such spans
_STUCK_RATE_HZ = 20.0


def reading_findings(comparison: Comparison, attitude: AttitudeTrack, imu: ImuFigures) -> Iterator[Finding]:
    """Readings that cannot be: frozen while the vehicle turns, at the end of the sensor's range."""
    track = comparison.track
    same = (np.diff(track.gyro, axis=0) == 0).all(axis=1) & (np.diff(track.accel, axis=0) == 0).all(axis=1)
    for first, last in runs(np.asarray(same)):
        start, end = float(track.t[first]), float(track.t[last + 1])
        if end - start < _FROZEN_S:
            continue
        during = slice(*np.searchsorted(attitude.t, [start, end + 1e-9]).tolist())
        # a vehicle at rest reads the same whole milli-units for ever: only one that moves proves a frozen sensor
        if during.stop - during.start < 3:
            continue
        moved = float(np.abs(np.diff(_heading_free(attitude.q_ned_frd[during]), axis=0)).sum(axis=0).max())
        if moved > np.radians(1.0):
            yield Finding(
                "frozen",
                "imu",
                "error",
                start,
                end,
                f"every axis reads the same for {end - start:.1f} s while the autopilot's attitude moves by "
                f"{np.degrees(moved):.0f}°",
                "The sensor or its bus has stopped while its messages go on. Replace the IMU.",
            )
    for name, readings, full in (
        ("gyro", track.gyro, imu.gyro.full_scale),
        ("accel", track.accel, imu.accel.full_scale),
    ):
        at = np.flatnonzero((np.abs(readings) >= 0.98 * full).any(axis=1))
        if not len(at):
            continue
        for group in np.split(at, np.flatnonzero(np.diff(track.t[at]) > _TOGETHER_S) + 1):
            yield Finding(
                f"{name}_clipping",
                "imu",
                "error",
                float(track.t[group[0]]),
                float(track.t[group[-1]]),
                f"{len(group)} samples at the end of the range, {full:.1f}",
                "Damp the mounting: vibration or a shock is larger than the sensor can read.",
            )


def _heading_free(q: Array) -> Array:
    """Where the body's down points, as angles: what turns when the vehicle tilts, whatever the yaw does."""
    return np.asarray(quaternion.rotate(quaternion.conjugate(q), np.broadcast_to([0.0, 0.0, 1.0], (len(q), 3))))


def stuck_findings(comparison: Comparison, autopilot: ReferenceFigures) -> Iterator[Finding]:
    """One axis that reads the same for a second or more while its neighbours go on and the vehicle moves about it.

    Whole milli-units read the same for long when nothing happens: there, what the autopilot's attitude says that the
    axis should have read has to move by ten steps, and by more than the attitude's own noise.
    """
    track = comparison.track
    if track.rate_hz < _STUCK_RATE_HZ:
        return
    for name, readings, step in (("gyro", track.gyro, track.gyro_step), ("accel", track.accel, track.accel_step)):
        same = np.diff(readings, axis=0) == 0
        for axis in range(3):
            first, last = run_edges(np.asarray(same[:, axis]))
            lasted = track.t[last + 1] - track.t[first]
            for i in np.flatnonzero(lasted > _STUCK_S):
                stretch = slice(int(first[i]), int(last[i]) + 2)
                others = np.delete(same[stretch], axis, axis=1)
                if others.mean(axis=0).max() > 0.8 or comparison.holes[stretch].any():
                    continue
                if not comparison.reference.attitude_known[stretch].all():
                    continue
                low, high = np.percentile(_should_read(comparison, name, stretch)[:, axis], [20, 80])
                noise = autopilot.attitude_noise * (
                    STANDARD_GRAVITY if name == "accel" else np.sqrt(2.0) / (_TURN_PART * lasted[i])
                )
                if step and high - low < max(10 * step, 2 * noise):  # not the whole range: a yaw reset is no turn
                    continue
                yield Finding(
                    "stuck_axis",
                    "imu",
                    "error",
                    float(track.t[first[i]]),
                    float(track.t[last[i] + 1]),
                    f"{name} {'xyz'[axis]} reads {readings[first[i], axis]:.4g} for {lasted[i]:.1f} s while the other "
                    "axes go on",
                    "The sensor or its driver has lost an axis. Replace the IMU.",
                )


def _should_read(comparison: Comparison, name: str, stretch: slice) -> Array:
    """What the autopilot's attitude says the gyro turned (rad/s), or gravity weighs on the accelerometer (m/s²)."""
    t, q = comparison.track.t[stretch], comparison.reference.q_ned_frd[stretch]
    if name == "accel":
        return quaternion.rotate(quaternion.conjugate(q), np.broadcast_to([0.0, 0.0, -STANDARD_GRAVITY], (len(q), 3)))
    span = max(1, round(_TURN_PART * len(t)))
    turned = quaternion.log(quaternion.multiply(quaternion.conjugate(q[:-span]), q[span:]))
    return np.asarray(turned / (t[span:] - t[:-span])[:, None])
