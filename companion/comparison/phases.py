"""The parts of a flight: before its estimator has aligned, standing, in the air, landed, out of control.

What is judged later is what lies between: while the estimator aligns, its heading slews by 17° without any gyro and its
position jumps by hundreds of metres (ArduPilot: "DCM active", "EKF3 IMU0 initialised"); in a fall and after an impact
everything that a vehicle measures is true and means nothing, until it is armed again or has been caught: a gyro at the
end of its range misleads the estimator, and a wreck reads forces of thousands of m/s². All of it is derived from what
the vehicle says (arming, take-off, flags of its estimator, texts) and from how it moves, whatever the log's format.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from companion.comparison.reference import length, window, within, within_any
from companion.comparison.spans import Span, runs, spans
from companion.constants import check, harm, healthy
from companion.model import Array, AttitudeTrack, BoolArray, ControlTrack, Flight, IntArray, Phase, PhaseKind, without

_CRASHED = re.compile(
    r"Crash: Disarming|crash check: error|[Aa]ttitude failure|[Cc]ritical failure|[Ff]light termination", re.ASCII
)
UPRIGHT = (
    "QUADROTOR", "HEXAROTOR", "OCTOROTOR", "TRICOPTER", "DECAROTOR", "DODECAROTOR", "GENERIC_MULTIROTOR", "COAXIAL",
    "HELICOPTER",
)  # fmt: skip
_AT_WILL = ("ACRO", "FLIP")  # modes in which a pilot may turn it over: ArduCopter looks for no crash (crash_check.cpp)


def losses_of_control(flight: Flight, airborne: Sequence[Span]) -> tuple[Phase, ...]:
    """Every loss of control in order of time, to its end: the end of the log where nothing follows.

    airborne: from when to when the vehicle was in the air each time, s.
    """
    over: list[Span] = []
    calm: list[Span] = []
    if flight.attitude is not None:
        beyond = _over(flight, flight.attitude)
        over, calm = (spans(flight.attitude.t, where) for where in (beyond, ~beyond))
    every = [*_turned_over(flight, airborne, over, calm), *_reported_crashes(flight, airborne, calm)]
    losses: list[Phase] = []
    for lost in sorted(every, key=lambda one: one.start):
        if not losses or lost.start >= losses[-1].end:
            losses.append(lost)
    return tuple(losses)


def unjudged(parts: Sequence[Phase]) -> tuple[Span, ...]:
    """The stretches of a flight's phases that are left out of it, s: out of control, and a second before."""
    return tuple((part.start - check.WORTHLESS_S, part.end) for part in parts if part.kind == "impact")


def in_control(parts: Sequence[Phase]) -> tuple[Span, ...]:
    """What lies between them, s; everything where control was never lost."""
    return between(unjudged(parts), np.array([-np.inf, np.inf]))


def between(out: Sequence[Span], t: Array) -> tuple[Span, ...]:
    """What lies between spans in order, s, from the first to the last of times t (N,)."""
    edges = [float(t[0]), *(edge for span in out for edge in span), float(t[-1])]
    return tuple((begin, end) for begin, end in zip(edges[::2], edges[1::2], strict=True) if begin < end)


def controlled(flight: Flight, parts: Sequence[Phase], imu: str) -> Flight:
    """The flight without what was measured out of control; as it is where nothing would be left."""
    seen = without(flight, unjudged(parts))
    left = [seen.imus[imu], *([] if seen.attitude is None else [seen.attitude])]
    return seen if min(map(len, left)) > 1 else flight


def body_rates(flight: Flight) -> tuple[Array, Array]:
    """Times (N,) s and body rates (N, 3) rad/s by the IMU, else by the autopilot."""
    if (name := flight.default_imu) is not None:
        return flight.imus[name].t, flight.imus[name].gyro
    return (np.zeros(0), np.zeros((0, 3))) if flight.attitude is None else (flight.attitude.t, flight.attitude.rates)


def down_in_body(q: Array) -> Array:
    """World down in the body frame, (N, 3), of attitudes (N, 4)."""
    w, x, y, z = q.T
    return np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z])


