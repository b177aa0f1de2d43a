"""The parts of a flight: before its estimator has aligned, standing, in the air, landed, after a loss of control.

What is judged later is what lies between: while the estimator aligns, its heading slews by 17° without any gyro and its
position jumps by hundreds of metres (ArduPilot: "DCM active", "EKF3 IMU0 initialised"); after an impact everything that
a vehicle measures is true and means nothing. All of it is derived from what the vehicle says (arming, take-off, flags
of its estimator, texts) and from how it moves, whatever the format of the log.
"""

from __future__ import annotations

import re
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from companion.model import Array, AttitudeTrack, ControlTrack, Flight, Phase, PhaseKind

BoolArray = npt.NDArray[np.bool_]
Span = tuple[float, float]

_ATTITUDE, _POSITION = 0b1, 0b11000  # ESTIMATOR_STATUS_FLAGS: attitude; horizontal position, relative or absolute
_STARTING = re.compile(
    r"AHRS: (?:DCM active|EKF\d active)|EKF\d IMU\d (?:initialised|tilt alignment complete|is using GPS|.*initial yaw)",
    re.ASCII,
)
_RECEIVER = re.compile(r"GPS \d: detected", re.ASCII)
_CRASHED = re.compile(
    r"Crash: Disarming|crash check: error|[Aa]ttitude failure|[Cc]ritical failure|[Ff]light termination", re.ASCII
)

_YOUNG_S = 60.0  # since boot: until then an estimator may still be finding its heading
_SETTLED = np.radians(2.0)  # heading, at rest
_BIAS = 0.02  # rad/s, of a gyro at rest
_STILL = 0.03  # rad/s: a vehicle that is not being turned
_MOVING = 0.5  # m/s, or m above where it was armed
_ENDING_S = 1.0
_SHAKEN = 0.05  # rad/s rms over a second, for a vehicle without a position

_UPRIGHT = ("QUADROTOR", "HEXAROTOR", "OCTOROTOR", "TRICOPTER", "DODECAROTOR", "COAXIAL", "HELICOPTER")
_OVER = np.radians(60.0)  # from level, for what flies by thrust alone; or from the desired attitude, for every vehicle
_TUMBLING = 10.0  # rad/s
_FAST = 2.0  # rad/s: what leads to a loss of control
_RECOVERED_S = 2.0  # in control for so long, the vehicle has been caught: a flip is none
_LASTING_S = 0.3
_BEFORE_S = 3.0  # so long before the vehicle is over, control may have been lost
_FRESH_S = 0.5  # age of a desired attitude that still holds
_FOLLOWS_S = 2.0  # that a vehicle may take to follow another desired attitude


def phases(flight: Flight) -> tuple[Phase, ...]:
    """The parts of a flight in order of time, without gaps between them; one, without length, of a flight of none."""
    begin, end = flight.start, flight.start + flight.duration
    airborne = _airborne(flight, _armed(flight))
    takeoff = airborne[0][0] if airborne else end
    aligned, why = _aligned(flight, takeoff)
    lost = _lost(flight, airborne)
    parts = [Phase(begin, aligned, "aligning", why)] if aligned > begin else []
    cuts = [aligned, *(edge for span in airborne for edge in span if edge > aligned), end]
    aloft = any(first <= aligned < last for first, last in airborne)
    for start, stop in pairwise(cuts):
        kind: PhaseKind = "flight" if aloft else "landed" if airborne and start >= airborne[-1][1] else "standing"
        if stop > start:
            parts.append(Phase(start, stop, kind, _REASONS[kind]))
        aloft = not aloft
    if lost is None:
        return tuple(parts) or (Phase(begin, end, "standing", _REASONS["standing"]),)
    before = [Phase(p.start, min(p.end, lost[0]), p.kind, p.reason) for p in parts if p.start < lost[0]]
    return (*before, Phase(lost[0], end, "impact", lost[1]))


_REASONS: dict[PhaseKind, str] = {
    "standing": "not in the air",
    "flight": "armed and moving",
    "landed": "after the last landing",
}


def _armed(flight: Flight) -> list[Span] | None:
    """When the vehicle was armed; None where the log does not tell."""
    said = [(event.t, event.kind == "armed") for event in flight.events if event.kind in ("armed", "disarmed")]
    if not said:
        return None
    spans: list[Span] = []
    since = None if said[0][1] else flight.start  # a log on board begins when the vehicle is armed
    for t, armed in said:
        if since is not None:  # armed again: older logs do not say that it was disarmed in between
            spans.append((since, t))
        since = t if armed else None
    return spans if since is None else [*spans, (since, flight.start + flight.duration)]


