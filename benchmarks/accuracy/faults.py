"""Faults to inject into healthy flights: one table of what is wrong, on which side, and in which sizes.

A fault of a sensor (IMU, GPS, compass) changes what the sensor says; what the estimator makes of it is the small EKF's
matter (ekf.py). A fault of the estimate itself bends the recorded attitude or position.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from benchmarks.accuracy.cutting import alone, at, attitude_at, every_imu, gps_moved, with_twin
from companion.model import Array, Flight, GpsTrack, ImuTrack
from companion.strapdown import quaternion

Inject = Callable[[Flight, float, float], Flight]  # (flight, size, onset in s) → flight
Imus = Literal["its own", "one", "with a twin"]

_RAMP_S = 40.0  # biases that grow
_DRIFT_S = 30.0  # headings and positions that drift
_TURN_S = 10.0  # tilts and compasses that turn
_HEATS_S = 60.0  # time constant of a part that warms


@dataclass(frozen=True, slots=True)
class Fault:
    """One way to be wrong. Sizes ascend, from what nobody can see to what nobody can miss."""

    name: str
    side: Literal["imu", "autopilot"]
    causes: tuple[str, ...]  # in the words of labels.toml
    unit: str
    sizes: tuple[float, ...]  # in `unit`
    scale: float  # of the unit, in SI
    inject: Inject
    sensed: bool = True  # a sensor is wrong, and the estimator follows; otherwise the estimate alone is
    throughout: bool = False  # there is no onset: it has always been so
    middle: int = 1  # the size that is taken where one has to do
    imus: Imus = "its own"  # that the vehicle has; of two, one is healthy

    def made_into(self, flight: Flight) -> Flight:
        """A healthy flight of a vehicle with these IMUs."""
        if self.imus == "its own":
            return flight
        one = alone(flight)
        return one if self.imus == "one" else with_twin(one)


def _gyro(change: Callable[[Array, Array, float], Array]) -> Inject:
    """A change of the gyro's readings (N, 3), given the time since the onset (N,) and the size."""

    def inject(flight: Flight, size: float, onset: float) -> Flight:
        def changed(imu: ImuTrack) -> ImuTrack:
            return replace(imu, gyro=change(imu.t - onset, imu.gyro, size))

        return every_imu(flight, changed, flight.imu().instance)

    return inject


def _accel(change: Callable[[Array, Array, float], Array]) -> Inject:
    def inject(flight: Flight, size: float, onset: float) -> Flight:
        def changed(imu: ImuTrack) -> ImuTrack:
            return replace(imu, accel=change(imu.t - onset, imu.accel, size))

        return every_imu(flight, changed, flight.imu().instance)

    return inject


def _constant(change: Callable[[Array, Array, float], Array]) -> Callable[[Array, Array, float], Array]:
    """The same from the first sample on."""
    return lambda since, readings, size: change(np.zeros(len(since)), readings, size)


def _step(axis: int) -> Callable[[Array, Array, float], Array]:
    def change(since: Array, readings: Array, size: float) -> Array:
        return np.asarray(readings + size * np.eye(3)[axis] * (since >= 0)[:, None])

    return change


def _ramp(axis: int) -> Callable[[Array, Array, float], Array]:
    def change(since: Array, readings: Array, size: float) -> Array:
        return np.asarray(readings + size * np.eye(3)[axis] * np.clip(since / _RAMP_S, 0, 1)[:, None])

    return change


def _scaled(since: Array, readings: Array, size: float) -> Array:
    return readings * (1 + size * (since >= 0)[:, None])


def _stuck(axis: int) -> Callable[[Array, Array, float], Array]:
    def change(since: Array, readings: Array, size: float) -> Array:
        held = readings.copy()
        inside = (since >= 0) & (since < size)
        if inside.any():
            held[inside, axis] = readings[np.argmax(inside), axis]
        return held

    return change


def _flipped(axis: int) -> Callable[[Array, Array, float], Array]:
    sign = np.where(np.arange(3) == axis, -1.0, 1.0)
    return lambda since, readings, size: readings * sign  # noqa: ARG005


def _clipped(since: Array, readings: Array, size: float) -> Array:
    """The range is less than the largest reading by `size`, a share of it."""
    end = (1 - size) * np.quantile(np.abs(readings), 0.9999)
    return np.where((since >= 0)[:, None], np.clip(readings, -end, end), readings)


def _swapped(flight: Flight, size: float, onset: float) -> Flight:
    del size, onset

    def changed(imu: ImuTrack) -> ImuTrack:
        return replace(imu, gyro=imu.gyro[:, [1, 0, 2]], accel=imu.accel[:, [1, 0, 2]])

    return every_imu(flight, changed, flight.imu().instance)


