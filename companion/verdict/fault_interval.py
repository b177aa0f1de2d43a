"""What was off for a time, a sensor or the autopilot's estimate, in words and numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from companion.comparison import length, runs
from companion.constants import check, harm, num, priors
from companion.estimation import (
    HYPOTHESES,
    SLOPED,
    BestEstimate,
    Explained,
    Rival,
    Size,
    activation,
    fault_of_size,
    hypothesis_of,
    main_axis,
    probabilities,
    turn_of_the_field,
)
from companion.model import Array, words
from companion.verdict.finding import Cause, Side

SENSOR_WORDS: Mapping[str, str] = {"gyro": "gyro", "accel": "accelerometer", "compass": "compass"}
"""Sensor, as kinds begin with it → its name in words."""

BIAS_UNITS: Mapping[str, tuple[str, float, int]] = {"gyro": ("mrad/s", 1e3, 1), "accel": ("m/s²", 1.0, 2)}
"""Sensor → the unit that a bias is told in, how many of it are one in SI, and decimals."""

DEVIATION_UNITS: Mapping[str, tuple[str, str, float]] = {
    "tilt": ("rad", "°", np.degrees(1.0)), "heading": ("rad", "°", np.degrees(1.0)),
    "velocity": ("m/s", " m/s", 1.0), "position": ("m", " m", 1.0), "height": ("m", " m", 1.0),
}  # fmt: skip
"""What an estimate may be off in → its unit in SI, the one that it is given in, and how many of that are one in SI."""


@dataclass(frozen=True, slots=True, eq=False)
class FaultInterval:
    """A time during which one sensor was off in one way."""

    kind: str  # of `estimation.HYPOTHESES`
    device: str  # whose it is: "imu", "gps", "compass", "barometer"
    start: float  # s, boot clock
    start_sigma: float
    end: float  # s; infinite where it lasts to the end
    size: Array  # (m,) at its greatest, in the kind's unit
    sigma: float  # 1σ of its length
    rivals: tuple[Rival, ...]  # every hypothesis in its place, itself among them, the likeliest first
    slow: bool = False  # whether it grows, and is not there at once
    imu: int | None = None  # the IMU whose it is, where that is not the estimate's
    parts: tuple[Explained, ...] = field(default=(), repr=False)  # what was explained of it

    @property
    def magnitude(self) -> float:
        """The length of its size."""
        return float(np.linalg.norm(self.size))


@dataclass(frozen=True, slots=True)
class EstimatorDeviation:
    """A time during which the autopilot's estimate is off the best estimate by what does harm."""

    quantity: str  # "tilt", "heading", "velocity", "position", "height"
    start: float  # s, boot clock
    end: float
    size: float  # at its greatest: rad, m/s, m
    sigma: float  # of both together, at that time
    log_bayes: float  # that it is an error against what both may be off by, of what lasts of it
    lasts: float  # s
    judged: float  # s of the flight in which chance might have made one
    imu_confirms: bool = False  # whether the IMU moved as the autopilot says, and not as the best estimate

    @property
    def probability(self) -> float:
        """That the estimator is in error by itself, the time being unknown beforehand."""
        return self._probability(priors.ESTIMATOR_ERROR, self.judged)

    def probability_after(self, onset: float) -> float:
        """That it is in error where a sensor that it reads has a fault since an onset, s."""
        return self._probability(priors.MISLED, min(self.end - onset, self.judged))

    def _probability(self, prior: float, within: float) -> float:
        places = max(1.0, within / self.lasts)  # in so many chance may do as much
        return float(1.0 / (1.0 + np.exp(-(np.log(prior / (1.0 - prior) / places) + self.log_bayes))))

    @property
    def may_be_error(self) -> bool:
        """Whether it is more than chance, where nothing else explains it."""
        return self.probability > 1.0 - priors.ACCUSED

    @property
    def or_imu(self) -> tuple[float, float]:
        """That the estimator is in error, and that an IMU is, where only how often they are tells the two apart."""
        odds = self.probability / max(1.0 - self.probability, 1e-300)
        imu = odds * priors.FAULTY_IMU / priors.ESTIMATOR_ERROR
        return odds / (1.0 + odds + imu), imu / (1.0 + odds + imu)

    @property
    def cause(self) -> Cause:
        """Itself, in numbers, where nothing else explains it."""
        unit, sure = DEVIATION_UNITS[self.quantity][0], self.probability
        sized = Cause(f"{self.quantity}_off", "autopilot", self.start, self.end, size=self.size, sigma=self.sigma)
        return replace(sized, unit=unit, probability=sure, side_probability=sure)

    def __str__(self) -> str:
        _, unit, scale = DEVIATION_UNITS[self.quantity]
        return f"{self.size * scale:.1f} ± {self.sigma * scale:.1f}{unit} in {self.quantity}"


