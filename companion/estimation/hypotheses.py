"""What may go wrong in a flight, each as a signature in the smoother's linear system, and how it comes and goes.

An explanation has a few unknown numbers u (a step of the gyro's bias: three) that would change the residuals of some
factors by S u from its onset on.

Also here: how the size of what went wrong is said in words: the phrases that the rows of `HYPOTHESES` are made of.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from companion.constants import harm, healthy, num, priors
from companion.estimation.aiding_sensors import FIXED, SENSORS
from companion.estimation.model import ACCEL_BIAS, ATTITUDE, CONSTANTS, GYRO_BIAS, VELOCITY
from companion.estimation.shapes import INTEGRAL, SLOPED
from companion.estimation.system import Problem
from companion.model import Array, words
from companion.strapdown import bend, quaternion, skew


@dataclass(frozen=True, slots=True, eq=False)
class Size:
    """How large something was at its greatest, in its kind's unit."""

    value: Array  # (m,)
    sigma: float  # 1σ of its length
    earth_field: Array  # (3,) NED, µT

    @property
    def magnitude(self) -> float:
        """Its length."""
        return float(np.linalg.norm(self.value))


Phrase = Callable[[Size], str]


def main_axis(value: Array) -> str:
    """The one axis of the body, of three, that is off; "" where several are."""
    worst = int(np.argmax(np.abs(value)))
    return "xyz"[worst] if np.linalg.norm(np.delete(value, worst)) < 0.2 * abs(value[worst]) else ""


def _plus_minus(value: float, sigma: float, decimals: int) -> str:
    """A number and its 1σ to so many decimals, or as many as it takes to show the σ: "45.0 ± 0.3"."""
    while decimals < num.SIGMA_DECIMALS and 0.0 < sigma < 0.5 * 10.0**-decimals:
        decimals += 1
    return f"{value:z.{decimals}f} ± {sigma:.{decimals}f}"


def by_axes(sensor: str, error: str, unit: str, factor: float, decimals: int, size: Size) -> str:
    """'gyro z bias 14.9 ± 0.6 mrad/s', or all three where more than one is off."""
    values, sigma = factor * size.value, factor * size.sigma
    if axis := main_axis(size.value):
        return f"{sensor} {axis} {error} {_plus_minus(float(values['xyz'.index(axis)]), sigma, decimals)} {unit}"
    every = ", ".join(f"{name} {value:z.{decimals}f}" for name, value in zip("xyz", values, strict=True))
    return f"{sensor} {error} {every} ± {sigma:.{decimals}f} {unit}"


def by_length(what: str, unit: str, size: Size, axes: Sequence[str] = ("north", "east")) -> str:
    """'the GPS position is off by up to 9.1 ± 1.2 m (north 8.0, east 4.3)'; axes: in which the size is."""
    parts = ", ".join(f"{axis} {value:.1f}" for axis, value in zip(axes, size.value, strict=False))
    along = f" ({parts})" if len(size.value) > 1 else ""
    return f"{what} is off by up to {_plus_minus(size.magnitude, size.sigma, 1)} {unit}{along}"


def by_number(words: str, decimals: int, factor: float, size: Size) -> str:
    """Words with a place for the number, of several its magnitude, with its σ: both times the factor."""
    number = size.magnitude if len(size.value) > 1 else float(size.value[0])
    return words.format(_plus_minus(number * factor, size.sigma * factor, decimals))


def turn_of_the_field(size: Size) -> tuple[float, float]:
    """By how much the horizontal field turns, and so the heading: rad, 1σ."""
    field = size.earth_field[:2]
    changed = field + size.value[:2]
    angle = np.arctan2(field[0] * changed[1] - field[1] * changed[0], field @ changed)
    return float(angle), size.sigma / max(float(np.linalg.norm(field)), 1e-9)


def by_turn_of_the_field(size: Size) -> str:
    """'the compass's field turns by 45 ± 2°'."""
    angle, spread = np.degrees(turn_of_the_field(size))
    return f"the compass's field turns by {_plus_minus(float(angle), float(spread), 0)}°"


_SENSOR = {GYRO_BIAS.start: "gyro", ACCEL_BIAS.start: "accel"}
_DEGREES = float(np.degrees(1.0))
_GPS = tuple(name for name, sensor in SENSORS.items() if sensor.device == "gps")


