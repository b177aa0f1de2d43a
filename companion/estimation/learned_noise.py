"""Noise learned from the flight: densities of the IMU, and the scale of every aiding sensor's σ.

The variance θ of a cause with covariance θ V is multiplied by the root of eᵀ V e / tr(D V), where e is the smoothed
disturbance and D its variance: each step raises the likelihood (MM algorithm of Zhou et al. 2019, "MM algorithms for
variance components models"; e and D as in de Jong and Penzer 1998, "Diagnosing shocks in time series"). The sums are
kept for stretches of the flight, without what is off in the same way all through a stretch, and a typical stretch is
taken: a fault in a part of the flight does not pass for noise in all of it.

Also here: redescending weights of readings, and of process noise, that their own neighbours contradict (P. J. Huber
1981).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from companion.constants import healthy, num
from companion.estimation.aiding_sensors import SENSORS, SLOW
from companion.estimation.hypotheses import HYPOTHESES
from companion.estimation.model import ATTITUDE, GYRO_BIAS, NOISES, POSITION, STATES, VELOCITY, ProcessNoise
from companion.estimation.setup import Setup
from companion.estimation.system import Problem, measurement_residual, measurement_variance, motion_residual
from companion.model import Array, BoolArray, IntArray, percentile
from companion.noise import neighbourhoods
from companion.strapdown import MOVED, quaternion

FIRST_NOISE = ProcessNoise(**num.FIRST_PROCESS_NOISE)


_ALONE = {hypothesis.name: hypothesis for hypothesis in HYPOTHESES if hypothesis.name in SENSORS}
"""Aiding sensor → what is wrong with it where it alone is off by so much."""


@dataclass(frozen=True, slots=True)
class Change:
    """What a step has changed a density by."""

    size: float  # of the logarithm
    plain: bool  # whether it is one of a series, and not where such a series leads


def noise_limits(setup: Setup) -> dict[str, tuple[float, float]]:
    """What may be learned of the densities: not less than the steps of the readings make.

    Without GPS the motion of the vehicle and the accelerometer's noise look alike; what is white shows between samples.
    """
    steps = (setup.imu.gyro_step, setup.imu.accel_step)
    limits = {
        cause: (max(least, 0.5 * step * np.sqrt(num.TRUNCATED_S)), most)
        for cause, (least, most), step in zip(NOISES[:2], healthy.IMU_NOISE, steps, strict=True)
    }
    if _without_gps(setup):
        least, most = limits["accel_noise"]
        limits["accel_noise"] = least, float(np.clip(num.FILTERED_NOISE * setup.scatter[1], least, most))
    return limits


def spectral(setup: Setup) -> tuple[float, float]:
    """Densities of gyro and accelerometer where no vibration is, by their spectra, rad/s/√Hz and m/s²/√Hz.

    Not less than what may be learned at least. Without GPS the vehicle's motion is learned as the accelerometer's
    noise: there it is what readings scatter by between samples.
    """
    limits, (gyro, accel) = noise_limits(setup), setup.spectral_noise
    if _without_gps(setup):
        accel = setup.scatter[1]
    return max(gyro, limits["gyro_noise"][0]), max(accel, limits["accel_noise"][0])


def _without_gps(setup: Setup) -> bool:
    return any(one.name == "calm" for one in setup.readings)


def doubted_limits(
    setup: Setup, linear: Problem, noise: ProcessNoise, scale: Mapping[str, float], *, imu_in_order: bool
) -> Iterator[dict[str, tuple[float, float]]]:
    """Limits of the noise as if sensors that seem all noise were in order: what lasts for long is learned as noise.

    imu_in_order: whether nothing of the IMU is explained: its noise then is three times what its spectra show.
    """
    limits, shown = noise_limits(setup), spectral(setup)
    if noise.contradicts(shown) and imu_in_order:
        yield {
            cause: (least, float(np.clip(num.FILTERED_NOISE * own, least, most)))
            for (cause, (least, most)), own in zip(limits.items(), shown, strict=True)
        }
    if noise.gyro_wanders:
        yield limits | {"gyro_walk": (FIRST_NOISE.gyro_walk, FIRST_NOISE.gyro_walk)}
    if limited := _persistent_limits(setup, scale, linear):
        yield limits | limited


def _persistent_limits(setup: Setup, scale: Mapping[str, float], linear: Problem) -> dict[str, tuple[float, float]]:
    """Limits of the scales of aiding sensors that need more noise than usual, while their readings scatter by less.

    It is then no noise: they are off for long. Where it is so, the scale is limited to what one in order would have: a
    third of what is called wrong of it. A compass is none of them, for it errs by what the vehicle does.
    """
    nominal = {one.name: float(np.median(one.sigma)) for one in setup.readings}
    limits = {}
    for one in linear.measurements:
        hypothesis = _ALONE.get(one.name)
        if hypothesis is None or len(one.t) < num.NOISE_STRETCHES:
            continue
        in_order = max(hypothesis.min_reported, hypothesis.min_reported_slow) / 3.0
        steps = np.diff(measurement_residual(one, linear.solution), n=2, axis=0) / np.sqrt(6.0)
        shown = 1.4826 * float(np.median(np.abs(steps)))  # σ of what is normal, whatever a few steps are
        if scale[one.name] * nominal[one.name] > max(in_order, num.AIDING_SCATTERS * shown):
            most = in_order / nominal[one.name]
            limits[one.name] = (min(SENSORS[one.name].least / nominal[one.name], 1.0, most), most)
    return limits


def learn(
    linear: Problem,
    setup: Setup,
    noise: ProcessNoise,
    scale: Mapping[str, float],
    slow: Mapping[str, float],
    limits: Mapping[str, tuple[float, float]],
    before: Mapping[str, Change],
) -> tuple[ProcessNoise, dict[str, float], dict[str, float], dict[str, Change]]:
    """One step of learning: densities of the process noise, scales of the aiding sensors' σ, and the change of each.

    limits: of the densities of the IMU, and of the scales of aiding sensors that have any.
    before: the changes of the step before. The densities that the spectra of gyro and accelerometer show are believed
    beforehand: an inverse gamma distribution of the variance.
    """
    solution = linear.solution
    across_gaps = linear.variance[:, 0] > 0.1
    still = _at_rest(linear)
    usual = _telling(still[:-1] & still[1:], ~across_gaps | across_gaps.all())
    count = max(1, min(num.NOISE_STRETCHES, len(usual) // 8))
    e = _in_body(linear, solution.disturbances[0])[usual]
    e -= _means(e, count)  # what is off in the same way all through a stretch is a bias, and no noise
    e = _in_turn(linear.states.q_ned_frd[usual], e)
    moved = slice(0, 9)  # by the densities that are learned: attitude, velocity and position
    turn = np.zeros((len(usual), 9, 9))
    for block in (ATTITUDE, VELOCITY, POSITION):
        turn[:, block, block] = linear.turn[usual]
    e = (turn.swapaxes(-1, -2) @ e[:, moved, None])[..., 0]
    d = turn.swapaxes(-1, -2) @ solution.disturbances[1][usual, moved, moved] @ turn
    densities, change = dict[str, float](), dict[str, Change]()
    for cause, expected in zip(NOISES[:2], setup.spectral_noise, strict=True):
        own, v = MOVED[cause], linear.sums[cause][usual]
        believed = num.DENSITY_PRIOR_READINGS / len(e) / noise.density(cause) ** 2
        above = np.einsum("ki,kij,kj->k", e[:, own], v, e[:, own]) + believed * (expected / noise.density(cause)) ** 2
        below = np.einsum("kij,kij->k", d[:, own, own], v) * (1.0 - count / len(e)) + believed
        step = _further(0.5 * np.log(_typical(above, below)), before.get(cause))
        densities[cause], change[cause] = _changed(noise.density(cause), step, limits[cause])
    if "gyro_walk" in before or (before and max(abs(one.size) for one in before.values()) < num.DENSITY_NEAR):
        step = _further(_walk(linear, setup, noise, usual), before.get("gyro_walk"))
        walk = _changed(noise.gyro_walk, step, limits.get("gyro_walk", _walk_limits(setup, noise)))
        densities["gyro_walk"], change["gyro_walk"] = walk
    learned = dict(scale)
    for one in linear.measurements:
        if SENSORS[one.name].device == "rest":
            continue
        information = one.information
        left = measurement_residual(one, solution)
        above = (left**2 * information).sum(axis=1)
        below = (1.0 - np.minimum(information * measurement_variance(one, solution), 1.0)).sum(axis=1)
        least = SENSORS[one.name].least / percentile(one.sigma.ravel() / scale[one.name], 50.0)
        moving = _telling(still[one.keyframe])
        step = _further(0.5 * np.log(_typical(above[moving], below[moving])), before.get(one.name))
        bounds = limits.get(one.name, (min(least, 1.0), num.AIDING_MAX_SCALE))
        learned[one.name], change[one.name] = _changed(scale[one.name], step, bounds)
    wandering: dict[str, float] = {}
    for name, growth in _slow_errors(linear, setup, slow).items():
        (median, spread, _), key = SLOW[name], f"slow {name}"
        bounds = median / spread**2, median * spread**2
        wandering[name], change[key] = _changed(slow[name], _further(growth, before.get(key)), bounds)
    return replace(noise, **densities), learned, wandering, change


def _walk_limits(setup: Setup, noise: ProcessNoise) -> tuple[float, float]:
    """Of the density of the gyro bias's walk: where the IMU contradicts the other sensors nothing is learned of it."""
    most = 1.0 if noise.contradicts(spectral(setup)) else healthy.GYRO_WALK_SPREAD**2
    return FIRST_NOISE.gyro_walk, most * FIRST_NOISE.gyro_walk


