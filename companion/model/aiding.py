"""The other sensors of a flight and what its estimator says of itself, as frozen dataclasses of arrays.

Conventions of `companion.model.tracks`: `t` in seconds of the boot clock, strictly increasing; SI; FRD and NED. NaN
where the vehicle does not know.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from companion.model.checks import floats, times
from companion.model.errors import DataError
from companion.model.tracks import Array, Sampled


def _check(source: str, t: Array, columns: dict[str, tuple[Array, tuple[int, ...]]]) -> None:
    """Times finite and strictly increasing, every column of its shape (NaN is allowed)."""
    times(f"{source}.t", t)
    for name, (values, shape) in columns.items():
        floats(f"{source}.{name}", values, (len(t), *shape), finite=False)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class GpsTrack(Sampled):
    """One receiver. Rows without a position fix have NaN in latitude, longitude and height."""

    t: Array  # (N,) s; the time of validity where the log tells it, else that of the message
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

    def __post_init__(self) -> None:
        scalars = (
            "latitude", "longitude", "height", "horizontal_sigma", "vertical_sigma", "speed_sigma", "fix_type",
            "satellites",
        )  # fmt: skip
        _check(self.source, self.t, {n: (getattr(self, n), ()) for n in scalars} | {"velocity": (self.velocity, (3,))})


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CompassTrack(Sampled):
    """One magnetometer, in the body frame of the IMU tracks; the autopilot's own hard-iron offsets applied or not."""

    t: Array  # (N,) s
    field: Array  # (N, 3) FRD, tesla
    source: str = ""
    instance: int = 0
    calibrated: bool = True  # whether the autopilot's offsets have been applied

    def __post_init__(self) -> None:
        _check(self.source, self.t, {"field": (self.field, (3,))})


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BarometerTrack(Sampled):
    """One barometer."""

    t: Array  # (N,) s
    pressure: Array  # (N,) Pa
    altitude: Array  # (N,) m, as the vehicle makes of it, else by the standard atmosphere; up, from its own zero
    temperature: Array  # (N,) °C
    source: str = ""
    instance: int = 0

    def __post_init__(self) -> None:
        _check(self.source, self.t, {n: (getattr(self, n), ()) for n in ("pressure", "altitude", "temperature")})


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class AirspeedTrack(Sampled):
    """One airspeed sensor."""

    t: Array  # (N,) s
    airspeed: Array  # (N,) m/s, indicated, along the body's x axis; NaN where only the pressure is told
    true_airspeed: Array  # (N,) m/s, corrected for the density of the air
    pressure: Array  # (N,) Pa, total minus static
    temperature: Array  # (N,) °C
    source: str = ""
    instance: int = 0

    def __post_init__(self) -> None:
        scalars = ("airspeed", "true_airspeed", "pressure", "temperature")
        _check(self.source, self.t, {n: (getattr(self, n), ()) for n in scalars})


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RangeTrack(Sampled):
    """One range finder."""

    t: Array  # (N,) s
    distance: Array  # (N,) m along its own axis; NaN where it calls the reading none or outside its range
    sigma: Array  # (N,) m, the sensor's own 1σ
    quality: Array  # (N,) 0 to 1, the sensor's own
    orientation: int | None = None  # MAV_SENSOR_ORIENTATION: 0 is forward, 25 down; None where it is not told
    least: float | None = None  # m, the range of the sensor
    most: float | None = None  # m
    source: str = ""
    instance: int = 0

    def __post_init__(self) -> None:
        _check(self.source, self.t, {n: (getattr(self, n), ()) for n in ("distance", "sigma", "quality")})


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FlowTrack(Sampled):
    """One optical flow sensor, looking down: a right-handed rotation about an axis makes a positive flow about it."""

    t: Array  # (N,) s, the end of the interval
    flow: Array  # (N, 2) about body x and y, FRD, rad/s: rotation and motion together
    gyro: Array  # (N, 3) FRD, rad/s: how the vehicle turned meanwhile, by the sensor's own or the autopilot's gyro
    interval: Array  # (N,) s, over which both are means; NaN where it is not told
    quality: Array  # (N,) 0 (bad) to 255
    distance: Array  # (N,) m to the ground, where the sensor measures that too
    source: str = ""
    instance: int = 0

    def __post_init__(self) -> None:
        scalars = {n: (getattr(self, n), ()) for n in ("interval", "quality", "distance")}
        _check(self.source, self.t, scalars | {"flow": (self.flow, (2,)), "gyro": (self.gyro, (3,))})


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BiasTrack(Sampled):
    """What an estimator believes one IMU to read too much: truth = reading - bias, in the IMU's own FRD frame."""

    t: Array  # (N,) s
    gyro: Array  # (N, 3) rad/s
    accel: Array  # (N, 3) m/s²
    gyro_sigma: Array  # (N, 3) rad/s, 1σ
    accel_sigma: Array  # (N, 3) m/s²
    source: str = ""  # XKF1[0], estimator_sensor_bias, SCALED_IMU - HIGHRES_IMU, ...
    core: int = 0  # which of the vehicle's estimators
    imu_instance: int | None = 0  # which IMU it speaks of; None where that is not known

    def __post_init__(self) -> None:
        names = ("gyro", "accel", "gyro_sigma", "accel_sigma")
        _check(self.source, self.t, {n: (getattr(self, n), (3,)) for n in names})


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class TruthTrack(Sampled):
    """What a simulator knows. For tests and benchmarks: no analysis reads it."""

    t: Array  # (N,) s
    q_ned_frd: Array  # (N, 4) wxyz; NaN where it is not told
    velocity: Array  # (N, 3) NED, m/s; NaN where it is not told
    position: Array  # (N, 3) NED, m, about the flight's origin; NaN where it is not told
    source: str = ""
    faults: tuple[float, ...] = ()  # s: when the simulator switched a fault on, where it tells

    def __post_init__(self) -> None:
        _check(
            self.source,
            self.t,
            {"q_ned_frd": (self.q_ned_frd, (4,)), "velocity": (self.velocity, (3,)), "position": (self.position, (3,))},
        )


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ControlTrack(Sampled):
    """What the controller wanted, and what it asked of the motors."""

    t: Array  # (N,) s
    q_ned_frd: Array  # (N, 4) wxyz, the desired attitude; NaN where it is not told
    source: str = ""

    def __post_init__(self) -> None:
        _check(self.source, self.t, {"q_ned_frd": (self.q_ned_frd, (4,))})


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ActuatorTrack(Sampled):
    """Outputs to motors and servos."""

    t: Array  # (N,) s
    output: Array  # (N, K) as a share of the range, 0 to 1; NaN for outputs not in use
    source: str = ""

    def __post_init__(self) -> None:
        if self.output.ndim != 2:
            raise DataError(f"{self.source}.output must have shape (N, K), got {self.output.shape}")
        _check(self.source, self.t, {"output": (self.output, self.output.shape[1:])})


