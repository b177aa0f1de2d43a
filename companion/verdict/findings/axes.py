"""Findings about what the readings mean: the IMU's units, and its axes, against the autopilot and other sensors.

Two sensors that are turned against each other do not tell which of them sits otherwise than its setting says. A third
does: gravity, or another IMU that reads as one of them. That a multirotor flew says that its IMU was right, for with a
board that is turned it leans another way than it was told to; but no log shows how it was flown, so it decides nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np

from companion.comparison import (
    UPRIGHT,
    Comparison,
    down_in_body,
    ends_of,
    flown,
    length,
    means_between,
    phases,
    turn_between,
)
from companion.constants import check, harm, healthy, num
from companion.estimation import BestEstimate, Reading, TurnedCompass, righted, turned_compasses
from companion.model import (
    STANDARD_GRAVITY,
    Array,
    BoolArray,
    Flight,
    ImuTrack,
    orientation_name,
    orientation_number,
    orientations,
)
from companion.strapdown import quaternion
from companion.verdict.fault_interval import SENSOR_WORDS
from companion.verdict.finding import Cause, Finding
from companion.verdict.findings.settings import board_orientation, compass_orientation, is_internal, mended

_DOES = {"gyro": "turns", "accel": "feels"}
_THOUSAND = {1e3: "thousandths, where whole units are meant", 1e-3: "whole units, where thousandths are meant"}
_UNITS = {
    "gyro": {np.degrees(1.0): "degrees, where radians are meant", np.radians(1.0): "radians, where degrees are meant"}
    | _THOUSAND,
    "accel": {STANDARD_GRAVITY: "m/s², where g are meant", 1.0 / STANDARD_GRAVITY: "g, where m/s² are meant"}
    | _THOUSAND,
}


@dataclass(frozen=True, slots=True, eq=False)
class _Motion:
    """Means over windows, (M, 3) in the body, by autopilot and IMU: turns in rad/s, specific forces in g."""

    turn: Array  # of the autopilot's attitude
    gyro: Array
    pull: Array  # of its velocity, less gravity
    accel: Array

    def misfit(self, rotation: Array) -> tuple[float, float]:
        """Median over windows for forces, g, and turns, rad/s, of readings that are turned by a rotation (3, 3)."""
        forces, turns = self.pull - self.accel @ rotation.T, self.turn - self.gyro @ rotation.T
        return float(np.median(length(forces))), float(np.median(length(turns)))

    def only(self, used: BoolArray) -> _Motion:
        """Some of the windows (M,)."""
        return _Motion(self.turn[used], self.gyro[used], self.pull[used], self.accel[used])


def meaning_findings(flight: Flight, comparison: Comparison) -> Iterator[Finding]:
    """The IMU's readings are not what they are taken for: of other units, or of other axes."""
    track, motion = comparison.track, _motion(comparison)
    if motion is None:
        return
    units = [*_unit_findings(track, motion)]
    yield from units
    fitting = None if units else _fitting(motion)
    if fitting is not None:
        turn, how = fitting
        beside = [motion for other in _others(flight, track) if (motion := _beside(track, other)) is not None]
        alone = any(sum(motion.misfit(turn.T)) < harm.AXES_MISFIT for motion in beside)  # read as one turned so
        yield _wrong(track, how, _mending(flight, track, turn, alone=alone))
    elif not units and not comparison.has_position:  # no velocity that would have to follow from the forces
        yield from _weight_findings(track, motion)


