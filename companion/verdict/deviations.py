"""Where the autopilot's own estimate leaves the best estimate further than both may be off, and what would be seen.

Also here: what is known of the autopilot's own estimate: how far it was off, and the biases that it takes off the
readings.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from companion.comparison import (
    Limits,
    Reference,
    attitude_error,
    block_means,
    ends_of,
    flight_of,
    judged_at,
    length,
    phases,
    reference_at,
    runs,
    wrapped,
)
from companion.constants import check, harm, healthy, num
from companion.estimation import ATTITUDE, CONSTANTS, HEIGHTS, POSITION, VELOCITY, BestEstimate, hypothesis_of
from companion.model import (
    Array,
    BoolArray,
    EstimatorReset,
    Flight,
    ImuTrack,
    IntArray,
    NoEstimateError,
    Origin,
    interpolated,
    radii_of_curvature,
    weighted_median,
)
from companion.strapdown import quaternion
from companion.verdict.fault_interval import (
    BIAS_UNITS,
    DEVIATION_UNITS,
    SENSOR_WORDS,
    EstimatorDeviation,
    error_log_bayes,
    unreported,
)
from companion.verdict.finding import Finding


@dataclass(frozen=True, slots=True, eq=False)
class AutopilotBias:
    """An estimator's own gyro bias towards the end of a flight."""

    gyro: Array  # (3,) rad/s, FRD
    sigma: Array  # (3,) from its scatter, and from the steps of the readings
    start_s: float  # boot clock
    end_s: float


def autopilot_bias(flight: Flight, track: ImuTrack) -> AutopilotBias | None:
    """Readings of the gyro less the rates of ATTITUDE; None where those say nothing of this gyro.

    They are the first IMU's. Where the log has no rates but the gyro's own, or the bias has been taken off the readings
    already, there is nothing to compare.
    """
    attitude = flight.attitude
    if attitude is None or not attitude.rates_reported or not attitude.rates.any():
        return None
    if track.instance != 0 or track.bias_removed:
        return None
    inside = (attitude.t >= track.t[0]) & (attitude.t <= track.t[-1])
    t, rates = attitude.t[inside], attitude.rates[inside]
    if len(t) < 2:
        return None
    gyro = interpolated(t, track.t, track.gyro)
    slow = length(rates) < num.AP_BIAS_MAX_RPS
    block = ((t - t[0]) / num.AVERAGED_S).astype(np.intp)
    count = np.bincount(block[slow], minlength=block[-1] + 1)
    full = np.flatnonzero(count >= 0.9 * np.bincount(block).clip(1))
    if len(full) < num.AP_BIAS_MIN_BLOCKS:
        return None
    means = block_means(block[slow], (gyro - rates)[slow])[full]
    newest = means[-max(num.AP_BIAS_MIN_BLOCKS, round(num.AP_BIAS_NEWEST * len(means))) :]
    used = full[-len(newest) :]
    middle = np.median(newest, axis=0)
    scatter = 1.4826 * np.median(np.abs(newest - middle), axis=0)
    begin, end = (float(min(t[0] + i * num.AVERAGED_S, t[-1])) for i in (used[0], used[-1] + 1))
    return AutopilotBias(middle, np.hypot(scatter, 0.5 * track.gyro_step), begin, end)


@dataclass(frozen=True, slots=True)
class AutopilotError:
    """One quantity: size of the difference over the flight, and how well the best estimate knows it."""

    quantity: str  # "tilt", "heading", "velocity", "position"
    unit: str  # "rad", "m/s", "m"
    samples: int
    median: float
    p95: float
    worst: float
    worst_s: float  # s, boot clock, of the worst
    sigma: float  # 1σ of the best estimate at that time, and of the autopilot's state between two of its samples
    typical_sigma: float  # its median