def _heats(flight: Flight, size: float, onset: float) -> Flight:
    """The bias of the gyro's x grows as its part warms, from the beginning to `size` at the end."""
    del onset

    def changed(imu: ImuTrack) -> ImuTrack:
        grown = 1.0 - np.exp((imu.t[0] - imu.t) / _HEATS_S)
        return replace(imu, gyro=imu.gyro + size * np.outer(grown / grown[-1], [1.0, 0.0, 0.0]))

    return every_imu(flight, changed, flight.imu().instance)


def _board_turned(flight: Flight, size: float, onset: float) -> Flight:
    """The board sits turned about its vertical, and its settings do not know: so does the IMU on it."""
    del onset
    turn = quaternion.exp(np.array([0.0, 0.0, -size]))

    def changed(imu: ImuTrack) -> ImuTrack:
        return replace(imu, gyro=quaternion.rotate(turn, imu.gyro), accel=quaternion.rotate(turn, imu.accel))

    return every_imu(flight, changed, flight.imu().instance)


def _compass_turned(flight: Flight, size: float, onset: float) -> Flight:
    """Every compass sits turned about the vertical."""
    del onset
    turn = quaternion.exp(np.array([0.0, 0.0, -size]))
    turned = (replace(compass, field=quaternion.rotate(turn, compass.field)) for compass in flight.compasses)
    return replace(flight, compasses=tuple(turned))


def _turned(turn: Callable[[Array, float], Array]) -> Inject:
    """The recorded attitude turned in the world by rotation vectors (N, 3), given the time since the onset."""

    def inject(flight: Flight, size: float, onset: float) -> Flight:
        attitude = flight.require_attitude()
        q = quaternion.multiply(quaternion.exp(turn(attitude.t - onset, size)), attitude.q_ned_frd)
        return replace(flight, attitude=replace(attitude, q_ned_frd=quaternion.continuous_sign(q)))

    return inject


def _about(axis: int, course: Array, size: float) -> Array:
    return np.asarray(size * course[:, None] * np.eye(3)[axis])


def _moved(course: Callable[[Array], Array]) -> Inject:
    """The recorded position moved to the north-east, and its velocity does not know."""

    def inject(flight: Flight, size: float, onset: float) -> Flight:
        assert flight.position
        position = flight.position
        away = size * course(position.t - onset)[:, None] * np.array([0.6, 0.8, 0.0])
        return replace(flight, position=replace(position, position=position.position + away))

    return inject


def _late(flight: Flight, size: float, onset: float) -> Flight:
    """The estimate of `size` s ago."""
    attitude, position = flight.require_attitude(), flight.position
    ta = attitude.t - size * (attitude.t >= onset)
    late = replace(
        attitude,
        q_ned_frd=quaternion.continuous_sign(attitude_at(ta, attitude.t, attitude.q_ned_frd)),
        rates=at(ta, attitude.t, attitude.rates),
    )
    if position is None:
        return replace(flight, attitude=late)
    tp = position.t - size * (position.t >= onset)
    both = np.hstack([position.position, position.velocity])
    values = at(tp, position.t, both)
    return replace(flight, attitude=late, position=replace(position, position=values[:, :3], velocity=values[:, 3:]))


def _gps(course: Callable[[Array], Array], *, velocity: bool = False) -> Inject:
    """Every receiver moved to the north-east; with `velocity`, the velocity that it tells goes with it."""

    def inject(flight: Flight, size: float, onset: float) -> Flight:
        def moved(gps: GpsTrack) -> GpsTrack:
            away = size * course(gps.t - onset)[:, None] * np.array([0.6, 0.8])
            told = gps.velocity.copy()
            if velocity:
                told[1:, :2] += np.diff(away, axis=0) / np.diff(gps.t)[:, None]
            return replace(gps_moved(gps, away), velocity=told)

        return replace(flight, gps=tuple(map(moved, flight.gps)))

    return inject


def _gps_late(flight: Flight, size: float, onset: float) -> Flight:
    def late(gps: GpsTrack) -> GpsTrack:
        before = gps.t - size * (gps.t >= onset)
        columns = np.column_stack([gps.latitude, gps.longitude, gps.height, gps.velocity])
        values = at(before, gps.t, columns)
        return replace(gps, latitude=values[:, 0], longitude=values[:, 1], height=values[:, 2], velocity=values[:, 3:])

    return replace(flight, gps=tuple(map(late, flight.gps)))