def _reported_crashes(flight: Flight, airborne: Sequence[Span], calm: Sequence[Span]) -> Iterator[Phase]:
    """Crashes by the vehicle's own words. calm: in control, s."""
    for t, text in [(one.t, one.text) for one in flight.texts] + [(one.t, one.text) for one in flight.events]:
        if _CRASHED.search(text) and any(begin <= t <= end + check.CRASH_REPORTED_S for begin, end in airborne):
            yield Phase(t, _armed_again(flight, calm, t), "impact", text)


def _turned_over(
    flight: Flight, airborne: Sequence[Span], over: Sequence[Span], calm: Sequence[Span]
) -> Iterator[Phase]:
    """Stretches in which the attitude is beyond control, and was not to be. over, calm: beyond control, in it, s."""
    if all(event.kind not in ("armed", "disarmed") for event in flight.events):
        return  # a board that is turned by hand has lost nothing
    free = -np.inf
    lasting = np.array([span for span in calm if span[1] - span[0] > check.CAUGHT_S]).reshape(-1, 2)
    for start, stop in over:
        landed = next((end for begin, end in airborne if begin <= start <= end + check.LANDED_S), None)
        if start < free or landed is None or _at_rest(flight, start):
            continue
        caught = _first_calm(lasting, stop, landed, check.CAUGHT_S)
        intended = caught is not None and (caught - start <= healthy.FLIP_S or _at_will(flight, start))
        if intended or (caught is None and stop - start < harm.OVERTURNED_S):
            continue
        held = _first_calm(lasting, stop, landed, healthy.ALIGNS_S)
        again = _armed_again(flight, calm, stop)
        free = again if held is None else min(held + healthy.ALIGNS_S, again)
        yield Phase(_onset(flight, start), free, "impact", "the attitude is beyond control")


def _first_calm(calm: Array, after: float, landed: float, least_s: float) -> float | None:
    """Where the first stretch in control, of (N, 2), begins that ends after a time and lasts for so long in the air.

    By bisection: what shakes about the limit is beyond it thousands of times.
    """
    for i in range(int(np.searchsorted(calm[:, 1], after, side="right")), len(calm)):
        begin, end = float(calm[i, 0]), float(calm[i, 1])
        if min(end, landed) - begin > least_s:
            return begin
        if begin > landed:
            break
    return None


def _at_will(flight: Flight, over: float) -> bool:
    """Whether a pilot may have turned the vehicle over: by the mode that it was in."""
    modes = [event.text for event in flight.events if event.kind == "mode" and event.t <= over]
    return bool(modes) and modes[-1] in _AT_WILL


def _at_rest(flight: Flight, over: float) -> bool:
    """Whether the vehicle lies still as its attitude turns over: what turns is a gyro, or the estimator."""
    if (name := flight.default_imu) is None:
        return False
    track = flight.imus[name]
    around = track.accel[window(track.t, over - 1.0, over + 1.0)]
    return len(around) > 1 and bool((around.std(axis=0) < healthy.LYING_SCATTER).all())


def _armed_again(flight: Flight, calm: Sequence[Span], lost: float) -> float:
    """The next time that the vehicle was armed and in control, s: it checks its attitude itself before it arms.

    The end of the log where it was not.
    """
    end = flight.start + flight.duration
    armed = next((event.t for event in flight.events if event.kind == "armed" and event.t > lost), None)
    if armed is None or flight.attitude is None:
        return end if armed is None else armed
    since = ((max(begin, armed), stop) for begin, stop in calm)
    return next((begin for begin, stop in since if stop - begin > check.CAUGHT_S), end)


def _over(flight: Flight, track: AttitudeTrack) -> BoolArray:
    """(N,) where the attitude is beyond control."""
    level = down_in_body(track.q_ned_frd)[:, 2]  # cosine of the angle between body and world down
    over = (level < np.cos(harm.OVERTURNED_RAD)) & (flight.vehicle.type in UPRIGHT)
    if flight.control is not None and len(flight.control):
        followed, unfollowed = _as_desired(track, flight.control)
        over = (over & ~followed) | unfollowed
    return np.asarray(over | (np.linalg.norm(track.rates, axis=1) > harm.TUMBLING_RPS))