def autopilot_error(flight: Flight, best: BestEstimate, limits: Limits) -> tuple[AutopilotError, ...]:
    """The autopilot's estimate less the best estimate, at the keyframes at which the autopilot tells its state.

    Velocity and position need a GPS. Positions are compared from where both begin: their zeros need not be one place.
    Empty where the flight has no estimate of the autopilot's.
    """
    if flight.attitude is None or len(flight.attitude) < 2:
        return ()
    reference = reference_at(flight.attitude, flight.position, best.t, limits)
    turned = attitude_error(reference.q_ned_frd, best.q_ned_frd)
    between = reference.interpolation_error(np.arange(len(best.t)), best.path)
    pairs = (ATTITUDE, between.attitude), (VELOCITY, between.velocity), (POSITION, between.position)
    attitude, velocity, position = (np.hypot(best.sigma(block), own[:, None]) for block, own in pairs)
    tilt, heading = attitude[:, :2], attitude[:, 2:]
    rows = [
        ("tilt", length(turned[:, :2]), tilt, reference.attitude_known),
        ("heading", np.abs(turned[:, 2]), heading, reference.attitude_known),
    ]
    known = reference.position_known
    if "gps_position" in best.residuals and known.any():
        moved = reference.position - best.position
        begin = np.flatnonzero(known)[: max(5, int(num.POSITION_ORIGIN_SHARE * known.sum()))]
        rows.append(("velocity", length(reference.velocity - best.velocity), velocity, known))
        rows.append(("position", length(moved - np.median(moved[begin], axis=0)), position, known))
    return tuple(_summary(best.t, *row) for row in rows if row[-1].any())


def _summary(t: Array, name: str, size: Array, each: Array, known: BoolArray) -> AutopilotError:
    t, size, sigma = t[known], size[known], length(each[known])
    worst = int(np.argmax(size))
    median, p95 = float(np.median(size)), float(np.percentile(size, 95.0))
    at_worst = float(size[worst]), float(t[worst]), float(sigma[worst])
    return AutopilotError(name, DEVIATION_UNITS[name][0], len(size), median, p95, *at_worst, float(np.median(sigma)))


def known_biases(flight: Flight, best: BestEstimate) -> Iterator[Finding]:
    """Where the best estimate and an estimator of the vehicle find the same large bias in the IMU that was judged."""
    own = [b for b in flight.biases if b.imu_instance == best.imu.instance and len(b)]
    if not own:
        return
    held, (begin, end) = own[0], ends_of(best.t)
    since = end - num.AP_BIAS_NEWEST * (end - begin)
    late, newest = held.t >= since, best.t >= since
    for sensor, large in harm.AP_BIAS.items():
        values: Array = getattr(held, sensor)[late]
        estimate: Array = getattr(best.states, f"{sensor}_bias")[newest]
        if not len(values) or not np.isfinite(values).all():
            continue
        theirs, ours = np.median(values, axis=0), np.median(estimate, axis=0)
        doubts = getattr(held, f"{sensor}_sigma")[late], getattr(best, f"{sensor}_bias_sigma")[newest]
        their_sigma, our_sigma = (np.median(doubt, axis=0) for doubt in doubts)
        sigma = np.maximum(np.hypot(np.nan_to_num(their_sigma), our_sigma), healthy.AP_BIAS_MIN_SIGMA[sensor])
        if float(length(ours)) < large or (np.abs(ours - theirs) > num.SIGMAS * sigma).any():
            continue
        axis = int(np.argmax(np.abs(ours)))
        if abs(theirs[axis]) < 0.5 * abs(ours[axis]):
            continue  # it does not know it: it is only unsure
        name, (unit, factor, decimals) = SENSOR_WORDS[sensor], BIAS_UNITS[sensor]
        reads, takes = (f"{v[axis] * factor:.{decimals}f}" for v in (ours, theirs))
        known = f"the autopilot's estimator takes {takes} off ({held.source})"
        evidence = f"{name} {'xyz'[axis]} bias {reads} {unit}; {known}"
        advice = "No fault: the estimator knows it and removes it. A calibration at rest would spare it the work."
        yield Finding(f"{sensor}_bias_known", "data", "info", begin, end, evidence, advice)


COMPONENTS: Mapping[str, tuple[str, slice]] = {
    "tilt": ("turn", slice(0, 2)),
    "heading": ("turn", slice(2, 3)),
    "velocity": ("velocity", slice(0, 2)),
    "position": ("position", slice(0, 2)),
    "height": ("position", slice(2, 3)),
}
"""Quantity → what it is of, and its components in NED."""

_LEAST = {**harm.AP_ERROR, "position": hypothesis_of("gps_position").min_reported}  # as a healthy receiver shifts