def error_log_bayes(quantity: str, size: Array, sigma: Array) -> Array:
    """(K,) logarithm of the Bayes factor of an error of an estimate that is off by a size (K,), known to sigma (K,).

    Of two normal distributions: an estimate in order is off by sigma.
    """
    large = np.hypot(sigma, harm.AP_ERROR_SIGMA[quantity])
    return np.asarray(np.log(sigma / large) + 0.5 * size**2 * (sigma**-2.0 - large**-2.0))


def fault_intervals(best: BestEstimate) -> tuple[FaultInterval, ...]:
    """What was explained, kind by kind, as times with a beginning, an end and a size; in order of time."""
    best, intervals = of_one_kind(best), list[FaultInterval]()
    in_time = sorted(best.explained, key=lambda e: e.onset)
    for kind in HYPOTHESES:
        for imu in dict.fromkeys(e.imu for e in in_time if e.kind == kind.name):
            parts = [e for e in in_time if (e.kind, e.imu) == (kind.name, imu)]
            intervals += _intervals_of(parts, kind.device, kind.min_reported, best)
    return tuple(sorted(intervals, key=lambda e: e.start))


_ALIKE = {"accel_bias": ("accel_bias", "accel_scale")}
"""Kind → what may stand in the place of a part of it, and leaves as much in all."""


def of_one_kind(best: BestEstimate) -> BestEstimate:
    """The same where a scale of the accelerometer that begins with a bias of it is one more bias.

    Gravity is always there: in level flight either explains the other, and half a fault each may be harmless.
    """
    biases = [part for part in best.explained if part.kind == "accel_bias"]
    units, out = np.ones(len(best.explained_covariance)), list[Explained]()
    for part in best.explained:
        if part.kind != "accel_scale" or not any(_begin_together(part, bias) for bias in biases):
            out.append(part)
            continue
        force = best.imu.accel[(best.imu.t >= part.onset) & (best.imu.t <= part.end)].mean(axis=0)
        if part.place is not None:
            units[part.place] = force
        out.append(replace(part, kind="accel_bias", size=part.size * force, sigma=part.sigma * np.abs(force)))
    covariance = best.explained_covariance * np.outer(units, units)
    return replace(best, explained=tuple(out), explained_covariance=covariance)


def _begin_together(one: Explained, other: Explained) -> bool:
    """Whether what is wrong with one IMU begins at the same time."""
    apart = check.NEAR_S + num.SIGMAS * float(np.hypot(one.onset_sigma, other.onset_sigma))
    return one.imu == other.imu and abs(one.onset - other.onset) <= apart


def _intervals_of(parts: list[Explained], device: str, least: float, best: BestEstimate) -> Iterator[FaultInterval]:
    last = float(best.t[-1])
    ends = [np.nextafter(p.end, p.onset) for p in parts if p.end < last]  # the last moments of what ends
    grid = np.unique(np.concatenate([np.linspace(parts[0].onset, last, 400), [p.onset for p in parts], ends]))
    share = np.array([_activation(part, grid) for part in parts])
    level = share.T @ np.array([part.size for part in parts])
    size, sigma = length(level), _sigma(parts, share, level, best)
    for first, final in runs(np.asarray(size >= 0.5 * least)):
        here = slice(first, final + 1)
        if float(size[here].max()) < least:
            continue
        peak = first + int(np.argmax(size[here] - num.SIGMAS * sigma[here]))  # where it surely is largest
        before = [p for p in parts if p.onset <= grid[first] + 1e-9]
        cause = before[-1] if before[-1].shape not in SLOPED else next(p for p in before if p.shape in SLOPED)
        end = _end_of(float(grid[final]) if final < len(grid) - 1 else np.inf, cause, device, best)
        meanwhile = [p for p in parts if p.onset <= grid[final] and p.end >= grid[first]]
        rivals = _rivals(meanwhile, level[peak], sigma[peak], best)
        began, largest = (cause.onset, cause.onset_sigma), (level[peak], float(sigma[peak]))
        yield FaultInterval(
            cause.kind, device, *began, end, *largest, rivals, cause.shape in SLOPED, cause.imu, tuple(meanwhile)
        )


def _end_of(end: float, cause: Explained, device: str, best: BestEstimate) -> float:
    """Of the estimate's own IMU no later than when the readings become those of another one."""
    own = best.imu.switches if device == "imu" and cause.imu is None else None
    left: list[float] = [] if own is None else own.t[own.t > cause.onset + cause.onset_sigma].tolist()
    return min([end, *left])