def _as_desired(track: AttitudeTrack, control: ControlTrack) -> tuple[BoolArray, BoolArray]:
    """(N,), (N,) where the attitude is about the desired one; and far from it, not because that has just changed.

    The third axes alone: heading may be anything without control being lost.
    """
    t, down, desired = track.t, down_in_body(track.q_ned_frd), down_in_body(control.q_ned_frd)
    last = np.maximum(np.searchsorted(control.t, t, side="right") - 1, 0)
    fresh, alike = np.abs(t - control.t[last]) < check.DESIRED_FRESH_S, (down * desired[last]).sum(axis=1)
    apart = np.asarray(fresh & (alike < np.cos(harm.OVERTURNED_RAD)))
    for begin, end in runs(apart):
        lately = window(control.t, t[begin] - healthy.ATTITUDE_FOLLOWS_S, t[begin])
        if (desired[lately] @ down[begin] > np.cos(0.5 * harm.OVERTURNED_RAD)).any():
            apart[begin : min(np.searchsorted(t, t[begin] + healthy.ATTITUDE_FOLLOWS_S), end + 1)] = False
    return np.asarray(fresh & (alike > np.cos(0.5 * harm.OVERTURNED_RAD))), apart


def _onset(flight: Flight, over: float) -> float:
    """Where the turning began that ended in being over."""
    t, rates = body_rates(flight)
    near = within(t, (over - check.LOST_BEFORE_S, over))
    slow = t[near][length(rates[near]) < check.LEADS_TO_TUMBLING_RPS]
    return min(float(slow[-1]), over) if len(slow) else over


_STARTING = re.compile(
    r"AHRS: (?:DCM active|EKF\d active)|EKF\d IMU\d (?:initialised|tilt alignment complete|is using GPS|.*initial yaw)",
    re.ASCII,
)
_RECEIVER = re.compile(r"GPS \d: detected", re.ASCII)


def aligned_at(parts: Sequence[Phase]) -> float:
    """When the estimator had aligned, s, for the last time; minus infinity where it was never seen to align."""
    return max((part.end for part in parts if part.kind == "aligning"), default=-np.inf)


def landed_at(parts: Sequence[Phase]) -> float:
    """s, boot clock, from when on nothing is judged: the last landing; infinite where there is none."""
    return parts[-1].start if parts[-1].kind == "landed" else np.inf


def phases(flight: Flight) -> tuple[Phase, ...]:
    """The parts of a flight in order of time, without gaps between them; one, without length, of a flight of none."""
    begin, end = flight.start, flight.start + flight.duration
    airborne = _airborne(flight, _armed(flight))
    takeoff = airborne[0][0] if airborne else end
    aligned, why = _aligned(flight, takeoff)
    parts = [Phase(begin, aligned, "aligning", why)] if aligned > begin else []
    cuts = [aligned, *(edge for span in airborne for edge in span if edge > aligned), end]
    aloft = any(first <= aligned < last for first, last in airborne)
    for start, stop in pairwise(cuts):
        kind: PhaseKind = "flight" if aloft else "landed" if airborne and start >= airborne[-1][1] else "standing"
        if stop > start:
            parts.append(Phase(start, stop, kind, _REASONS[kind]))
        aloft = not aloft
    parts = parts or [Phase(begin, end, "standing", _REASONS["standing"])]
    losses = losses_of_control(flight, airborne)
    kept = [piece for part in parts for piece in _outside(part, losses)]
    return tuple(sorted([*kept, *losses], key=lambda part: part.start))


def in_the_air(flight: Flight) -> list[Phase]:
    """The parts of a flight in the air."""
    return [part for part in phases(flight) if part.kind == "flight"]