@dataclass(frozen=True, slots=True, eq=False)
class Signature:
    """How one explanation of m unknowns changes the residuals, fully at work."""

    motion: Array | None  # (K-1, 15, m)
    measurements: Mapping[str, Array]  # aiding sensor → (M, d, m), as it adds to what is measured

    @property
    def unknowns(self) -> int:
        """m"""
        parts = (self.motion, *self.measurements.values())
        return int(next(part.shape[2] for part in parts if part is not None))


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """One row of what may be wrong."""

    name: str
    about: str  # in words
    phrase: Phrase  # how one of a certain size is said
    advice: str
    device: str  # whose it is: "imu", "gps", "compass", "barometer"
    unit: str
    shapes: tuple[str, ...]
    prior: float  # 1σ of a size that may occur, in the unit; of a ramp reached within the flight
    min_reported: float  # the smallest size that is reported: healthy sensors change by less in a flight
    signature: Callable[[Problem], Signature | None]
    needs: str = ""  # the aiding sensor without which nothing can be said of it
    min_reported_slow: float = 0.0  # the same of a ramp or creep, where that is more
    min_between_imus: float = 0.0  # of an IMU: two of a vehicle differ by less in flight where both are in order
    fault_threshold: float = 0.0  # of an IMU: three times what real parts change in flight; infinite: never a fault
    rate: float = 0.1  # faults an hour
    slow_share: float = 1.0  # how often a ramp or creep occurs beside a shape that begins at once
    max_plausible: float = np.inf  # no such fault is larger: such readings are invalid, or something else is wrong
    integrated: tuple[str, ...] = ()  # aiding sensors that read the integral of what the others read
    time_shifts: tuple[str, ...] = ()  # aiding sensors whose readings speak of another time: linear in small sizes
    turns_field: bool = False  # whether it turns the field that a compass reads: linear in small sizes
    turns_compass: bool = False  # whether it turns the compass in its mounting: linear in small sizes too
    about_size: float = 0.0  # in the unit, about which its columns are made; 0: about none, and it is small

    @property
    def sensor(self) -> str:
        """The sensor that its name begins with: "gyro", "accel" of the IMU's."""
        return self.name.partition("_")[0]

    @property
    def error(self) -> str:
        """What of the sensor: "bias", "scale", "shock" of the IMU's."""
        return self.name.partition("_")[2]

    @property
    def turns(self) -> bool:
        """Whether it turns something by any angle: its columns are derivatives at its size (`about_sizes`)."""
        return self.turns_field or self.turns_compass

    @property
    def between_imus(self) -> bool:
        """Whether IMUs of a vehicle differ by it for so long that it shows: of a moment their means have nothing."""
        return self.device == "imu" and self.error != "shock"

    def min_reported_of(self, shape: str) -> float:
        """The smallest size that is reported; of what grows, at its end."""
        return max(self.min_reported, self.min_reported_slow) if shape in SLOPED else self.min_reported

    def rate_of(self, shape: str) -> float:
        """Faults an hour of one of its shapes: an IMU that is off hardly ever recovers by itself."""
        if self.device != "imu":
            return self.rate / len(self.shapes) * (self.slow_share if shape in SLOPED else 1.0)
        return self.rate * (priors.RECOVERING_SHARE if shape == "pulse" else 1.0)

    def harmful(self, shape: str) -> float:
        """The size from which on it is a fault; of what grows, at its end."""
        return self.fault_threshold if 0.0 < self.fault_threshold < np.inf else self.min_reported_of(shape)

    @property
    def nuisance(self) -> bool:
        """Whether it is no fault at any size."""
        return self.fault_threshold == np.inf

    def of(self, problem: Problem) -> Signature | None:
        """Its signature in a problem; None where the flight has nothing that it would change, or no sensor shows it."""
        return self.signature(problem) if self.has_aiding(problem) else None

    def has_aiding(self, problem: Problem) -> bool:
        """Whether the flight has what it takes to say anything of it."""
        return not self.needs or problem.measurement(self.needs) is not None

    @property
    def basis_order(self) -> int:
        """1 where it is there or not, 2 where any of its shapes grows for any of its aiding sensors."""
        return 2 if self.integrated or any(shape in SLOPED for shape in self.shapes) else 1

    def shape_at(self, measured: str, shape: str) -> str:
        """What a shape is for one of its aiding sensors."""
        return INTEGRAL[shape] if measured in self.integrated else shape


