"""What stands out in a flight: each finding with its interval, its evidence in numbers, and what to do.

A finding speaks of the IMU, of the autopilot or of the data. Detectors look at readings alone (frozen, clipped), at
short windows (a bias that begins in mid-flight has a beginning), or at the autopilot's own jumps that the IMU did not
feel.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from companion.analysis.budget import VELOCITY, window_noise
from companion.analysis.compare import length
from companion.analysis.comparison import Comparison, errors, windows
from companion.analysis.figures import ImuFigures
from companion.analysis.reference import BoolArray
from companion.strapdown import propagate, quaternion
from companion.tracks import Array, AttitudeTrack, Flight, PositionTrack

Side = Literal["imu", "autopilot", "data"]
Severity = Literal["info", "warning", "error"]

GYRO_BIAS = slice(9, 12)  # place in the 15-state error of `propagate`

SHORT_S = 2.0  # length of the windows in which a bias is looked for
_BIAS_RATE_HZ = 10.0  # below it the motion between the samples looks like a bias
_STEP_RATE_HZ = 20.0  # below it a turn between two samples looks like a step of the heading
_FROZEN_S = 0.5
_TOGETHER_S = 1.0  # jumps closer than this are one finding
_STEP_S = 0.2  # length of the windows in which a heading step is looked for


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that stands out."""

    kind: str
    side: Side  # whom it speaks against
    severity: Severity  # an error decides the verdict; a warning may explain it; info is said
    start_s: float  # boot clock
    end_s: float
    evidence: str
    advice: str


def rate_findings(comparison: Comparison, sampling_share: float) -> Iterator[Finding]:
    """The sample rate is too low for the motion: nothing else in the budget matters then."""
    track = comparison.track
    rate = track.rate_hz
    if rate < 10.0 or sampling_share > 0.5:
        yield Finding(
            "rate_too_low",
            "data",
            "error",
            float(track.t[0]),
            float(track.t[-1]),
            f"{track.source} at {rate:.1f} Hz"
            + (f"; sampling is {sampling_share:.0%} of the expected attitude error" if sampling_share > 0.05 else ""),
            "Record the IMU at 50-200 Hz (SRx_RAW_SENS, SET_MESSAGE_INTERVAL), or use the on-board log.",
        )
    holes = np.flatnonzero(comparison.holes)
    if len(holes):
        lost = float((track.t[holes + 1] - track.t[holes]).sum())
        yield Finding(
            "samples_missing",
            "data",
            "warning" if lost > 0.01 * (track.t[-1] - track.t[0]) else "info",
            float(track.t[holes[0]]),
            float(track.t[holes[-1] + 1]),
            f"{len(holes)} holes, {lost:.1f} s in all, the longest {np.diff(track.t).max():.2f} s",
            "Look at the link's quality, or use the on-board log. Windows over holes are left out.",
        )


