"""The aiding sensors: one row says all that is known of each, and everything else goes through the rows.

barometer    z = -p_down + offset
rangefinder  z = (-p_down + offset) / (C e_z · e_z): the distance to level ground along the body's down axis
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from companion.constants import healthy
from companion.estimation.compass import predict_field, read_compass
from companion.estimation.gps_fixes import predict_fix, read_fixes
from companion.estimation.readings import AidingSensor, Intake, Kinematics, Prediction, Readings
from companion.model import PITCH_270, RangeTrack
from companion.strapdown import quaternion


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
    AidingSensor("gps_position", "gps", "m", 1.0, predict_fix, read_fixes, 0.1, (0.12, 2.0, 60.0),
                 latency_s=_GPS_LATENCY),
    AidingSensor("gps_height", "gps", "m", 1.5, predict_fix, read_fixes, 0.15, (0.5, 2.0, 60.0),
                 latency_s=_GPS_LATENCY, height=True),
    AidingSensor("gps_velocity", "gps", "m/s", 0.2, predict_fix, read_fixes, 0.04, (0.035, 2.5, 10.0),
                 latency_s=_GPS_LATENCY, motion=("gps_position", (0.05, 2.5, 10.0))),
    AidingSensor("gps_climb", "gps", "m/s", 0.3, predict_fix, read_fixes, 0.06, (0.045, 2.0, 10.0),
                 latency_s=_GPS_LATENCY),
    AidingSensor("compass", "compass", "µT", 1.0, predict_field, read_compass, 0.8, (0.4, 2.0, 40.0)),
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