def turned_others(
    flight: Flight, track: ImuTrack, faults: Sequence[Finding], best: BestEstimate | None
) -> list[Finding]:
    """Other IMUs of the vehicle that are turned against one, which is itself in order by faults, those of its readings.

    Or of other units than that one. Which of two that are turned is told by a compass, that reads the Earth's field in
    the axes of one of them; without one neither is accused.
    """
    if any(f.kind in _CAUSES for f in faults):
        return []
    compass = best is not None and "compass" in best.residuals
    against = best is not None and any(one.kind == "compass_turn" for one in best.explained)
    against |= any(f.kind == "compass_orientation" for f in faults)
    out = []
    for other in _others(flight, track):
        motion = _beside(track, other)
        if motion is None:
            continue
        if units := [*_unit_findings(other, motion, f"IMU {track.instance} ({track.source})")]:
            cause, whose = Cause("units_wrong", "imu", float(other.t[0]), imu=other.instance), f"IMU {other.instance}"
            words = [f"{whose} ({other.source}): {f.evidence}" for f in units]
            out += [replace(f, evidence=w, headline=w, cause=cause) for f, w in zip(units, words, strict=True)]
            continue
        if (fitting := _fitting(motion)) is None:
            continue
        turn, how = fitting
        evidence = f"IMU {other.instance} ({other.source}), beside IMU {track.instance} ({track.source}): {how}"
        cause = Cause("axes_wrong", "imu", float(other.t[0]), imu=other.instance)
        finding = _wrong(other, evidence, _mending(flight, other, turn, alone=True))
        finding = replace(finding, headline=evidence, cause=cause)
        if not compass or against:
            evidence = f"{evidence}; which of the two sits so, or is set so, cannot be told"
            finding = replace(finding, side="data", severity="warning", evidence=evidence, headline="", undecided=True)
        out.append(finding)
    return out


def righted_compasses(
    flight: Flight, best: BestEstimate, without_compass: Callable[[Flight], BestEstimate]
) -> tuple[Flight, list[Finding]]:
    """The flight with compasses turned so that they read as the IMU does, and a finding for each that is turned.

    As it is where none is. best, without_compass: as for `turned_compasses`.
    """
    turned = turned_compasses(flight, best, without_compass)
    if not turned:
        return flight, []
    track = flight.imu(best.imu.source)
    told = [_which_is_turned(flight, track, orientations()[one.orientation]) for one in turned]
    if "imu" not in told:
        pairs = zip(turned, told, strict=True)
        return righted(flight, turned), [_finding(flight, one, best, which) for one, which in pairs]
    back = quaternion.conjugate(orientations()[turned[told.index("imu")].orientation])
    number, _ = orientation_number(back)
    evidence = f"it is turned by {orientation_name(number)} against another IMU and the compass"
    mending = _mending(flight, track, quaternion.to_matrix(back), alone=True)
    return righted(flight, turned), [_wrong(track, evidence, mending)]


def _which_is_turned(flight: Flight, track: ImuTrack, turn: Array) -> str:
    """Which of compass and IMU is turned against the other by a rotation (4,), from the compass to the IMU.

    By the other IMUs, which read as one of the two; "" where none does so clearly, or they differ.
    """
    said = set()
    for other in _others(flight, track):
        if (motion := _beside(track, other)) is None:
            continue
        as_imu, as_compass = (sum(motion.misfit(rotation)) for rotation in (np.eye(3), quaternion.to_matrix(turn)))
        if min(as_imu, as_compass) < min(harm.AXES_MISFIT, check.ORIENTATION_BETTER * max(as_imu, as_compass)):
            said.add("compass" if as_imu < as_compass else "imu")
    return said.pop() if len(said) == 1 else ""


def _finding(flight: Flight, one: TurnedCompass, best: BestEstimate, which: str) -> Finding:
    """About a compass and an IMU that are turned against each other; which: of them is, by the other IMUs."""
    turn = orientations()[one.orientation]
    internal = bool(is_internal(flight, one.instance))
    sure = which == "compass" or _gravity_tells(best, turn)
    board = board_orientation(flight)
    compass = mended(flight, compass_orientation(flight, one.instance), turn, board if internal else "")
    who = f"the compass ({one.source}) {'is turned' if sure else 'and the IMU are turned against each other'}"
    how = f"{who} by {orientation_name(one.orientation)} since the start of the log"
    better = f"{np.degrees(one.left):.0f}° off the Earth's field, as they are {np.degrees(one.off):.0f}°"
    words, (begin, end) = f"{how}: so turned, its readings are {better}", ends_of(best.t)
    if not sure:
        evidence = f"{words}; which of them sits so, or is set so, cannot be told by their readings"
        if flight.vehicle.type in UPRIGHT and flown(phases(flight)):
            evidence += ", but few multirotors with a turned IMU would have flown: rather the compass"
        turned_board = mended(flight, board, quaternion.conjugate(turn))
        advice = f"Set {compass} if the compass is mounted so, or {turned_board} if the board is."
        if internal:
            advice = f"The compass is set to be internal, turned with {board}: if it is external, set {compass}."
        return Finding("compass_orientation", "data", "warning", begin, end, evidence, advice, undecided=True)
    size = float(2.0 * np.arccos(min(abs(turn[0]), 1.0)))
    cause = Cause("compass_orientation", "data", begin, sensor="compass", size=size, unit="rad")
    advice = f"Set {compass}, and calibrate the compass again."
    if internal:
        advice = f"It is set to be internal, turned with {board}: if it is external, say so and set {compass}."
    return Finding("compass_orientation", "data", "warning", begin, end, words, advice, words, cause)