def flown(parts: Sequence[Phase]) -> tuple[Span, ...]:
    """From when to when each flight of a log was, s: a landing ends it, and a loss of control.

    parts: of `phases`. A flight has what lies before its take-off and after its landing; what never left the ground is
    none.
    """
    spans: list[Span] = []
    begin, aloft = parts[0].start, False
    for part in parts:
        if aloft and part.kind in ("impact", "standing", "aligning"):
            spans.append((begin, part.start))
            begin, aloft = part.start, False
        if part.kind == "impact":
            begin = part.end
        aloft |= part.kind == "flight"
    return (*spans, (begin, parts[-1].end)) if aloft else tuple(spans)


def _outside(part: Phase, losses: Sequence[Phase]) -> Iterator[Phase]:
    """What of a part was not out of control."""
    start = part.start
    for lost in losses:
        if lost.start >= part.end or lost.end <= start:
            continue
        if lost.start > start:
            yield replace(part, start=start, end=lost.start)
        start = max(start, lost.end)
    if start < part.end or part.start == part.end:
        yield replace(part, start=start)


_REASONS: dict[PhaseKind, str] = {
    "standing": "not in the air",
    "flight": "armed and moving",
    "landed": "after the last landing",
}


def _armed(flight: Flight) -> list[Span] | None:
    """When the vehicle was armed; None where the log does not tell."""
    reports = [(event.t, event.kind == "armed") for event in flight.events if event.kind in ("armed", "disarmed")]
    if not reports:
        return None
    spans: list[Span] = []
    since = None if reports[0][1] else flight.start  # a log on board begins when the vehicle is armed
    for t, armed in reports:
        if since is not None:  # armed again: older logs do not say that it was disarmed in between
            spans.append((since, t))
        since = t if armed else None
    return spans if since is None else [*spans, (since, flight.start + flight.duration)]


def _airborne(flight: Flight, armed: list[Span] | None) -> list[Span]:
    """What the vehicle itself says; where it does not, from first to last motion of each time armed."""
    reports = [(e.t, e.text in ("took off", "in the air")) for e in flight.events if e.text in AIRBORNE_REPORTS]
    flown = []
    for begin, end in [(flight.start, flight.start + flight.duration)] if armed is None else armed:
        moving = _moving(flight, begin, end, by_position=armed is not None)
        mine = [(t, up) for t, up in reports if begin <= t <= end]
        if not moving and not any(up for _, up in mine):
            continue
        first = min([t for t, up in mine if up] + moving[:1])
        last = (end if mine[-1][1] else mine[-1][0]) if mine else moving[-1]
        if flight.vehicle.type in ON_THE_GROUND and armed is not None:
            last = end  # it stops on its way as well
        over = flight.start + flight.duration
        whole = end >= over and last > over - check.HEARTBEAT_S  # the log ends in the air
        flown.append((first, over if whole else max(last, first)))
    return flown


ON_THE_GROUND = ("GROUND_ROVER", "SURFACE_BOAT")
AIRBORNE_REPORTS = ("took off", "in the air", "landed")


def _moving(flight: Flight, begin: float, end: float, *, by_position: bool) -> list[float]:
    """The first and the last moment of motion in a stretch; empty where there is none.

    Of a vehicle that was armed when the log begins nothing tells where the ground is, and in the air it may stand
    still: it moves to the end, but where it has come down by half of its heights, to where it is at the end.
    """
    track = flight.position if by_position else None
    if track is not None:
        inside = within(track.t, (begin, end))
        t, height = track.t[inside], -track.position[inside, 2]
        if len(t) > 1:
            speed = length(track.velocity[inside])
            least = healthy.REST_MPS
            moving, until = (t[(speed > least) | (np.abs(height - height[ground]) > least)] for ground in (0, -1))
            if not len(moving):
                return []
            lost = t[-1] < end - check.HEARTBEAT_S and moving[-1] > t[-1] - check.HEARTBEAT_S
            if begin > flight.start or lost:
                return [float(moving[0]), end if lost else float(moving[-1])]
            landed = height[-1] < 0.5 * (height.min() + height.max()) and np.ptp(height) > healthy.REST_MPS
            return [float(moving[0]), float(until[-1] if landed and len(until) else t[-1])]
    t, rates = body_rates(flight)
    inside = within(t, (begin, end))
    if inside.sum() < 2:
        return []
    t, turning = t[inside], np.square(rates[inside] - _rest(rates)).sum(axis=1)
    second = np.floor(t - t[0]).astype(np.int64)
    rms = np.sqrt(np.bincount(second, turning) / np.maximum(np.bincount(second), 1))
    shaken = t[rms[second] > harm.ALOFT_RPS]
    return [float(shaken[0]), float(shaken[-1])] if len(shaken) else []