def _bias(block: slice, resting: tuple[str, ...], problem: Problem) -> Signature:
    """A bias u beside the one that the states have; aiding sensors at rest read it too."""
    out = np.zeros((*problem.motion.transition.shape[:2], 3))
    out[:, :9] = problem.motion.transition[:, :9, block]
    read = {n: np.tile(np.eye(3), (len(one.t), 1, 1)) for n in resting if (one := problem.measurement(n)) is not None}
    return Signature(out, read)


def _scale(block: slice, problem: Problem) -> Signature:
    """Scale errors u: readings are off by u times what the states turned or were accelerated by.

    Not times the readings themselves, whose noise would explain itself.
    """
    lasted = np.diff(problem.t)[:, None]
    q = problem.states.q_ned_frd
    if block == GYRO_BIAS:
        measured = quaternion.log(quaternion.multiply(quaternion.conjugate(q[:-1]), q[1:])) / lasted
    else:
        force = np.diff(problem.states.velocity, axis=0) / lasted - [0.0, 0.0, problem.gravity]
        measured = quaternion.rotate(quaternion.conjugate(q[:-1]), force)
    out = np.zeros((*problem.motion.transition.shape[:2], 3))
    least = harm.LIVELY[_SENSOR[block.start]]
    if block == GYRO_BIAS:
        known = np.diagonal(problem.motion.weight[:, ATTITUDE, ATTITUDE], axis1=1, axis2=2).mean(axis=1)
        least = min(least, num.ABOVE_NOISE * float(np.median(1.0 / (np.sqrt(known) * lasted[:, 0]))))
    lively = np.sqrt((measured**2).mean(axis=0)) > least  # else it is the noise that is scaled
    out[:, :9] = problem.motion.transition[:, :9, block] * (measured * lively)[:, None, :]
    return Signature(out, {})


def _shock(block: slice, problem: Problem) -> Signature:
    """A turn or a push u within a moment that the IMU has not felt."""
    out = np.zeros((*problem.motion.transition.shape[:2], 3))
    out[:, block] = np.eye(3)
    return Signature(out, {})


def _shift(name: str, problem: Problem) -> Signature | None:
    """Measurements that are off by u, all their components."""
    one = problem.well_observed(name)
    if one is None:
        return None
    return Signature(None, {one.name: np.tile(np.eye(one.residual.shape[1]), (len(one.t), 1, 1))})


def _motion(problem: Problem) -> Signature | None:
    """GPS position and velocity that move together, as by spoofing: a velocity u."""
    ones = [problem.measurement(name) for name in ("gps_velocity", "gps_position")]
    return Signature(None, {one.name: np.tile(np.eye(2), (len(one.t), 1, 1)) for one in ones if one is not None})


def _late(problem: Problem) -> Signature | None:
    """A GPS whose fixes are late by u more: what a constant latency would change."""
    place = CONSTANTS["gps_latency"][0]
    ones = [problem.measurement(name) for name in _GPS]
    return Signature(None, {one.name: one.constants[:, :, place] for one in ones if one is not None})


def _late_by(size: float, problem: Problem) -> Signature | None:
    """The same of a u about a size, s: by where the vehicle was then, and how fast (a secant in place of a tangent)."""
    t, states = problem.t, problem.states
    i = np.clip(np.searchsorted(t, t - size, side="right") - 1, 0, len(t) - 2)
    lasted = np.diff(t)[i][:, None]
    u = np.clip((t - size - t[i])[:, None] / lasted, 0.0, 1.0)
    moved, rate = np.diff(states.position, axis=0)[i], states.velocity
    then = {"position": states.position[i] + u * moved + bend(moved, lasted * rate[i], lasted * rate[i + 1], u),
            "velocity": rate[i] + u * np.diff(rate, axis=0)[i]}  # fmt: skip
    changed = {name: (then[name] - getattr(states, name)) / size for name in then}
    parts = {}
    for name in _GPS:
        observed, axes = FIXED[name]
        if (one := problem.measurement(name)) is not None:
            parts[name] = changed[observed][one.keyframe, axes, None]
    return Signature(None, parts)