def _airborne(flight: Flight, armed: list[Span] | None) -> list[Span]:
    """What the vehicle itself says; where it does not, from first to last motion of each time armed."""
    said = [(e.t, e.text in ("took off", "in the air")) for e in flight.events if e.text in _TOLD]
    flown = []
    for begin, end in [(flight.start, flight.start + flight.duration)] if armed is None else armed:
        moving = _moving(flight, begin, end, by_position=armed is not None)
        mine = [(t, up) for t, up in said if begin <= t <= end]
        if not moving and not any(up for _, up in mine):
            continue
        first = min([t for t, up in mine if up] + moving[:1])
        last = (end if mine[-1][1] else mine[-1][0]) if mine else moving[-1]
        if flight.vehicle.type in _ON_THE_GROUND and armed is not None:
            last = end  # it stops on its way as well
        over = flight.start + flight.duration
        whole = end >= over and last > over - _ENDING_S  # the log ends in the air
        flown.append((first, over if whole else max(last, first)))
    return flown


_ON_THE_GROUND = ("GROUND_ROVER", "SURFACE_BOAT")
_TOLD = ("took off", "in the air", "landed")


def _moving(flight: Flight, begin: float, end: float, *, by_position: bool) -> list[float]:
    """The first and the last moment of motion in a stretch; empty where there is none.

    Of a vehicle that was armed when the log begins nothing tells where the ground is, and in the air it may stand
    still: it moves to the end, but where it has come down by half of its heights, to where it is at the end.
    """
    track = flight.position if by_position else None
    if track is not None:
        inside = (track.t >= begin) & (track.t <= end)
        t, height = track.t[inside], -track.position[inside, 2]
        if len(t) > 1:
            speed = np.linalg.norm(track.velocity[inside], axis=1)
            moving, until = (t[(speed > _MOVING) | (np.abs(height - height[ground]) > _MOVING)] for ground in (0, -1))
            if not len(moving):
                return []
            lost = t[-1] < end - _ENDING_S and moving[-1] > t[-1] - _ENDING_S
            if begin > flight.start or lost:
                return [float(moving[0]), end if lost else float(moving[-1])]
            landed = height[-1] < 0.5 * (height.min() + height.max()) and np.ptp(height) > _MOVING
            return [float(moving[0]), float(until[-1] if landed and len(until) else t[-1])]
    t, rates = _rates(flight)
    if not len(t):
        return []
    inside = (t >= begin) & (t <= end)
    t, turning = t[inside], np.square(rates[inside] - _rest(rates)).sum(axis=1)
    if len(t) < 2:
        return []
    second = np.floor(t - t[0]).astype(np.int64)
    rms = np.sqrt(np.bincount(second, turning) / np.maximum(np.bincount(second), 1))
    shaken = t[rms[second] > _SHAKEN]
    return [float(shaken[0]), float(shaken[-1])] if len(shaken) else []


def _rates(flight: Flight) -> tuple[Array, Array]:
    """Times and body rates by the IMU, else by the autopilot."""
    name = flight.default_imu
    if name is not None:
        return flight.imus[name].t, flight.imus[name].gyro
    return (np.zeros(0), np.zeros((0, 3))) if flight.attitude is None else (flight.attitude.t, flight.attitude.rates)


def _rest(rates: Array) -> Array:
    """(3,) rad/s that a gyro reads at rest: what it reads mostly, but no more than a bias; the rest is an even turn."""
    return np.asarray(np.clip(np.median(rates, axis=0), -_BIAS, _BIAS))


def _aligned(flight: Flight, takeoff: float) -> tuple[float, str]:
    """When the estimator knew where it is and how it lies, and what tells; the flight's begin where it always did."""
    best, why = flight.start, ""
    texts = [said for said in flight.texts if said.t < takeoff and _STARTING.match(said.text)]
    if texts:
        best, why = texts[-1].t, texts[-1].text
        if not any("using GPS" in said.text for said in texts) and any(_RECEIVER.match(t.text) for t in flight.texts):
            best, why = takeoff, "the estimator does not use the GPS yet"
    estimator = flight.series.get("estimator")
    if estimator is not None and "flags" in estimator.columns:
        known = np.isfinite(estimator["flags"])
        t, flags = estimator.t[known], estimator["flags"][known].astype(np.int64)
        placed = (flags & _ATTITUDE != 0) & (flags & _POSITION != 0)
        valid = placed if placed.any() else flags & _ATTITUDE != 0
        if valid.any():
            told = "the estimator's flags: " + ("position" if placed.any() else "attitude")
            best, why = (flight.start, "") if valid[0] else (float(t[valid][0]), told)
    young = why or flight.start < _YOUNG_S
    if young and (settled := _settled(flight, min(takeoff, flight.start + _YOUNG_S))) > best:
        best, why = settled, "the heading turns at rest"
    return min(best, takeoff), why