def _walk(linear: Problem, setup: Setup, noise: ProcessNoise, usual: IntArray) -> float:
    """By how much the logarithm of the density of the gyro bias's walk changes, with a log-normal prior.

    A walk goes on all through the flight, a fault begins and ends: a typical stretch tells of the one alone.
    """
    e, d = linear.solution.disturbances
    own = noise.gyro_walk**2 * np.diff(setup.t)[usual, None]
    believed = _observations(healthy.GYRO_WALK_SPREAD) / len(usual)
    above = (e[usual, GYRO_BIAS] ** 2 * own).sum(axis=1) + believed * (FIRST_NOISE.gyro_walk / noise.gyro_walk) ** 2
    below = (np.einsum("kii->ki", d[usual, GYRO_BIAS, GYRO_BIAS]) * own).sum(axis=1) + believed
    return 0.5 * float(np.log(_typical(above, below)))


def _slow_errors(linear: Problem, setup: Setup, slow: Mapping[str, float]) -> dict[str, float]:
    """By how much the logarithm of each slow error's σ changes: as of the IMU's noise, with a log-normal prior."""
    e, d = linear.solution.disturbances
    apart = np.diff(setup.t)
    steps = {}
    for name, place in setup.slow.items():
        median, spread, time = SLOW[name]
        gained = (1.0 - np.exp(-2.0 * apart / time))[:, None]
        variance, believed = slow[name] ** 2, _observations(spread)
        above = float((e[:, place] ** 2 * gained).sum()) * variance + believed * median**2 / variance
        below = float((np.einsum("kii->ki", d[:, place, place]) * gained).sum()) * variance + believed
        steps[name] = 0.5 * float(np.log(above / below))
    return steps


