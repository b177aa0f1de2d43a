"""The aiding sensors: one row says all that is known of each, and everything else goes through the rows.

With C = C(q_ned_frd) at the keyframe, l the lever arm and τ the latency of the GPS, m the Earth's field in NED, h the
hard and S the soft iron and τ_m the latency of the compass:

position     z = p + C l + v (t - t_k - τ)
velocity     z = v + a (t - t_k - τ) + C (ω × l)
compass      z = (I + S) C(t - τ_m)ᵀ m + h
barometer    z = -p_down + offset
rangefinder  z = (-p_down + offset) / (C e_z · e_z): the distance to level ground along the body's down axis
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from companion.constants import healthy, num
from companion.estimation.readings import AidingSensor, Intake, Kinematics, Prediction, Readings, three_samples, through
from companion.model import PITCH_270, Array, ImuTrack, RangeTrack, interpolated, ned_from_geodetic
from companion.strapdown import quaternion, skew

FIXED: Mapping[str, tuple[str, slice]] = {
    "gps_position": ("position", slice(0, 2)), "gps_height": ("position", slice(2, 3)),
    "gps_velocity": ("velocity", slice(0, 2)), "gps_climb": ("velocity", slice(2, 3)),
}  # fmt: skip
"""What a fix consists of → the vector that it observes, and its components in NED."""


def _read_fixes(sensor: AidingSensor, intake: Intake) -> Readings | None:
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


def _predict_fix(one: Readings, at: Kinematics) -> Prediction:
    """Where the vehicle was, or how fast, when the fix was taken."""
    k, states, (observed, axes) = one.keyframe, at.states, FIXED[one.name]
    lever = states.constant("lever_arm")
    imu_known = at.imu_known[k]  # else a velocity that nothing observes would go with the latency
    late = one.t - one.late - at.t[k] - np.where(imu_known, states.constant("gps_latency")[0], healthy.GPS_LATENCY_S)
    matrix = quaternion.to_matrix(states.q_ned_frd[k])
    derivatives: dict[str, Array] = {}
    if observed == "position":
        arm = matrix @ lever
        force_part, goes_on = through(at.when[k], at.position[k], late)
        value = states.position[k] + states.velocity[k] * late[:, None] + force_part + arm
        value[:, 2] += 0.5 * at.gravity * late**2
        derivatives["position"] = np.eye(3)[axes]
        derivatives["velocity"] = late[:, None, None] * np.eye(3)[axes]
        change, of_arm = states.velocity[k] + goes_on, matrix
        change[:, 2] += at.gravity * late
    else:
        arm = np.einsum("kij,kj->ki", matrix, quaternion.cross(at.rate[k], lever))
        force_part, goes_on = through(at.when[k], at.velocity[k], late)
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


def _read_compass(sensor: AidingSensor, intake: Intake) -> Readings | None:
    """The compass that goes with the IMU, else the first that reads something."""
    compasses, track = intake.flight.compasses, intake.imu
    usable = [one for one in compasses if len(one) > 10 and _plausible(one.field)]
    if not usable:
        if compasses:
            intake.notes.append("no compass is used: its readings are constant, or no field of the Earth")
        return None
    one = next((c for c in usable if c.source == track.source), usable[0])
    when, field = one.t, one.field
    good = np.isfinite(field).all(axis=1) & (np.linalg.norm(field, axis=1) > 5e-6)
    if not good.all():
        when, field = when[good], field[good]
    spacing = intake.spacing if intake.gps is not None else max(intake.spacing, num.NO_GPS_SPACING_S)
    readings = sensor.at_keyframes(when, field, intake.t, spacing)
    readings = _averaged(readings, when, field, _hardly_turned(track, readings.t))
    sample = np.clip(np.searchsorted(track.t, readings.t), 0, len(track) - 1).astype(np.intp)
    sample = three_samples(track, sample, num.FIELD_SAMPLES_S, before=2)
    return replace(readings, value=readings.value * num.MICROTESLA, sample=sample)


def _averaged(one: Readings, when: Array, value: Array, half_s: Array) -> Readings:
    """Readings (M, d) that are each the mean of those at times `when` (N,) within half_s (M,) of it, either way alike.

    What scatters from one to the next is less by the root of their number; what changes evenly meanwhile cancels.
    """
    i = np.searchsorted(when, one.t)
    n = np.minimum(i - np.searchsorted(when, one.t - half_s), np.searchsorted(when, one.t + half_s, "right") - 1 - i)
    sums = np.concatenate([np.zeros((1, 1 + value.shape[1])), np.cumsum(np.column_stack([when, value]), axis=0)])
    mean = (sums[i + n + 1] - sums[i - n]) / (2 * n + 1)[:, None]
    return replace(one, t=mean[:, 0], value=mean[:, 1:])


def _hardly_turned(track: ImuTrack, t: Array) -> Array:
    """(M,) s, for how long before and after times t (M,) a mean of directions is as good as one that is turned back."""
    turned = np.cumsum(track.gyro[1:] * np.diff(track.t)[:, None], axis=0)
    reach = healthy.FIELD_MEAN_S
    before, after = (interpolated(t + apart, track.t[1:], turned) for apart in (-reach, reach))
    angle = 0.5 * np.linalg.norm(after - before, axis=1)
    return np.asarray(healthy.FIELD_MEAN_S * num.FIELD_MEAN_RAD / np.maximum(angle, num.FIELD_MEAN_RAD))


def _plausible(field: Array) -> bool:
    """Whether most readings have the size of a field on Earth (22 to 67 µT, with room for iron)."""
    read = field[np.isfinite(field).all(axis=1)]
    size = np.linalg.norm(read, axis=1)
    return bool(len(size) > 10 and 10e-6 < np.median(size) < 150e-6 and np.ptp(read, axis=0).max() > 0)


def _predict_field(one: Readings, at: Kinematics) -> Prediction:
    """The field when the reading was taken: the IMU turns the keyframe's attitude until then, and says how fast."""
    states, path = at.states, at.path
    start, samples = path.row(at.index[one.keyframe]), path.row(one.sample)
    turned = quaternion.log(quaternion.multiply(quaternion.conjugate(path.q[start])[:, None], path.q[samples]))
    when = path.t[samples]
    across_gap = when[:, 2] - when[:, 0] > num.GAP_S
    turned[across_gap] = turned[across_gap, 2:]
    angle, rate = through(when, turned, one.t - states.constant("compass_latency"))
    q = quaternion.multiply(states.q_ned_frd[one.keyframe], quaternion.exp(angle))
    matrix = quaternion.to_matrix(q).swapaxes(-1, -2)
    field = states.constant("earth_field")
    iron = np.eye(3) + states.constant("soft_iron").reshape(3, 3)
    in_body = matrix @ field
    across = quaternion.cross(angle, rate)
    rate = rate - quaternion.cross(angle, rate - across / 3.0) / 2.0  # of the body, not of the rotation vector
    derivatives = {
        "attitude": iron @ matrix @ skew(field),
        "earth_field": iron @ matrix,
        "hard_iron": np.eye(3),
        "soft_iron": np.einsum("ij,mk->mijk", np.eye(3), in_body).reshape(-1, 3, 9),
        "compass_latency": iron @ quaternion.cross(rate, in_body)[..., None],
    }
    return Prediction(np.asarray(in_body @ iron.T + states.constant("hard_iron")), derivatives)


