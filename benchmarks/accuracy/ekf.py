"""A small error-state EKF in place of the autopilot's: what it would have made of sensors that are wrong.

15 states (φ, δv, δp in NED, δb_g, δb_a in FRD; truth minus estimate, as in `companion.strapdown.covariance`), the noise
figures, gates and timeouts of ArduPilot's and PX4's filters. Predicted from epoch to epoch by pre-integrated
increments, so that only the epochs are a loop; corrected by GPS position and velocity, the compass's heading and the
barometer. Its errors are correlated and slow, and go into its biases and rates, as those of a real estimator do.

What a real one knows of its sensors before take-off (declination, the GPS's latency, the frame of its position, the
barometer's zero) is taken from the healthy flight: `set_up`. Sola, "Quaternion kinematics for the error-state Kalman
filter" (2017), §6.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from benchmarks.accuracy.cutting import at, attitude_at, field_ned, gps_ned
from companion.model import (
    STANDARD_GRAVITY,
    Array,
    DataError,
    EstimatorReset,
    Flight,
    GpsTrack,
    ImuTrack,
    NavState,
    PositionTrack,
    ResetKind,
)
from companion.strapdown import preintegrate, propagate, quaternion

Index = npt.NDArray[np.intp]

PHI, VEL, POS, GYRO, ACCEL = (slice(i, i + 3) for i in range(0, 15, 3))

_EPOCH_S = 0.2  # between fusions of compass and barometer
_DOWN = np.array([0.0, 0.0, STANDARD_GRAVITY])


@dataclass(frozen=True, slots=True)
class Tuning:
    """1σ and densities; about the defaults of ArduPilot's EKF3 and PX4's EKF2."""

    gyro_noise: float = 1.5e-3  # rad/s/√Hz (EK3_GYRO_P_NSE 0.015 at 100 Hz)
    accel_noise: float = 0.035  # m/s²/√Hz (EK3_ACC_P_NSE 0.35 at 100 Hz)
    gyro_walk: float = 1e-4  # rad/s/√s (EK3_GBIAS_P_NSE 1e-3 at 100 Hz)
    accel_walk: float = 2e-3  # m/s²/√s (EK3_ABIAS_P_NSE 0.02 at 100 Hz)
    gps_position: float = 0.5  # m, at least (EK3_POSNE_M_NSE)
    gps_velocity: float = 0.3  # m/s, at least (EK3_VELNE_M_NSE)
    heading: float = 0.1  # rad
    height: float = 1.0  # m (EK3_ALT_M_NSE 2, EKF2_BARO_NOISE 3.5)
    start: tuple[float, float, float, float, float] = (0.02, 0.2, 0.5, 5e-3, 0.1)  # rad, m/s, m, rad/s, m/s²
    gate: float = 5.0  # σ, of GPS and height (EK3_POS_I_GATE 500)
    heading_gate: float = 3.0  # σ (EK3_YAW_I_GATE 300)
    timeout: float = 7.0  # s without an accepted measurement: then the state is reset to it


DEFAULT = Tuning()


@dataclass(frozen=True, slots=True, eq=False)
class SetUp:
    """What is known of a flight's sensors before they go wrong."""

    gps: GpsTrack | None  # of the healthy flight
    position: PositionTrack  # of the healthy flight
    latency: float  # s, of the GPS
    north: float  # rad, bearing of the compass's field, as the healthy attitude has it
    height_zero: float | None  # m, altitude of the barometer where the position's down is zero
    begin: NavState
    gyro_bias: Array  # (3,) rad/s, at the beginning
    accel_bias: Array  # (3,) m/s²
    tuning: Tuning


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """What the filter believes at its epochs, after their corrections."""

    t: Array  # (K,) s
    q_ned_frd: Array  # (K, 4)
    velocity: Array  # (K, 3) NED, m/s
    position: Array  # (K, 3) NED, m
    gyro_bias: Array  # (K, 3) rad/s
    accel_bias: Array  # (K, 3) m/s²
    covariance: Array  # (K, 15, 15)
    index: Index  # (K,) of the IMU's samples
    resets: tuple[EstimatorReset, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Measured:
    """What there is at each epoch; NaN where there is nothing. Sigmas of the same shapes."""

    position: Array  # (K, 2)
    position_sigma: Array  # (K,)
    velocity: Array  # (K, 3), down NaN where the receiver does not tell
    velocity_sigma: Array  # (K,)
    down: Array  # (K,)
    field: Array  # (K, 3) of the compass, FRD


def set_up(flight: Flight, tuning: Tuning = DEFAULT) -> SetUp:
    """From a healthy flight. Raises DataError when it lacks what the filter needs: attitude, position, GPS, compass."""
    gps = flight.gps[0] if flight.gps else None
    attitude, position = flight.attitude, flight.position
    if attitude is None or position is None or gps is None or not flight.compasses or len(gps) < 10:
        raise DataError("the flight has no attitude, position, GPS or compass to set the estimator up with.")
    latency = _latency(gps, position)
    world = field_ned(flight.compasses[0], attitude.t, attitude.q_ned_frd)
    bearing = np.arctan2(world[:, 1], world[:, 0])
    zero = None
    if flight.barometers and np.isfinite(flight.barometers[0].altitude).sum() > 3:
        barometer = flight.barometers[0]
        down = np.interp(barometer.t, position.t, position.position[:, 2])
        zero = float(np.nanmedian(barometer.altitude + down))
    fixed = gps.t[np.isfinite(gps.latitude)]
    t = max(attitude.t[0], position.t[0], fixed[0], flight.imu().t[0], flight.compasses[0].t[0])
    begin = NavState(
        float(t),
        attitude_at(np.array([t]), attitude.t, attitude.q_ned_frd)[0],
        at(np.array([t]), position.t, position.velocity)[0],
        at(np.array([t]), position.t, position.position)[0],
    )
    gyro_bias, accel_bias = _known_bias(flight, float(t))
    # the middle of the bearings, as directions: they may lie about ±180°
    north = float(np.angle(np.median(np.cos(bearing)) + 1j * np.median(np.sin(bearing))))
    return SetUp(gps, position, latency, north, zero, begin, gyro_bias, accel_bias, _in_flight(flight.imu(), tuning))


def aligned(known: SetUp, flight: Flight) -> SetUp:
    """The same, begun with the heading that this flight's compass tells there, as a real one begins."""
    q, compass = known.begin.q_ned_frd, flight.compasses[0]
    north, east, _ = quaternion.rotate(q[None], at(np.array([known.begin.t]), compass.t, compass.field))[0].tolist()
    turn = quaternion.exp(np.array([[0.0, 0.0, known.north - np.arctan2(east, north)]]))
    return replace(known, begin=replace(known.begin, q_ned_frd=quaternion.multiply(turn, q[None])[0]))


def _in_flight(imu: ImuTrack, tuning: Tuning) -> Tuning:
    """The tuning with the noise that the IMU has in flight where that is more: vibration, and at 25 Hz what aliases.

    White noise of σ a sample has third differences of √20 σ; of smooth motion hardly anything is left in them.
    """
    step = np.sqrt(np.median(np.diff(imu.t)))

    def density(readings: Array) -> float:
        rough = np.abs(np.diff(readings, 3, axis=0))
        return float(step * np.sqrt(np.mean(np.minimum(rough, 10 * np.median(rough, axis=0)) ** 2) / 20))

    return replace(
        tuning,
        gyro_noise=max(tuning.gyro_noise, density(imu.gyro)),
        accel_noise=max(tuning.accel_noise, density(imu.accel)),
    )


def _known_bias(flight: Flight, t: float) -> tuple[Array, Array]:
    instance = flight.imu().instance
    own = next((b for b in flight.biases if b.imu_instance == instance and len(b)), None)
    if own is None:
        return np.zeros(3), np.zeros(3)
    i = min(int(np.searchsorted(own.t, t)), len(own) - 1)
    return np.nan_to_num(own.gyro[i]), np.nan_to_num(own.accel[i])


def _latency(gps: GpsTrack, position: PositionTrack) -> float:
    """By how much the receiver's velocity lags behind the estimate's: its time of validity."""
    lags = np.arange(0.0, 0.41, 0.02)
    ours = [at(gps.t - lag, position.t, position.velocity[:, :2]) for lag in lags]
    return float(lags[np.argmin([np.nanmedian(((gps.velocity[:, :2] - v) ** 2).sum(axis=1)) for v in ours])])


def estimate(flight: Flight, known: SetUp) -> Estimate:
    """Run the filter over a flight's IMU, GPS, compass and barometer, from where `known` begins."""
    imu = flight.imu()
    index = _epochs(flight, imu, known)
    t, tuning = imu.t[index], known.tuning
    path = preintegrate(imu)
    first, last = index[:-1], index[1:]
    none = np.zeros((len(first), 3))
    grown = propagate(imu, path, first, last, np.tile(quaternion.IDENTITY, (len(first), 1)), none)
    noise = grown.covariance(
        gyro_noise=tuning.gyro_noise,
        accel_noise=tuning.accel_noise,
        gyro_walk=tuning.gyro_walk,
        accel_walk=tuning.accel_walk,
    )
    dq, dv, dp = path.carry(first, last, np.tile(quaternion.IDENTITY, (len(first), 1)), none, none, gravity=0.0)
    filter_ = _Filter(known, quaternion.to_matrix(known.begin.q_ned_frd))
    measured = _measured(flight, known, t)
    rows = [filter_.correct(0, float(t[0]), measured)]
    turned = quaternion.to_matrix(dq)
    for k in range(len(first)):
        filter_.predict(float(t[k + 1] - t[k]), turned[k], dv[k], dp[k], grown.transition[k], noise[k])
        rows.append(filter_.correct(k + 1, float(t[k + 1]), measured))
    matrices, v, p, gyro, accel, covariance = (np.array(column) for column in zip(*rows, strict=True))
    q = quaternion.continuous_sign(quaternion.from_matrix(matrices))
    return Estimate(t, q, v, p, gyro, accel, covariance, index, tuple(filter_.resets))


def _epochs(flight: Flight, imu: ImuTrack, known: SetUp) -> Index:
    """Indices of the IMU's samples at which something is measured."""
    end = imu.t[-1]
    times = np.arange(known.begin.t, end, _EPOCH_S)
    for gps in flight.gps[:1]:
        valid = gps.t - known.latency
        times = np.concatenate([times, valid[(valid > known.begin.t) & (valid < end)]])
    nearest = np.clip(np.searchsorted(imu.t, np.sort(times)), 0, len(imu) - 1)
    return np.unique(nearest)


def _measured(flight: Flight, known: SetUp, t: Array) -> _Measured:
    count = len(t)
    position, velocity = np.full((count, 2), np.nan), np.full((count, 3), np.nan)
    position_sigma, velocity_sigma = np.full(count, np.nan), np.full(count, np.nan)
    if flight.gps and known.gps is not None:
        gps = flight.gps[0]
        valid = gps.t - known.latency
        inside = np.flatnonzero((valid >= t[0]) & (valid <= t[-1]) & (gps.fix_type >= 3))
        k = np.clip(np.searchsorted(t, valid[inside] - 1e-9), 0, count - 1)
        late = (t[k] - valid[inside])[:, None]
        speed = gps.velocity[inside]
        ned = gps_ned(gps, known.gps, known.position, known.latency)[inside]
        position[k] = ned[:, :2] + late * np.nan_to_num(speed[:, :2])
        velocity[k] = speed
        position_sigma[k] = np.fmax(gps.horizontal_sigma[inside], known.tuning.gps_position)
        velocity_sigma[k] = np.fmax(gps.speed_sigma[inside], known.tuning.gps_velocity)
    down = np.full(count, np.nan)
    if flight.barometers and known.height_zero is not None:
        barometer = flight.barometers[0]
        fresh = _fresh(t, barometer.t)
        down[fresh] = known.height_zero - np.interp(t[fresh], barometer.t, barometer.altitude)
    elif flight.gps and known.gps is not None:
        down[k] = ned[:, 2]
    compass = flight.compasses[0]
    field = at(t, compass.t, compass.field)
    field[~_fresh(t, compass.t)] = np.nan
    return _Measured(position, position_sigma, velocity, velocity_sigma, down, field)


def _fresh(t: Array, own: Array) -> npt.NDArray[np.bool_]:
    """Whether a sensor has spoken since the epoch before."""
    heard = np.searchsorted(own, t, side="right")
    return np.asarray(np.diff(heard, prepend=-1) > 0)


class _Filter:
    """State and covariance between two epochs."""

    def __init__(self, known: SetUp, matrix: Array) -> None:
        self._known, self._tuning = known, known.tuning
        self._c, self._v, self._p = matrix, known.begin.velocity.copy(), known.begin.position.copy()
        self._gyro, self._accel = known.gyro_bias.copy(), known.accel_bias.copy()
        self._cov = np.diag(np.repeat(np.square(known.tuning.start), 3))
        self._accepted: dict[str, float] = {}
        self.resets: list[EstimatorReset] = []

    def predict(self, dt: float, turn: Array, dv: Array, dp: Array, transition: Array, noise: Array) -> None:
        """Over one interval: increments in the body at its start, error transition and noise in the same frame."""
        c = self._c
        self._p = self._p + self._v * dt + 0.5 * _DOWN * dt**2 + c @ dp
        self._v = self._v + _DOWN * dt + c @ dv
        self._c = c @ turn
        frame = np.eye(15)
        for block in (PHI, VEL, POS):
            frame[block, block] = c
        growth = frame @ transition @ frame.T
        # the increments are those of the readings: the biases act to first order
        self._inject(np.concatenate([growth[:9, 9:] @ np.concatenate([self._gyro, self._accel]), np.zeros(6)]))
        self._cov = growth @ self._cov @ growth.T + frame @ noise @ frame.T

    def correct(self, k: int, t: float, measured: _Measured) -> tuple[Array, ...]:
        """Take in what there is at epoch k. The state and covariance after it."""
        tuning = self._tuning
        if np.isfinite(measured.position[k]).all():
            z, sigma = measured.position[k] - self._p[:2], measured.position_sigma[k]
            if self._update("position", t, np.arange(6, 8), z, sigma, tuning.gate):
                self._p[:2] = measured.position[k]
        told = np.isfinite(measured.velocity[k])
        if told.any():
            z, sigma = (measured.velocity[k] - self._v)[told], measured.velocity_sigma[k]
            if self._update("velocity", t, 3 + np.flatnonzero(told), z, sigma, tuning.gate):
                self._v[told] = measured.velocity[k][told]
        if np.isfinite(measured.down[k]):
            z = np.array([measured.down[k] - self._p[2]])
            if self._update("height", t, np.array([8]), z, tuning.height, tuning.gate):
                self._p[2] = measured.down[k]
        if np.isfinite(measured.field[k]).all():
            north, east, _ = self._c @ measured.field[k]
            z = np.array([self._known.north - np.arctan2(east, north)])
            z = (z + np.pi) % (2 * np.pi) - np.pi
            if self._update("heading", t, np.array([2]), z, tuning.heading, tuning.heading_gate):
                self._c = _exp(np.array([0.0, 0.0, z[0]])) @ self._c
        return self._c, self._v.copy(), self._p.copy(), self._gyro, self._accel, self._cov

    def _update(self, kind: ResetKind, t: float, states: Index, z: Array, sigma: float, gate: float) -> bool:
        """Correct by a measurement of some states themselves. True: refused for so long that they are to be reset."""
        cov = self._cov
        spread = cov[np.ix_(states, states)] + sigma**2 * np.eye(len(states))
        if float(z @ np.linalg.solve(spread, z)) > gate**2 * len(states):
            if t - self._accepted.setdefault(kind, t) < self._tuning.timeout:
                return False
            self._accepted[kind] = t
            self.resets.append(EstimatorReset(t, kind))
            cov[states, :] = cov[:, states] = 0.0
            cov[states, states] = sigma**2
            return True
        self._accepted[kind] = t
        gain = np.linalg.solve(spread, cov[states]).T
        self._cov = cov - gain @ cov[states]
        self._cov = 0.5 * (self._cov + self._cov.T)
        self._inject(gain @ z)
        return False

    def _inject(self, error: Array) -> None:
        self._c = _exp(error[PHI]) @ self._c
        self._v, self._p = self._v + error[VEL], self._p + error[POS]
        self._gyro, self._accel = self._gyro + error[GYRO], self._accel + error[ACCEL]


def _exp(vector: Array) -> Array:
    """The rotation matrix of a rotation vector (3,)."""
    x, y, z = vector.tolist()
    angle2 = x * x + y * y + z * z
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = np.sqrt(angle2)
    a, b = (np.sin(angle) / angle, (1 - np.cos(angle)) / angle2) if angle > 1e-6 else (1.0, 0.5)
    return np.asarray(np.eye(3) + a * skew + b * skew @ skew)