def _gravity_tells(best: BestEstimate, turn: Array) -> bool:
    """Whether gravity says that the IMU cannot be turned by the reverse of a rotation (4,).

    It does of one that leaves down not where it is: half of the time the vehicle is nearly upright.
    """
    half = np.cos(num.ORIENTATION_HALF_RAD)
    upright = float(np.median(down_in_body(best.q_ned_frd)[:, 2])) > half
    return bool(upright and down_in_body(turn[None])[0, 2] < half)


_CAUSES = ("axes_wrong", "units_wrong", "frozen")  # readings that say nothing of how another IMU sits


def _others(flight: Flight, track: ImuTrack) -> list[ImuTrack]:
    return [one for one in flight.each_imu() if one.instance != track.instance]


def _mending(flight: Flight, track: ImuTrack, turn: Array, *, alone: bool) -> str:
    """What to set so that an IMU whose readings a rotation (3, 3) takes into the body is read so.

    alone: the other IMUs of the board are in order.
    """
    name = board_orientation(flight)
    if not alone:
        mending = mended(flight, name, quaternion.from_matrix(turn))
        return f"Set {mending}, as the board is mounted, and calibrate again."
    own = f"CAL_GYRO{track.instance}_ROT and CAL_ACC{track.instance}_ROT, if it is external, or "
    look = f"look at {own if name == 'SENS_BOARD_ROT' else ''}how this IMU's own driver is told to turn it"
    return f"Another IMU of the vehicle is not turned, so {name} is right: {look}."


def _motion(comparison: Comparison) -> _Motion | None:
    """Of the windows in which the autopilot's attitude is known; None where they are too few."""
    track, reference = comparison.track, comparison.reference
    span = round(check.AXES_WINDOW_S * track.rate_hz)
    if span < check.AXES_MIN_SAMPLES:
        return None
    start = np.arange(0, len(track) - span, span)
    end = start + span
    known = reference.attitude_known[start] & reference.attitude_known[end]
    known &= track.t[end] - track.t[start] < 2 * check.AXES_WINDOW_S
    if known.sum() < check.AXES_MIN_WINDOWS:
        return None
    start, end = start[known], end[known]
    begin, arrived = reference.at(start), reference.at(end)
    turned = turn_between(begin.q_ned_frd, arrived.q_ned_frd)
    seconds = (track.t[end] - track.t[start])[:, None]
    moving = (reference.position_known[start] & reference.position_known[end])[:, None]
    moved = np.where(moving, arrived.velocity - begin.velocity, 0.0)
    force = moved / seconds / STANDARD_GRAVITY - [0.0, 0.0, 1.0]
    half = quaternion.exp(0.5 * turned)  # to the middle of the window, which its mean force belongs to
    pull = quaternion.rotate(quaternion.conjugate(quaternion.multiply(begin.q_ned_frd, half)), force)
    gyro, accel = (means_between(readings, start, end) for readings in (track.gyro, track.accel / STANDARD_GRAVITY))
    return _Motion(turned / seconds, gyro, pull, accel)


def _weight_findings(track: ImuTrack, motion: _Motion) -> Iterator[Finding]:
    """The accelerometer feels the vehicle's weight upside down along the vertical of the autopilot's attitude.

    On average it feels it upright, however the vehicle turns and pulls, and nothing where the attitude tumbles.
    """
    felt = float((motion.accel * motion.pull).sum() / (motion.pull**2).sum())
    if felt * check.UNIT_MIN_FACTOR < -1.0:
        feels = f"along the vertical of the autopilot's attitude the accelerometer feels {felt:.2f} g on average"
        evidence = f"{feels}, where weight is 1; it cannot be told which of the two is wrong"
        advice = f"Look at the signs and axes of {track.source} where it is sent. GPS in the log would tell."
        yield Finding("axes_wrong", "data", "warning", *ends_of(track.t), evidence, advice, undecided=True)