def deviations_of(
    flight: Flight, best: BestEstimate, limits: Limits, tilted: tuple[float, float] = (0.0, 0.0)
) -> tuple[EstimatorDeviation, ...]:
    """Every time in which the autopilot's estimate is off by what does harm, while it is judged.

    And in which an error of it is likelier than what both may be off by: how likely, it says itself.

    A heading deviates by what it is off by, and where that is in doubt by what it has changed by: that is known better
    where the whole flight is turned, as by a compass that is not calibrated.
    tilted: rad about x and y, FRD, from the IMU's axes into those of the attitude, where the IMU is known to sit askew.
    """
    reference, off = _off(flight, best, limits, tilted)
    every = (one for name, quantity in off.items() for one in _lasting(best, reference, name, *quantity))
    return tuple(sorted(every, key=lambda one: one.start))


def _lasting(
    best: BestEstimate, reference: Reference, name: str, value: Array, known_to: Array, judged: BoolArray
) -> Iterator[EstimatorDeviation]:
    """Each stretch of keyframes (K,) that lasts; one that begins with a step need not last as long as what grows.

    known_to: (K,) 1σ of the best estimate. judged: (K,) where chance might have made one.
    """
    sigma = np.hypot(known_to, healthy.AP_SIGMA[name])
    evidence, in_all = error_log_bayes(name, value, sigma), float(np.diff(best.t)[judged[1:]].sum())
    is_off = (value > _LEAST[name]) & (evidence > 0.0)
    for part in _parts(best.t, judged, healthy.DEVIATION_S[name]):
        t, own = best.t[part], value[part]
        for first, last in runs(is_off[part]):
            before = own[max(first - 2, 0) : first]  # one keyframe may lie within the step
            stepped = len(before) > 0 and own[first] - before.min() > check.SUDDEN * own[first]
            here = slice(first, last + 1)
            least = check.SUDDEN_S if stepped else healthy.DEVIATION_S[name]
            if (weighed := _strongest_part(t[here], evidence[part][here], least)) is None:
                continue
            peak = int(part[first + int(np.argmax(own[here]))])
            confirmed = _confirmed_by_imu(best, reference, name, value, peak)
            size = float(value[peak]), float(sigma[peak])
            yield EstimatorDeviation(name, float(t[first]), float(t[last]), *size, *weighed, in_all, confirmed)


def _parts(t: Array, judged: BoolArray, apart: float) -> list[IntArray]:
    """Keyframes at times t (K,) that are judged, in parts that are so far apart, s: a gap ends no error."""
    known = np.flatnonzero(judged)
    return np.split(known, np.flatnonzero(np.diff(t[known]) > apart) + 1)


def _strongest_part(t: Array, evidence: Array, least: float) -> tuple[float, float] | None:
    """The evidence (K,) that no keyframe (K,) of some part falls below, and how long that part lasts, s.

    Of all parts of least s, twice that and so on the one with the strongest evidence: what lasts longer, chance may do
    in fewer places. None where nothing lasts for so long.
    """
    padded, parts, lasts = np.append(evidence, np.inf), list[tuple[float, float]](), least
    while lasts <= t[-1] - t[0]:
        end = np.searchsorted(t, t + lasts)
        first = np.flatnonzero(end < len(t))
        weakest = np.minimum.reduceat(padded, np.column_stack([first, end[first] + 1]).ravel())[::2]
        if len(weakest):  # by rounding none may last so long
            parts.append((float(weakest.max()), lasts))
        lasts *= 2.0
    return max(parts, key=lambda part: part[0] + np.log(part[1]), default=None)


def is_judged(flight: Flight, best: BestEstimate, limits: Limits) -> bool:
    """Whether the autopilot tells its attitude where it is judged beside the best estimate, and often enough."""
    return bool(_judged(flight, best, reference_at(flight.require_attitude(), None, best.t, limits)).any())


def _judged(flight: Flight, best: BestEstimate, reference: Reference) -> BoolArray:
    """(K,) keyframes at which the autopilot is judged; none where they are too few."""
    judged = judged_at(flight, best.t) & reference.attitude_known
    return np.asarray(judged & (judged.sum() >= 5))


