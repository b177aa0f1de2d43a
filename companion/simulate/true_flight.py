"""A flight with known truth: motion, sensor readings, the autopilot's estimate, faults.

Also here: a quadrotor's flight in closed form: take-off, squares with yaw turns at the corners, landing.

The path is a sum of smooth steps, three times differentiable everywhere. A multicopter's thrust stands along its own
down axis, so the path and the heading fix its attitude and, by their derivatives, its rates (differential flatness:
Mellinger & Kumar, "Minimum snap trajectory generation and control for quadrotors", ICRA 2011, §III).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from companion.model import STANDARD_GRAVITY, Array, ImuTrack, SettingsError, interpolated
from companion.strapdown import ImuModel, Motion, Sensor, motions, quaternion, simulate

SIDE = 28.0  # m
HEIGHT = 10.0  # m

_REST_S, _CLIMB_S, _HOVER_S, _LEG_S, _TURN_S, _PAUSE_S, _DESCENT_S = 6.0, 7.0, 4.0, 7.0, 3.0, 0.5, 9.0
_LAP_S = 4 * (_LEG_S + _TURN_S + 2 * _PAUSE_S)
_ONCE_S = 2 * _REST_S + _CLIMB_S + 2 * _HOVER_S + _DESCENT_S
_STEP = np.polynomial.Polynomial([0, 0, 0, 0, 35, -84, 70, -20])  # 0 → 1 with three derivatives zero at both ends
_DERIVATIVES = [_STEP.deriv(order) if order else _STEP for order in range(4)]


@dataclass(frozen=True, slots=True)
class _Move:
    """A smooth step."""

    begin: float  # s
    duration: float  # s
    by: tuple[float, float, float]  # north, east, down, m
    turn: float = 0.0  # yaw, rad


def square(t: Array) -> Motion:
    """At times t (N,) s, from rest at t = 0 to rest at the end: as many laps as fit, at least one.

    A flight of less than 75 s ends in the air.
    """
    t = np.asarray(t, dtype=np.float64)
    laps = max(1, int((float(t[-1]) - _ONCE_S) // _LAP_S))
    states = np.zeros((4, len(t), 4))  # order of the derivative, time, (north, east, down, yaw)
    for move in _moves(laps):
        first, last = np.searchsorted(t, [move.begin, move.begin + move.duration])
        u, by = (t[first:last] - move.begin) / move.duration, np.array([*move.by, move.turn])
        for order, polynomial in enumerate(_DERIVATIVES):
            states[order, first:last] += (polynomial(u) / move.duration**order)[:, None] * by
        states[0, last:] += by
    return _flown(t, *states[..., :3], *states[:2, :, 3])


def _moves(laps: int) -> list[_Move]:
    moves = [_Move(_REST_S, _CLIMB_S, (0.0, 0.0, -HEIGHT))]
    now = _REST_S + _CLIMB_S + _HOVER_S
    for leg in range(4 * laps):
        north, east = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[leg % 4]
        moves.append(_Move(now, _LEG_S, (SIDE * north, SIDE * east, 0.0)))
        now += _LEG_S + _PAUSE_S
        moves.append(_Move(now, _TURN_S, (0.0, 0.0, 0.0), np.pi / 2))
        now += _TURN_S + _PAUSE_S
    moves.append(_Move(now + _HOVER_S, _DESCENT_S, (0.0, 0.0, HEIGHT)))
    return moves


def _flown(
    t: Array, position: Array, velocity: Array, acceleration: Array, jerk: Array, yaw: Array, yaw_rate: Array
) -> Motion:
    """The attitude that this path and heading need, its rates, and what an accelerometer reads on the way."""
    thrust = np.array([0.0, 0.0, STANDARD_GRAVITY]) - acceleration  # per mass, along the body's down axis
    size = np.linalg.norm(thrust, axis=1, keepdims=True)
    down = thrust / size
    down_rate = (-jerk - down * _dot(down, -jerk)) / size
    ahead = np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)])
    ahead_rate = yaw_rate[:, None] * np.column_stack([-np.sin(yaw), np.cos(yaw), np.zeros_like(yaw)])
    across = np.cross(down, ahead)
    across_size = np.linalg.norm(across, axis=1, keepdims=True)
    right = across / across_size
    forward = np.cross(right, down)
    across_rate = np.cross(down_rate, ahead) + np.cross(down, ahead_rate)
    gyro = np.hstack([-_dot(right, down_rate), _dot(forward, down_rate), -_dot(forward, across_rate) / across_size])
    q = quaternion.continuous_sign(quaternion.from_matrix(np.stack([forward, right, down], axis=-1)))
    accel = np.column_stack([np.zeros((len(t), 2)), -size])
    return Motion(t, q, velocity, position, gyro, accel)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.sum(a * b, axis=1, keepdims=True))


HOME = (float(np.radians(47.0)), float(np.radians(8.0)), 500.0)
"""Where simulated vehicles fly: latitude and longitude in rad, m above mean sea level."""

EARTH_FIELD = np.array([21.765e-6, 1.232e-6, 42.914e-6])
"""The Earth's field at HOME, NED, tesla: World Magnetic Model 2020, end of 2023."""