def _compass(flight: Flight, size: float, onset: float) -> Flight:
    """The field about every compass turns in the world, as beside a wall."""
    attitude = flight.require_attitude()
    turned = []
    for compass in flight.compasses:
        q = attitude_at(compass.t, attitude.t, attitude.q_ned_frd)
        turn = quaternion.exp(_about(2, np.clip((compass.t - onset) / _TURN_S, 0, 1), size))
        world = quaternion.rotate(turn, quaternion.rotate(q, compass.field))
        turned.append(replace(compass, field=quaternion.rotate(quaternion.conjugate(q), world)))
    return replace(flight, compasses=tuple(turned))


def _jump(since: Array) -> Array:
    return (since >= 0).astype(np.float64)


def _creep(since: Array) -> Array:
    return np.clip(since, 0, _DRIFT_S)


def _installed(imus: Imus) -> Iterator[Fault]:
    """What is wrong from the start on, of a vehicle with one IMU, or with a healthy second one."""
    with_it = {"one": "one IMU", "with a twin": "second IMU healthy"}[imus]
    some = (
        Fault("gyro bias from the start (z)", "imu", ("gyro_bias",), "mrad/s", (50, 200), _MRAD,
              _gyro(_constant(_step(2)))),
        Fault("accel. bias from the start (x)", "imu", ("accel_bias",), "m/s²", (1, 3), 1.0,
              _accel(_constant(_step(0)))),
        Fault("gyro scale from the start", "imu", ("gyro_scale",), "%", (10, 30), _PERCENT,
              _gyro(_constant(_scaled))),
        Fault("accel. scale from the start", "imu", ("accel_scale", "accel_bias"), "%", (10, 20), _PERCENT,
              _accel(_constant(_scaled))),
        Fault("board turned", "imu", ("axes",), "°", (90,), _DEG, _board_turned),
        Fault("compass turned", "autopilot", ("heading", "attitude"), "°", (90,), _DEG, _compass_turned),
    )  # fmt: skip
    for one in some:
        yield replace(one, name=f"{one.name}, {with_it}", throughout=True, middle=len(one.sizes) - 1, imus=imus)


_MRAD, _PERCENT, _DEG = 1e-3, 1e-2, float(np.radians(1))