def _off(
    flight: Flight, best: BestEstimate, limits: Limits, tilted: tuple[float, float]
) -> tuple[Reference, dict[str, tuple[Array, Array, BoolArray]]]:
    """The autopilot's state at the keyframes, and by how much it is off in each quantity, 1σ and where that is known.

    (K,) each: rad, m/s, m. None where no keyframes are judged.
    """
    t = best.t
    reference = reference_at(flight.require_attitude(), flight.position, t, limits)
    judged = _judged(flight, best, reference)
    if not judged.any():
        return reference, {}
    askew = quaternion.exp(-np.array([*tilted, 0.0]))
    error = attitude_error(reference.q_ned_frd, quaternion.multiply(best.q_ned_frd, askew))
    error = error - _lag(error, best, judged)
    heading, doubt = _heading_off(_beyond_the_compass(error[:, 2], best), best, judged, flight.resets)
    between = reference.interpolation_error(np.arange(len(t)), best.path)
    tilt = best.sigma(ATTITUDE)[:, :2].max(axis=1)
    off = {
        "tilt": (length(error[:, :2]), _together(tilt, between.attitude), judged),
        "heading": (heading, _together(doubt, between.attitude), judged),
    }
    known = judged & reference.position_known
    which = flight_of(phases(flight), t)
    if "gps_position" in best.residuals and known.sum() > 5:
        moved = (reference.position - best.position)[:, :2]
        speed = length(_beyond((reference.velocity - best.velocity)[:, :2], unreported(best, "gps_velocity")))
        moved, gone = (values - at_first(values, known, which) for values in (moved, reference.position))
        moved = beyond_the_sphere(moved, gone, best.origin or flight.origin)
        place = length(_beyond(moved, unreported(best, "gps_position")))
        late = CONSTANTS["gps_latency"][1]  # an estimator assumes one latency of its GPS
        pull, swift = length(np.gradient(best.velocity[:, :2], t, axis=0)), length(best.velocity[:, :2])
        known_velocity, known_position = (best.sigma(block)[:, :2].max(axis=1) for block in (VELOCITY, POSITION))
        off["velocity"] = speed, _together(known_velocity, late * pull, between.velocity), known
        off["position"] = place, _together(known_position, late * swift, between.position), known
    if len(HEIGHTS & best.residuals.keys()) > 1 and known.sum() > 5:
        above = (best.position - reference.position)[:, 2]
        height = _together(best.sigma(POSITION)[:, 2], between.position)
        off["height"] = np.abs(above - at_first(above, known, which)), height, known
    return reference, off


def _confirmed_by_imu(best: BestEstimate, reference: Reference, quantity: str, value: Array, peak: int) -> bool:
    """Whether the IMU moved as the autopilot says, rather than as the best estimate, while a value (K,) rose.

    Each of the two is carried by the IMU from where the value was a quarter of its peak: an autopilot that went astray
    by itself is contradicted by what the value rose by. Of what was off from the beginning on the IMU tells nothing,
    nor of velocity and position after more than some seconds.
    """
    low = np.flatnonzero(value[:peak] <= check.DEVIATION_ONSET * value[peak])
    if not len(low):
        return False
    first, (moved, axes) = int(low[-1]), COMPONENTS[quantity]
    if moved != "turn" and best.t[peak] - best.t[first] > check.DEAD_RECKONED_S:
        return False

    def off(one: Reference | BestEstimate) -> float:
        start = one.q_ned_frd[first], one.velocity[first], one.position[first]
        q, v, p = best.path.carry(best.index[first], best.index[peak], *start, gravity=best.gravity)
        error = {"velocity": one.velocity[peak] - v, "position": one.position[peak] - p}
        turn = attitude_error(one.q_ned_frd[peak], q)
        return float(np.linalg.norm(error.get(moved, turn)[axes]))

    autopilot = off(reference)
    return autopilot < off(best) and autopilot < (1.0 - check.DEVIATION_ONSET) * float(value[peak])


def _together(*sigmas: Array) -> Array:
    """(K,) 1σ of the sum of what has each of some σ (K,)."""
    return length(np.column_stack(sigmas))


def _early(where: BoolArray) -> IntArray:
    """The first tenth of some keyframes (K,), where a change begins: their numbers, five or more."""
    mine = np.flatnonzero(where)
    return mine[: max(5, int(0.1 * len(mine)))]


def at_first(values: Array, where: BoolArray, which: IntArray) -> Array:
    """(K, ...) the median of values (K, ...) when each flight (K,) began: arming may set an estimator's zero anew.

    ArduCopter: `resetHeightDatum`, AP_Arming_Copter.cpp.
    """
    first = np.zeros_like(values)
    for one in np.unique(which[where]):
        first[which == one] = np.median(values[_early(where & (which == one))], axis=0)
    return first