def _read_barometer(sensor: AidingSensor, intake: Intake) -> Readings | None:
    """The barometer with the most readings."""
    one = max(intake.flight.barometers, key=len, default=None)
    good = np.zeros(0, np.bool_) if one is None else np.isfinite(one.altitude)
    if one is None or good.sum() <= 5 or np.ptp(one.altitude[good]) == 0:
        return None
    return sensor.at_keyframes(one.t[good], one.altitude[good][:, None], intake.t, 2 * intake.spacing)


def _predict_height(one: Readings, at: Kinematics) -> Prediction:
    """The height above the zero of the sensor."""
    constant = f"{one.name}_offset"
    value = (at.states.constant(constant)[0] - at.states.position[one.keyframe, 2])[:, None]
    return Prediction(value, {"position": np.array([0.0, 0.0, -1.0]), constant: np.ones(1)})


def _read_rangefinder(sensor: AidingSensor, intake: Intake) -> Readings | None:
    """Of those that look down the one with the most readings; at either end of its range it reads no distance."""

    def good(one: RangeTrack) -> npt.NDArray[np.bool_]:
        least, most = (end if end is not None else limit for end, limit in ((one.least, 0.0), (one.most, np.inf)))
        return np.asarray((one.distance > least) & (one.distance < most))

    down = [(one, good(one)) for one in intake.flight.ranges if one.orientation == PITCH_270]
    one, read = max(down, key=lambda pair: int(pair[1].sum()), default=(None, np.zeros(0, np.bool_)))
    if one is None or read.sum() < 2:
        return None
    distance = one.distance[read][:, None]
    return sensor.at_keyframes(one.t[read], distance, intake.t, 2 * intake.spacing, one.sigma[read])