def _observations(spread: float) -> float:
    """How many observations of σ a log-normal prior is worth whose 1σ is a factor: their Fisher information is 2 each.

    With s = ln(spread) that of the prior of ln σ is 1 / s².
    """
    return 0.5 / float(np.log(spread)) ** 2


def _further(step: float, before: Change | None) -> Change:
    """A step as far as the geometric series leads that it and the step before begin (Aitken 1926).

    One that goes to and fro ends before its next step does. A step that is as far as a series leads begins none.
    """
    ratio = step / before.size if before is not None and before.plain and before.size else 0.0
    goes_on = num.SERIES_RATIO < abs(ratio) < 1.0
    times = min(1.0 / (1.0 - ratio), num.SERIES_MAX_STEPS) if goes_on else 1.0
    return Change(float(np.clip(times * step, -num.SERIES_MAX_LOG, num.SERIES_MAX_LOG)), not goes_on)


def _changed(value: float, step: Change, limits: tuple[float, float]) -> tuple[float, Change]:
    """A density after a step, and what has changed: it stays within limits."""
    after = float(np.clip(value * np.exp(step.size), *limits))
    return after, replace(step, size=float(np.log(after / value)))


def _in_body(linear: Problem, e: Array) -> Array:
    """Disturbances (K-1, 15) in FRD: in the body a bias stands still."""
    return _in_turn(quaternion.conjugate(linear.states.q_ned_frd[:-1]), e)


def _in_turn(q: Array, e: Array) -> Array:
    """Disturbances (N, 15) with those of attitude, velocity and position turned by q (N, 4)."""
    out = e.copy()
    for block in (ATTITUDE, VELOCITY, POSITION):
        out[:, block] = quaternion.rotate(q, e[:, block])
    return out


def _at_rest(linear: Problem) -> BoolArray:
    """(K,) whether the vehicle rests at a keyframe."""
    still = np.zeros(len(linear.t), np.bool_)
    for one in linear.measurements:
        if SENSORS[one.name].device == "rest":
            still[one.keyframe] = True
    return still


def _telling(still: BoolArray, good: BoolArray | None = None) -> IntArray:
    """Which of some intervals or readings tell of the noise in flight: where more than a third rest (N,), the others.

    Those at rest are quieter, and what is typical of them all would be the quiet of the ground.
    """
    good = np.ones(len(still), np.bool_) if good is None else good
    moving = good & ~still
    few = moving.sum() < num.MOVING_MIN_INTERVALS
    return np.flatnonzero(good if few or still[good].mean() <= num.RESTING_SHARE else moving)


def _stretches(count: int, parts: int) -> IntArray:
    """(parts,) where stretches of `count` values begin, which are of one length, the first ones longer by one."""
    each, more = divmod(count, parts)
    return np.arange(parts) * each + np.minimum(np.arange(parts), more)