def bias_findings(comparison: Comparison, imu: ImuFigures) -> Iterator[Finding]:
    """A rate or specific force that stays wrong over several short windows, by more than a calibrated sensor can.

    Where the readings are noisy, four standard errors of a window's mean are allowed on top.
    """
    chosen = windows(comparison, SHORT_S)
    if len(chosen.start) < 3 or comparison.track.rate_hz < _BIAS_RATE_HZ:
        return
    found = errors(comparison, chosen)
    back = quaternion.conjugate(comparison.reference.q_ned_frd[chosen.start])
    span = (found.end_s - found.anchor_s)[:, None]
    noise = window_noise(comparison.track, chosen) / np.sqrt(span)
    # to first order truth minus estimate is -(bias) t: with the sign turned, and in the body, it is the bias
    rate = -quaternion.rotate(back, found.attitude) / span
    limit = 3.0 * imu.gyro.residual_bias + 4.0 * noise[:, 0]
    turning = list(_stretches(found.anchor_s, found.end_s, rate, limit))
    for start, end, value in turning:
        yield Finding(
            "gyro_bias",
            "imu",
            "error",
            start,
            end,
            f"it reads ({_milli(value)}) mrad/s too much; after calibration {_milli(imu.gyro.residual_bias)} "
            f"mrad/s is usual for {imu.name}",
            "Calibrate the gyro at rest before take-off (INS_GYR_CAL = 1, keep still). If it returns, replace the IMU.",
        )
    if not comparison.has_position:
        return
    growth = propagate(
        comparison.track,
        comparison.path,
        chosen.start,
        chosen.end,
        comparison.reference.q_ned_frd[chosen.start],
        comparison.reference.velocity[chosen.start],
        gravity=comparison.gravity,
    )
    # a gyro bias leans gravity over; that is not the accelerometer's
    leaned = np.einsum("wij,wj->wi", growth.transition[:, VELOCITY, GYRO_BIAS], rate)
    force = -quaternion.rotate(back, found.velocity - leaned) / span
    limit = 5.0 * imu.accel.residual_bias + 4.0 * noise[:, 1]
    for start, end, value in _stretches(found.anchor_s, found.end_s, force, limit):
        # a gyro bias throws the estimator's own tilt off by degrees until it is learned: not the accelerometer's
        if length(value) < 1.0 and any(s < end and start < e for s, e, _ in turning):
            continue
        yield Finding(
            "accel_bias",
            "imu",
            "error",
            start,
            end,
            f"it is off by ({value[0]:.2f}, {value[1]:.2f}, {value[2]:.2f}) m/s²; after calibration "
            f"{imu.accel.residual_bias:.2f} m/s² is usual for {imu.name}",
            "Calibrate the accelerometer in six positions. If it returns, replace the IMU.",
        )


def noise_findings(comparison: Comparison, measured: tuple[float, float], imu: ImuFigures) -> Iterator[Finding]:
    """Readings far noisier than the data sheet: vibration, or a simulator that shakes."""
    track = comparison.track
    for name, density, sheet, unit in (
        ("gyro", measured[0], imu.gyro.noise_density, "rad/s/√Hz"),
        ("accel", measured[1], imu.accel.noise_density, "m/s²/√Hz"),
    ):
        if density > 10.0 * sheet:
            yield Finding(
                f"{name}_noise",
                "imu",
                "warning",
                float(track.t[0]),
                float(track.t[-1]),
                f"{density:.2g} {unit} in flight, {density / sheet:.0f} times the {sheet:.2g} of {imu.name}",
                "Vibration reaches the sensor: look at VIBE and at the damping. The budget below allows for it.",
            )


def reading_findings(comparison: Comparison, attitude: AttitudeTrack, imu: ImuFigures) -> Iterator[Finding]:
    """Readings that cannot be: frozen while the vehicle turns, at the end of the sensor's range."""
    track = comparison.track
    same = (np.diff(track.gyro, axis=0) == 0).all(axis=1) & (np.diff(track.accel, axis=0) == 0).all(axis=1)
    for first, last in _runs(np.asarray(same)):
        start, end = float(track.t[first]), float(track.t[last + 1])
        during = (attitude.t >= start) & (attitude.t <= end)
        # a vehicle at rest reads the same whole milli-units for ever: only one that moves proves a frozen sensor
        if end - start < _FROZEN_S or during.sum() < 3:
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
        for first, last in _runs(np.asarray((np.abs(readings) >= 0.98 * full).any(axis=1))):
            yield Finding(
                f"{name}_clipping",
                "imu",
                "error",
                float(track.t[first]),
                float(track.t[last]),
                f"{last - first + 1} samples at the end of the range, {full:.1f}",
                "Damp the mounting: vibration or a shock is larger than the sensor can read.",
            )


def jump_findings(comparison: Comparison, flight: Flight) -> Iterator[Finding]:
    """The autopilot's estimate steps where neither its own velocity, its own rates nor the IMU say so."""
    known = comparison.reference.t[comparison.reference.position_known]
    settled = float(known[0]) if len(known) else float(comparison.track.t[0])
    position = flight.position
    if position is not None:
        yield from _position_findings(comparison, position, settled)
    for start, end, step in _heading_steps(comparison):
        severity: Severity = "info" if start < settled or step < np.radians(10.0) else "error"
        yield Finding(
            "heading_jump",
            "autopilot",
            severity,
            start,
            end,
            f"the heading steps by {np.degrees(step):.1f}° that the gyro did not feel",
            "The estimator has set its yaw anew. Some degrees after take-off are usual; more is a compass problem.",
        )