def _unit_findings(track: ImuTrack, motion: _Motion, by: str = "the autopilot's estimate") -> Iterator[Finding]:
    """A sensor reads a multiple of the motion, the same about every axis: no fault of a sensor, but of its units."""
    moves = length(motion.turn) > healthy.AXES_MISFIT  # less is what a bias and an estimate that aligns come to
    turn, gyro = motion.turn[moves], motion.gyro[moves]
    pairs = {"gyro": _times(turn, gyro, biased=True), "accel": _times(motion.pull, motion.accel)}
    for sensor, times in pairs.items():
        if times is None or max(times, 1.0 / times) < check.UNIT_MIN_FACTOR:
            continue
        meant = (words for known, words in _UNITS[sensor].items() if abs(times / known - 1.0) < check.UNIT_TOLERANCE)
        reads = f"{SENSOR_WORDS[sensor]} reads {times:.3g} times what the vehicle {_DOES[sensor]}"
        alike = f"about every axis alike: {next(meant, 'as the counts of a converter would')}"
        evidence = f"{reads} by {by}, {alike}"
        mavlink = "MAVLink has mrad/s and thousandths of g in SCALED_IMU and RAW_IMU, rad/s and m/s² in HIGHRES_IMU"
        advice = f"Mend the units where {track.source} is sent: {mavlink}. Until then take another IMU: --imu."
        yield Finding("units_wrong", "imu", "error", *ends_of(track.t), evidence, advice)


def _times(own: Array, read: Array, *, biased: bool = False) -> float | None:
    """By what factor readings (M, 3) are larger than the motion (M, 3), however they are turned; None if they differ.

    A matrix that makes the ones of the others, about the axes about which there is motion, is then so many times a
    rotation or a mirror: its singular values are alike. biased: what is constant tells nothing.
    """
    motion, reading = length(own), length(read)
    if len(motion) < check.AXES_MIN_WINDOWS:
        return None
    busy = (motion >= np.median(motion)) & (motion > 0) & (reading > 0)
    if busy.sum() < check.AXES_MIN_WINDOWS:
        return None
    times = reading[busy] / motion[busy]
    usual = np.abs(np.log(times / np.median(times))) < check.UNIT_FACTOR_LOG
    if usual.mean() < check.UNIT_FACTOR_SHARE:
        return None
    own, read = own[busy][usual], read[busy][usual]  # without an attitude that is set, and spikes
    if biased:
        own, read = own - own.mean(axis=0), read - read.mean(axis=0)
    much, axes = np.linalg.eigh(own.T @ own)
    if not much[-1] > 0:
        return None
    motion = own @ axes[:, much > check.UNIT_AXIS_SHARE * much[-1]]
    by, *_ = np.linalg.lstsq(motion, read)
    sizes = np.linalg.svd(by, compute_uv=False)
    explained = ((read - motion @ by) ** 2).sum() < check.UNIT_REST * (read**2).sum()
    alike = sizes[0] < np.exp(check.UNIT_FACTOR_LOG) * sizes[-1] and explained
    return float(np.sqrt(sizes[0] * sizes[-1])) if alike else None


