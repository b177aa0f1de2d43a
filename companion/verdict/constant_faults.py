"""What an IMU reads wrongly from the first second on: more than a calibrated part does, or a fault.

No change shows it: only the best estimate, which knows gravity and where the vehicle went. A constant error is one of a
part in order or, rarely, of one that is broken, wrongly calibrated or of wrong settings; both are normal about zero,
and the probability of the second is Bayes'. All IMUs of a vehicle are weighed together: what all of them read alike is
likelier an error of the estimate, by which all are measured, than the same fault of each.

Also here: the best estimate's trajectory as a judge.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from companion.comparison import Comparison, InterpolationError, Reference, States, Windows, phases
from companion.constants import check, harm, healthy, num, priors
from companion.estimation import (
    BestEstimate,
    Explained,
    at_rest,
    hypothesis_of,
    in_blocks,
    probabilities,
    times_of_change,
)
from companion.model import Array, Flight, IntArray
from companion.strapdown import Preintegration
from companion.verdict.fault_interval import BIAS_UNITS, SENSOR_WORDS, percent
from companion.verdict.finding import Cause, Finding


def steady_error(best: BestEstimate, sensor: str) -> tuple[Array, Array]:
    """What "gyro" or "accel" reads too much all the time, (3,) FRD, and its 1σ, rad/s or m/s².

    Of an accelerometer when level, bias and scale together.
    """
    value = np.median(getattr(best.states, f"{sensor}_bias"), axis=0)
    if sensor == "accel":
        value = value + best.states.constant("accel_matrix").reshape(3, 3) @ [0.0, 0.0, -best.gravity]
    return value, np.median(getattr(best, f"{sensor}_bias_sigma"), axis=0)


def level_is_unusual(best: BestEstimate, flight: Flight) -> bool:
    """Whether an accelerometer reads more too much when level than a part in order does, unknown to the autopilot."""
    value, sigma = steady_error(best, "accel")
    held = next((one for one in flight.biases if one.imu_instance == best.imu.instance and len(one)), None)
    theirs = np.full(3, np.nan) if held is None else np.median(held.accel, axis=0)
    known = np.abs(value - theirs) <= num.SIGMAS * sigma
    return bool(((np.abs(value) > healthy.USUAL_BIAS["accel"] + num.SIGMAS * sigma) & ~known).any())


ALL_THE_TIME = "it was so from the beginning on: calibration, mounting or what the model lacks would look like it"


def beside_best(own: Comparison, best: BestEstimate, chosen: Windows) -> tuple[Comparison, Windows]:
    """The same track beside the best estimate in place of the autopilot's, and those of the windows in which it is."""
    t, index = own.track.t, best.index
    within = chosen.only((chosen.start >= index[0]) & (chosen.end <= index[-1]))
    samples = np.unique(np.concatenate([within.start, within.end]))
    known, nowhere = np.zeros(len(t), np.bool_), np.zeros(len(t), np.bool_)
    known[samples] = True
    placed = known if "gps_position" in best.residuals else nowhere
    states = States(*best.at(t[samples]))

    def look_up(index: IntArray) -> States:
        return states.rows(np.searchsorted(samples, index))

    def not_interpolated(index: IntArray, _: Preintegration) -> InterpolationError:
        return InterpolationError(*np.zeros((3, len(index))))  # the best estimate follows the IMU from sample to sample

    return own.beside(Reference(t, known, placed, look_up, not_interpolated)), within


@dataclass(frozen=True, slots=True, eq=False)
class ConstantError:
    """What one sensor of an IMU reads too much all the time; an accelerometer when level, bias and scale together."""

    imu: int
    source: str
    sensor: str  # "gyro", "accel"
    value: Array  # (3,) rad/s or m/s², FRD
    sigma: Array  # (3,)
    by_axis: Array  # (3,) the probability that it is a fault

    @property
    def probability(self) -> float:
        """That it is a fault, on any axis."""
        return float(self.by_axis.max())

    @property
    def axis(self) -> int:
        """The one that is furthest off, of those that are likely to be a fault: all IMUs may be so on another."""
        off = np.abs(self.value) / np.hypot(self.sigma, _usual(self.sensor))
        return int(np.argmax(np.where(self.by_axis >= priors.ACCUSED * self.by_axis.max(), off, -1.0)))

    @property
    def is_unusual(self) -> bool:
        """Whether it is surely more than a calibrated part shows."""
        return bool((np.abs(self.value) > healthy.USUAL_BIAS[self.sensor] + num.SIGMAS * self.sigma).any())


def _usual(sensor: str) -> float:
    """1σ of a part in order, wide on purpose: nineteen of twenty stay within the double."""
    return 0.5 * ({"compass": healthy.USUAL_IRON, "scale": healthy.USUAL_SCALE} | healthy.USUAL_BIAS)[sensor]


