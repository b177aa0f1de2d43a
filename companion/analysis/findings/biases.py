"""Findings about readings that stay wrong, and which side they speak against."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from companion.analysis.budget import ATTITUDE, turn_jacobian
from companion.analysis.compare import length
from companion.analysis.comparison import Comparison
from companion.analysis.figures import ImuFigures, ReferenceFigures
from companion.analysis.finding import Finding, digits, runs
from companion.analysis.findings.blame import attitude_turned, in_world, leaning
from companion.analysis.findings.residuals import Residuals
from companion.analysis.findings.witnesses import all_alike
from companion.strapdown import quaternion
from companion.tracks import STANDARD_GRAVITY, Array

BIAS_RATE_HZ = 10.0  # below it the motion between the samples looks like a bias
_FEWEST = 3  # windows in a row
_BEFORE = 15  # windows before a force in which the attitude may have begun to lean
_FOLDED = 0.3  # of the shaking
_SLOWEST = 1.0  # m/s that the position may move against its own velocity

Stretch = tuple[int, int, Array]  # first and last window, median


def bias_findings(
    comparison: Comparison,
    found: Residuals,
    own: Array,
    others: Callable[[], Sequence[Residuals]],
    imu: ImuFigures,
    autopilot: ReferenceFigures,
) -> Iterator[Finding]:
    """A rate or specific force that stays wrong over several short windows, by more than a calibrated sensor can.

    Where the readings are noisy, four standard errors of a window's mean are allowed on top; for the force also what
    the autopilot's own tilt and heading may be off by. own: `blame.own_rates`, (W, 3). others: the vehicle's further
    IMUs, which are asked when this one is biased: two sensors do not err alike, and what they share is the autopilot's.
    """
    if len(found) < _FEWEST or comparison.track.rate_hz < BIAS_RATE_HZ:
        return
    # four of one axis: three axes together pass three in 3 % of all sensors; a turn that goes on shows the gyro's scale
    # and its axes as if they were a bias; and half a step of each axis
    usual = np.hypot(4.0 * imu.gyro.residual_bias, 2.0 * _of_turning(found, imu, autopilot))
    limit = usual + 4.0 * found.noise[:, 0] + found.bend + comparison.track.gyro_step
    # what shakes faster than the samples tell folds into them, and may stand still there for a while
    folded = _FOLDED * np.median(found.noise * np.sqrt(found.span * comparison.track.rate_hz), axis=0)
    limit = limit + folded[0]
    turning = list(_stretches(found, found.rate, limit))
    leant: list[float] = []  # when an attitude began to lean
    for first, last, value in turning:
        begin, end = found.between(first, last)
        if attitude_turned(found, own, first, last) or all_alike(others(), "rate", begin, end, value):
            leant.append(begin)
            yield _diverging(found, first, last)
        else:
            yield Finding(
                "gyro_bias",
                "imu",
                "error",
                begin,
                end,
                f"it reads ({digits(value * 1e3, 1)}) mrad/s too much; after calibration "
                f"{imu.gyro.residual_bias * 1e3:.1f} mrad/s is usual for {imu.name}",
                "Calibrate the gyro at rest before take-off (INS_GYR_CAL = 1, keep still). If it returns, replace "
                "the IMU.",
            )
    if not comparison.has_position:
        return
    start = found.chosen.start
    heavy = quaternion.rotate(comparison.reference.q_ned_frd[start], comparison.track.accel[start])
    limit = 5.0 * imu.accel.residual_bias + 4.0 * found.noise[:, 1] + folded[1]
    limit = limit + 3.0 * (autopilot.tilt * STANDARD_GRAVITY + autopilot.heading * length(heavy[:, :2]))
    for first, last, value in _stretches(found, found.force, limit):
        begin, end = found.between(first, last)
        # what leans stays leaning until the estimator notices
        if any(begin > since - 4.0 for since in leant):
            continue
        # a gyro bias throws the estimator's own tilt off by degrees until it is learned: not the accelerometer's
        if length(value) < 1.0 and any(found.begin[i] < end and begin < found.end[j] for i, j, _ in turning):
            continue
        share = leaning(found, max(0, first - _BEFORE), last)
        if share is not None and 0.5 < share < 2.0:
            leant.append(begin)
            yield _diverging(found, max(0, first - _BEFORE), last)
        elif in_world(found, found.force, first, last) and not abs(value[2]) > length(value[:2]):
            yield _tilt(found, first, last)
        elif all_alike(others(), "force", begin, end, value):
            yield Finding(
                "attitude_tilted",
                "autopilot",
                "error",
                begin,
                end,
                f"every IMU is off by the same ({digits(value, 2)}) m/s²: it is the attitude that leans, or the "
                "velocity that is wrong",
                "Look at the estimator's GPS velocity and at its innovations (EKF_STATUS_REPORT, XKF3).",
            )
        else:
            yield Finding(
                "accel_bias",
                "imu",
                "error",
                begin,
                end,
                f"it is off by ({digits(value, 2)}) m/s²; after calibration {imu.accel.residual_bias:.2f} m/s² is "
                f"usual for {imu.name}",
                "Calibrate the accelerometer in six positions. If another IMU shows the same, it is the autopilot's "
                "tilt.",
            )


def _diverging(found: Residuals, first: int, last: int) -> Finding:
    part = slice(first, last + 1)
    rate = -np.median(quaternion.rotate(found.q_ned_frd[part], found.rate[part]), axis=0)
    lasted = float(found.end[last] - found.begin[first])
    about = "its heading" if abs(rate[2]) > 2 * length(rate[:2]) else "it"
    return Finding(
        "attitude_diverging",
        "autopilot",
        "error",
        *found.between(first, last),
        f"{about} turns by {np.degrees(length(rate)):.2f}°/s, {np.degrees(length(rate)) * lasted:.0f}° in all, that "
        "neither the IMU nor the forces on it explain",
        "The estimator is being pulled away: look at its compass and GPS innovations (EKF_STATUS_REPORT, XKF4) then.",
    )


def _tilt(found: Residuals, first: int, last: int) -> Finding:
    part = slice(first, last + 1)
    world = np.median(quaternion.rotate(found.q_ned_frd[part], found.force[part]), axis=0)
    angle = np.degrees(length(world[:2]) / STANDARD_GRAVITY)
    return Finding(
        "attitude_tilted",
        "autopilot",
        "error",
        *found.between(first, last),
        f"it leans by {angle:.1f}° towards one side of the world, whichever way the vehicle points",
        "The estimator's tilt is wrong, not the accelerometer: that would turn with the vehicle. Look at its GPS "
        "velocity.",
    )


def position_findings(comparison: Comparison, found: Residuals) -> Iterator[Finding]:
    """The autopilot's position moves steadily against its own velocity."""
    reference, start, end = comparison.reference, found.chosen.start, found.chosen.end
    if not comparison.has_position or len(found) < _FEWEST or comparison.track.rate_hz < BIAS_RATE_HZ:
        return
    total = np.concatenate(
        [
            np.zeros((1, 3)),
            np.cumsum(0.5 * (reference.velocity[1:] + reference.velocity[:-1]) * np.diff(reference.t)[:, None], axis=0),
        ]
    )
    creep = (reference.position[end] - reference.position[start] - (total[end] - total[start])) / found.span
    creep = quaternion.rotate(quaternion.conjugate(found.q_ned_frd), creep)
    for first, last, value in _stretches(found, creep, np.full(len(creep), _SLOWEST)):
        lasted = float(found.end[last] - found.begin[first])
        yield Finding(
            "position_diverging",
            "autopilot",
            "error",
            *found.between(first, last),
            f"it moves by {length(value):.1f} m/s, {length(value) * lasted:.0f} m in all, that its own velocity does "
            "not know of",
            "The estimator is being pulled away: look at the GPS and at the position innovations (XKF3) of that time.",
        )


