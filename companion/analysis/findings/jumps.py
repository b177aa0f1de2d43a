"""Findings about the autopilot: its estimate jumps where the IMU felt nothing."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from companion.analysis.comparison import Comparison
from companion.analysis.finding import Cause, Finding, Severity, runs
from companion.analysis.phases import aligned_at, phases
from companion.analysis.reference import Limits, attitude_error, attitude_jumps, length, position_jumps
from companion.constants import check, num
from companion.model import Array, AttitudeTrack, Flight, PositionTrack
from companion.strapdown import quaternion


def jump_findings(comparison: Comparison, flight: Flight) -> Iterator[Finding]:
    """The autopilot's estimate steps where neither its own velocity, its own rates nor the IMU say so."""
    known = comparison.reference.t[comparison.reference.position_known]
    settled = max(_aligned(flight), float(known[0] if len(known) else comparison.track.t[0]))
    limits, steps = comparison.how.limits, comparison.position_steps
    yield from _position_findings(flight.position, steps, limits, settled, "the IMU felt nothing")
    yield from _heading_findings(list(_heading_steps(comparison)), settled, "that the gyro did not feel")


def jumps_without_imu(flight: Flight, limits: Limits) -> Iterator[Finding]:
    """The same where there is no IMU: its own velocity and its own rates do not say so."""
    settled, position = _aligned(flight), flight.position
    if position is not None and len(position):
        settled, steps = max(settled, float(position.t[0])), position_jumps(position, limits)
        yield from _position_findings(position, steps, limits, settled, "its own velocity does not say so")
    yield from _heading_findings(list(_steps_of(flight.attitude, limits)), settled, "that its own rates do not explain")


def reset_findings(flight: Flight) -> Iterator[Finding]:
    """What the estimator says that it has set anew, once it had aligned."""
    settled = _aligned(flight)
    for one in flight.resets:
        if one.t >= settled:
            said = f"the estimator says: {one.text}" if one.text else f"the estimator has set its {one.kind} anew"
            yield Finding("estimator_reset", "autopilot", "info", one.t, one.t, said, "")


def _aligned(flight: Flight) -> float:
    return max(flight.start, aligned_at(phases(flight)))


def _heading_findings(steps: list[tuple[float, float, float]], settled: float, unfelt: str) -> Iterator[Finding]:
    """Steps (start, end, size rad) of the heading, those before the estimator had settled as one."""
    starting = [step for step in steps if step[0] < settled]
    for group in filter(None, [starting, *([step] for step in steps[len(starting) :])]):
        start, end, step = group[0][0], group[-1][1], max(size for _, _, size in group)
        many = f"{len(group)} times, by up to" if len(group) > 1 else "by"
        severity: Severity = "info" if start < settled or step < np.radians(10.0) else "error"
        words = f"the heading steps {many} {np.degrees(step):.1f}° {unfelt}"
        yield Finding(
            "heading_jump",
            "autopilot",
            severity,
            start,
            end,
            words,
            "The estimator has reset its yaw. Some degrees after take-off are usual; more is a compass problem.",
            headline=f"{words}, from {start:.1f} to {end:.1f} s",
            cause=Cause("heading_jump", "autopilot", start, end, size=step, unit="rad"),
        )


def _position_findings(
    position: PositionTrack | None, steps: Array, limits: Limits, settled: float, unfelt: str
) -> Iterator[Finding]:
    """Jumps of the position, those close together as one; a gap is none."""
    if position is None:
        return
    steps = steps[steps[:, 1] - steps[:, 0] <= limits.longest_step(position.t)]
    if not len(steps):
        return
    for group in np.split(steps, np.flatnonzero(np.diff(steps[:, 0]) > check.GROUPED_S) + 1):
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
            f"{length(position.velocity[j]).max():.1f} m/s; {unfelt}",
            "A GPS glitch or a reset of the estimator. Look at the GPS's satellites and at EKF messages of that time.",
            cause=Cause("position_jump", "autopilot", start, end, size=moved, unit="m"),
        )


def _steps_of(attitude: AttitudeTrack | None, limits: Limits) -> Iterator[tuple[float, float, float]]:
    """Steps of the heading as `_heading_steps` has them, from one attitude to the next, where the rates are told."""
    if attitude is None or not attitude.rates_reported or len(attitude) < 2:
        return
    steps, longest = attitude_jumps(attitude, limits), limits.longest_step(attitude.t)
    for start, end in steps[steps[:, 1] - steps[:, 0] <= longest].tolist():
        i, j = np.searchsorted(attitude.t, [start, end])
        turn = 0.5 * (attitude.rates[i] + attitude.rates[j]) * (end - start)
        predicted = quaternion.multiply(attitude.q_ned_frd[i], quaternion.exp(turn))
        *tilt, heading = attitude_error(attitude.q_ned_frd[j], predicted)
        if np.hypot(*tilt) < 0.5 * abs(heading):
            yield start, end, float(abs(heading))


def _heading_steps(comparison: Comparison) -> Iterator[tuple[float, float, float]]:
    """(start, end, size rad) of steps of the heading against the integrated gyro, larger than 1.5° in 0.2 s.

    And larger than what the attitude between two of its samples may make of it.
    """
    t, q = comparison.track.t, comparison.reference.q_ned_frd
    if comparison.track.rate_hz < check.YAW_STEP_RATE_HZ:
        return
    span = max(1, round(check.YAW_STEP_S * comparison.track.rate_hz))
    start = np.arange(0, len(t) - span)
    end = start + span
    known = comparison.reference.attitude_known
    turned = quaternion.multiply(quaternion.conjugate(comparison.path.q[start]), comparison.path.q[end])
    seen = quaternion.multiply(q[end], quaternion.conjugate(quaternion.multiply(q[start], turned)))
    error = quaternion.log(seen)
    tilt = length(error[:, :2])
    big = (np.abs(error[:, 2]) > np.radians(1.5)) & (tilt < 0.5 * np.abs(error[:, 2])) & known[start] & known[end]
    big &= t[end] - t[start] < 2 * check.YAW_STEP_S
    some = np.flatnonzero(big)
    ends = (comparison.reference.interpolation_error(at[some], comparison.path).attitude for at in (start, end))
    big[some] = np.abs(error[some, 2]) > num.SIGMAS * np.hypot(*ends)
    for first, last in runs(np.asarray(big)):
        peak = first + int(np.argmax(np.abs(error[first : last + 1, 2])))
        edges = sorted((float(t[start[last]]), float(t[end[first]])))
        yield edges[0], edges[1], float(abs(error[peak, 2]))