def _fitting(motion: _Motion) -> tuple[Array, str] | None:
    """The IMU's axes are not the body's: another of the 24 right-handed rotations fits turns and gravity far better.

    That rotation (3, 3), the body from the IMU's axes, and in words. Turns are those of the autopilot's attitude, the
    force is that of its velocity, less gravity.
    """
    moved = length(motion.turn) + length(motion.pull[:, :2])
    motion = motion.only(moved >= np.median(moved))  # at rest every heading fits
    misfit = {name: motion.misfit(rotation) for name, rotation in _ROTATIONS.items()}
    total = {name: sum(parts) for name, parts in misfit.items()}
    best = min(total, key=lambda name: total[name])
    own = total["x y z"]
    # where little is wrong, turns and forces both have to say so: else it is a bias
    pairs = zip(misfit[best], misfit["x y z"], strict=True)
    both = all(better < 0.5 * worse or worse < healthy.AXES_MISFIT for better, worse in pairs)
    if total[best] < 0.3 * own and (own > harm.AXES_MISFIT or (own > harm.AXES_MIN_MISFIT and both)):
        names, better = best.replace(" ", ", "), own / total[best]
        how = f"forward, right, down are the IMU's ({names}): so the readings fit {better:.0f} times better"
        return _ROTATIONS[best], how
    free = _wahba(np.concatenate([motion.turn, motion.pull]), np.concatenate([motion.gyro, motion.accel]))
    if free is None:
        return None
    angle = quaternion.log(quaternion.from_matrix(free))
    forces, turns = motion.misfit(free)
    # a tilted board and an offset of the accelerometer look alike in level flight: the turns have to say so
    if not (
        length(angle) > healthy.TRIM_RAD
        and misfit["x y z"][1] > healthy.AXES_MISFIT
        and turns < 0.4 * misfit["x y z"][1]
        and forces + turns < 0.3 * own
    ):
        return None
    x, y, z = angle / length(angle)
    turned = f"the board is turned by {np.degrees(length(angle)):.0f}° about ({x:.1f}, {y:.1f}, {z:.1f})"
    return free, f"{turned}: so the readings fit {own / (forces + turns):.0f} times better"


def _beside(track: ImuTrack, other: ImuTrack) -> _Motion | None:
    """What two IMUs read, means over the same windows, the first as the motion of the other; None for too few."""
    span, rate = check.AXES_WINDOW_S, min(track.rate_hz, other.rate_hz)
    edges = np.arange(max(track.t[0], other.t[0]), min(track.t[-1], other.t[-1]), span)
    if span * rate < check.AXES_MIN_SAMPLES or len(edges) <= check.AXES_MIN_WINDOWS:
        return None
    means, full = [], np.ones(len(edges) - 1, np.bool_)
    for one in (track, other):
        start, end = (np.searchsorted(one.t, at) for at in (edges[:-1], edges[1:]))
        full &= end - start > 0.5 * span * one.rate_hz
        end = np.maximum(end, start + 1)
        means.append([means_between(values, start, end) for values in (one.gyro, one.accel / STANDARD_GRAVITY)])
    if full.sum() < check.AXES_MIN_WINDOWS:
        return None
    (turn, pull), (gyro, accel) = means
    return _Motion(turn, gyro, pull, accel).only(full)


def misread_finding(track: ImuTrack, reading: Reading, best: BestEstimate) -> Finding:
    """An IMU whose axes are mirrored or exchanged, by the aiding sensors of the best estimate, which has GPS."""
    aiding = "GPS, compass and gravity" if "compass" in best.residuals else "GPS and gravity"
    evidence = f"{reading.words}: read so, it fits {aiding} with {reading.fits:.0f} times less noise"
    return _wrong(track, evidence, "Set the board's orientation to how it is mounted, and calibrate again.")


def _wrong(track: ImuTrack, evidence: str, advice: str) -> Finding:
    return Finding("axes_wrong", "imu", "error", *ends_of(track.t), evidence, advice)


def _wahba(body: Array, imu: Array) -> Array | None:
    """The rotation (3, 3) that turns the IMU's vectors (M, 3) best into the body's; None where it is not determined.

    Markley, Attitude determination using vector observations and the singular value decomposition, 1988.
    """
    u, size, v = np.linalg.svd(body.T @ imu)
    if size[1] < 0.01 * size[0]:  # all vectors along one line
        return None
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u) * np.linalg.det(v)]) @ v)


def _rotations() -> dict[str, Array]:
    """The 24 right-handed ways to name three axes: "y -x z" takes the IMU's y as forward, its -x as right."""
    rotations = {}
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            if np.linalg.det(matrix) > 0:
                names = (f"{'-' if sign < 0 else ''}{'xyz'[axis]}" for sign, axis in zip(signs, order, strict=True))
                rotations[" ".join(names)] = matrix
    return rotations


_ROTATIONS = _rotations()