def _predict_distance(one: Readings, at: Kinematics) -> Prediction:
    """The distance to level ground along the body's down axis: times the cosine of the tilt it is the height.

    The tilt is left to the other sensors: over sloping ground it would be wrong. Beyond 45° it observes nothing.
    """
    height = _predict_height(one, at)
    cosine = quaternion.to_matrix(at.states.q_ned_frd[one.keyframe])[:, 2, 2, None]
    level = cosine > np.sqrt(0.5)
    value = np.where(level, one.value * (1.0 - cosine) + height.value, one.value)
    return Prediction(value, {name: level[..., None] * one for name, one in height.derivatives.items()})


def _read_rest_velocity(sensor: AidingSensor, intake: Intake) -> Readings | None:
    k, _, _ = intake.rest
    return sensor.at(intake.t[k], k, np.zeros((len(k), 3))) if len(k) else None


def _read_rest_rate(sensor: AidingSensor, intake: Intake) -> Readings | None:
    """What the gyro reads at rest: its bias."""
    k, mean, own = intake.rest
    sigma = np.hypot(np.hypot(sensor.nominal, 0.5 * intake.imu.gyro_step), np.repeat(own, 3, axis=1))
    return sensor.at(intake.t[k], k, mean, sigma) if len(k) else None


def _predict_rate(one: Readings, at: Kinematics) -> Prediction:
    return Prediction(at.states.gyro_bias[one.keyframe], {"gyro_bias": np.eye(3)})


def _predict_velocity(one: Readings, at: Kinematics) -> Prediction:
    return Prediction(at.states.velocity[one.keyframe], {"velocity": np.eye(3)})


_GPS_LATENCY = healthy.GPS_LATENCY_S

_ROWS = (
    # a velocity that wanders by 5 m/s within 20 s, as white noise every half second says it
    AidingSensor("calm", "calm", "m/s", 45.0, _predict_velocity, least=20.0),
    AidingSensor("gps_position", "gps", "m", 1.0, _predict_fix, _read_fixes, 0.1, (0.12, 2.0, 60.0),
                 latency_s=_GPS_LATENCY),
    AidingSensor("gps_height", "gps", "m", 1.5, _predict_fix, _read_fixes, 0.15, (0.5, 2.0, 60.0),
                 latency_s=_GPS_LATENCY, height=True),
    AidingSensor("gps_velocity", "gps", "m/s", 0.2, _predict_fix, _read_fixes, 0.04, (0.035, 2.5, 10.0),
                 latency_s=_GPS_LATENCY, motion=("gps_position", (0.05, 2.5, 10.0))),
    AidingSensor("gps_climb", "gps", "m/s", 0.3, _predict_fix, _read_fixes, 0.06, (0.045, 2.0, 10.0),
                 latency_s=_GPS_LATENCY),
    AidingSensor("compass", "compass", "µT", 1.0, _predict_field, _read_compass, 0.8, (0.4, 2.0, 40.0)),
    AidingSensor("barometer", "barometer", "m", 0.5, _predict_height, _read_barometer, 0.1, (0.8, 1.5, 60.0),
                 offset=1000.0, height=True),
    # 1σ: the default of ArduPilot's EK3_RNG_M_NSE. Nothing bounds the ground, be it a slope or a roof: a random walk of
    # 0.5 m/√s, as by PX4's EKF2_TERR_NOISE (5 m/s in a step of 10 ms), and so a jump is no fault
    AidingSensor("rangefinder", "rangefinder", "m", 0.5, _predict_distance, _read_rangefinder, 0.05, (10.0, 4.0, 800.0),
                 offset=1000.0),
    AidingSensor("rest_velocity", "rest", "m/s", 0.02, _predict_velocity, _read_rest_velocity),
    AidingSensor("rest_rate", "rest", "rad/s", 2e-4, _predict_rate, _read_rest_rate),
)  # fmt: skip
"""Slow errors: of ten healthy flights of six real vehicles."""

SENSORS: Mapping[str, AidingSensor] = {row.name: row for row in _ROWS}
"""Name of the readings → their row."""

HEIGHTS = frozenset(name for name, row in SENSORS.items() if row.height)
"""Readings that are a height above a fixed place."""

RECEIVER_MOTION = {f"{row.device}_motion": (row.name, *row.motion) for row in _ROWS if row.motion is not None}
"""Slow error of the motion that a receiver sees → the readings that follow it, those that follow its integral, and its
median, factor of spread and correlation time."""

SLOW = {name: row.slow for name, row in SENSORS.items() if row.slow is not None} | {
    name: own for name, (*_, own) in RECEIVER_MOTION.items()
}
"""Name of the readings → median, factor of its spread and correlation time of their slow error."""
