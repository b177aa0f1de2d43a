"""The flight twice on one time axis: as the autopilot had it and as the IMU alone would have it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.analysis.compare import attitude_error
from companion.analysis.integration import DEFAULT, Integration
from companion.analysis.reference import BoolArray, nearest, reference_at
from companion.errors import DataError
from companion.strapdown import preintegrate, quaternion
from companion.tracks import Array, Flight


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """Both trajectories at the same times, and the error between them.

    Without a position source the autopilot's position and velocity are zero throughout, the IMU's are
    held at zero too, and `has_position` is False: only the attitudes mean something.
    """

    t: Array  # (N,) s, boot clock
    q_imu: Array  # (N, 4) wxyz NED/FRD, the IMU's reckoning
    velocity_imu: Array  # (N, 3) NED m/s
    position_imu: Array  # (N, 3) NED m
    q_ref: Array  # (N, 4) the autopilot's
    velocity_ref: Array  # (N, 3)
    position_ref: Array  # (N, 3)
    attitude_error: Array  # (N, 3) rotation vector of q_ref ⊗ q_imu⁻¹ in NED, rad
    velocity_error: Array  # (N, 3) autopilot minus IMU, NED m/s
    position_error: Array  # (N, 3) autopilot minus IMU, NED m
    anchors: Array  # (A,) s, where the reckoning was (re)started from the autopilot's state
    has_position: bool
    reference_valid: BoolArray  # (N,) False where the autopilot's messages have a hole: its state is interpolated


def replay(
    flight: Flight,
    *,
    imu: str | None = None,
    how: Integration = DEFAULT,
    reanchor_s: float | None = 10.0,
    start_s: float | None = None,
) -> Replay:
    """The reckoning of the flight's IMU beside its autopilot, at every IMU sample.

    It starts from the autopilot's state at `start_s` (s, boot clock; None: as soon as the state is known) and again
    every `reanchor_s` seconds, or runs free when that is None. Where the autopilot's state is not known at the time
    of a new anchor, the reckoning goes on from the old one until it is.

    Raises DataError when the flight has no usable IMU or no attitude, or never both at once after `start_s`; ValueError
    for an unknown method or a period that is not positive.

    >>> import companion as c
    >>> shown = c.replay(c.open_log("tlogs/copter-demo-100hz.tlog")[0], reanchor_s=20)
    >>> len(shown.anchors), shown.position_imu.shape == shown.position_ref.shape
    (6, True)
    >>> float(abs(shown.position_error[0]).max())  # at an anchor both are the same
    0.0
    """
    track, attitude = flight.imu(imu), flight.require_attitude()
    if reanchor_s is not None and not reanchor_s > 0:
        raise ValueError(f"the re-anchor period must be positive seconds or None, got {reanchor_s}")
    reference = reference_at(attitude, flight.position, track.t, how.limits)
    # an attitude-only flight is compared in attitude alone; one with a position starts when that is known too
    has_position = bool(reference.position_known.any())
    valid = reference.position_known if has_position else reference.attitude_known
    usable = np.flatnonzero(valid & (track.t >= (-np.inf if start_s is None else start_s)))
    if len(usable) < 2:
        raise DataError(
            f"{track.source} and {attitude.source} do not overlap"
            + (f" after {start_s:.1f} s" if start_s is not None else "")
            + f" (IMU {track.t[0]:.1f} to {track.t[-1]:.1f} s, attitude {attitude.t[0]:.1f} to {attitude.t[-1]:.1f} s)."
            " Choose an earlier start or another flight of the log."
        )
    shown = slice(int(usable[0]), int(usable[-1]) + 1)
    t = track.t[shown]
    anchors = np.array([usable[0]])
    if reanchor_s is not None:
        wanted = t[0] + reanchor_s * np.arange(1, int((t[-1] - t[0]) / reanchor_s) + 1)
        later = nearest(track.t, wanted)
        delayed = np.searchsorted(usable, later)
        anchors = np.unique(np.concatenate([anchors, usable[delayed[delayed < len(usable)]]]))
    path = preintegrate(track[shown], method=how.method, middle=how.middle, segments=how.segments)
    index = anchors - shown.start
    owner = index[np.searchsorted(index, np.arange(len(t)), side="right") - 1]
    q_ref, v_ref, p_ref = (a[shown] for a in (reference.q_ned_frd, reference.velocity, reference.position))
    q, v, p = path.carry(owner, np.arange(len(t)), q_ref[owner], v_ref[owner], p_ref[owner], gravity=how.gravity)
    if not has_position:
        v, p = v_ref, p_ref
    return Replay(
        t=t,
        q_imu=quaternion.continuous_sign(q),
        velocity_imu=v,
        position_imu=p,
        q_ref=q_ref,
        velocity_ref=v_ref,
        position_ref=p_ref,
        attitude_error=attitude_error(q_ref, q),
        velocity_error=v_ref - v,
        position_error=p_ref - p,
        anchors=track.t[anchors],
        has_position=has_position,
        reference_valid=valid[shown],
    )