def fault_probabilities(sensor: str, values: Array, sigma: float, own: Array) -> Array:
    """The probability (N,) that each of N sensors of a kind has a constant fault on an axis.

    sensor: "gyro", "accel", "compass", or "scale". values: (N,) their errors, all measured by one estimate that is off
    by sigma; own: (N,) 1σ of each beside that.

    A fault may be as large as the largest error: what is beyond any, as of other units, is no error of all the others.
    """
    usual, large = _usual(sensor), max(harm.CONSTANT_FAULT_SIGMA[sensor], float(np.abs(values).max()))
    count = len(values)
    weights, sets = [], []
    for faulty in product((False, True), repeat=count):
        for misjudged in (False, True):
            common = sigma**2 + large**2 * misjudged
            covariance = common * np.ones((count, count)) + np.diag(usual**2 + own**2 + large**2 * np.array(faulty))
            prior = sum(np.log(priors.FAULTY_IMU if one else 1.0 - priors.FAULTY_IMU) for one in faulty)
            prior += np.log(priors.MISJUDGED_ESTIMATE if misjudged else 1.0 - priors.MISJUDGED_ESTIMATE)
            likelihood = -0.5 * (np.linalg.slogdet(covariance)[1] + values @ np.linalg.solve(covariance, values))
            weights.append(prior + likelihood)
            sets.append(faulty)
    share = np.exp(np.array(weights) - max(weights))
    return np.asarray(share / share.sum() @ np.array(sets, np.float64))


def lone_fault_probability(sensor: str, sizes: Array, sigma: float) -> float:
    """That a sensor which has been off by sizes (n,), each known to sigma, since the start is not of usual calibration.

    sensor: "compass" (µT), or "scale" of a gyro or an accelerometer (no unit). It is weighed by itself.
    """
    return max(float(fault_probabilities(sensor, np.array([one]), sigma, np.zeros(1))[0]) for one in sizes)


def read_wrongly(
    best: BestEstimate | None, flight: Flight, gravity: float, faults: Sequence[Finding]
) -> tuple[ConstantError, ...]:
    """What the IMUs of a flight read wrongly all the time: by the best estimate, and gyros at rest by themselves.

    faults: of `reading_faults`; readings that are none are off by nothing.
    """
    if any(f.severity == "error" or f.kind == "axes_wrong" for f in faults):
        return ()
    known = {(one.imu, one.sensor): one for one in (() if best is None else constant_errors(best, flight))}
    for one in errors_at_rest(flight, gravity):
        if (one.imu, one.sensor) not in known or one.sensor == "gyro":
            known[one.imu, one.sensor] = one
    return tuple(known.values())


def constant_errors(best: BestEstimate, flight: Flight) -> tuple[ConstantError, ...]:
    """Of every IMU: the estimate's own, and by what the others read more than it.

    Empty where the estimate does not know its IMU's errors: where the readings contradict each other. What a fault
    changed in flight is no constant.
    """
    if best.contradicted:
        return ()
    since_start = [e for e in best.explained if _is_constant(e, best)]
    later = [e for e in best.explained if e not in since_start and probabilities(e.rivals)["nobody"] < priors.ACCUSED]
    changed = {(e.imu, hypothesis_of(e.kind).sensor) for e in later}
    others = in_blocks(flight, best.imu)
    out: list[ConstantError] = []
    for sensor in ("gyro", "accel"):
        if (None, sensor) in changed:
            continue
        value, sigma = steady_error(best, sensor)
        for one in (e for e in since_start if hypothesis_of(e.kind).sensor == sensor):
            value, sigma = value + one.size, np.hypot(sigma, one.sigma)
        steady = [one for one in others if (one.instance, sensor) not in changed]
        imus = [(best.imu.instance, best.imu.source), *((one.instance, one.source) for one in steady)]
        values = [value, *(value + np.median(one.value[sensor], axis=0) for one in steady)]
        out += _weighed(sensor, imus, values, [np.zeros(3), *(one.aliased[sensor] for one in steady)], sigma)
    return tuple(out)


def _is_constant(one: Explained, best: BestEstimate) -> bool:
    """Whether it is a bias of the estimate's IMU that may have been there since the start, and has stayed."""
    begun = one.onset - num.ONSET_SIGMAS * one.onset_sigma <= times_of_change(best.t)[0]
    return begun and one.shape == "step" and one.imu is None and one.kind in ("gyro_bias", "accel_bias")


def _weighed(
    sensor: str, imus: Sequence[tuple[int, str]], values: Sequence[Array], own: Sequence[Array], sigma: Array
) -> Iterator[ConstantError]:
    """The errors (3,) of some IMUs, instance and message, with the probability that each is a fault on any axis.

    sigma: (3,) 1σ that they share, of the estimate that measured them; own: (3,) of each beside that.
    """
    errors, spread = np.array(values), np.array(own)
    sure = np.array([fault_probabilities(sensor, errors[:, i], sigma[i], spread[:, i]) for i in range(3)])
    for k, (instance, source) in enumerate(imus):
        yield ConstantError(instance, source, sensor, errors[k], np.hypot(sigma, spread[k]), sure[:, k])


