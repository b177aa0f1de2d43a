"""Findings about times in flight without a valid position, or with one that no GPS fix supports.

Also here: findings about the autopilot: its estimate jumps where the IMU felt nothing.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from companion.comparison import (
    Comparison,
    Limits,
    Span,
    aligned_at,
    attitude_error,
    attitude_jumps,
    ends_of,
    grouped,
    in_the_air,
    length,
    phases,
    position_jumps,
    runs,
    within,
    within_any,
)
from companion.constants import check, harm, num
from companion.model import Array, AttitudeTrack, BoolArray, Flight, PositionTrack, of_kind
from companion.strapdown import quaternion
from companion.verdict.finding import Cause, Finding, Severity


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
            words = f"the estimator says: {one.text}" if one.text else f"the estimator has set its {one.kind} anew"
            yield Finding("estimator_reset", "autopilot", "info", one.t, one.t, words, "")


def _aligned(flight: Flight) -> float:
    return max(flight.start, aligned_at(phases(flight)))


def _heading_findings(steps: list[tuple[float, float, float]], settled: float, unfelt: str) -> Iterator[Finding]:
    """Steps (start, end, size rad) of the heading, those before the estimator had settled as one."""
    starting = [step for step in steps if step[0] < settled]
    for group in filter(None, [starting, *([step] for step in steps[len(starting) :])]):
        start, end, step = group[0][0], group[-1][1], max(size for _, _, size in group)
        many = f"{len(group)} times, by up to" if len(group) > 1 else "by"
        severity: Severity = "info" if start < settled or step < np.radians(10.0) else "error"
        evidence = f"the heading steps {many} {np.degrees(step):.1f}° {unfelt}"
        advice = "The estimator has reset its yaw. Some degrees after take-off are usual; more is a compass problem."
        headline = f"{evidence}, from {start:.1f} to {end:.1f} s"
        cause = Cause("heading_jump", "autopilot", start, end, size=step, unit="rad")
        yield Finding("heading_jump", "autopilot", severity, start, end, evidence, advice, headline, cause)


def _position_findings(
    position: PositionTrack | None, steps: Array, limits: Limits, settled: float, unfelt: str
) -> Iterator[Finding]:
    """Jumps of the position, those close together as one; a gap is none."""
    if position is None:
        return
    steps = steps[steps[:, 1] - steps[:, 0] <= limits.longest_step(position.t)]
    for at in grouped(steps[:, 0], np.arange(len(steps))):
        group = steps[at]
        i, j = np.searchsorted(position.t, group[:, 0]), np.searchsorted(position.t, group[:, 1])
        moved = float(length(position.position[j] - position.position[i]).max())
        start, end = float(group[0, 0]), float(group[-1, 1])
        many = f"{len(group)} times in {end - start:.1f} s, by up to" if len(group) > 1 else "by"
        severity: Severity = "error" if start >= settled else "info"
        steps_within = f"the position steps {many} {moved:.1f} m within {np.diff(group, axis=1).max():.2f} s"
        evidence = f"{steps_within} at {length(position.velocity[j]).max():.1f} m/s; {unfelt}"
        look = "Look at the GPS's satellites and at EKF messages of that time."
        advice = f"A GPS glitch or a reset of the estimator. {look}"
        cause = Cause("position_jump", "autopilot", start, end, size=moved, unit="m")
        yield Finding("position_jump", "autopilot", severity, start, end, evidence, advice, cause=cause)


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
    t = comparison.track.t
    if comparison.track.rate_hz < check.YAW_STEP_RATE_HZ:
        return
    q = comparison.reference.at(np.arange(len(t))).q_ned_frd
    span = max(1, round(check.YAW_STEP_S * comparison.track.rate_hz))
    start, end, path = slice(0, max(len(t) - span, 0)), slice(span, None), comparison.path
    known = comparison.reference.attitude_known
    turned = quaternion.multiply(quaternion.conjugate(path.q[start]), path.q[end])
    seen = quaternion.multiply(q[end], quaternion.conjugate(quaternion.multiply(q[start], turned)))
    error = quaternion.log(seen)
    tilt = length(error[:, :2])
    big = (np.abs(error[:, 2]) > np.radians(1.5)) & (tilt < 0.5 * np.abs(error[:, 2])) & known[start] & known[end]
    big &= t[end] - t[start] < 2 * check.YAW_STEP_S
    some = np.flatnonzero(big)
    ends = (comparison.reference.interpolation_error(at, path).attitude for at in (some, some + span))
    big[some] = np.abs(error[some, 2]) > num.SIGMAS * np.hypot(*ends)
    for first, last in runs(np.asarray(big)):
        peak = first + int(np.argmax(np.abs(error[first : last + 1, 2])))
        edges = sorted((float(t[last]), float(t[first + span])))
        yield edges[0], edges[1], float(abs(error[peak, 2]))


def outage_findings(flight: Flight, received: Array, gaps: BoolArray) -> Iterator[Finding]:
    """Each time in flight of more than 5 s in which the position was lost, or dead-reckoned; at the end of it too.

    Only what had been there before is lost, and only while the rest is in the log: a gap of the link says nothing.
    received: times (N,) s of the IMU, or where there is none of the attitude; gaps: (N-1,) where nothing was received.
    A position is dead-reckoned where no receiver has a fix: whatever else aids it, GPS does not.
    """
    fixes = [one.t[one.fix_type >= check.FIX_3D] for one in flight.gps]
    without_fix = _gaps(flight, received, gaps, np.sort(np.concatenate(fixes)) if fixes else np.zeros(0))
    if flight.position is None:
        yield from _never_valid(flight)
        return
    lost = _gaps(flight, received, gaps, flight.position.t)
    for span in lost:
        meanwhile = next((other for other in without_fix if _overlap(other, span)), None)
        without_fix = [other for other in without_fix if other != meanwhile]
        yield _while_it_lasts(_lost(flight.position, span, meanwhile), "no position", received)
    reckons = "the autopilot's position is dead-reckoned, or of other sensors"
    for span in without_fix:
        yield _dead_reckoned(span, "no GPS fix", reckons, received)
    for span in _doubted(flight):
        if not any(_overlap(span, other) for other in (*lost, *without_fix)):
            yield _dead_reckoned(span, "by its own flags the estimator doubts its GPS", "it may dead-reckon", received)


def _while_it_lasts(finding: Finding, what: str, received: Array) -> Finding:
    """With its beginning in the headline, in place of how long it has lasted, where it goes on at the end."""
    if finding.end_s < received[-1] - check.NEAR_S:
        return finding
    return replace(finding, headline=f"{what} since {finding.start_s:.1f} s")


def _never_valid(flight: Flight) -> Iterator[Finding]:
    """That the estimator never called its position valid in flight, by its own flags: it was never lost."""
    estimator, parts = flight.series.get("estimator"), in_the_air(flight)
    if estimator is None or "flags" not in estimator.columns or not parts:
        return
    flags, begin, end = estimator["flags"], parts[0].start, parts[-1].end
    flags_in_flight = flags[np.isfinite(flags) & within(estimator.t, (begin, end))].astype(np.int64)
    if len(flags_in_flight) and not (flags_in_flight & check.POSITION_VALID).any():
        words = f"no valid position in flight, by the estimator's own flags ({estimator.source}): it is not judged"
        yield Finding("position_lost", "data", "info", begin, end, words, "")


def _dead_reckoned(span: Span, why: str, then: str, received: Array) -> Finding:
    begin, end = span
    words = f"{why} for {end - begin:.1f} s; {then}"
    advice = "Look at the receiver, its antenna and at interference. A dead-reckoned position drifts with t²."
    return _while_it_lasts(Finding("dead_reckoned", "data", "warning", begin, end, words, advice), why, received)


def _doubted(flight: Flight) -> Iterator[Span]:
    """Where in flight the estimator that flew says without a break, for more than 5 s, that its GPS is bad.

    PX4 as long as it rejects it. EKF3 also where the receiver's own accuracy of speed was above 1.5 m/s, and for 10 s
    after a second in which it rejected it (AP_NavEKF3_VehicleStatus.cpp, calcGpsGoodForFlight): it may be using it.
    """
    every, flew = list(of_kind(flight.series, "estimator")), flight.lane_in_use
    for one in every[:1] if flew is None else every:
        bits = check.GPS_DOUBTED.get(re.sub(r"[_[]\d+]?$", "", one.source), 0)  # of whichever instance
        if bits and "flags" in one.columns:
            doubting = (np.nan_to_num(one["flags"]).astype(np.int64) & bits) != 0
            yield from _long(flight, one.t, doubting if flew is None else doubting & (flew.at(one.t) == one.instance))


def poor_gps_findings(flight: Flight) -> Iterator[Finding]:
    """A receiver that has fixes, and says for more than 5 s in flight that they are poor.

    By its satellites and accuracies, by which EKF3 would not begin with it. And one that never has a fix.
    """
    series = None if flight.gps else next(of_kind(flight.series, "gps"), None)
    if series is not None and len(series) and np.isnan(series["lat_rad"]).all():
        none = f"the GPS ({series.source}) never has a fix: {np.nan_to_num(series['satellites']).max():.0f} satellites"
        yield Finding("gps_poor", "data", "info", float(series.t[0]), float(series.t[-1]), f"{none} at most", "")
    for one in flight.gps:
        poor = (one.satellites < harm.GPS_SATELLITES) | (one.fix_type < check.FIX_3D)
        for name, most in harm.GPS_POOR.items():
            poor |= getattr(one, name) > most
        for begin, end in _long(flight, one.t, poor):
            during = within(one.t, (begin, end))
            without = one.fix_type[during] < check.FIX_3D
            if without.all():
                continue
            words = ["no 3D fix"] if without.any() else []
            words += [f"{least:.0f} satellites" for least in [np.min(one.satellites[during])] if np.isfinite(least)]
            for name, (what, unit) in _SIGMAS.items():
                most = float(np.nan_to_num(getattr(one, name)[during]).max())
                words += [f"{what} ±{most:.1f} {unit}"] if most > 0.0 else []
            poor_for = f"the GPS ({one.source}) calls its fix poor for {end - begin:.1f} s; at worst {', '.join(words)}"
            advice = "Look at the antenna's view of the sky, and at what sends or switches near it."
            yield Finding("gps_poor", "data", "warning", begin, end, poor_for, advice)


_SIGMAS = {"horizontal_sigma": ("level", "m"), "vertical_sigma": ("height", "m"), "speed_sigma": ("speed", "m/s")}


def _long(flight: Flight, t: Array, where: BoolArray) -> Iterator[Span]:
    """Stretches of more than 5 s in flight in which something is so, s; what is not so for less than a second is."""
    for part in in_the_air(flight):
        inside = np.flatnonzero(where & within(t, (part.start, part.end)))
        apart = np.diff(t[inside])
        ends = (apart > harm.GPS_OUTAGE_S) | ((np.diff(inside) > 1) & (apart > check.GROUPED_S))
        for group in np.split(inside, np.flatnonzero(ends) + 1) if len(inside) else ():
            begin, end = ends_of(t[group])
            if end - begin > harm.GPS_OUTAGE_S:
                yield begin, end


def interference_findings(flight: Flight) -> Iterator[Finding]:
    """A receiver that says itself, for more than 5 s of a flight, that it is jammed or spoofed.

    By its state (PX4 `msg/SensorGps.msg`), or where that is not told by its indicator of continuous waves.
    """
    one = next(of_kind(flight.series, "interference"), None)  # the selected receiver; its driver's topic says the same
    if one is None:
        return
    aloft = within_any(one.t, [(part.start, part.end) for part in in_the_air(flight)])
    columns = dict.fromkeys(("jamming_state", "jamming_indicator", "spoofing_state"), np.zeros(len(one.t)))
    columns |= {name: np.nan_to_num(one[name]) for name in one.columns}
    state, noisy = columns["jamming_state"], columns["jamming_indicator"] >= harm.JAMMING
    jammed = (state >= check.JAMMED) | ((state == 0) & noisy)
    interval = float(np.median(np.diff(one.t))) if len(one.t) > 1 else 0.0
    for words, where in (("jammed", jammed), ("spoofed", columns["spoofing_state"] >= check.JAMMED)):
        reports = one.t[where & aloft].tolist()
        lasted = len(reports) * interval
        if lasted > harm.GPS_OUTAGE_S:
            evidence = f"the GPS ({one.source}) says that it is {words}, for {lasted:.1f} s"
            advice = "Look at what sends or switches near the antenna: a GPS that is disturbed misleads an estimator."
            yield Finding("gps_interference", "data", "warning", reports[0], reports[-1], evidence, advice)


def _lost(position: PositionTrack, span: Span, without_fix: Span | None) -> Finding:
    """A position that the autopilot lost; with the GPS outage that it lost it by."""
    begin, end = span
    words, then = f"no position for {end - begin:.1f} s", "to the end"
    if end < position.t[-1]:
        i, j = np.searchsorted(position.t, begin, side="right") - 1, np.searchsorted(position.t, end)
        then = f"in which it moved by {length(position.position[j] - position.position[i]):.1f} m"
    words = f"{words}, {then}"
    if without_fix is not None:
        words += f"; no GPS fix from {without_fix[0]:.1f} to {without_fix[1]:.1f} s"
    advice = "The estimator had lost its position: GPS outage. Windows over it are left out."
    return Finding("position_lost", "autopilot", "warning", begin, end, words, advice, undecided=True)


def _gaps(flight: Flight, received: Array, gaps: BoolArray, t: Array) -> list[Span]:
    """Where in flight nothing of times t (N,) s is heard for long, from the first on, though the rest is."""
    if not len(t):
        return []
    end = min(flight.start + flight.duration, float(received[-1]))
    begins, ends = t, np.append(t[1:], max(end, t[-1]))
    out = []
    for begin, stop in np.column_stack([begins, ends])[ends - begins > harm.GPS_OUTAGE_S].tolist():
        for part in in_the_air(flight):
            first, last = max(begin, part.start), min(stop, part.end)
            if last - first - _not_received(received, gaps, first, last) > harm.GPS_OUTAGE_S:
                out.append((first, last))
    return out


def _overlap(one: Span, other: Span) -> bool:
    return min(one[1], other[1]) > max(one[0], other[0])


def _not_received(received: Array, gaps: BoolArray, start: float, end: float) -> float:
    """For how long (s) the rest is missing too."""
    before = np.flatnonzero(gaps)
    missing = np.minimum(received[before + 1], end) - np.maximum(received[before], start)
    return float(missing[missing > 0].sum())
