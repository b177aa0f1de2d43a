"""What the smoother estimates: the constants of a flight, the noise densities, and the result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import accumulate

import numpy as np
import numpy.typing as npt

from companion.constants import healthy, num
from companion.estimation.aiding_sensors import SENSORS
from companion.estimation.block_tridiagonal import Factor
from companion.model import Array, ImuTrack, Origin, interpolated, nearest
from companion.strapdown import Preintegration, preintegrate, quaternion

ATTITUDE, VELOCITY, POSITION, GYRO_BIAS, ACCEL_BIAS = (slice(i, i + 3) for i in range(0, 15, 3))
"""Places in the error of a keyframe, truth minus estimate: rad and m/s and m in NED, rad/s and m/s² in FRD."""

STATES = ACCEL_BIAS.stop

_PRIORS: Mapping[str, tuple[int, float]] = {
    "earth_field": (3, 8.0),  # µT, NED; the world model's own σ is set where it is known
    "hard_iron": (3, 5.0),  # µT, FRD: what calibration leaves, root mean square of an axis of 7 real vehicles
    "gps_latency": (1, 0.06),  # s
    "lever_arm": (3, 0.2),  # m, FRD, from the IMU to the antenna
    **{f"{name}_offset": (1, sensor.offset) for name, sensor in SENSORS.items() if sensor.offset},
    "compass_latency": (1, 0.05),  # s: the mean age of what ArduPilot averages over 0.1 s
    "gyro_matrix": (9, 0.004),  # 3 x 3 by rows, scale and misalignment: true rate = (I - E) reading
    "accel_matrix": (9, 0.004),  # the same for specific force
    "soft_iron": (9, 0.03),  # 3 x 3 by rows: what it adds to the field, as a part of it
}
"""Constant of the flight → how many components it has, and the 1σ of its prior."""

_ENDS = accumulate(width for width, _ in _PRIORS.values())

CONSTANTS: Mapping[str, tuple[slice, float]] = {
    name: (slice(end - width, end), sigma) for (name, (width, sigma)), end in zip(_PRIORS.items(), _ENDS, strict=True)
}
"""Constant of the flight → its place among the C constants, and the 1σ of its prior."""

CONSTANT_STATES = max(place.stop for place, _ in CONSTANTS.values())

NOISES = ("gyro_noise", "accel_noise", "gyro_walk", "accel_walk")


@dataclass(frozen=True, slots=True)
class ProcessNoise:
    """Densities of the IMU as it is in this flight."""

    gyro_noise: float  # rad/s/√Hz
    accel_noise: float  # m/s²/√Hz
    gyro_walk: float  # rad/s/√s
    accel_walk: float  # m/s²/√s

    def density(self, cause: str) -> float:
        """The density of a cause by its name."""
        return float(getattr(self, cause))

    def louder(self, gyro: float, accel: float) -> ProcessNoise:
        """The same where gyro and accelerometer scatter so many times more."""
        return replace(self, gyro_noise=gyro * self.gyro_noise, accel_noise=accel * self.accel_noise)

    @property
    def gyro_wanders(self) -> bool:
        """Whether the bias of the gyro walks by more than those of parts in order do."""
        return self.gyro_walk > healthy.GYRO_WALK_SPREAD * num.FIRST_PROCESS_NOISE["gyro_walk"]

    def contradicts(self, spectral: tuple[float, float]) -> bool:
        """Whether gyro or accelerometer needs far more than its spectra show, in the same units."""
        both = zip((self.gyro_noise, self.accel_noise), spectral, strict=True)
        return any(own > num.NOISE_BEYOND * shown for own, shown in both)


@dataclass(frozen=True, slots=True, eq=False)
class States:
    """The estimate at K keyframes, and the constants of the flight."""

    q_ned_frd: Array  # (K, 4) wxyz
    velocity: Array  # (K, 3) NED, m/s
    position: Array  # (K, 3) NED, m
    gyro_bias: Array  # (K, 3) rad/s, FRD: truth = reading - bias
    accel_bias: Array  # (K, 3) m/s²
    constants: Array  # (C,) in the order of CONSTANTS
    slow: Array  # (K, S) slowly varying errors of the aiding sensors, in the units of their readings

    def constant(self, name: str) -> Array:
        """The value of one of CONSTANTS."""
        return np.asarray(self.constants[CONSTANTS[name][0]])

    def moved(self, x: Array, c: Array) -> States:
        """The states with an error x (K, 15 + S) and c (C,) taken out: truth = estimate ⊕ error.

        What follows in c are sizes of explanations, which are no states.
        """
        return States(
            quaternion.normalize(quaternion.multiply(quaternion.exp(x[:, ATTITUDE]), self.q_ned_frd)),
            self.velocity + x[:, VELOCITY],
            self.position + x[:, POSITION],
            self.gyro_bias + x[:, GYRO_BIAS],
            self.accel_bias + x[:, ACCEL_BIAS],
            self.constants + c[:CONSTANT_STATES],
            self.slow + x[:, STATES:],
        )


@dataclass(frozen=True, slots=True)
class Rival:
    """One hypothesis in the place of a cause that was found, weighed at the same noise as all others there."""

    kind: str  # of `hypotheses.HYPOTHESES`
    shape: str
    log_odds: float  # natural logarithm of its posterior odds against nothing
    fault: float  # probability, if it occurred, that its size is harmful
    imu: int | None = None  # the IMU whose it is, where that is not the estimate's

    @property
    def fault_log_odds(self) -> float:
        """Natural logarithm of the posterior odds of a harmful size against nothing."""
        return self.log_odds + float(np.log(max(self.fault, 1e-300)))


@dataclass(frozen=True, slots=True)
class Identifiability:
    """One kind of fault in the middle of a flight: what it is called, and what it does while it is not found."""

    kind: str  # of `hypotheses.HYPOTHESES`
    shape: str  # "step", or "creep"
    lasts: float  # s, that it grows for; 0 for a step
    detectable: float  # in the kind's unit, of a creep at its end: the size that is found in 95 % of flights like this
    identifiable: float | None  # that is told from its rivals too, not less; None for none up to 8 times the former
    called: Mapping[str, float]  # at the detectable size: kind, or as `ConfusionMatrix` → share of the data sets
    tilt: float  # rad, that the estimate is off by at that size, if nobody finds it, at most; the other three alike
    heading: float  # rad
    velocity: float  # m/s
    position: float  # m


@dataclass(frozen=True, slots=True)
class ConfusionMatrix:
    """What faults are called in a flight.

    A kind where its device is accused; "nobody" where none is at fault; "perhaps harmless" where one is known to be
    off, but not whether by enough to be a fault; else "cannot tell".
    """

    rows: tuple[Identifiability, ...]
    not_shown: tuple[str, ...]  # kinds that the flight would not show at any size that occurs
    draws: int  # data sets of each row


@dataclass(frozen=True, slots=True, eq=False)
class Explained:
    """One thing that changed during the flight, with its size, and what else it could have been."""

    kind: str  # of `hypotheses.HYPOTHESES`
    shape: str  # "step", "pulse" (to its end), "ramp", "creep" (a ramp to its end), "shock"
    onset: float  # s, boot clock
    onset_sigma: float  # s
    end: float  # s, of a pulse; infinite for what stays
    size: Array  # (m,) in the unit of the kind; of a ramp per second
    sigma: Array  # (m,)
    rivals: tuple[Rival, ...] = ()  # every hypothesis in its place, itself among them, the likeliest first
    imu: int | None = None  # the IMU whose it is, where that is not the estimate's
    place: slice | None = None  # of its size among those of `BestEstimate.explained_covariance`; None where it has no σ


@dataclass(frozen=True, slots=True)
class Residuals:
    """One aiding sensor: what the best estimate leaves of it."""

    t: Array = field(repr=False)  # (M,) s
    value: Array = field(repr=False)  # (M, d) measured less estimated, in the unit of the aiding sensor
    sigma: Array = field(repr=False)  # (M, d) 1σ as learned
    weight: Array = field(repr=False)  # (M,) 1 for what is believed, towards 0 for what is doubted
    unit: str = ""

    @property
    def rms(self) -> float:
        """Root mean square of all components."""
        return float(np.sqrt((self.value**2).mean())) if self.value.size else 0.0

    @property
    def normalised_rms(self) -> float:
        """The same in units of σ: 1 where σ is what the residuals are."""
        return float(np.sqrt(((self.value / self.sigma) ** 2).mean())) if self.value.size else 0.0

    @property
    def doubted(self) -> float:
        """Share of the readings that count for less than half."""
        return float((self.weight < 0.5).mean()) if len(self.weight) else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class ConstantErrors:
    """What lasts of an IMU's errors: gyro bias (rad/s), accelerometer bias (m/s²), and both matrices by rows.

    The biases are their mean over the flight; truth = (I - matrix) (reading - bias), in the IMU's own axes.
    """

    values: Array  # (24,)
    covariance: Array  # (24, 24)
    possible: Array  # (24,) 1σ of what was possible beforehand


@dataclass(frozen=True, slots=True, eq=False)
class Correlation:
    """How the errors of one keyframe go with those of another."""

    factor: Factor  # of the K blocks of 15 states, the constants known
    border: Array  # (K, 15, C) minus what the states change by with the constants
    constants: Array  # (C, C) covariance

    def change_sigma(self, own: Array, block: slice, since: int) -> Array:
        """(K, n) 1σ of the change of a block of n errors since a keyframe; own (K, n, n) the covariance of each."""
        one = np.zeros((*self.border.shape[:2], block.stop - block.start))
        one[since, block] = np.eye(block.stop - block.start)
        chain = self.factor.solve(one)[:, block]
        y = self.border[:, block]
        cross = chain + y @ self.constants @ y[since].T
        variance = np.diagonal(own + own[since] - cross - cross.swapaxes(-1, -2), axis1=1, axis2=2)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def variance_of_sum(self, weights: Array) -> float:
        """The variance of the sum of all errors of all keyframes, each times its weight (K, n), of the first n."""
        whole = np.zeros((*self.border.shape[:2], 1))
        whole[:, : weights.shape[1], 0] = weights
        of_constants = np.tensordot(self.border, whole, axes=((0, 1), (0, 1)))
        variance = self.factor.product(whole).item() + (of_constants.T @ self.constants @ of_constants).sum()
        return max(float(variance), 0.0)


@dataclass(frozen=True, eq=False, repr=False)  # without slots: its path is kept
class BestEstimate:
    """A trajectory from one IMU, every aiding sensor and rest, without the autopilot's estimate."""

    imu: ImuTrack  # that it was carried by
    index: npt.NDArray[np.intp]  # (K,) samples of the IMU track at which the keyframes stand
    t: Array  # (K,) s, boot clock
    states: States
    covariance: Array  # (K, 9, 9) of attitude (rad, NED), velocity, position errors
    correlation: Correlation  # between keyframes
    gyro_bias_sigma: Array  # (K, 3) rad/s
    accel_bias_sigma: Array  # (K, 3) m/s²
    constants_sigma: Array  # (C,)
    errors: ConstantErrors  # of the IMU
    first_half: tuple[float, ConstantErrors]  # a time in the middle, s, and what the aiding sensors tell until then
    noise: ProcessNoise  # learned
    correlated: tuple[float, float]  # by how much more it weighs, gyro and accelerometer, because it is not white
    spectral: tuple[float, float]  # densities of gyro and accelerometer where no vibration is, by their spectra
    measurement_scale: Mapping[str, float]  # aiding sensor → learned σ over the nominal one
    slow_sigma: Mapping[str, float]  # aiding sensor → learned 1σ of its slow error, in the units of its readings
    residuals: Mapping[str, Residuals]
    gravity: float
    origin: Origin | None = None  # the zero of the positions; None where no place on Earth is known
    explained: tuple[Explained, ...] = ()  # what was wrong, as far as the aiding sensors tell, the first in time first
    explained_covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))  # of the sizes of all of them
    further: tuple[Rival, ...] = ()  # the hypotheses beside those in the estimate, the likeliest fault first
    # kind → smallest that would have been accused in 95 % of such flights
    detectable: Mapping[str, float] = field(default_factory=dict)
    confusion: ConfusionMatrix | None = None  # where it was asked for
    heading_from: str = ""  # "compass", "GPS and acceleration", "first guess": which aiding sensor gives the heading
    notes: tuple[str, ...] = ()
    converged: bool = True  # whether the iteration has ended where the misfit is least: else its σ say little
    linearisations: int = 0  # that it took

    def __repr__(self) -> str:
        """In a line: what it was made of and what it had to explain."""
        wrong = ", ".join(f"{e.kind} {e.shape} at {e.onset:.1f} s" for e in self.explained) or "nothing"
        return (
            f"BestEstimate({self.imu.source}, {len(self.t)} keyframes, {self.t[0]:.1f}-{self.t[-1]:.1f} s, "
            f"from {', '.join(self.residuals)}; explained: {wrong})"
        )

    @property
    def q_ned_frd(self) -> Array:
        """(K, 4) wxyz at the keyframes."""
        return self.states.q_ned_frd

    @property
    def velocity(self) -> Array:
        """(K, 3) NED, m/s"""
        return self.states.velocity

    @property
    def position(self) -> Array:
        """(K, 3) NED, m, about `origin`."""
        return self.states.position

    @property
    def contradicted(self) -> bool:
        """Whether the IMU fits the aiding sensors only with far more process noise than its spectra show."""
        return self.noise.contradicts(self.spectral)

    def sigma(self, block: slice) -> Array:
        """(K, 3) 1σ of a block of the error: ATTITUDE, VELOCITY or POSITION."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance[:, block, block], axis1=1, axis2=2)))

    def change_sigma(self, block: slice, since: int) -> Array:
        """(K, 3) 1σ of how much the error of a block has changed since a keyframe.

        What the whole flight is off by, as for a compass that is not calibrated, is not in it.
        """
        return self.correlation.change_sigma(self.covariance[:, block, block], block, since)

    @cached_property
    def path(self) -> Preintegration:
        """One pass over the IMU without the errors that were estimated; carries any window."""
        return preintegrate(corrected(self.imu, self))

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """q_ned_frd (N, 4), velocity and position (N, 3) at times t (N,), carried by the IMU from the keyframe before.

        Times are moved to the nearest sample of the IMU, and carried on from there at the velocity of that sample.
        Outside the keyframes the first or last one is carried on.
        """
        sample = nearest(self.imu.t, t)
        k = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 1)
        start = self.index.astype(np.intp)[k]
        s = self.states
        q, v, p = self.path.carry(start, sample, s.q_ned_frd[k], s.velocity[k], s.position[k], gravity=self.gravity)
        rest = (t - self.imu.t[sample])[:, None]
        gyro = _freed(self.imu.gyro[sample], interpolated(t, self.t, s.gyro_bias), s.constant("gyro_matrix"))
        q = quaternion.multiply(q, quaternion.exp(gyro * rest))
        return q, v, p + v * rest


def corrected(imu: ImuTrack, estimate: BestEstimate) -> ImuTrack:
    """The IMU track without the biases, scale and misalignment that were estimated."""
    s = estimate.states
    gyro, accel = (interpolated(imu.t, estimate.t, bias) for bias in (s.gyro_bias, s.accel_bias))
    return without_errors(imu, s, gyro, accel)


def without_errors(imu: ImuTrack, states: States, gyro_bias: Array, accel_bias: Array) -> ImuTrack:
    """An IMU track of N samples without biases, (3,) or (N, 3), and without the scale and misalignment of states."""
    gyro = _freed(imu.gyro, gyro_bias, states.constant("gyro_matrix"))
    return replace(imu, gyro=gyro, accel=_freed(imu.accel, accel_bias, states.constant("accel_matrix")))


def _freed(readings: Array, bias: Array, matrix: Array) -> Array:
    """Readings (N, 3) without a bias, (3,) or (N, 3), and without scale and misalignment (9,)."""
    return np.asarray((readings - bias) @ (np.eye(3) - matrix.reshape(3, 3)).T)
