"""The aiding sensors of a flight, its estimator's own reports and its lanes, as frozen dataclasses of arrays.

Conventions of `companion.model.tracks`: `t` in seconds of the boot clock, strictly increasing; SI; FRD and NED. NaN
where the vehicle does not know.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from companion.model.errors import DataError, floats
from companion.model.tracks import Array, Checked, SensorInUse


class _Readings(Checked):
    """What a sensor or estimator reports: a track whose columns may hold NaN."""

    __slots__ = ()

    source: str
    _finite = False

    @property
    def _named(self) -> str:
        return self.source


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class GpsTrack(_Readings):
    """One receiver. Rows without a position fix have NaN in latitude, longitude and height."""

    t: Array  # (N,) s; the time of validity where it is logged, else that of the message
    latitude: Array  # (N,) rad, WGS-84
    longitude: Array  # (N,) rad
    height: Array  # (N,) m above mean sea level; NaN below a 3D fix
    velocity: Array  # (N, 3) NED, m/s; the down part NaN where the message has speed and course only
    horizontal_sigma: Array  # (N,) m, the receiver's own 1σ
    vertical_sigma: Array  # (N,) m
    speed_sigma: Array  # (N,) m/s
    fix_type: Array  # (N,) GPS_FIX_TYPE: 2 is 2D, 3 is 3D, 4 DGPS, 5 RTK float, 6 RTK fixed
    satellites: Array  # (N,)
    source: str = ""  # GPS_RAW_INT, GPS[1], vehicle_gps_position, ...
    instance: int = 0  # which receiver


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CompassTrack(_Readings):
    """One magnetometer, in the body frame of the IMU tracks; the autopilot's own hard-iron offsets applied or not."""

    t: Array  # (N,) s
    field: Array  # (N, 3) FRD, tesla
    source: str = ""
    instance: int = 0
    calibrated: bool = True  # whether the autopilot's offsets have been applied


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BarometerTrack(_Readings):
    """One barometer."""

    t: Array  # (N,) s
    pressure: Array  # (N,) Pa
    altitude: Array  # (N,) m, as the vehicle makes of it, else by the standard atmosphere; up, from its own zero
    temperature: Array  # (N,) °C
    source: str = ""
    instance: int = 0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class AirspeedTrack(_Readings):
    """One airspeed sensor."""

    t: Array  # (N,) s
    airspeed: Array  # (N,) m/s, indicated, along the body's x axis; NaN where only the pressure is reported
    true_airspeed: Array  # (N,) m/s, corrected for the density of the air
    pressure: Array  # (N,) Pa, total minus static
    temperature: Array  # (N,) °C
    source: str = ""
    instance: int = 0


