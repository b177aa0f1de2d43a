"""The flight twice on one time axis: as the autopilot had it and as the IMU alone would have it.

Also here: the IMU left alone since an anchor, carried on as samples arrive: what re-anchoring hides.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from companion.comparison.alignment import Alignment
from companion.comparison.reference import Reference, attitude_error, reference_at
from companion.comparison.windows import DEFAULT, Integration
from companion.constants import num
from companion.model import (
    Array,
    AttitudeTrack,
    BoolArray,
    DataError,
    Flight,
    ImuTrack,
    IntArray,
    NavState,
    PositionTrack,
    Trajectory,
    brief,
    check_seconds,
    nearest,
)
from companion.strapdown import SAME_TIME, DeadReckoner, Preintegration, quaternion, sample_at


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """Both trajectories at the same times, and the error between them.

    Without a position source the autopilot's position and velocity are zero throughout, the IMU's are
    held at zero too, and `has_position` is False: only the attitudes mean something.
    """

    __repr__ = brief

    t: Array  # (N,) s, boot clock
    q_imu: Array  # (N, 4) wxyz NED/FRD, the IMU's dead reckoning
    velocity_imu: Array  # (N, 3) NED m/s
    position_imu: Array  # (N, 3) NED m
    q_ref: Array  # (N, 4) the autopilot's
    velocity_ref: Array  # (N, 3)
    position_ref: Array  # (N, 3)
    attitude_error: Array  # (N, 3) rotation vector of q_ref ⊗ q_imu⁻¹ in NED, rad
    velocity_error: Array  # (N, 3) autopilot minus IMU, NED m/s
    position_error: Array  # (N, 3) autopilot minus IMU, NED m
    anchors: Array  # (A,) s, where the dead reckoning was (re)started from the autopilot's state
    has_position: bool
    reference_valid: BoolArray  # (N,) False where the autopilot's messages have a gap: its state is interpolated
    from_rest: bool = False  # it began from the IMU's own alignment at rest, not from the autopilot's state


def replay(
    flight: Flight,
    *,
    imu: str | None = None,
    how: Integration = DEFAULT,
    reanchor_s: float | None = 10.0,
    start_s: float | None = None,
    reference: Reference | None = None,
) -> Replay:
    """The dead reckoning of the flight's IMU beside its autopilot, at every IMU sample.

    It starts from the autopilot's state at `start_s` (s, boot clock; None: as soon as the state is known) and again
    every `reanchor_s` seconds, or runs free when that is None. Where the autopilot's state is not known at the time
    of a new anchor, dead reckoning goes on from the old one until it is. reference: that state at the samples of the
    IMU, where it has been looked up already.

    Raises DataError when the flight has no usable IMU or no attitude, or never both at once after `start_s`;
    SettingsError for an unknown method or a period that is not positive.

    >>> import companion as c
    >>> shown = c.replay(c.open_log("tlogs/copter-demo-100hz.tlog")[0], reanchor_s=20)
    >>> len(shown.anchors), shown.position_imu.shape == shown.position_ref.shape
    (6, True)
    >>> float(abs(shown.position_error[0]).max())  # at an anchor both are the same
    0.0
    """
    track, attitude = flight.imu(imu), flight.require_attitude()
    if reanchor_s is not None:
        check_seconds("reanchor_s", reanchor_s)
    reference = reference or reference_at(attitude, flight.position, track.t, how.limits)
    # an attitude-only flight is compared in attitude alone; one with a position starts when that is known too
    usable = np.flatnonzero(reference.known & (track.t >= (-np.inf if start_s is None else start_s)))
    if len(usable) < 2:
        imu_s, attitude_s = (f"{t[0]:.1f} to {t[-1]:.1f} s" for t in (track.t, attitude.t))
        after = "" if start_s is None else f" after {start_s:.1f} s"
        apart = f"{track.source} and {attitude.source} do not overlap{after} (IMU {imu_s}, attitude {attitude_s})"
        raise DataError(f"{apart}. Choose an earlier start or another flight of the log.")
    shown = slice(int(usable[0]), int(usable[-1]) + 1)
    t = track.t[shown]
    anchors = np.array([usable[0]])
    if reanchor_s is not None:
        turn = np.unique(np.floor((t - t[0]) / reanchor_s))  # not those in gaps, which may be of any length
        turn = np.unique(np.concatenate([turn - 1, turn, turn + 1]))
        times = t[0] + reanchor_s * turn[(turn > 0) & (turn <= (t[-1] - t[0]) / reanchor_s)]
        later = nearest(track.t, times)
        delayed = np.searchsorted(usable, later)
        anchors = np.unique(np.concatenate([anchors, usable[delayed[delayed < len(usable)]]]))
    starts = [a[anchors] for a in (reference.q_ned_frd, reference.velocity, reference.position)]
    return _reckoned(track, reference, shown, anchors, starts, how)


def replay_from_rest(
    flight: Flight, aligned: Alignment, *, imu: str | None = None, how: Integration = DEFAULT
) -> Replay:
    """The dead reckoning from the beginning of a rest on, free of the autopilot: its alignment, and then the IMU alone.

    It starts from the IMU's own alignment, less the biases that the rest shows, at a velocity of zero, and from the
    autopilot's position there (its first, where that comes later), and is never anchored again. Where the autopilot's
    state is not known yet, its first one stands for it. Raises DataError as `replay` does.
    """
    track, attitude = aligned.freed(flight.imu(imu)), flight.require_attitude()
    reference = reference_at(attitude, flight.position, track.t, how.limits)
    later = np.flatnonzero(reference.known[aligned.rest.first :])
    if len(later) < 2:
        nothing = f"{attitude.source} has nothing after the rest at {aligned.rest.start_s:.1f} s"
        raise DataError(f"{nothing}. Use --anchor autopilot.")
    first = aligned.rest.first
    position = reference.position[first + int(later[0])]
    shown = slice(first, first + int(later[-1]) + 1)
    start = (aligned.q_ned_frd[None], np.zeros((1, 3)), position[None])
    return replace(_reckoned(track, reference, shown, np.array([first]), start, how), from_rest=True)


def _reckoned(
    track: ImuTrack, reference: Reference, shown: slice, anchors: IntArray, starts: Iterable[Array], how: Integration
) -> Replay:
    """The samples `shown` of both, reckoned from the states `starts` (A, 4), (A, 3), (A, 3) at samples `anchors`."""
    path, index, samples = how.preintegrate(track[shown]), anchors - shown.start, np.arange(shown.stop - shown.start)
    which = np.searchsorted(index, samples, side="right") - 1
    states = path.carry(index[which], samples, *(start[which] for start in starts), gravity=how.gravity)
    return _beside(states, reference, shown, track.t[anchors])


@dataclass(frozen=True, slots=True, eq=False)
class Continued:
    """A replay that went on."""

    replay: Replay  # from `num.BACK` samples before the end of the one before
    path: Preintegration  # over its samples, after `num.CONTEXT` more


def extend(
    before: Replay, imu: ImuTrack, attitude: AttitudeTrack, position: PositionTrack | None, how: Integration
) -> Continued | None:
    """A replay carried on to the newest samples, with its anchors: its last rows, and those that are new.

    imu, attitude, position: the newest samples, from some before the end of `before` on. None where they do not join
    it: a gap, samples that are too few or too late, or an anchor between them.
    """
    has_position = before.has_position
    if len(before.t) <= num.BACK or before.anchors[-1] > before.t[-1 - num.BACK] + SAME_TIME:
        return None
    first = sample_at(imu.t, before.t[-1 - num.BACK])
    if first is None or first < num.CONTEXT or not len(attitude):
        return None
    reference = reference_at(attitude, position if has_position else None, imu.t, how.limits)
    known = np.flatnonzero(reference.position_known if has_position else reference.attitude_known)
    last = int(known[-1]) if len(known) else -1
    part, shown = slice(first - num.CONTEXT, last + 1), slice(first, last + 1)
    if last < first + num.BACK or np.diff(imu.t[part]).max() > how.limits.longest_step(imu.t):
        return None
    path = how.preintegrate(imu[part])
    state = (a[-1 - num.BACK] for a in (before.q_imu, before.velocity_imu, before.position_imu))
    states = path.carry(num.CONTEXT, np.arange(num.CONTEXT, len(path.t)), *state, gravity=how.gravity)
    return Continued(_beside(states, reference, shown, before.anchors), path)


def _beside(states: tuple[Array, Array, Array], reference: Reference, shown: slice, anchors: Array) -> Replay:
    """The reckoned attitude (N, 4), velocity and position (N, 3) at samples `shown` beside the reference's own."""
    t, (q, v, p) = reference.t[shown], states
    q_ref, v_ref, p_ref = (a[shown] for a in (reference.q_ned_frd, reference.velocity, reference.position))
    if not reference.has_position:
        v, p = v_ref, p_ref
    imu, ref = (quaternion.continuous_sign(q), v, p), (q_ref, v_ref, p_ref)
    error = attitude_error(q_ref, q), v_ref - v, p_ref - p
    valid = reference.known[shown]
    return Replay(t, *imu, *ref, *error, anchors, reference.has_position, valid)