def errors_at_rest(flight: Flight, gravity: float) -> tuple[ConstantError, ...]:
    """What every IMU reads too much while the vehicle lies still before it first takes off.

    A gyro at rest reads its error, but for a turn about the vertical, of which gravity tells nothing. Of an
    accelerometer gravity tells the length alone: its error along that.
    """
    take_off = min((part.start for part in phases(flight) if part.kind == "flight"), default=np.inf)
    imus: list[tuple[int, str]] = []
    gyro, accel = [], []  # what each reads too much, and its 1σ
    for track in flight.each_imu(num.REST_READ_MIN_SAMPLES):
        t = np.arange(track.t[0], track.t[-1], check.REST_BLOCK_S)
        rates, own, still = at_rest(flight, track, t)
        first = np.flatnonzero(still & (t < take_off))[: round(num.REST_READ_MAX_S / check.REST_BLOCK_S)]
        if len(first) * check.REST_BLOCK_S < check.REST_MIN_S:
            continue
        sample, rates = np.searchsorted(track.t, t[first]), rates[first]
        force = np.median(track.accel[np.minimum(sample, len(track) - 1)], axis=0)
        size = float(np.linalg.norm(force))
        turning = healthy.REST_TURN_RPS * np.abs(force) / size
        spread = np.hypot(np.hypot(np.median(own[first]), rates.std(axis=0)), turning)
        imus.append((track.instance, track.source))
        gyro.append((np.median(rates, axis=0), spread))
        accel.append((force * (1.0 - gravity / size), np.full(3, healthy.LOCAL_GRAVITY)))
    out: list[ConstantError] = []
    for sensor, readings in (("gyro", gyro), ("accel", accel)) if imus else ():
        out += _weighed(sensor, imus, [value for value, _ in readings], [sigma for _, sigma in readings], np.zeros(3))
    return tuple(out)


def constant_fault_probability(errors: Sequence[ConstantError], others: Sequence[Finding] = ()) -> float:
    """That any IMU has one, or has what other findings say of it that the best estimate does not know."""
    told = [one.cause.probability or 0.0 for one in others if one.cause is not None]
    return float(1.0 - np.prod([1.0 - sure for sure in (*told, *(one.probability for one in errors))]))


def constant_findings(errors: Sequence[ConstantError], begin: float, end: float) -> Iterator[Finding]:
    """Those that are faults, as errors; those of which it cannot be told, as warnings. begin, end: of the log, s.

    Each with what the other IMUs read: of two that are off the other way round neither is the one in order.
    """
    told = [one for one in errors if one.is_unusual or one.probability >= 1.0 - priors.ACCUSED]
    for one in told:
        sure, i = one.probability, one.axis
        unit, scale, decimals = BIAS_UNITS[one.sensor]
        whose, level = f"IMU {one.imu} ({one.source})", " when level" if one.sensor == "accel" else ""
        much = f"{SENSOR_WORDS[one.sensor]} {'xyz'[i]} of {whose} reads {_reads(one)} {unit} too much{level}"
        others = (other for other in told if other.sensor == one.sensor and other is not one)
        beside = "".join(f", {'xyz'[other.axis]} of IMU {other.imu} {_reads(other)}" for other in others)
        words = f"{much}{beside} since the start of the log"
        usual = f"a calibrated part stays below {scale * healthy.USUAL_BIAS[one.sensor]:.{decimals}f}"
        kind = hypothesis_of(f"{one.sensor}_bias")
        evidence = f"{words}; {usual} (probability of a fault {percent(sure)})"
        advice = f"Calibrate the {SENSOR_WORDS[one.sensor]} of IMU {one.imu}, and look at its range setting."
        if sure < priors.ACCUSED:
            unsure = sure > 1.0 - priors.ACCUSED
            yield Finding(kind.name, "data", "warning", begin, end, evidence, advice, undecided=unsure)
            continue
        size, sigma = abs(float(one.value[i])), float(one.sigma[i])
        cause = Cause(kind.name, "imu", begin, None, None, one.sensor, "xyz"[i], size, sigma, kind.unit, sure, sure)
        cause = replace(cause, imu=one.imu)
        yield Finding(kind.name, "imu", "error", begin, end, evidence, advice, words, cause)


def _reads(one: ConstantError) -> str:
    """What it reads too much on its axis, ± 1σ, in the unit of its sensor."""
    _, scale, decimals = BIAS_UNITS[one.sensor]
    return f"{scale * one.value[one.axis]:.{decimals}f} ± {scale * one.sigma[one.axis]:.{decimals}f}"