FIX_PERIOD_S, FIX_LATENCY_S = 0.2, 0.1
GPS_SIGMA = (0.3, 0.5, 0.1)
"""1σ of a fix: horizontal and vertical, m; of its velocity, m/s."""

_COMPASS_SIGMA = 0.5e-6  # tesla
_SECOND_IRON = np.array([0.8e-6, -0.5e-6, 0.3e-6])  # what calibration has left of the second compass' hard iron
_BAROMETER_SIGMA = 0.1  # m


@dataclass(frozen=True, slots=True, eq=False)
class AidingReadings:
    """Readings at the N times of a motion, and fixes as they come."""

    fixed: Array  # (M,) s, when a fix reached the autopilot: FIX_LATENCY_S after its time of validity
    place: Array  # (M, 3) m, NED about HOME
    velocity: Array  # (M, 3) m/s, NED
    fields: tuple[Array, Array]  # (N, 3) tesla, FRD, of either compass
    height: Array  # (N,) m above HOME, by the barometer


def aiding_readings(truth: Motion, seed: int) -> AidingReadings:
    """What the sensors read of a motion. The same seed gives the same readings."""
    rng = np.random.default_rng([seed, 1])  # the IMU's noise has draws of its own
    t = truth.t
    fixed = np.arange(t[0], t[-1] + 1e-9, FIX_PERIOD_S)
    horizontal, vertical, speed = GPS_SIGMA
    place, velocity = (interpolated(fixed - FIX_LATENCY_S, t, of) for of in (truth.position, truth.velocity))
    field = quaternion.rotate(quaternion.conjugate(truth.q_ned_frd), EARTH_FIELD)
    first, second = field + _COMPASS_SIGMA * rng.standard_normal((2, len(t), 3))
    return AidingReadings(
        fixed=fixed,
        place=place + [horizontal, horizontal, vertical] * rng.standard_normal(place.shape),
        velocity=velocity + speed * rng.standard_normal(velocity.shape),
        fields=(first, second + _SECOND_IRON),
        height=-truth.position[:, 2] + _BAROMETER_SIGMA * rng.standard_normal(len(t)),
    )


def pressure(height: Array) -> Array:
    """Pa at heights (N,) m above HOME, by the standard atmosphere (ISO 2533)."""
    return np.asarray(101_325.0 * (1.0 - 2.25577e-5 * (HOME[2] + height)) ** 5.25588)