PITCH_270 = 25
"""MAV_SENSOR_ORIENTATION of a sensor that looks down."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RangeTrack(_Readings):
    """One range finder."""

    t: Array  # (N,) s
    distance: Array  # (N,) m along its own axis; NaN where it calls the reading none or outside its range
    sigma: Array  # (N,) m, the sensor's own 1σ
    quality: Array  # (N,) 0 to 1, the sensor's own
    orientation: int | None = None  # MAV_SENSOR_ORIENTATION: 0 is forward, 25 down; None: unknown
    least: float | None = None  # m, the range of the sensor
    most: float | None = None  # m
    source: str = ""
    instance: int = 0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FlowTrack(_Readings):
    """One optical flow sensor, looking down: a right-handed rotation about an axis makes a positive flow about it."""

    t: Array  # (N,) s, the end of the interval
    flow: Array  # (N, 2) about body x and y, FRD, rad/s: rotation and motion together
    gyro: Array  # (N, 3) FRD, rad/s: the vehicle's own rotation, by the sensor's own or the autopilot's gyro
    interval: Array  # (N,) s, over which both are means; NaN: unknown
    quality: Array  # (N,) 0 (bad) to 255
    distance: Array  # (N,) m to the ground, where the sensor measures that too
    source: str = ""
    instance: int = 0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BiasTrack(_Readings):
    """What an estimator believes one IMU to read too much: truth = reading - bias, in the IMU's own FRD frame."""

    t: Array  # (N,) s
    gyro: Array  # (N, 3) rad/s
    accel: Array  # (N, 3) m/s²
    gyro_sigma: Array  # (N, 3) rad/s, 1σ
    accel_sigma: Array  # (N, 3) m/s²
    source: str = ""  # XKF1[0], estimator_sensor_bias, SCALED_IMU - HIGHRES_IMU, ...
    core: int = 0  # which of the vehicle's estimators
    imu_instance: int | None = 0  # which IMU it is of; None: unknown


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class TruthTrack(_Readings):
    """What a simulator knows. For tests and benchmarks: no analysis reads it."""

    t: Array  # (N,) s
    q_ned_frd: Array  # (N, 4) wxyz; NaN where it is not reported
    velocity: Array  # (N, 3) NED, m/s; NaN where it is not reported
    position: Array  # (N, 3) NED, m, about the flight's origin; NaN where it is not reported
    source: str = ""
    faults: tuple[float, ...] = ()  # s: when the simulator switched a fault on, where it is logged


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ControlTrack(_Readings):
    """The attitude that the controller demands."""

    t: Array  # (N,) s
    q_ned_frd: Array  # (N, 4) wxyz, the desired attitude; NaN where it is not reported
    source: str = ""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ActuatorTrack(_Readings):
    """Outputs to motors and servos."""

    t: Array  # (N,) s
    output: Array  # (N, K) as a share of the range, 0 to 1; NaN for outputs not in use
    source: str = ""

    @property
    def _shapes(self) -> Mapping[str, tuple[int]]:
        if self.output.ndim != 2:
            raise DataError(f"{self.source}.output must have shape (N, K), got {self.output.shape}")
        return {"output": (self.output.shape[1],)}


ResetKind = Literal["attitude", "heading", "velocity", "position", "height", "lane"]


@dataclass(frozen=True, slots=True)
class EstimatorReset:
    """A jump that the estimator announced itself: a reset of a state, or the change to another core."""

    t: float  # s
    kind: ResetKind
    text: str = ""  # untrusted: escape it before it becomes markup
    core: int | None = None


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened. The text is untrusted: escape it before it becomes markup."""

    t: float  # s, boot clock
    kind: str  # "armed", "disarmed", "mode", "error" or "event"
    text: str  # the name of the mode, or what happened


@dataclass(frozen=True, slots=True)
class ParameterChange:
    """A parameter that got another value while the log ran."""

    t: float  # s
    name: str
    value: float


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class EstimatorLane(_Readings):
    """One core of an EKF, one instance of EKF2, or DCM: what it estimated, whether or not the vehicle flew by it."""

    t: Array  # (N,) s, strictly increasing
    q_ned_frd: Array  # (N, 4) wxyz, in the body frame of the IMU tracks
    velocity: Array  # (N, 3) NED, m/s; NaN where it is not logged, or not valid
    position: Array  # (N, 3) NED, m; NaN alike. The zero is the estimator's own
    name: str  # "EKF3 core 0", "EKF2 instance 1", "DCM"
    core: int | None = None  # its number among those that may fly; None for a fallback, which has none
    source: str = ""  # XKQ[0], estimator_attitude_1, AHRS2, ...
    imu: int | None = None  # the IMU that it reads; None: unknown
    sensors: Mapping[str, SensorInUse] = field(default_factory=dict)  # "GPS", "compass", ... → the one that it uses

    def __post_init__(self) -> None:
        _Readings.__post_init__(self)
        floats(f"{self.source}.q_ned_frd", self.q_ned_frd, self.q_ned_frd.shape)

    @property
    def has_position(self) -> bool:
        """Whether any position of it is known."""
        return bool(np.isfinite(self.position).any())


PhaseKind = Literal["aligning", "standing", "flight", "landed", "impact"]


@dataclass(frozen=True, slots=True)
class Phase:
    """A part of the flight. Only `standing` and `flight` are judged; an `impact` begins where control was lost."""

    start: float  # s
    end: float  # s
    kind: PhaseKind
    reason: str = ""  # the evidence for it
