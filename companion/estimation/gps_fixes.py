"""Fixes of a GPS receiver as position, height, velocity and climb, each with the 1σ that the receiver states.

With C = C(q_ned_frd) at the keyframe, l the lever arm and τ the latency:

    position  z = p + C l + v (t - t_k - τ)            velocity  z = v + a (t - t_k - τ) + C (ω × l)
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from companion.constants import healthy
from companion.estimation.readings import AidingSensor, Intake, Kinematics, Prediction, Readings
from companion.model import Array, ned_from_geodetic
from companion.strapdown import quaternion, skew

FIXED: Mapping[str, tuple[str, slice]] = {
    "gps_position": ("position", slice(0, 2)), "gps_height": ("position", slice(2, 3)),
    "gps_velocity": ("velocity", slice(0, 2)), "gps_climb": ("velocity", slice(2, 3)),
}  # fmt: skip
"""What a fix consists of → the vector that it observes, and its components in NED."""


def read_fixes(sensor: AidingSensor, intake: Intake) -> Readings | None:
    """Every fix within half a spacing of a keyframe, the nearest to each."""
    track, origin, (observed, axes) = intake.gps, intake.origin, FIXED[sensor.name]
    if track is None or origin is None:
        return None
    if observed == "velocity":
        value, own = track.velocity[:, axes], track.speed_sigma
    else:
        zero = (origin.latitude, origin.longitude, origin.height)
        value = ned_from_geodetic(track.latitude, track.longitude, track.height, zero)[:, axes]
        own = track.vertical_sigma
    if sensor.name == "gps_position":  # where there is no height it is still one: of the origin's height
        flat = ned_from_geodetic(track.latitude, track.longitude, np.full(len(track), origin.height), zero)
        value, own = np.where(np.isfinite(value), value, flat[:, axes]), track.horizontal_sigma
    good = np.isfinite(value).all(axis=1) & (track.fix_type >= 3)
    if good.sum() < 2:
        return None
    return sensor.at_keyframes(track.t[good], value[good], intake.t, 2 * intake.spacing, own[good])


def predict_fix(one: Readings, at: Kinematics) -> Prediction:
    """Where the vehicle was, or how fast, when the fix was taken."""
    k, states, (observed, axes) = one.keyframe, at.states, FIXED[one.name]
    lever = states.constant("lever_arm")
    imu_known = at.imu_known[k]  # else a velocity that nothing observes would go with the latency
    late = one.t - one.late - at.t[k] - np.where(imu_known, states.constant("gps_latency")[0], healthy.GPS_LATENCY_S)
    matrix = quaternion.to_matrix(states.q_ned_frd[k])
    derivatives: dict[str, Array] = {}
    if observed == "position":
        arm = matrix @ lever
        force_part, goes_on = at.moved(at.position, k, late)
        value = states.position[k] + states.velocity[k] * late[:, None] + force_part + arm
        value[:, 2] += 0.5 * at.gravity * late**2
        derivatives["position"] = np.eye(3)[axes]
        derivatives["velocity"] = late[:, None, None] * np.eye(3)[axes]
        change, of_arm = states.velocity[k] + goes_on, matrix
        change[:, 2] += at.gravity * late
    else:
        arm = np.einsum("kij,kj->ki", matrix, quaternion.cross(at.rate[k], lever))
        force_part, goes_on = at.moved(at.velocity, k, late)
        value = states.velocity[k] + force_part + arm
        value[:, 2] += at.gravity * late
        derivatives["velocity"] = np.eye(3)[axes]
        derivatives["gyro_bias"] = (matrix @ skew(lever))[:, axes]
        change, of_arm = goes_on, matrix @ skew(at.rate[k])
        change[:, 2] += at.gravity
    attitude = -skew(arm)[:, axes]
    # What the IMU felt in between turns with the heading: on a circle nothing else observes a latency. Its tilt is
    # left to the motion, which has the same noise: of a noisy IMU the fix would show a tilt that is none.
    attitude[:, :, 2] -= skew(force_part)[:, axes, 2]
    derivatives["attitude"] = attitude
    derivatives["gps_latency"] = -(imu_known[:, None] * change[:, axes])[..., None]
    derivatives["lever_arm"] = of_arm[:, axes]
    return Prediction(np.asarray(value[:, axes]), derivatives)