def _stretches(found: Residuals, value: Array, limit: Array) -> Iterator[Stretch]:
    """Three or more windows in a row that are all beyond the limit in one direction, of the body or of the world."""
    for first, last in runs(np.asarray(length(value) > limit)):
        if last - first < _FEWEST - 1:
            continue
        part = slice(first, last + 1)
        middle = np.median(value[part], axis=0)
        world = np.median(quaternion.rotate(found.q_ned_frd[part], value[part]), axis=0)
        if max(length(middle), length(world)) > np.median(limit[part]):
            yield first, last, middle


def _of_turning(found: Residuals, imu: ImuFigures, autopilot: ReferenceFigures) -> Array:
    """(W,) rad/s, 1σ of what scale and misalignment make of a turn that goes on: what turns back averages out."""
    scale = np.diagonal(found.growth.gyro_matrix[:, ATTITUDE], axis1=2, axis2=3) * imu.gyro.scale
    askew = turn_jacobian(found.growth)[:, ATTITUDE] * autopilot.misalignment
    lasting = [_neighbourhood(part / found.span[:, :1, None]) for part in (scale, askew)]
    return np.asarray(np.sqrt(sum((part**2).sum(axis=(1, 2)) for part in lasting)))


def _neighbourhood(values: Array) -> Array:
    """Mean of each window's values (W, ...) and those of as many about it as make a finding."""
    reach = _FEWEST - 1
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    low = np.maximum(np.arange(len(values)) - reach, 0)
    high = np.minimum(np.arange(len(values)) + reach + 1, len(values))
    return np.asarray((total[high] - total[low]) / (high - low).reshape(-1, *[1] * (values.ndim - 1)))