def _settled(flight: Flight, until: float) -> float:
    """The last time before `until` at which a vehicle at rest had another heading than then."""
    track = flight.attitude
    t, rates = _rates(flight)
    early = t <= until
    if track is None or not early.any():
        return flight.start
    turning = np.linalg.norm(rates[early] - _rest(rates[early]), axis=1) > _STILL
    since = float(t[early][turning][-1]) if turning.any() else flight.start
    before = np.flatnonzero((track.t <= until) & (track.t > since))
    if len(before) < 2 or (_down(track.q_ned_frd[before])[:, 2] < np.cos(_OVER)).any():  # on its side it has no heading
        return flight.start
    w, x, y, z = track.q_ned_frd[before].T
    heading = np.unwrap(np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z))
    off = np.flatnonzero(np.abs(heading - heading[-1]) > _SETTLED)
    return float(track.t[before[off[-1]]]) if len(off) else flight.start


def _lost(flight: Flight, airborne: list[Span]) -> tuple[float, str] | None:
    """When control was lost for good, and what tells; None where it was not."""
    words = [*((said.t, said.text) for said in flight.texts), *((event.t, event.text) for event in flight.events)]
    crashed = next(((t, text) for t, text in words if _CRASHED.search(text)), None)
    track = flight.attitude
    if track is None or not airborne:
        return crashed if airborne else None
    over, what = _over(flight, track)
    armed = _armed(flight)
    for first, last in _runs(over):
        start, stop = float(track.t[first]), float(track.t[last])
        flying = next((span for span in airborne if span[0] <= start <= span[1] + 1.0), None)
        if flying is None or armed is None or _recovered(track.t, over, last, flying[1]):
            continue
        if stop - start < _LASTING_S:
            continue
        onset = _onset(flight, start)
        return (min(onset, crashed[0]) if crashed and crashed[0] >= flying[0] else onset), what
    return crashed if crashed and any(begin <= crashed[0] <= end + 10.0 for begin, end in airborne) else None


def _over(flight: Flight, track: AttitudeTrack) -> tuple[BoolArray, str]:
    """(N,) where the attitude is beyond control, and how that shows."""
    w, x, y, z = track.q_ned_frd.T
    level = w * w - x * x - y * y + z * z  # cosine of the angle between body and world down
    over = (level < np.cos(_OVER)) & (flight.vehicle.type in _UPRIGHT)
    if flight.control is not None and len(flight.control):
        followed, unfollowed = _as_desired(track, flight.control)
        over = (over & ~followed) | unfollowed
    return over | (np.linalg.norm(track.rates, axis=1) > _TUMBLING), "the attitude is beyond control until the end"


def _as_desired(track: AttitudeTrack, control: ControlTrack) -> tuple[BoolArray, BoolArray]:
    """(N,), (N,) where the attitude is about the desired one; and far from it, not because that has just changed.

    The third axes alone: heading may be anything without control being lost.
    """
    t, down, desired = track.t, _down(track.q_ned_frd), _down(control.q_ned_frd)
    last = np.maximum(np.searchsorted(control.t, t, side="right") - 1, 0)
    fresh, alike = np.abs(t - control.t[last]) < _FRESH_S, (down * desired[last]).sum(axis=1)
    apart = np.asarray(fresh & (alike < np.cos(_OVER)))
    for begin, end in _runs(apart):
        lately = slice(*np.searchsorted(control.t, [t[begin] - _FOLLOWS_S, t[begin]]))
        if (desired[lately] @ down[begin] > np.cos(0.5 * _OVER)).any():
            apart[begin : min(np.searchsorted(t, t[begin] + _FOLLOWS_S), end + 1)] = False
    return np.asarray(fresh & (alike > np.cos(0.5 * _OVER))), apart


def _down(q: Array) -> Array:
    """World down in the body frame, (N, 3)."""
    w, x, y, z = q.T
    return np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z])


def _runs(mask: BoolArray) -> list[tuple[int, int]]:
    """First and last index of each stretch."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _recovered(t: Array, over: BoolArray, last: int, landed: float) -> bool:
    """Whether a stretch in control of some length follows in the air."""
    calm = _runs(~over[last:])
    return any(min(float(t[last + b]), landed) - float(t[last + a]) > _RECOVERED_S for a, b in calm)


def _onset(flight: Flight, over: float) -> float:
    """Where the turning began that ended in being over."""
    t, rates = _rates(flight)
    near = (t <= over) & (t >= over - _BEFORE_S)
    slow = t[near][np.linalg.norm(rates[near], axis=1) < _FAST]
    return min(float(slow[-1]), over) if len(slow) else over
