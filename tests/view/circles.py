"""A made-up flight whose truth is known: a minute of banked circles, and an IMU whose error grows from each anchor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from companion.app.examination import assess_imu
from companion.app.settings import Settings
from companion.comparison import Replay
from companion.model import Array, AttitudeTrack, DataError, Flight, ImuTrack, PositionTrack, Vehicle
from companion.view import AnalysisResult, DisplayTrajectory, ReplayChoice, analysed, chosen_track, display_trajectory

RATE = 50.0
DURATION = 60.0
BOOT = 100.0  # s, boot clock of the first sample


def quaternion(roll: Array, pitch: Array, yaw: Array) -> Array:
    """(N, 4) wxyz NED/FRD of Euler angles (N,) rad."""
    cr, sr, cp, sp, cy, sy = (f(a / 2) for a in (roll, pitch, yaw) for f in (np.cos, np.sin))
    q = [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]
    return np.stack(q, axis=1)


def make_flight(radius: float = 40.0, sysid: int = 1, duration: float = DURATION, kind: str = "QUADROTOR") -> Flight:
    """Two banked circles with a climb, as the autopilot saw them."""
    t = BOOT + np.arange(0.0, duration, 1 / RATE)
    turn = 4 * np.pi / duration
    phase = (t - BOOT) * turn
    climb = 12 * np.sin(phase / 4)
    position = np.stack([radius * np.sin(phase), radius * (1 - np.cos(phase)), -5.0 - climb], axis=1)
    velocity = np.gradient(position, t, axis=0)
    attitude = quaternion(np.full_like(t, np.arctan(radius * turn**2 / 9.81)), np.full_like(t, -0.08), phase)
    still = np.zeros((len(t), 3))
    imu = ImuTrack(t, still, still + np.array([0.0, 0.0, -9.80665]), "RAW_IMU")
    return Flight(
        Vehicle(sysid, 1, "ARDUPILOTMEGA", kind),
        boot=1,
        start=BOOT - 1.0,
        duration=duration + 1.0,
        imus={"RAW_IMU": imu, "SCALED_IMU2": replace(imu, source="SCALED_IMU2", instance=1)},
        attitude=AttitudeTrack(t, attitude, still, "ATTITUDE"),
        position=PositionTrack(t, position, velocity, "LOCAL_POSITION_NED"),
    )


def recompute(flight: Flight, choice: ReplayChoice) -> DisplayTrajectory:
    """`dead_reckon`, as the viewer asks for it."""
    others = {name: dead_reckon(flight, choice, worse=1.5) for name in choice.others}
    return display_trajectory(dead_reckon(flight, choice), chosen_track(flight, choice), others)


def examine(flight: Flight, choice: ReplayChoice, display: DisplayTrajectory) -> AnalysisResult:
    """What the analysis says of the made-up readings: nothing good, for the IMU stands still while it circles."""
    seen = flight.with_imu(display.track or flight.imu(choice.imu))
    found = assess_imu(seen, Settings(), imu=choice.imu, how=choice.integration(flight))
    return analysed(flight, display, found, choice.horizon_s, None)


def dead_reckon(flight: Flight, choice: ReplayChoice, worse: float = 1.0) -> Replay:
    """A stand-in for the analysis: errors that grow with the time since the anchor, faster with Euler."""
    if flight.attitude is None or flight.position is None:
        raise DataError("This flight has no attitude. Record one with ATTITUDE.")
    start = float(flight.attitude.t[0]) if choice.start_s is None else choice.start_s
    good = flight.attitude.t >= start - 1e-9
    t, q = flight.attitude.t[good], flight.attitude.q_ned_frd[good]
    if len(t) < 2:
        raise DataError("Nothing is left of the flight after the start. Start earlier.")
    anchors = t[:1] if choice.reanchor_s is None else np.arange(t[0], t[-1], choice.reanchor_s)
    age = t - anchors[np.searchsorted(anchors, t, side="right") - 1]
    worse *= {"euler": 3.0, "midpoint": 1.3, "rk4": 1.0}[choice.how.method]
    angles = worse * np.stack([0.004 * age, 0.002 * age, 0.006 * np.sin(age)], axis=1)
    velocity_error = worse * np.stack([0.08 * age, 0.1 * age, 0.03 * age], axis=1)
    position_error = worse * np.stack([0.04 * age**2, 0.05 * age**2, 0.015 * age**2], axis=1)
    wrong = q + 0.5 * _times(np.column_stack([np.zeros(len(t)), -angles]), q)
    position, velocity = flight.position.position[good], flight.position.velocity[good]
    return Replay(
        t=t,
        q_imu=wrong / np.linalg.norm(wrong, axis=1, keepdims=True),
        velocity_imu=velocity - velocity_error,
        position_imu=position - position_error,
        q_ref=q,
        velocity_ref=velocity,
        position_ref=position,
        attitude_error=angles,
        velocity_error=velocity_error,
        position_error=position_error,
        anchors=anchors,
        has_position=True,
        reference_valid=np.ones(len(t), dtype=np.bool_),
    )


def _times(a: Array, b: Array) -> Array:
    w, v, u, x = a[:, :1], a[:, 1:], b[:, :1], b[:, 1:]
    return np.column_stack([w * u - (v * x).sum(1, keepdims=True), w * x + u * v + np.cross(v, x)])