@dataclass(frozen=True, slots=True)
class Faults:
    """Faults of a simulated flight; times in s since it began."""

    reboot: tuple[float, ...] = ()  # s, the autopilot starts again: clock, sequence and intervals are gone
    silence: tuple[tuple[float, float], ...] = ()  # (begin, end) s, nothing is sent
    drop: float = 0.0  # share of packets that get lost
    duplicate: float = 0.0  # share of packets that arrive twice
    reorder: float = 0.0  # share of packets that arrive after the next
    garbage: float = 0.0  # share of packets with noise in front of them
    denied: frozenset[str] = frozenset()  # messages whose interval may not be set; "*": none may
    never: frozenset[str] = frozenset()  # messages that are promised and never come, as PX4 does without a source
    turned_down: tuple[float, ...] = ()  # s, another ground station requests every stream at 2 Hz
    imu_bias: tuple[float, float] | None = None  # from s on, rad/s about z: a gyro bias
    imu_stuck: float | None = None  # from s on, every axis reads the same
    imu_clip: tuple[float, float] | None = None  # (begin, end) s, vibration beyond the accelerometer's range
    gps_glitch: tuple[float, float, float] | None = None  # (begin, end) s, m east: the estimate follows a false GPS
    ekf_reset: tuple[float, float] | None = None  # from s on, m north: the estimate jumps

    def __post_init__(self) -> None:
        for name in ("drop", "duplicate", "reorder", "garbage"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise SettingsError(f"the fault {name} is a share between 0 and 1, got {getattr(self, name)}")

    def silent(self, t: float) -> bool:
        """Whether nothing is sent at t s."""
        return any(begin <= t < end for begin, end in self.silence)


class Channel:
    """A bad link: loses, doubles, swaps and soils packets at random, the same way for the same seed."""

    def __init__(self, faults: Faults, seed: int) -> None:
        self._faults = faults
        self._rng = np.random.default_rng(seed)
        self._late: tuple[float, bytes] | None = None

    def carry(self, packets: Iterable[tuple[float, bytes]]) -> Iterator[tuple[float, bytes]]:
        """The packets that arrive, each with its time."""
        faults = self._faults
        if not (faults.silence or faults.drop or faults.duplicate or faults.reorder or faults.garbage):
            yield from packets
            return
        for t, packet in packets:
            lost, twice, late, soiled = self._rng.random(4)
            if faults.silent(t) or lost < faults.drop:
                continue
            arriving = self._rng.bytes(20) + packet if soiled < faults.garbage else packet
            if self._late is None and late < faults.reorder:
                self._late = (t, arriving)
                continue
            yield t, arriving
            if twice < faults.duplicate:
                yield t, arriving
            if self._late is not None:
                yield t, self._late[1]
                self._late = None


LOOP_US = 2500
"""Period of the autopilot's main loop: ArduCopter's 400 Hz."""

MOTIONS: dict[str, Callable[[Array], Motion]] = {
    "square": square,
    "circle": motions.circle,
    "coning": motions.coning,
    "spin": motions.spin,
    "rest": motions.rest,
}

_RANGE = 16 * STANDARD_GRAVITY  # m/s², the accelerometer range that autopilots choose
_SHAKING_HZ = 87.0  # of a propeller out of balance
_MOVING = 0.02  # m/s
_ARMED_S = 2.0  # before it moves, and after
_SLOWEST_FILTER_HZ = 0.1  # slower ones take minutes: their impulse response lasts for as many cycles as a fast one's

TYPICAL = ImuModel(
    gyro=Sensor(noise_density=5e-5, bias_walk=5e-6, bias=np.array([4e-4, -3e-4, 2e-4]), full_scale=np.radians(2000)),
    accel=Sensor(noise_density=7e-4, bias_walk=3e-5, bias=np.array([0.01, -0.015, 0.02]), full_scale=_RANGE),
)
"""A calibrated MEMS IMU of the better sort: ICM-42688-P's noise, and the biases that calibration leaves."""


@dataclass(frozen=True, slots=True, eq=False)
class Flown:
    """A flight at every step of the autopilot's loop, LOOP_US apart, from t = 0."""

    truth: Motion
    imu: ImuTrack  # as measured: with the sensor's errors and faults, not yet cut to whole units
    second: ImuTrack  # of a second IMU of the same part, which has no faults
    q_ned_frd: Array  # (N, 4) the autopilot's estimate of attitude,
    rates: Array  # (N, 3) of the body rates, FRD, rad/s,
    velocity: Array  # (N, 3) of velocity, NED, m/s,
    position: Array  # (N, 3) and of position, NED, m
    aiding: AidingReadings  # GPS, compasses, barometer

    def __len__(self) -> int:
        return len(self.truth.t)

    @property
    def duration(self) -> float:
        """s"""
        return (len(self) - 1) * LOOP_US * 1e-6

    @property
    def armed(self) -> tuple[float, float]:
        """From when to when it is armed, s: a little longer than it moves; never when it stays where it is."""
        moving = np.flatnonzero(np.linalg.norm(self.truth.velocity, axis=1) > _MOVING)
        if not len(moving):
            return np.inf, np.inf
        return float(self.truth.t[moving[0]]) - _ARMED_S, float(self.truth.t[moving[-1]]) + _ARMED_S


def fly(
    duration_s: float,
    *,
    motion: str = "circle",
    model: ImuModel = TYPICAL,
    faults: Faults = Faults(),
    filter_hz: float = 0.0,
    latency_s: float = 0.0,
    seed: int = 0,
) -> Flown:
    """Fly a closed-form motion of `MOTIONS` for a time. The same seed gives the same flight.

    The estimate is the truth with white noise of 0.2 mrad, 5 mm/s and 1 cm: better than any autopilot's, so what
    drifts against it is the IMU. Where the GPS is wrong the estimate follows it. filter_hz: corner of the low-pass that
    the autopilot puts over its IMU (ArduPilot's INS_GYRO_FILTER: 20 Hz); 0 for none. latency_s: age of the estimate.
    Raises SettingsError for an unknown motion, a duration that is not positive, a filter or a latency that cannot be.
    """
    if motion not in MOTIONS:
        raise SettingsError(f"there is no motion {motion!r}: choose one of {', '.join(MOTIONS)}.")
    if not 0 < duration_s <= 7200:
        raise SettingsError(f"a simulated flight lasts up to 7200 s, got {duration_s:g}.")
    if filter_hz and not _SLOWEST_FILTER_HZ <= filter_hz < 0.5e6 / LOOP_US:
        between = f"between {_SLOWEST_FILTER_HZ:g} and {0.5e6 / LOOP_US:g} Hz"
        raise SettingsError(f"a filter's corner lies {between}, or is 0 for none, got {filter_hz:g}.")
    if not 0 <= latency_s <= 1:
        raise SettingsError(f"the latency of an estimate lies between 0 and 1 s, got {latency_s:g}.")
    t = np.arange(round(duration_s * 1e6 / LOOP_US) + 1, dtype=np.float64) * (LOOP_US * 1e-6)
    truth = MOTIONS[motion](t)
    rng = np.random.default_rng(seed)
    imu = _with_faults(simulate(_shaken(truth.imu, model, faults), model, rng), faults)
    angle, rate, speed, place = rng.standard_normal((4, len(t), 3))
    other = ImuModel(replace(model.gyro, bias=-model.gyro.bias), replace(model.accel, bias=-model.accel.bias))
    second = simulate(truth.imu, other, rng)
    if filter_hz:
        imu, second = _filtered(imu, filter_hz), _filtered(second, filter_hz)
    then = np.maximum(np.arange(len(t)) - round(latency_s * 1e6 / LOOP_US), 0)
    position = truth.position[then] + 0.01 * place
    others = aiding_readings(truth, seed)
    if faults.ekf_reset:
        begin, jump = faults.ekf_reset
        position[t >= begin, 0] += jump
    if faults.gps_glitch:
        begin, end, jump = faults.gps_glitch
        position[(t >= begin) & (t < end), 1] += jump
        valid_at = others.fixed - FIX_LATENCY_S
        others.place[(valid_at >= begin) & (valid_at < end), 1] += jump
    return Flown(
        truth=truth,
        imu=replace(imu, source="measured"),
        second=replace(second, source="measured", instance=1),
        q_ned_frd=quaternion.multiply(quaternion.exp(2e-4 * angle), truth.q_ned_frd[then]),
        rates=truth.gyro[then] + 2e-3 * rate,
        velocity=truth.velocity[then] + 5e-3 * speed,
        position=position,
        aiding=others,
    )


def _filtered(imu: ImuTrack, corner_hz: float) -> ImuTrack:
    return replace(imu, gyro=low_pass(imu.gyro, corner_hz), accel=low_pass(imu.accel, corner_hz))


def low_pass(readings: Array, corner_hz: float) -> Array:
    """Readings (N, 3) at the loop's rate through ArduPilot's filter: Butterworth, second order (LowPassFilter2p.cpp).

    As a convolution with its impulse response, which after some cycles of the corner is nothing.
    """
    c = np.tan(np.pi * corner_hz * LOOP_US * 1e-6)
    norm = 1 + np.sqrt(2) * c + c**2
    b0, a1, a2 = c**2 / norm, 2 * (c**2 - 1) / norm, (1 - np.sqrt(2) * c + c**2) / norm
    taps = round(6.0 / (corner_hz * LOOP_US * 1e-6))  # the envelope falls by e^4.4 in each cycle of the corner
    response, x, y = [], [1.0, 0.0, 0.0], [0.0, 0.0]
    for _ in range(taps):
        value = b0 * (x[0] + 2 * x[1] + x[2]) - a1 * y[0] - a2 * y[1]
        response.append(value)
        x, y = [0.0, x[0], x[1]], [value, y[0]]
    padded = np.concatenate([np.tile(readings[:1], (taps - 1, 1)), readings])  # it has been at rest before
    return np.column_stack([np.convolve(column, response, mode="valid") for column in padded.T])


def _shaken(truth: ImuTrack, model: ImuModel, faults: Faults) -> ImuTrack:
    """What the sensor feels: vibration beyond the range of the accelerometer, where that is the fault."""
    if not faults.imu_clip:
        return truth
    begin, end = faults.imu_clip
    beyond = 1.5 * (model.accel.full_scale if np.isfinite(model.accel.full_scale) else _RANGE)
    shaking = beyond * np.sin(2 * np.pi * _SHAKING_HZ * truth.t) * ((truth.t >= begin) & (truth.t < end))
    return replace(truth, accel=truth.accel + np.column_stack([0.3 * shaking, 0.2 * shaking, shaking]))


def _with_faults(imu: ImuTrack, faults: Faults) -> ImuTrack:
    gyro, accel = imu.gyro.copy(), imu.accel.copy()
    if faults.imu_bias:
        begin, bias = faults.imu_bias
        gyro[imu.t >= begin, 2] += bias
    if faults.imu_stuck is not None:
        first = int(np.searchsorted(imu.t, faults.imu_stuck))
        gyro[first:], accel[first:] = gyro[first : first + 1], accel[first : first + 1]
    return replace(imu, gyro=gyro, accel=accel)