def _rest(rates: Array) -> Array:
    """(3,) rad/s that a gyro reads at rest: what it reads mostly, but no more than a bias; the rest is an even turn."""
    return np.asarray(np.clip(np.median(rates, axis=0), -healthy.REST_GYRO_BIAS_RPS, healthy.REST_GYRO_BIAS_RPS))


def _aligned(flight: Flight, takeoff: float) -> tuple[float, str]:
    """When the estimator knew where it is and how it lies, and what tells; the flight's begin where it always did."""
    best, why = flight.start, ""
    texts = [one for one in flight.texts if one.t < takeoff and _STARTING.match(one.text)]
    if texts:
        best, why = texts[-1].t, texts[-1].text
        if not any("using GPS" in one.text for one in texts) and any(_RECEIVER.match(t.text) for t in flight.texts):
            best, why = takeoff, "the estimator does not use the GPS yet"
    estimator = flight.series.get("estimator")
    if estimator is not None and "flags" in estimator.columns:
        known = np.isfinite(estimator["flags"])
        t, flags = estimator.t[known], estimator["flags"][known].astype(np.int64)
        placed = (flags & check.ATTITUDE_VALID != 0) & (flags & check.POSITION_VALID != 0)
        valid = placed if placed.any() else flags & check.ATTITUDE_VALID != 0
        if valid.any():
            reason = "the estimator's flags: " + ("position" if placed.any() else "attitude")
            best, why = (flight.start, "") if valid[0] else (float(t[valid][0]), reason)
    young = why or flight.start < healthy.EKF_YOUNG_S
    if young and (settled := _settled(flight, min(takeoff, flight.start + healthy.EKF_YOUNG_S))) > best:
        best, why = settled, "the heading turns at rest"
    return min(best, takeoff), why


def _settled(flight: Flight, until: float) -> float:
    """The last time before `until` at which a vehicle at rest had another heading than then."""
    track = flight.attitude
    t, rates = body_rates(flight)
    early = t <= until
    if track is None or not early.any():
        return flight.start
    turning = np.linalg.norm(rates[early] - _rest(rates[early]), axis=1) > healthy.HANDLED_RPS
    since = float(t[early][turning][-1]) if turning.any() else flight.start
    before = np.flatnonzero((track.t <= until) & (track.t > since))
    on_its_side = down_in_body(track.q_ned_frd[before])[:, 2] < np.cos(harm.OVERTURNED_RAD)  # where it has no heading
    if len(before) < 2 or on_its_side.any():
        return flight.start
    w, x, y, z = track.q_ned_frd[before].T
    heading = np.unwrap(np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z))
    off = np.flatnonzero(np.abs(heading - heading[-1]) > healthy.HEADING_SETTLED_RAD)
    return float(track.t[before[off[-1]]]) if len(off) else flight.start


def flight_of(parts: Sequence[Phase], t: Array) -> IntArray:
    """(N,) which flight of the log each time, s, is of."""
    return np.searchsorted([begin for begin, _ in flown(parts)][1:], t, side="right")


def judged_at(flight: Flight, t: Array) -> BoolArray:
    """Keyframes at which the estimator is held responsible: in the air, or on a bench after it has aligned."""
    aligns = {"standing": healthy.ALIGNS_S}
    judged = judged_parts(phases(flight))
    return within_any(t, [(part.start + aligns.get(part.kind, 0.0), part.end) for part in judged])


def judged_parts(parts: Sequence[Phase]) -> list[Phase]:
    """Those in the air; of a log that never was there, as one of a bench, those in which it stands."""
    return [part for part in parts if part.kind == "flight"] or [part for part in parts if part.kind == "standing"]