ResetKind = Literal["attitude", "heading", "velocity", "position", "height", "lane"]


@dataclass(frozen=True, slots=True)
class EstimatorReset:
    """A jump that the estimator announced itself: a reset of a state, or the change to another core."""

    t: float  # s
    kind: ResetKind
    text: str = ""  # untrusted: escape it before it becomes markup
    core: int | None = None


@dataclass(frozen=True, slots=True)
class ParameterChange:
    """A parameter that got another value while the log ran."""

    t: float  # s
    name: str
    value: float


@dataclass(frozen=True, slots=True, eq=False)
class SensorInUse:
    """Which IMU, receiver, compass, ... the estimator that flew used from each time on."""

    t: Array  # (N,) s
    instance: npt.NDArray[np.int64]  # (N,)
    source: str = ""  # XKF4.PI, sensor_selection, ...

    def __post_init__(self) -> None:
        floats(f"{self.source}.instance", self.instance, self.t.shape)

    def uses(self, instance: int, start: float, end: float) -> bool:
        """Whether it used an instance between two times (s), as far as it is known."""
        until = np.append(self.t[1:], np.inf)
        return not len(self.t) or bool((self.instance[(self.t < end) & (until > start)] == instance).any())

    @property
    def changes(self) -> list[tuple[float, int]]:
        """Each time (s) with the instance that is used from then on."""
        return list(zip(self.t.tolist(), self.instance.tolist(), strict=True))

    def at(self, t: Array) -> npt.NDArray[np.int64]:
        """The instance in use at each of the times t (N,) s (the first one before the log tells)."""
        return self.instance[np.maximum(np.searchsorted(self.t, t, side="right") - 1, 0)]


PhaseKind = Literal["aligning", "standing", "flight", "landed", "impact"]


@dataclass(frozen=True, slots=True)
class Phase:
    """A part of the flight. Only `standing` and `flight` are judged; an `impact` begins where control was lost."""

    start: float  # s
    end: float  # s
    kind: PhaseKind
    reason: str = ""  # what tells it