def _position_findings(comparison: Comparison, position: PositionTrack, settled: float) -> Iterator[Finding]:
    """Jumps of the position, those close together as one, and times without any position."""
    steps = comparison.position_steps
    lost = steps[:, 1] - steps[:, 0] > comparison.limits.hole(position.t)
    for start, end in steps[lost]:
        i, j = np.searchsorted(position.t, [start, end])
        yield Finding(
            "position_lost",
            "autopilot",
            "warning",
            float(start),
            float(end),
            f"no position for {end - start:.1f} s, in which it moved by "
            f"{length(position.position[j] - position.position[i]):.1f} m",
            "The estimator had lost its position: GPS outage. Windows over it are left out.",
        )
    steps = steps[~lost]
    if not len(steps):
        return
    for group in np.split(steps, np.flatnonzero(np.diff(steps[:, 0]) > _TOGETHER_S) + 1):
        i, j = np.searchsorted(position.t, group[:, 0]), np.searchsorted(position.t, group[:, 1])
        moved = float(length(position.position[j] - position.position[i]).max())
        start, end = float(group[0, 0]), float(group[-1, 1])
        many = f"{len(group)} times in {end - start:.1f} s, by up to" if len(group) > 1 else "by"
        yield Finding(
            "position_jump",
            "autopilot",
            "error" if start >= settled else "info",
            start,
            end,
            f"the position steps {many} {moved:.1f} m within {np.diff(group, axis=1).max():.2f} s at "
            f"{length(position.velocity[j]).max():.1f} m/s; the IMU felt nothing",
            "A GPS glitch or a reset of the estimator. Look at the GPS's satellites and at EKF messages of that time.",
        )


def _heading_steps(comparison: Comparison) -> Iterator[tuple[float, float, float]]:
    """(start, end, size rad) of steps of the heading against the integrated gyro, larger than 1.5° in 0.2 s."""
    t, q = comparison.track.t, comparison.reference.q_ned_frd
    if comparison.track.rate_hz < _STEP_RATE_HZ:
        return
    span = max(1, round(_STEP_S * comparison.track.rate_hz))
    start = np.arange(0, len(t) - span)
    end = start + span
    known = comparison.reference.attitude_known
    turned = quaternion.multiply(quaternion.conjugate(comparison.path.q[start]), comparison.path.q[end])
    seen = quaternion.multiply(q[end], quaternion.conjugate(quaternion.multiply(q[start], turned)))
    error = quaternion.log(seen)
    tilt = length(error[:, :2])
    big = (np.abs(error[:, 2]) > np.radians(1.5)) & (tilt < 0.5 * np.abs(error[:, 2])) & known[start] & known[end]
    big &= t[end] - t[start] < 2 * _STEP_S
    for first, last in _runs(np.asarray(big)):
        peak = first + int(np.argmax(np.abs(error[first : last + 1, 2])))
        edges = sorted((float(t[start[last]]), float(t[end[first]])))
        yield edges[0], edges[1], float(abs(error[peak, 2]))


def _stretches(begin: Array, end: Array, value: Array, limit: Array) -> Iterator[tuple[float, float, Array]]:
    """(start, end, median) of three or more windows in a row that are all beyond the limit in one direction."""
    for first, last in _runs(np.asarray(length(value) > limit)):
        middle = np.median(value[first : last + 1], axis=0)
        if last - first >= 2 and length(middle) > np.median(limit[first : last + 1]):
            yield float(begin[first]), float(end[last]), middle


def _runs(flags: BoolArray) -> Iterator[tuple[int, int]]:
    """First and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    for first, after in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        yield first, after - 1


def _heading_free(q: Array) -> Array:
    """Where the body's down points, as angles: what turns when the vehicle tilts, whatever the yaw does."""
    return np.asarray(quaternion.rotate(quaternion.conjugate(q), np.broadcast_to([0.0, 0.0, 1.0], (len(q), 3))))


def _milli(value: float | Array) -> str:
    return ", ".join(f"{v * 1e3:.1f}" for v in np.atleast_1d(value))
