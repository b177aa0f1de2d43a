"""Findings about the level of the readings: too slow, biased, noisy.

Short windows say when a bias begins and ends, which a fit to the whole flight cannot.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from companion.analysis.budget import VELOCITY, window_noise
from companion.analysis.compare import length
from companion.analysis.comparison import Comparison, errors, windows
from companion.analysis.figures import ImuFigures, ReferenceFigures
from companion.analysis.finding import Finding, runs
from companion.strapdown import propagate, quaternion
from companion.tracks import STANDARD_GRAVITY, Array

_GYRO_BIAS = slice(9, 12)  # place in the 15-state error of `propagate`
_SHORT_S = 2.0  # length of the windows in which a bias is looked for
_BIAS_RATE_HZ = 10.0  # below it the motion between the samples looks like a bias


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


def bias_findings(comparison: Comparison, imu: ImuFigures, autopilot: ReferenceFigures) -> Iterator[Finding]:
    """A rate or specific force that stays wrong over several short windows, by more than a calibrated sensor can.

    Where the readings are noisy, four standard errors of a window's mean are allowed on top; for the force also what
    the autopilot's own tilt and heading may be off by.
    """
    chosen = windows(comparison, _SHORT_S)
    if len(chosen.start) < 3 or comparison.track.rate_hz < _BIAS_RATE_HZ:
        return
    found = errors(comparison, chosen)
    back = quaternion.conjugate(comparison.reference.q_ned_frd[chosen.start])
    span = (found.end_s - found.anchor_s)[:, None]
    noise = window_noise(comparison.track, chosen) / np.sqrt(span)
    # to first order truth minus estimate is -(bias) t: with the sign turned, and in the body, it is the bias
    rate = -quaternion.rotate(back, found.attitude) / span
    # four of one axis: three axes together pass three in 3 % of all sensors; and half a step of each axis
    limit = 4.0 * imu.gyro.residual_bias + 4.0 * noise[:, 0] + comparison.track.gyro_step
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
        gravity=comparison.how.gravity,
    )
    # a gyro bias leans gravity over; that is not the accelerometer's
    leaned = np.einsum("wij,wj->wi", growth.transition[:, VELOCITY, _GYRO_BIAS], rate)
    force = -quaternion.rotate(back, found.velocity - leaned) / span
    level = quaternion.rotate(comparison.reference.q_ned_frd[chosen.start], comparison.track.accel[chosen.start])
    sideways = length(level[:, :2])
    limit = 5.0 * imu.accel.residual_bias + 4.0 * noise[:, 1]
    limit = limit + 3.0 * (autopilot.tilt * STANDARD_GRAVITY + autopilot.heading * sideways)
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
            "Calibrate the accelerometer in six positions. If another IMU shows the same, it is the autopilot's tilt.",
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


def _stretches(begin: Array, end: Array, value: Array, limit: Array) -> Iterator[tuple[float, float, Array]]:
    """(start, end, median) of three or more windows in a row that are all beyond the limit in one direction."""
    for first, last in runs(np.asarray(length(value) > limit)):
        middle = np.median(value[first : last + 1], axis=0)
        if last - first >= 2 and length(middle) > np.median(limit[first : last + 1]):
            yield float(begin[first]), float(end[last]), middle


def _milli(value: float | Array) -> str:
    return ", ".join(f"{v * 1e3:.1f}" for v in np.atleast_1d(value))
