"""When a vehicle was out of control, from where it began to turn over until it was armed again or had been caught.

What is measured in between is true and means nothing: a gyro at the end of its range misleads the estimator, and a
wreck reads forces of thousands of m/s². What lies before and after is judged as any flight.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from companion.constants import check, harm, healthy
from companion.model import Array, AttitudeTrack, ControlTrack, Flight, Phase, without

BoolArray = npt.NDArray[np.bool_]
Span = tuple[float, float]

_CRASHED = re.compile(
    r"Crash: Disarming|crash check: error|[Aa]ttitude failure|[Cc]ritical failure|[Ff]light termination", re.ASCII
)
UPRIGHT = ("QUADROTOR", "HEXAROTOR", "OCTOROTOR", "TRICOPTER", "DODECAROTOR", "COAXIAL", "HELICOPTER")
_AT_WILL = ("ACRO", "FLIP")  # modes in which a pilot may turn it over: ArduCopter looks for no crash (crash_check.cpp)


def losses_of_control(flight: Flight, airborne: Sequence[Span]) -> tuple[Phase, ...]:
    """Every loss of control in order of time, to its end: the end of the log where nothing follows.

    airborne: from when to when the vehicle was in the air each time, s.
    """
    track = flight.attitude
    over = None if track is None else _over(flight, track)
    calm = [] if track is None or over is None else _spans(track.t, ~over)
    turned = [] if track is None or over is None else _turned_over(flight, airborne, _spans(track.t, over), calm)
    losses: list[Phase] = []
    for lost in sorted([*turned, *_reported_crashes(flight, airborne, calm)], key=lambda one: one.start):
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


def while_in_control(flight: Flight, parts: Sequence[Phase], imu: str) -> Flight:
    """The flight without what was measured out of control; as it is where nothing would be left."""
    seen = without(flight, unjudged(parts))
    left = [seen.imus[imu], *([] if seen.attitude is None else [seen.attitude])]
    return seen if min(map(len, left)) > 1 else flight


def body_rates(flight: Flight) -> tuple[Array, Array]:
    """Times (N,) s and body rates (N, 3) rad/s by the IMU, else by the autopilot."""
    name = flight.default_imu
    if name is not None:
        return flight.imus[name].t, flight.imus[name].gyro
    return (np.zeros(0), np.zeros((0, 3))) if flight.attitude is None else (flight.attitude.t, flight.attitude.rates)


def down_in_body(q: Array) -> Array:
    """World down in the body frame, (N, 3), of attitudes (N, 4)."""
    w, x, y, z = q.T
    return np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z])


def _reported_crashes(flight: Flight, airborne: Sequence[Span], calm: Sequence[Span]) -> Iterator[Phase]:
    """Crashes by the vehicle's own words. calm: in control, s."""
    words = [
        *((text_at.t, text_at.text) for text_at in flight.texts),
        *((event.t, event.text) for event in flight.events),
    ]
    for t, text in words:
        if _CRASHED.search(text) and any(begin <= t <= end + check.CRASH_REPORTED_S for begin, end in airborne):
            yield Phase(t, _armed_again(flight, calm, t), "impact", text)


def _turned_over(
    flight: Flight, airborne: Sequence[Span], over: Sequence[Span], calm: Sequence[Span]
) -> Iterator[Phase]:
    """Stretches in which the attitude is beyond control, and was not to be. over, calm: beyond control, in it, s."""
    if all(event.kind not in ("armed", "disarmed") for event in flight.events):
        return  # a board that is turned by hand has lost nothing
    free = -np.inf
    for start, stop in over:
        landed = next((end for begin, end in airborne if begin <= start <= end + check.LANDED_S), None)
        if start < free or landed is None or _at_rest(flight, start):
            continue
        aloft = [(begin, min(end, landed)) for begin, end in calm if end > stop]
        caught = next((begin for begin, end in aloft if end - begin > check.CAUGHT_S), None)
        intended = caught is not None and (caught - start <= healthy.FLIP_S or _at_will(flight, start))
        if intended or (caught is None and stop - start < harm.OVERTURNED_S):
            continue
        held = next((begin + healthy.ALIGNS_S for begin, end in aloft if end - begin > healthy.ALIGNS_S), np.inf)
        free = min(held, _armed_again(flight, calm, stop))
        yield Phase(_onset(flight, start), free, "impact", "the attitude is beyond control")


def _at_will(flight: Flight, over: float) -> bool:
    """Whether a pilot may have turned the vehicle over: by the mode that it was in."""
    modes = [event.text for event in flight.events if event.kind == "mode" and event.t <= over]
    return bool(modes) and modes[-1] in _AT_WILL


def _at_rest(flight: Flight, over: float) -> bool:
    """Whether the vehicle lies still as its attitude turns over: what turns is a gyro, or the estimator."""
    name = flight.default_imu
    if name is None:
        return False
    track = flight.imus[name]
    around = track.accel[slice(*np.searchsorted(track.t, [over - 1.0, over + 1.0]))]
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
    for begin, end in _runs(apart):
        lately = slice(*np.searchsorted(control.t, [t[begin] - healthy.ATTITUDE_FOLLOWS_S, t[begin]]))
        if (desired[lately] @ down[begin] > np.cos(0.5 * harm.OVERTURNED_RAD)).any():
            apart[begin : min(np.searchsorted(t, t[begin] + healthy.ATTITUDE_FOLLOWS_S), end + 1)] = False
    return np.asarray(fresh & (alike > np.cos(0.5 * harm.OVERTURNED_RAD))), apart


def _runs(mask: BoolArray) -> list[tuple[int, int]]:
    """First and last index of each stretch."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _spans(t: Array, mask: BoolArray) -> list[Span]:
    """From when to when each stretch is, s; t (N,), mask (N,)."""
    return [(float(t[first]), float(t[last])) for first, last in _runs(mask)]


def _onset(flight: Flight, over: float) -> float:
    """Where the turning began that ended in being over."""
    t, rates = body_rates(flight)
    near = (t <= over) & (t >= over - check.LOST_BEFORE_S)
    slow = t[near][np.linalg.norm(rates[near], axis=1) < check.LEADS_TO_TUMBLING_RPS]
    return min(float(slow[-1]), over) if len(slow) else over