@dataclass(frozen=True, slots=True, eq=False)
class FreeState:
    """Where the IMU alone would have the vehicle, and how far from the autopilot that is."""

    anchor_s: float  # s, boot clock, when it was the autopilot's state
    state: NavState
    attitude_error: Array  # (3,) rotation vector of q_ref ⊗ q⁻¹ in NED, rad
    velocity_error: Array  # (3,) autopilot minus IMU, NED m/s; zero for a flight without a position
    position_error: Array  # (3,) likewise, m


class FreeRun:
    """Call `take` with every new replay of the flight's newest seconds; it goes on from where it was.

    A gap in the samples ends the run, because integrating across one is the largest false error there is: the next
    `take` begins another at the anchor of its replay.
    """

    def __init__(self) -> None:
        self.ended = ""  # why the last run ended, for the user
        self._anchor_s: float | None = None
        self._settled: NavState | None = None
        self._begun: Trajectory | None = None  # what the last `take` has reckoned for good, from which `carry` goes on
        self._gravity = DEFAULT.gravity
        self._has_position = False

    def anchor_now(self) -> None:
        """Begin another run with the next `take`."""
        self._end("")

    def take(self, track: ImuTrack, replay: Replay, how: Integration = DEFAULT) -> FreeState | None:
        """Carry the run on over the samples of `track` (the IMU of `replay`, whatever part of it) to the replay's end.

        None where a run has just ended.
        """
        if replay.has_position and not self._has_position:
            self.anchor_now()  # until now it was reckoned without a velocity
        self._has_position = replay.has_position
        end = int(np.searchsorted(track.t, replay.t[-1] + SAME_TIME))
        settled = self._settled or self._begin(replay)
        at = sample_at(track.t, settled.t)
        if at is None or at >= end:
            self._end("its samples are forgotten")
            return None
        steps = np.diff(track.t[at:end])
        if len(steps) and steps.max() > how.limits.longest_step(track.t):
            self._end(f"the IMU was silent for {steps.max():.1f} s")
            return None
        dead_reckoner = DeadReckoner(
            settled, method=how.method, middle=how.middle, segments=how.segments, gravity=how.gravity
        )
        begun = dead_reckoner.push(track[max(at - num.CONTEXT, 0) : end])
        rest = dead_reckoner.finish()
        t = np.concatenate([begun.t, rest.t])
        old = int(np.searchsorted(t, t[-1] - num.FREE_RUN_SETTLED_S)) - 1
        if 0 <= old < len(begun):
            self._settled = NavState(float(t[old]), begun.q_ned_frd[old], begun.velocity[old], begun.position[old])
        self._begun, self._gravity = begun, how.gravity
        return self._beside(dead_reckoner.state, replay)

    def carry(self, continued: Continued) -> FreeState | None:
        """Where the run is at the end of a replay that went on from that which was taken last: a tenth of the work.

        None where a run has just ended.
        """
        if self._begun is None or not len(self._begun):
            return None
        begun, path = self._begun, continued.path
        at = sample_at(begun.t, path.t[num.CONTEXT])
        if at is None:
            return None
        state = (a[at] for a in (begun.q_ned_frd, begun.velocity, begun.position))
        q, velocity, position = path.carry(num.CONTEXT, len(path.t) - 1, *state, gravity=self._gravity)
        return self._beside(NavState(float(path.t[-1]), q, velocity, position), continued.replay)

    def _beside(self, now: NavState, replay: Replay) -> FreeState:
        velocity, position = np.zeros((2, 3))
        if replay.has_position:
            velocity, position = replay.velocity_ref[-1] - now.velocity, replay.position_ref[-1] - now.position
        turned = attitude_error(replay.q_ref[-1], now.q_ned_frd)
        return FreeState(self._anchor_s or 0.0, now, turned, velocity, position)

    def _begin(self, replay: Replay) -> NavState:
        """The autopilot's state at the last anchor of the replay."""
        at = int(np.searchsorted(replay.t, replay.anchors[-1] - SAME_TIME))
        self._anchor_s = float(replay.t[at])
        self._settled = NavState(self._anchor_s, replay.q_ref[at], replay.velocity_ref[at], replay.position_ref[at])
        return self._settled

    def _end(self, why: str) -> None:
        self._settled = self._anchor_s = self._begun = None
        self.ended = why