def keyframe_at_first(where: BoolArray, which: IntArray) -> IntArray:
    """(K,) the keyframe in the middle of those that `at_first` takes the median of."""
    first = np.zeros(len(which), np.intp)
    for one in np.unique(which[where]):
        early = _early(where & (which == one))
        first[which == one] = early[len(early) // 2]
    return first


def _beyond(error: Array, sensor: Array) -> Array:
    """(K, 2) an error less as much of what a sensor is off by (K, 2) as leaves least: an estimator may follow it."""
    share = (error * sensor).sum(axis=1) / np.maximum((sensor**2).sum(axis=1), 1e-300)
    return np.asarray(error - np.clip(share, 0.0, 1.0)[:, None] * sensor)


def beyond_the_sphere(error: Array, position: Array, origin: Origin | None) -> Array:
    """(K, 2) m, an error north and east less what it is for an estimator that counts degrees on a sphere.

    position: (K, 3) NED, m, how far that says it has gone.
    """
    if origin is None:
        return error
    shares = [np.zeros(2), *(1.0 - radii_of_curvature(origin.latitude) / radius for radius in healthy.SPHERES)]
    stretched = np.array([share * position[:, :2] for share in shares])
    return np.asarray(error - np.clip(error, stretched.min(axis=0), stretched.max(axis=0)))


def _beyond_the_compass(error: Array, best: BestEstimate) -> Array:
    """(K,) rad, the error of a heading less what a calibrated compass does to one that follows it, in part or wholly.

    The best estimate has its constant iron as a state; an autopilot that takes the compass at its word is in order.
    """
    iron = best.states.constant("hard_iron")
    if "compass" not in best.residuals or float(np.linalg.norm(iron)) > healthy.USUAL_IRON:
        return error
    field, matrix = best.states.constant("earth_field"), quaternion.to_matrix(best.q_ned_frd)
    distorted = np.eye(3) + best.states.constant("soft_iron").reshape(3, 3)
    read = (matrix @ (distorted @ (matrix.swapaxes(1, 2) @ field)[..., None] + iron[:, None]))[..., 0]
    apart = np.arctan2(field[1], field[0]) - np.arctan2(read[:, 1], read[:, 0])
    turned = wrapped(apart)
    return error - np.clip(error, np.minimum(turned, 0.0), np.maximum(turned, 0.0))


def _heading_off(
    error: Array, best: BestEstimate, judged: BoolArray, resets: Sequence[EstimatorReset]
) -> tuple[Array, Array]:
    """(K,) by how much a heading is off, rad, and 1σ of the best estimate's (K,): by itself where that is known well.

    Else by its change since the beginning, or since the estimator told that it has set its heading anew: but not where
    it did so by a compass that is known to have turned, and its heading is further off since. Where the change is not
    known far better than the heading, by the less of the two, each as a part of what is called a deviation.
    """
    sigma = whole = best.sigma(ATTITUDE)[:, 2]
    size = np.abs(error)
    doubted = sigma > check.WELL_KNOWN * healthy.AP_SIGMA["heading"]
    reset_times = np.sort([one.t for one in resets if one.kind == "heading"])
    turned = min((one.onset for one in best.explained if hypothesis_of(one.kind).device == "compass"), default=np.inf)
    at = np.searchsorted(best.t, reset_times)
    further = np.abs(error[np.minimum(at + 1, len(error) - 1)]) > np.abs(error[np.maximum(at - 1, 0)])
    part = np.searchsorted(reset_times[~(further & (reset_times > turned))], best.t)
    for one in np.unique(part[doubted & judged]):
        early = _early(judged & (part == one))
        first = int(early[np.argmin(np.abs(error[early] - np.median(error[early])))])
        changed = best.change_sigma(ATTITUDE, first)[:, 2]
        since = np.abs(wrapped(error - error[first]))  # half a turn off is off either way
        less = since / least_deviation("heading", changed) < np.abs(error) / least_deviation("heading", whole)
        use = doubted & (part == one) & (less | (changed < check.KNOWN_BETTER * whole))
        size = np.where(use, since, size)
        sigma = np.where(use, changed, sigma)
    return size, sigma


def least_deviation(quantity: str, sigma: Array) -> Array:
    """(K,) the least that is called a deviation where the best estimate is known to sigma (K,): rad, m/s, m."""
    own, least = healthy.AP_SIGMA[quantity], _LEAST[quantity]
    return np.maximum(num.SIGMAS * np.hypot(sigma, own), least)


def _lag(error: Array, best: BestEstimate, judged: BoolArray) -> Array:
    """(K, 3) what a constant lag between the IMU's clock and the attitude's makes of the error, NED: no fault.

    Of how the error changes with the rate from one keyframe to the next: what is off throughout is no lag, nor what
    drifts, which on a circle may look like one. The median of what each change says, as often as it tells of it.
    """
    rate = quaternion.rotate(best.q_ned_frd, best.imu.gyro[best.index])
    both = judged[1:] & judged[:-1]
    changed, off = np.diff(rate, axis=0)[both], np.diff(error, axis=0)[both]
    weight = (changed**2).sum(axis=1)
    telling = weight > check.RATE_LAG_RPS**2
    if telling.sum() < check.RATE_LAG_CHANGES:
        return np.zeros_like(error)
    weight, lags = weight[telling], (off * changed).sum(axis=1)[telling] / weight[telling]
    return np.asarray(rate * np.clip(weighted_median(lags, weight), -check.RATE_LAG_S, check.RATE_LAG_S))


_UNITS: Mapping[str, tuple[str, str, float]] = {
    "gyro_bias": ("gyro bias", *BIAS_UNITS["gyro"][:2]),
    "accel_bias": ("accelerometer bias", *BIAS_UNITS["accel"][:2]),
    "tilt": ("tilt", "°", np.degrees(1.0)),
    "heading": ("heading", "°", np.degrees(1.0)),
    "position": ("a position step", "m", 1.0),
    "gps": ("a GPS creep", f"m in {num.CREEPS['gps_position']:g} s", 1.0),
    "compass": ("a compass turn", f"° in {num.CREEPS['compass_field']:g} s", np.degrees(1.0)),
}
"""What may be off → its name, unit, and units in the SI one."""


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """The smallest errors that the flight would have shown, and what it could not show."""

    smallest: Mapping[str, float]  # rad/s, m/s², rad, m; of GPS and compass, that both estimates may follow, m and rad
    not_judged: tuple[str, ...]  # what could not be judged, and why, in words

    def __str__(self) -> str:
        named = ((*_UNITS[kind], size) for kind, size in self.smallest.items())
        shown = (f"{name} above {_two_digits(size * factor)} {unit}" for name, unit, factor, size in named)
        return ", ".join(shown).replace(" °", "°")


def sensitivity(best: BestEstimate | NoEstimateError) -> Sensitivity:
    """What a best estimate could have shown; without one, nothing by a third sensor."""
    if isinstance(best, NoEstimateError):
        return Sensitivity({}, (f"what IMU and autopilot may have wrong together: {best.why}",))

    def usual(quantity: str, sigma: Array) -> float:
        return float(np.median(least_deviation(quantity, sigma)))

    smallest = {kind: best.detectable[kind] for kind in ("gyro_bias", "accel_bias") if kind in best.detectable}
    lacking, attitude = [], best.sigma(ATTITUDE)
    smallest["tilt"] = usual("tilt", attitude[:, :2].max(axis=1))
    if best.heading_from == "first guess":
        lacking.append("heading: no compass, and GPS does not tell it")
    else:
        smallest["heading"] = usual("heading", attitude[:, 2])
    if "gps_position" in best.residuals:
        smallest["position"] = usual("position", best.sigma(POSITION)[:, :2].max(axis=1))
    else:
        lacking.append("accelerometer bias, velocity and position: no GPS")
    if "gps_position" in best.detectable:
        smallest["gps"] = best.detectable["gps_position"]
    if "compass_field" in best.detectable:
        level = float(np.linalg.norm(best.states.constant("earth_field")[:2]))
        smallest["compass"] = float(np.arctan(best.detectable["compass_field"] / max(level, 1e-9)))
    for kind, (name, unit, factor) in _UNITS.items():
        if smallest.get(kind, 0.0) > (useless := harm.UNDETECTABLE[kind]):
            del smallest[kind]
            lacking.append(f"{name}: not even {useless * factor:.0f} {unit} would show".replace(" °", "°"))
    return Sensitivity(smallest, tuple(lacking))


def _two_digits(value: float) -> str:
    return f"{value:.{max(0, 1 - int(np.floor(np.log10(max(value, 1e-9)))))}f}"