def _means(values: Array, parts: int) -> Array:
    """For each of the values (N, d) the mean of its stretch."""
    begin = _stretches(len(values), parts)
    lengths = np.diff(begin, append=len(values))
    return np.repeat(np.add.reduceat(values, begin) / lengths[:, None], lengths, axis=0)


def _typical(above: Array, below: Array) -> float:
    """The ratio of the sums in a typical stretch, between 1/100 and 100; 1 where nothing says it."""
    if not len(above):
        return 1.0
    count = min(num.NOISE_STRETCHES, len(above) // 8)
    begin = _stretches(len(above), count if count >= 3 else 1)
    sums = np.add.reduceat(np.stack((above, below)), begin, axis=1)
    above, below = sums[:, np.isfinite(sums).all(axis=0) & (sums[1] > 0.0)]
    if not len(below):
        return 1.0
    ratio = above / np.maximum(below, above / 100.0)  # at most 100: a quotient of what is absurd overflows
    return float(np.clip(percentile(ratio, num.TYPICAL_PERCENTILE), 0.01, 100.0))


def coloured(linear: Problem) -> dict[str, float]:
    """Factor by which the noise of gyro and accelerometer has to grow because it is correlated in time.

    White noise of this size says as much about what changes slowly as the correlated errors do: it grows by the root of
    the sum of the autocorrelation. Smoothed disturbances of the motion are correlated even where its noise is white, by
    as much as those of a data set drawn with white noise.
    """
    still = _at_rest(linear)
    moving = _telling(still[:-1] & still[1:])
    sigma = np.sqrt(linear.variance)[moving]
    # any draw serves, and the same log gets the same answer
    drawn = linear.solution.redrawn(linear.drawn(np.random.default_rng(0), 1))
    noise = (drawn.motion.weight @ motion_residual(drawn.motion, drawn))[..., 0]
    own, white = (_in_body(linear, e)[moving, :STATES] * sigma for e in (linear.solution.disturbances[0], noise))
    return {
        sensor: max(1.0, _correlation_factor(own[:, block]) / _correlation_factor(white[:, block]))
        for sensor, block in (("gyro", ATTITUDE), ("accel", VELOCITY))
    }


def _correlation_factor(values: Array) -> float:
    """The root of the sum of the autocorrelation of values (M, d), in a typical stretch; at least 1."""
    if len(values) < 4 * num.CORRELATED_LAGS:
        return 1.0
    ratios = []
    for part in np.array_split(values, len(values) // (4 * num.CORRELATED_LAGS)):
        rest = part - part.mean(axis=0)
        own = float((rest**2).sum())
        lags = [float((rest[lag:] * rest[:-lag]).sum()) / max(own, 1e-300) for lag in range(1, num.CORRELATED_LAGS)]
        end = next((i for i, value in enumerate(lags) if value < 0.05), len(lags))
        ratios.append(1.0 + 2.0 * sum(lags[:end]))
    return float(np.sqrt(np.clip(np.median(ratios), 1.0, 36.0)))


def outlier_weights(linear: Problem) -> dict[str, Array]:
    """Weights of readings that their own neighbours contradict: they count linearly, not by their square.

    Readings that are off together keep their weight: whether it is they that are wrong is for the hypotheses to say.
    """
    return {
        one.name: _beside_neighbours(measurement_residual(one, linear.solution) / one.sigma)
        for one in linear.measurements
        if len(one.t) > num.HUBER_SPAN
    }


def shocks(linear: Problem) -> Array:
    """(K-1, 2) times by which the noise of gyro and accelerometer is larger in intervals that their neighbours
    contradict: a touch of the ground, a clipped or an aliased manoeuvre. What lasts, as a bias does, is none.
    """
    e, d = linear.solution.disturbances
    out = np.ones((len(e), 2))
    if len(e) <= num.HUBER_SPAN:
        return out
    for column, block in enumerate((ATTITUDE, VELOCITY)):
        known = np.diagonal(d, axis1=1, axis2=2)[:, block]
        sigma = np.sqrt(np.where(known > 0.0, known, np.inf))
        out[:, column] = _beside_neighbours(e[:, block] / sigma) ** -0.5
    return out


def _beside_neighbours(values: Array) -> Array:
    """(M,) weights of normalised values (M, d): 1 where they are near the median of those around them."""
    half = num.HUBER_SPAN // 2
    typical = np.partition(neighbourhoods(values, num.HUBER_SPAN), half, axis=-1)[..., half]
    size = np.abs(values - typical).max(axis=1)
    return np.asarray(np.minimum(1.0, num.HUBER / np.maximum(size, 1e-9)) ** 2)
