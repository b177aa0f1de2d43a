"""The IMU left alone since an anchor, carried on as samples arrive: what re-anchoring hides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.analysis.integration import DEFAULT, Integration
from companion.analysis.reference import attitude_error
from companion.analysis.replay import Continued, Replay
from companion.constants import num
from companion.model import Array, ImuTrack, NavState, Trajectory
from companion.strapdown import SAME_TIME, DeadReckoner


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
        self._settled = self._anchor_s = self._begun = None
        self.ended = ""

    def take(self, track: ImuTrack, replay: Replay, how: Integration = DEFAULT) -> FreeState | None:
        """Carry the run on over the samples of `track` (the IMU of `replay`, whatever part of it) to the replay's end.

        None where a run has just ended.
        """
        if replay.has_position and not self._has_position:
            self.anchor_now()  # until now it was reckoned without a velocity
        self._has_position = replay.has_position
        end = int(np.searchsorted(track.t, replay.t[-1] + SAME_TIME))
        settled = self._settled or self._begin(replay)
        at = int(np.searchsorted(track.t, settled.t - SAME_TIME))
        if at >= end or abs(track.t[at] - settled.t) > SAME_TIME:
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
        at = int(np.searchsorted(begun.t, path.t[num.CONTEXT] - SAME_TIME))
        if at >= len(begun) or abs(begun.t[at] - path.t[num.CONTEXT]) > SAME_TIME:
            return None
        state = (a[at] for a in (begun.q_ned_frd, begun.velocity, begun.position))
        q, velocity, position = path.carry(num.CONTEXT, len(path.t) - 1, *state, gravity=self._gravity)
        return self._beside(NavState(float(path.t[-1]), q, velocity, position), continued.replay)

    def _beside(self, now: NavState, replay: Replay) -> FreeState:
        q_error = attitude_error(replay.q_ref[-1], now.q_ned_frd)
        here = replay.has_position
        zero = np.zeros(3)
        return FreeState(
            anchor_s=self._anchor_s or 0.0,
            state=now,
            attitude_error=q_error,
            velocity_error=replay.velocity_ref[-1] - now.velocity if here else zero,
            position_error=replay.position_ref[-1] - now.position if here else zero,
        )

    def _begin(self, replay: Replay) -> NavState:
        """The autopilot's state at the last anchor of the replay."""
        at = int(np.searchsorted(replay.t, replay.anchors[-1] - SAME_TIME))
        self._anchor_s = float(replay.t[at])
        self._settled = NavState(self._anchor_s, replay.q_ref[at], replay.velocity_ref[at], replay.position_ref[at])
        return self._settled

    def _end(self, why: str) -> None:
        self._settled = self._anchor_s = self._begun = None
        self.ended = why