FAULTS: tuple[Fault, ...] = (
    Fault("gyro bias, step (z)", "imu", ("gyro_bias",), "mrad/s", (3, 10, 30), _MRAD, _gyro(_step(2))),
    Fault("gyro bias, step (x)", "imu", ("gyro_bias",), "mrad/s", (10, 30), _MRAD, _gyro(_step(0)), middle=0),
    Fault("gyro bias, ramp of 40 s (x)", "imu", ("gyro_bias",), "mrad/s", (10, 30), _MRAD, _gyro(_ramp(0)), middle=0),
    Fault("gyro scale", "imu", ("gyro_scale",), "%", (10, 30), _PERCENT, _gyro(_scaled), middle=0),
    Fault("gyro axis stuck (x)", "imu", ("stuck",), "s", (2, 20), 1.0, _gyro(_stuck(0))),
    Fault("gyro sign (x)", "imu", ("axes",), "", (1,), 1.0, _gyro(_flipped(0)), throughout=True, middle=0),
    Fault("gyro saturated", "imu", ("saturation",), "% of the largest", (25, 75), _PERCENT, _gyro(_clipped)),
    Fault("accel. bias, step (x)", "imu", ("accel_bias",), "m/s²", (0.15, 0.5, 1.5), 1.0, _accel(_step(0))),
    Fault("accel. bias, step (z)", "imu", ("accel_bias",), "m/s²", (0.5, 1.5), 1.0, _accel(_step(2)), middle=0),
    Fault("accel. bias, ramp of 40 s (x)", "imu", ("accel_bias",), "m/s²", (1, 3), 1.0, _accel(_ramp(0)), middle=0),
    Fault("accel. scale", "imu", ("accel_scale", "accel_bias"), "%", (4, 10), _PERCENT, _accel(_scaled), middle=0),
    Fault("accel. axis stuck (x)", "imu", ("stuck",), "s", (2, 20), 1.0, _accel(_stuck(0))),
    Fault("accel. sign (x)", "imu", ("axes",), "", (1,), 1.0, _accel(_flipped(0)), throughout=True, middle=0),
    Fault("accel. saturated", "imu", ("saturation",), "% of the largest", (25, 60), _PERCENT, _accel(_clipped)),
    Fault("axes x and y swapped", "imu", ("axes",), "", (1,), 1.0, _swapped, throughout=True, middle=0),
    Fault(
        "heading steps", "autopilot", ("heading", "attitude"), "°", (5, 15, 45), _DEG,
        _turned(lambda t, s: _about(2, _jump(t), s)), sensed=False,
    ),
    Fault(
        "heading drifts for 30 s", "autopilot", ("heading", "attitude"), "°/s", (0.3, 1), _DEG,
        _turned(lambda t, s: _about(2, _creep(t), s)), sensed=False, middle=0,
    ),
    Fault(
        "attitude leans over within 10 s", "autopilot", ("tilt", "attitude"), "°", (1, 3, 10), _DEG,
        _turned(lambda t, s: _about(0, np.clip(t / _TURN_S, 0, 1), s)), sensed=False,
    ),
    Fault("position jumps", "autopilot", ("position",), "m", (3, 10, 30), 1.0, _moved(_jump), sensed=False),
    Fault(
        "position creeps for 30 s", "autopilot", ("position",), "m/s", (0.3, 1, 3), 1.0, _moved(_creep),
        sensed=False,
    ),
    Fault(
        "estimate is late", "autopilot", ("latency", "attitude"), "ms", (150, 400), 1e-3, _late, sensed=False, middle=0,
    ),
    Fault("GPS jumps", "autopilot", ("position",), "m", (2, 10, 50), 1.0, _gps(_jump)),
    Fault("GPS creeps for 30 s", "autopilot", ("position",), "m/s", (0.3, 1, 3), 1.0, _gps(_creep)),
    Fault(
        "GPS creeps, its velocity too", "autopilot", ("position", "velocity"), "m/s", (0.3, 1, 3), 1.0,
        _gps(_creep, velocity=True),
    ),
    Fault("GPS is late", "autopilot", ("latency", "position"), "ms", (500, 1000), 1e-3, _gps_late, middle=0),
    Fault("compass turns within 10 s", "autopilot", ("heading", "attitude"), "°", (5, 15, 45), _DEG, _compass),
    *_installed("one"),
    *_installed("with a twin"),
    Fault(
        "gyro drifts with heat (x), second IMU healthy", "imu", ("gyro_bias",), "mrad/s", (10, 30), _MRAD, _heats,
        throughout=True, imus="with a twin",
    ),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Stated:
    """A fault whose detectable size a verdict states."""

    unit: str
    scale: float  # of the unit, in SI
    inject: Callable[[Flight, float, float, np.random.Generator], Flight]  # (flight, size in SI, middle in s, random)
    sensed: bool = True  # see `Fault`
    side: Literal["imu", "autopilot"] = "imu"
    causes: tuple[str, ...] = ()


def _any_axis(sensor: Literal["gyro", "accel"]) -> Callable[[Flight, float, float, np.random.Generator], Flight]:
    """A step of one axis, either way."""
    of = {"gyro": _gyro, "accel": _accel}[sensor]

    def inject(flight: Flight, size: float, middle: float, random: np.random.Generator) -> Flight:
        return of(_step(int(random.integers(3))))(flight, size * random.choice([-1.0, 1.0]), middle)

    return inject


def _either_way(inject: Inject, lasts: float = 0.0) -> Callable[[Flight, float, float, np.random.Generator], Flight]:
    """A fault of either sign, in the middle of which it has grown to half."""
    return lambda flight, size, middle, random: inject(flight, size * random.choice([-1.0, 1.0]), middle - 0.5 * lasts)


STATED: Mapping[str, Stated] = {
    "gyro_bias": Stated("mrad/s", _MRAD, _any_axis("gyro"), causes=("gyro_bias",)),
    "accel_bias": Stated("m/s²", 1.0, _any_axis("accel"), causes=("accel_bias",)),
    "gps": Stated(
        "m in 30 s", 1.0, _either_way(_gps(lambda t: _creep(t) / _DRIFT_S), _DRIFT_S), side="autopilot",
        causes=("position",),
    ),
    "compass": Stated(
        "° in 10 s", _DEG, _either_way(_compass, _TURN_S), side="autopilot", causes=("heading", "attitude")
    ),
    "tilt": Stated(
        "°", _DEG,
        lambda flight, size, middle, random: _turned(
            lambda t, s: _about(int(random.integers(2)), _jump(t), s * random.choice([-1.0, 1.0]))
        )(flight, size, middle),
        sensed=False, side="autopilot", causes=("tilt", "attitude"),
    ),
    "heading": Stated(
        "°", _DEG, _either_way(_turned(lambda t, s: _about(2, _jump(t), s))), sensed=False, side="autopilot",
        causes=("heading", "attitude"),
    ),
    "position": Stated(
        "m", 1.0, _either_way(_moved(_jump)), sensed=False, side="autopilot", causes=("position",)
    ),
}  # fmt: skip
"""Name among the smallest sizes of a verdict → the fault of which it would have shown that much.

Steps, lasting, in the middle of the flight; a GPS that creeps and a compass that turns go off evenly about it.
"""