def _field(problem: Problem) -> Signature | None:
    """A field whose horizontal part is another in NED: the compass, or the iron around it, has turned."""
    one = problem.well_observed("compass")
    if one is None:
        return None
    place = CONSTANTS["earth_field"][0]
    return Signature(None, {"compass": one.constants[:, :, place.start : place.start + 2]})


def _rotation(problem: Problem) -> Signature | None:
    """A compass turned by u in its mounting: what it reads changes by u × the field in the body."""
    one = problem.well_observed("compass")
    if one is None:
        return None
    of_matrix = one.constants[:, :, CONSTANTS["soft_iron"][0]]
    return Signature(None, {"compass": of_matrix @ skew(np.eye(3)).reshape(3, 9).T})


_LOOK_AT_THE_MOUNTING = "A shock, strong vibration or lost samples: look at the mounting and the log's gaps."

HYPOTHESES: tuple[Hypothesis, ...] = (
    Hypothesis("gyro_bias", "the gyro's bias steps, grows or comes and goes",
         partial(by_axes, "gyro", "bias", "mrad/s", 1e3, 1),
         "Let the gyro warm up and calibrate it at rest. If it steps again, fly on another IMU.",
         device="imu", unit="rad/s", shapes=("step", "ramp", "pulse"), prior=0.03, min_reported=3e-3,
         signature=partial(_bias, GYRO_BIAS, ("rest_rate",)), min_between_imus=8e-3, fault_threshold=5e-3, rate=1e-3),
    Hypothesis("accel_bias", "the accelerometer's bias steps, grows or comes and goes",
         partial(by_axes, "accelerometer", "bias", "m/s²", 1.0, 2),
         "Calibrate the accelerometer. If it steps again without a shock or strong vibration, fly on another IMU.",
         device="imu", unit="m/s²", shapes=("step", "ramp", "pulse"), prior=1.0, min_reported=0.15,
         signature=partial(_bias, ACCEL_BIAS, ()), needs="gps_position", min_between_imus=0.4, fault_threshold=0.2,
         rate=1e-3),
    Hypothesis("gyro_scale", "the gyro's scale changes",
         partial(by_axes, "gyro", "scale error", "%", 100.0, 1),
         "A gyro of wrong scale: check its range setting and its calibration.",
         device="imu", unit="", shapes=("step", "pulse"), prior=0.3, min_reported=0.02,
         signature=partial(_scale, GYRO_BIAS), needs="gps_position", min_between_imus=0.05, rate=3e-4,
         max_plausible=num.MAX_SCALE),
    Hypothesis("accel_scale", "the accelerometer's scale changes",
         partial(by_axes, "accelerometer", "scale error", "%", 100.0, 1),
         "Calibrate the accelerometer in six positions.",
         device="imu", unit="", shapes=("step", "pulse"), prior=0.1, min_reported=0.02,
         signature=partial(_scale, ACCEL_BIAS), needs="gps_position", min_between_imus=0.05, rate=3e-4,
         max_plausible=num.MAX_SCALE),
    Hypothesis("gyro_shock", "the gyro misses a turn, all at once",
         partial(by_number, "the gyro misses a turn of {}°", 0, _DEGREES),
         _LOOK_AT_THE_MOUNTING,
         device="imu", unit="rad", shapes=("shock",), prior=0.3, min_reported=0.035,
         signature=partial(_shock, ATTITUDE), fault_threshold=np.inf, rate=1.0),
    Hypothesis("accel_shock", "the accelerometer misses a push, all at once",
         partial(by_number, "the accelerometer misses a push of {} m/s", 1, 1.0),
         _LOOK_AT_THE_MOUNTING,
         device="imu", unit="m/s", shapes=("shock",), prior=5.0, min_reported=0.5, signature=partial(_shock, VELOCITY),
         needs="gps_position", fault_threshold=np.inf, rate=1.0),
    # two fixes of a receiver of 2.5 m CEP, minutes apart, differ by less than 11 m in 99.9 % of cases; 3 σ in height
    Hypothesis("gps_position", "the GPS position jumps, creeps or is off for a time",
         partial(by_length, "the GPS position", "m"),
         "Look at the antenna's view of the sky, its cable and at interference; a receiver of a second band helps.",
         device="gps", unit="m", shapes=("step", "ramp", "pulse", "creep"), prior=50.0, min_reported=6.0,
         signature=partial(_shift, "gps_position"), min_reported_slow=11.0, rate=0.3),
    Hypothesis("gps_height", "the GPS height jumps, creeps or is off for a time",
         partial(by_length, "the GPS height", "m"),
         "Usual under trees and beside walls; fly on the barometer.",
         device="gps", unit="m", shapes=("step", "ramp", "pulse"), prior=50.0, min_reported=5.0,
         signature=partial(_shift, "gps_height"), min_reported_slow=harm.CREEP_M, rate=1.0),
    Hypothesis("gps_motion", "GPS velocity and position move as the vehicle does not",
         partial(by_length, "the GPS reports a motion that no other sensor feels: it", "m/s"),
         "Position and velocity go off together: look at the receiver, and at interference or spoofing.",
         device="gps", unit="m/s", shapes=("step", "pulse"), prior=3.0, min_reported=0.5, signature=_motion,
         needs="gps_position", rate=0.01, integrated=("gps_position",)),
    Hypothesis("gps_velocity", "the GPS velocity is off",
         partial(by_length, "the GPS velocity", "m/s"),
         "Look at the antenna's view of the sky and at interference.",
         device="gps", unit="m/s", shapes=("step", "ramp", "pulse"), prior=5.0, min_reported=0.5,
         signature=partial(_shift, "gps_velocity"), rate=0.3),
    Hypothesis("gps_latency", "the GPS comes later than before",
         partial(by_number, "the GPS fixes come {} s later than before", 3, 1.0),
         "Look at the receiver's rate and load and at the line to it; set the estimator's GPS delay.",
         device="gps", unit="s", shapes=("step", "pulse"), prior=0.5, min_reported=0.15, signature=_late,
         needs="gps_position", time_shifts=_GPS, rate=0.01),
    Hypothesis("compass_field", "the field about the compass changes: it points elsewhere",
         by_turn_of_the_field,
         "Look for iron and currents near the compass and under the take-off place; calibrate it again, or use GPS for "
         "yaw.",
         device="compass", unit="µT", shapes=("step", "ramp", "pulse", "creep"), prior=30.0, min_reported=3.0,
         signature=_field, rate=0.3, slow_share=0.1, turns_field=True),  # currents come at once, iron is passed by
    Hypothesis("compass_turn", "the compass turns in its mounting",
         partial(by_number, "the compass turns by {}° in its mounting", 0, _DEGREES),
         "Look at the mounting of the compass, and at its orientation setting.",
         device="compass", unit="rad", shapes=("step", "ramp", "pulse"), prior=0.5, min_reported=0.1,
         signature=_rotation, rate=0.01, turns_compass=True),
    Hypothesis("compass_iron", "a magnet or a current comes near the compass",
         partial(by_length, "the compass", "µT", axes="xyz"),
         "Look for currents and iron near the compass: motors, cables.",
         device="compass", unit="µT", shapes=("step", "pulse"), prior=30.0, min_reported=healthy.USUAL_IRON,
         signature=partial(_shift, "compass"), rate=0.1),
    *(Hypothesis(name, f"the {words(name)} jumps or creeps", partial(by_length, f"the {words(name)}", "m"),
           "Shield it from wind and light.",
           device=sensor.device, unit="m", shapes=("step", "ramp", "pulse"), prior=20.0, min_reported=4.0,
           signature=partial(_shift, name), min_reported_slow=harm.CREEP_M, rate=1.0)
      for name, sensor in SENSORS.items() if sensor.device == "barometer"),
)  # fmt: skip
"""What may be wrong. An explanation that is not in this table does not exist."""

SECANTS = tuple(
    replace(row, signature=partial(_late_by, size), about_size=size)
    for row in HYPOTHESES
    if row.time_shifts
    for size in num.LATENCIES_S
)
"""Rows of what is linear in small sizes alone, as it is about larger ones: by secants, which lead there."""

AIDING = tuple(dict.fromkeys(hypothesis.device for hypothesis in HYPOTHESES if hypothesis.device != "imu"))
"""The devices beside the IMU."""


def hypothesis_of(name: str) -> Hypothesis:
    """The row of a kind. Raises KeyError for a name that is none."""
    return {hypothesis.name: hypothesis for hypothesis in HYPOTHESES}[name]