def imu_at(interval: FaultInterval, best: BestEstimate, imu: int | None) -> int:
    """An IMU that an interval or one of its rivals names; None: whose readings the estimate's own are then."""
    return int(best.imu.instance_at(np.array([interval.start + interval.start_sigma]))[0]) if imu is None else imu


def _rivals(parts: list[Explained], size: Array, sigma: float, best: BestEstimate) -> tuple[Rival, ...]:
    """Those of the likeliest to be a fault of the parts of one interval, whose size is that of all together."""

    def fault_odds(part: Explained) -> float:
        return max((one.fault_log_odds for one in part.rivals if one.kind == part.kind), default=-np.inf)

    likeliest = max(parts, key=fault_odds)
    if len(parts) == 1:
        return likeliest.rivals
    flight = float(best.t[0]), float(best.t[-1])
    fault = fault_of_size(likeliest.kind, size, float(sigma), flight, likeliest.imu)
    alike = _ALIKE.get(likeliest.kind, (likeliest.kind,))
    return tuple(
        replace(one, fault=max(one.fault, fault)) if one.imu == likeliest.imu and one.kind in alike else one
        for one in likeliest.rivals
    )


def unreported(best: BestEstimate, measured: str) -> Array:
    """(K, 2) NED, m or m/s, what "gps_position" or "gps_velocity" is explained to be off by, less reported faults."""
    shown = {interval.kind for interval in fault_intervals(best)}
    off = np.zeros((len(best.t), 2))
    for part in best.explained:
        kind = hypothesis_of(part.kind)
        if part.kind in (measured, "gps_motion") and part.kind not in shown:
            off += _activation(replace(part, shape=kind.shape_at(measured, part.shape)), best.t)[:, None] * part.size
    return off


def _activation(part: Explained, t: Array) -> Array:
    """(N,) how much of the size of what was explained is there at times t: of a ramp so many seconds of it."""
    if part.shape == "shock":
        return ((t >= part.onset) & (t <= part.onset + 1.0)).astype(np.float64)
    return np.asarray(activation(part.shape, np.array([part.onset]), np.array([part.end]), t, t)[0])


def share_at(part: Explained, t: float) -> float:
    """How much of the size of what was explained is there at a time, s."""
    return float(_activation(part, np.array([t]))[0])


def _sigma(parts: list[Explained], share: Array, level: Array, best: BestEstimate) -> Array:
    """(N,) 1σ of the length of a sum (N, m) of so much (P, N) of each part.

    Two that begin together are known together, while each by itself may be anything.
    """
    along = level / np.maximum(length(level), 1e-300)[:, None]
    joint = np.zeros((len(level), len(best.explained_covariance)))
    variance = np.zeros(len(level))
    for part, much in zip(parts, share, strict=True):
        weight = much[:, None] * along
        if part.place is None:
            variance += ((weight * part.sigma) ** 2).sum(axis=1)
        else:
            joint[:, part.place] += weight
    variance += ((joint @ best.explained_covariance) * joint).sum(axis=1)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def _size(interval: FaultInterval, best: BestEstimate) -> Size:
    return Size(interval.size, interval.sigma, best.states.constant("earth_field"))


def reported_size(interval: FaultInterval, best: BestEstimate) -> tuple[float, float, str]:
    """How large it is said to be, its σ, its unit: of scales the largest, of a compass' field that turns its angle."""
    if interval.kind in ("gyro_scale", "accel_scale"):  # three factors, and no vector
        return float(np.abs(interval.size).max()), interval.sigma, ""
    if interval.kind != "compass_field":
        return interval.magnitude, interval.sigma, hypothesis_of(interval.kind).unit
    angle, sigma = turn_of_the_field(_size(interval, best))
    return abs(angle), sigma, "rad"


def turn_of_compass(interval: FaultInterval, best: BestEstimate) -> tuple[float, float]:
    """By how much a compass turns the heading at most, and 1σ of it, rad."""
    size, sigma, unit = reported_size(interval, best)
    if unit == "rad":
        return min(size, np.pi), sigma
    level = max(float(np.linalg.norm(best.states.constant("earth_field")[:2])), 1e-9)
    return float(np.arcsin(min(size / level, 1.0))) if size < level else np.pi, sigma / level


def is_sized(interval: FaultInterval, best: BestEstimate) -> bool:
    """Whether its size is more than its σ."""
    size, sigma, _ = reported_size(interval, best)
    return size >= sigma


def cause_of(interval: FaultInterval, best: BestEstimate, side: Side, consequences: tuple[str, ...]) -> Cause:
    """The interval in numbers."""
    size, sigma, unit = reported_size(interval, best)
    other, shares = rival(interval), probability_imu_or_aiding(interval)
    return Cause(
        kind=interval.kind,
        side=side,
        onset_s=interval.start,
        end_s=interval.end if np.isfinite(interval.end) else None,
        onset_sigma_s=interval.start_sigma,
        sensor=interval.kind.split("_")[0] if interval.device == "imu" else interval.device,
        axis=main_axis(interval.size) if interval.device == "imu" else "",  # of others it is none of the body's
        size=size,
        sigma=sigma,
        unit=unit,
        probability=probabilities(interval.rivals)[interval.device] if interval.rivals else None,
        side_probability=shares["imu" if interval.device == "imu" else "aiding"] if interval.rivals else None,
        rival="" if other is None else other[0],
        rival_probability=None if other is None else other[1],
        consequences=consequences,
        imu=imu_at(interval, best, interval.imu) if interval.device == "imu" else None,
    )


def described(interval: FaultInterval, best: BestEstimate) -> str:
    """The interval in words, with its time."""
    until = "to the end" if not np.isfinite(interval.end) else f"to {interval.end:.1f} s"
    sized = is_sized(interval, best)
    phrase = hypothesis_of(interval.kind).phrase
    what = phrase(_size(interval, best)) if sized else f"{words(interval.kind)} of a size that cannot be told"
    if interval.imu is not None:
        what = f"IMU {interval.imu}, compared with IMU {imu_at(interval, best, None)}: {what}"
    elif interval.device == "imu" and best.imu.switches:
        what = f"IMU {imu_at(interval, best, None)}: {what}"
    since = f"from {interval.start:.1f} ± {interval.start_sigma:.1f} s"
    if interval.start - interval.start_sigma < best.t[0]:  # it may have been there from the beginning
        since = f"from before {interval.start + interval.start_sigma:.1f} s"
    return f"{what}, {since} {until}"


def probability_imu_or_aiding(interval: FaultInterval) -> dict[str, float]:
    """ "imu", "aiding" (any sensor beside it), "nobody" → the probability that it has the fault."""
    shares = probabilities(interval.rivals)
    imu, nobody = shares["imu"], shares["nobody"]
    return {"imu": imu, "aiding": max(1.0 - imu - nobody, 0.0), "nobody": nobody}


def probability_by_imu(interval: FaultInterval, best: BestEstimate) -> dict[int, float]:
    """IMU → the probability that it is the one with the fault, if an IMU has it; the likeliest first."""
    odds = [one for one in interval.rivals if hypothesis_of(one.kind).device == "imu"]
    share = np.exp([one.fault_log_odds - max(other.fault_log_odds for other in odds) for one in odds])
    out: dict[int, float] = {}
    for one, part in zip(odds, share / share.sum(), strict=True):
        instance = imu_at(interval, best, one.imu)
        out[instance] = out.get(instance, 0.0) + float(part)
    return dict(sorted(out.items(), key=lambda pair: -pair[1]))


def own_odds(interval: FaultInterval) -> float:
    """Logarithm of the posterior odds of its own kind against nothing."""
    return max((one.log_odds for one in interval.rivals if one.kind == interval.kind), default=0.0)


def rival(interval: FaultInterval) -> tuple[str, float] | None:
    """The likeliest kind of fault of another sensor, and its probability; None where there is none."""
    by_device = probabilities([replace(one, fault=1.0) for one in interval.rivals])
    odds: dict[str, dict[str, float]] = {}  # device → kind → its odds against the likeliest of that device
    for one in interval.rivals:
        own = odds.setdefault(hypothesis_of(one.kind).device, {})
        own[one.kind] = float(np.logaddexp(own.get(one.kind, -np.inf), one.log_odds))
    named: dict[str, float] = {}
    for device, kinds in odds.items():
        if device != interval.device:
            kind, most = max(kinds.items(), key=lambda pair: pair[1])
            named[kind] = by_device[device] / sum(math.exp(value - most) for value in kinds.values())
    return max(named.items(), key=lambda pair: pair[1]) if named else None


def percent(probability: float) -> str:
    """A probability in words: never 0 or 100 %, which no evidence gives."""
    if probability < 1e-3 or probability > 1.0 - 1e-3:
        return "under 0.1 %" if probability < 0.5 else "over 99.9 %"
    return f"{100.0 * probability:.{1 if min(probability, 1.0 - probability) < 0.02 else 0}f} %"
