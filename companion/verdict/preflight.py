"""Whether a vehicle that stands is fit to fly: each sensor against its limit, the others, gravity and the field.

A line is no-go where its size is beyond the limit with 95 % probability, go where it is within with as much, and
cannot be told in between. Limits are what healthy vehicles stay within (`constants/healthy`) or what an estimator needs
(`constants/harm`); those of the autopilots' own pre-arm checks stand beside them, and are wider.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from statistics import NormalDist
from typing import Literal

import numpy as np

from companion.comparison import ImuSpec, block_means, in_the_air, length, power_at_rest, runs, unchanged, wrapped
from companion.constants import check, harm, healthy, num, priors
from companion.estimation import field_at
from companion.model import (
    STANDARD_GRAVITY,
    Array,
    BoolArray,
    CompassTrack,
    DataError,
    Flight,
    ImuTrack,
    median,
    percentile,
)
from companion.strapdown import quaternion
from companion.verdict.findings.readings import read_by

Outcome = Literal["go", "no_go", "unknown"]


@dataclass(frozen=True, slots=True)
class Check:
    """A size against its limit, SI."""

    name: str  # "gyro_bias", "compass_field", ...
    sensor: str  # the message or record
    size: float
    sigma: float
    limit: float
    unit: str  # "rad/s", "m/s²", "rad", "T", "m", ...; "" for none
    outcome: Outcome
    probability: float  # that the size is beyond the limit
    autopilot: str = ""  # the autopilot's own pre-arm check that it anticipates
    autopilot_limit: float | None = None
    note: str = ""
    uncorrected: float | None = None  # the size before what the estimator takes off; None: it takes nothing off

    @property
    def own(self) -> float:
        """The size that is the sensor's own, whatever is known of it: what ages."""
        return self.size if self.uncorrected is None else self.uncorrected


@dataclass(frozen=True, slots=True)
class Standing:
    """The stretch in which the vehicle stands."""

    start: float  # s, boot clock
    end: float
    motors_off: bool

    def covers(self, t: Array) -> BoolArray:
        """(N,) which times lie in it."""
        return np.asarray((t >= self.start) & (t <= self.end))


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """An IMU's readings while the vehicle stands: what a sensor ("gyro", "accel") reads, (N, 3), and its mean (3,)."""

    t: Array  # (N,) s
    readings: Mapping[str, Array]  # rad/s, m/s²
    mean: Mapping[str, Array]
    sigma: Mapping[str, Array]  # 1σ of the mean


@dataclass(frozen=True, slots=True)
class Preflight:
    """All checks of a vehicle that stands."""

    start_s: float  # boot clock, the stretch that was looked at
    end_s: float
    motors_off: bool  # whether the vehicle reports itself disarmed throughout
    checks: tuple[Check, ...]
    vehicle_reports: tuple[str, ...]  # what the vehicle itself reports against arming, in that time: untrusted
    missing: tuple[str, ...]  # what could not be checked, and why
    refuses: bool = False  # whether it still did so at the end, and was not armed

    @property
    def outcome(self) -> Outcome:
        """No-go if any line is; else cannot be told if any line cannot, or if the vehicle itself refuses to arm."""
        outcomes = {one.outcome for one in self.checks}
        if "no_go" in outcomes:
            return "no_go"
        return "unknown" if "unknown" in outcomes or not outcomes or self.refuses else "go"


def preflight(flight: Flight, spec_of: Callable[[str], ImuSpec]) -> Preflight:
    """Every check that the flight's beginning allows. Raises DataError where it does not stand for three seconds.

    spec_of: the noise specification of an IMU by its message.
    """
    tracks = [one for one in flight.each_imu(num.REST_READ_MIN_SAMPLES) if len(one) >= num.REST_READ_MIN_SAMPLES]
    standing = _standing(flight, tracks)
    means = {one.source: _means(one, standing) for one in tracks}
    known = {name: one for name, one in means.items() if one is not None}
    checks = [*_of_imus(flight, tracks, known, spec_of)]
    checks += compass_checks(flight, standing, next((one for name, one in known.items() if _feels(name, checks)), None))
    checks += [*barometer_checks(flight, standing), *gps_checks(flight, standing)]
    missing = [f"{name}: no IMU" for name in ("gyro", "accelerometer") if not known]
    missing += _unchecked(flight, standing, checks)
    against = ("prearm", "arm:", "preflight fail")
    said = [one for one in flight.texts if standing.start <= one.t <= standing.end]
    refusals = [one for one in said if one.text.lower().startswith(against)]
    armed = any(one.kind == "armed" and one.t > standing.start for one in flight.events)
    refuses = not armed and any(one.t > standing.end - check.PREARM_REPEATED_S for one in refusals)
    reports = tuple(dict.fromkeys(one.text for one in refusals))
    return Preflight(standing.start, standing.end, standing.motors_off, tuple(checks), reports, tuple(missing), refuses)


def _unchecked(flight: Flight, standing: Standing, checks: Sequence[Check]) -> Iterator[str]:
    """What could not be checked of the sensors beside the IMUs, or not to the end of the stretch, and why."""
    tracks = (("compass", flight.compasses), ("barometer", flight.barometers), ("GPS", flight.gps))
    for name, there in tracks:
        if not there:
            yield f"{name}: none in the log"
        for one in there:
            when = one.t[standing.covers(one.t)]
            made = (c for c in checks if c.name.startswith(name.lower()))
            if not len(when):
                yield f"{name} {one.source}: no readings while it stood"
            elif not any(one.source in c.sensor.split(", ") for c in made):
                yield f"{name} {one.source}: too little is known of it"
            elif (silent := standing.end - float(when[-1])) > harm.GPS_OUTAGE_S:
                yield f"{name} {one.source}: silent in the last {silent:.0f} s"


def _standing(flight: Flight, tracks: Sequence[ImuTrack]) -> Standing:
    """The last minute before arming, else before take-off, in which the quietest IMU does not move."""
    if not tracks:
        raise DataError(f"no IMU in the log to check ({flight.how_to_record}).")
    takeoff = min((part.start for part in in_the_air(flight)), default=flight.start + flight.duration)
    armed = min((e.t for e in flight.events if e.kind == "armed" and e.t <= takeoff), default=takeoff)
    for end, off in ((armed, True), (takeoff, False)):
        start = max(flight.start, end - check.PREFLIGHT_S)
        stretches = (_quiet(track, start, end) for track in tracks)
        first, last = max(stretches, key=lambda one: one[1] - one[0])
        if last - first >= check.REST_MIN_S:
            return Standing(first, last, motors_off=off and not _may_be_armed(flight, first, last))
    moves = f"the vehicle does not stand still for {check.REST_MIN_S:g} s before it takes off"
    remedy = "let it stand for 20 to 60 s while the log or the link is recorded"
    raise DataError(f"{moves}: {remedy} (ArduPilot logs before arming with LOG_DISARMED 1).")


def _may_be_armed(flight: Flight, start: float, end: float) -> bool:
    armed = flight.armed(np.array([start]), np.array([end - check.REST_BLOCK_S]))
    return armed is None or bool(armed[0])


def _quiet(track: ImuTrack, start: float, end: float) -> tuple[float, float]:
    """The longest stretch, s, in which an IMU neither shakes more than a bench does nor turns from second to second."""
    inside = (track.t >= start) & (track.t < end)
    block = ((track.t[inside] - start) / check.REST_BLOCK_S).astype(np.intp)
    if not len(block):
        return start, start
    still = np.bincount(block) >= 2
    for sensor, most, change in zip(_UNITS, healthy.REST_SPREAD, healthy.REST_CHANGE, strict=True):
        readings = read_by(track, sensor)[0][inside]
        mean = block_means(block, readings)
        still &= np.sqrt(np.maximum(block_means(block, readings**2) - mean**2, 0.0)).max(axis=1) < most
        still[1:] &= np.abs(np.diff(mean, axis=0)).max(axis=1) < change
    first, last = max(runs(np.asarray(still)), key=lambda run: run[1] - run[0], default=(0, -1))
    begin = start + float(first) * check.REST_BLOCK_S
    return begin, min(start + float(last + 1) * check.REST_BLOCK_S, end)


def _means(track: ImuTrack, standing: Standing) -> Measured | None:
    """What an IMU reads on average, with the 1σ of its slow wander by blocks and of its steps."""
    inside = standing.covers(track.t)
    if inside.sum() < num.REST_READ_MIN_SAMPLES:
        return None
    t, readings = track.t[inside], {sensor: read_by(track, sensor)[0][inside] for sensor in _UNITS}
    sigma = {sensor: _sigma(t, values, read_by(track, sensor)[1]) for sensor, values in readings.items()}
    return Measured(t, readings, {sensor: values.mean(axis=0) for sensor, values in readings.items()}, sigma)


_UNITS = {"gyro": "rad/s", "accel": "m/s²"}


def _sigma(t: Array, readings: Array, step: float) -> Array:
    """(3,) 1σ of a mean of readings (N, 3): of block means, which noise that lasts does not make smaller, and steps."""
    block = ((t - t[0]) / num.AVERAGED_S).astype(np.intp)
    means = block_means(block, readings)[np.bincount(block) > 0]
    scatter = means.std(axis=0) / math.sqrt(max(len(means) - 1, 1))
    return np.asarray(np.hypot(scatter, 0.5 * step))


_PREARM: Mapping[str, tuple[str, str]] = {
    "gyro_bias": ("Gyros not calibrated", "High Gyro Bias"),
    "accel_size": ("Accels not calibrated", "High Accelerometer Bias"),
    "accel_direction": ("Roll/Pitch inconsistent", "EKF attitude"),
    "gyro_difference": ("Gyros inconsistent", "COM_ARM_IMU_GYR"),
    "accel_difference": ("Accels inconsistent", "COM_ARM_IMU_ACC"),
    "compass_field": ("Check mag field", "Check mag field"),
    "compass_difference": ("Compasses inconsistent", "COM_ARM_MAG_ANG"),
    "compass_heading": ("heading inconsistent", "COM_ARM_EKF_YAW"),
    "barometer_wander": ("Altitude disparity", "height estimate error"),
    "gps_fix": ("need 3D fix", "GPS fix too low"),
    "gps_satellites": ("EKF: GPS numsats", "EKF2_REQ_NSATS"),
    "gps_horizontal_sigma": ("EKF: GPS accuracy", "EKF2_REQ_EPH"),
    "gps_vertical_sigma": ("EKF: GPS accuracy", "EKF2_REQ_EPV"),
    "gps_speed_sigma": ("EKF: GPS accuracy", "EKF2_REQ_SACC"),
}
"""Check → the autopilot's own pre-arm check that it anticipates: ArduPilot's, PX4's."""


def _judged(
    flight: Flight, name: str, sensor: str, size: float, sigma: float, limit: float, unit: str, note: str = ""
) -> Check:
    """No-go where a size is beyond its limit with 95 %, go where it is within with as much."""
    p = NormalDist().cdf((size - limit) / max(sigma, 1e-300))
    outcome: Outcome = "no_go" if p >= priors.ACCUSED else "go" if p <= 1.0 - priors.ACCUSED else "unknown"
    theirs = _PREARM[name][_px4(flight)] if name in _PREARM else ""
    beyond = _their_limit(flight, name, sensor, limit)
    return Check(name, sensor, size, sigma, limit, unit, outcome, p, theirs, beyond, note)


def _their_limit(flight: Flight, name: str, sensors: str, limit: float) -> float | None:
    """The autopilot's own limit: ArduPilot `AP_Arming.cpp`, PX4 `imuConsistencyCheck.cpp`; None where unknown."""
    sensor, _, what = name.partition("_")
    if what == "difference":
        usual = (check.PREARM_PX4 if _px4(flight) else check.PREARM_ARDUPILOT)[sensor]
        setting = _PREARM[name][1] if _px4(flight) else {"accel": "ARMING_ACCTHRESH"}.get(sensor, "")
        if setting == "COM_ARM_MAG_ANG" and setting in flight.parameters:  # °; below 0 PX4 does not check it
            return math.radians(flight.parameters[setting]) if flight.parameters[setting] >= 0.0 else None
        allowed = flight.parameters.get(setting, usual)
        beyond_two = any(flight.imus[one].instance > 1 for one in sensors.split(", ") if one in flight.imus)
        return allowed * (check.PREARM_THIRD_ACCEL if setting == "ARMING_ACCTHRESH" and beyond_two else 1.0)
    if name.endswith("_sigma"):
        if _px4(flight):
            return flight.parameters.get(_PREARM[name][1])
        ekf = "EK2" if flight.parameters.get("AHRS_EKF_TYPE") == 2 else "EK3"
        return limit * flight.parameters.get(f"{ekf}_CHECK_SCALE", check.PREARM_GPS_SCALE) / check.PREARM_GPS_SCALE
    return None


def _px4(flight: Flight) -> bool:
    return flight.vehicle.autopilot == "PX4"


def _of_imus(
    flight: Flight, tracks: Sequence[ImuTrack], means: Mapping[str, Measured], spec_of: Callable[[str], ImuSpec]
) -> Iterator[Check]:
    known = [(track, means[track.source]) for track in tracks if track.source in means]
    alone: list[Check] = []
    for track, own in known:
        alone += [*_gyro(flight, track, own, spec_of(track.source)), *_accelerometer(flight, track, own)]
    yield from _of_which_leans(alone)
    for (track, own), (other_track, other) in combinations(known, 2):
        for sensor, limit in (("gyro", healthy.USUAL_BIAS["gyro"]), ("accel", _accel_limit())):
            size = float(length(own.mean[sensor] - other.mean[sensor]))
            sigma = float(length(np.hypot(own.sigma[sensor], other.sigma[sensor])))
            pair, name = f"{track.source}, {other_track.source}", f"{sensor}_difference"
            yield _judged(flight, name, pair, size, sigma, limit * math.sqrt(2.0), _UNITS[sensor])


def _of_which_leans(checks: Sequence[Check]) -> Iterator[Check]:
    """The checks of every IMU alone; where one fits the estimate and another does not, neither is named by itself.

    The estimate follows one of them, and leans with it where that is the one at fault. Two that fit it outvote a third.
    """
    directions = [one for one in checks if one.name == "accel_direction"]
    fitting = [one for one in directions if one.outcome == "go"]
    for one in checks:
        if one.name == "accel_direction" and one.outcome == "no_go" and len(fitting) == 1:
            both = ", ".join(other.sensor for other in directions if other in (one, *fitting))
            yield replace(one, sensor=both, note="the estimate follows one of them: which one is off is not known")
        else:
            yield one


def _feels(source: str, checks: Sequence[Check]) -> bool:
    """Whether nothing of its own is no-go of an IMU's accelerometer: a compass is held against the gravity of it."""
    own = ("accel_frozen", "accel_size", "accel_direction")
    return not any(c.outcome == "no_go" and c.name in own and source in c.sensor.split(", ") for c in checks)


def _accel_limit() -> float:
    """m/s²: a bias as in calibrated parts together with a scale as in those."""
    return float(np.hypot(healthy.USUAL_BIAS["accel"], healthy.USUAL_SCALE * STANDARD_GRAVITY))


def _gyro(flight: Flight, track: ImuTrack, own: Measured, spec: ImuSpec) -> Iterator[Check]:
    """Bias less what the estimator has learned of it, how it drifts, noise of both sensors against the part."""
    source, usual, believed = track.source, healthy.USUAL_BIAS["gyro"], _believed(flight, track, own)
    bias, sigma = np.abs(own.mean["gyro"] - believed).max(), own.sigma["gyro"].max()
    made = _judged(flight, "gyro_bias", source, float(bias), float(sigma), usual, "rad/s")
    if believed.any():
        learned = f"the estimator takes {length(believed) * 1e3:.1f} mrad/s off already"
        made = replace(made, note=learned, uncorrected=float(np.abs(own.mean["gyro"]).max()))
    yield made
    if own.t[-1] - own.t[0] >= check.WARMING_TOLD_S:
        warms, sigma = (harm.WARMING_S * np.array(_slope(own.t, own.readings["gyro"]))).tolist()
        if num.SIGMAS * sigma < usual:  # else the stretch is too short
            yield _judged(flight, "gyro_warming", source, warms, sigma, usual, "rad/s")
    for sensor, readings in own.readings.items():
        _, step = read_by(track, sensor)
        same = np.asarray(unchanged(readings).all(axis=0) & (step == 0.0))
        if same.any():
            axes = " and ".join(name for name, stands in zip("xyz", same, strict=True) if stands)
            note = f"{'it' if same.all() else axes} reads the same"
            yield Check(f"{sensor}_frozen", source, 0.0, 0.0, 0.0, "", "no_go", 1.0, note=note)
            continue
        rate = (len(own.t) - 1) / (own.t[-1] - own.t[0])
        power = power_at_rest(readings, step, rate, num.REST_READ_MIN_SAMPLES)
        if power is not None and track.rate_hz >= num.NOISE_RATE_HZ:
            noise, limit = math.sqrt(power), healthy.NOISE_OVER_DATA_SHEET * getattr(spec, sensor).noise_density
            clusters = max((own.t[-1] - own.t[0]) / check.REST_CLUSTER_S, 1.0)
            known_to = noise * math.sqrt(0.75 / clusters)  # neighbouring differences have a cluster in common
            yield _judged(flight, f"{sensor}_noise", source, noise, known_to, limit, f"{_UNITS[sensor]}/√Hz")


def _believed(flight: Flight, track: ImuTrack, own: Measured) -> Array:
    """(3,) rad/s that an estimator takes off this gyro at the end of the stretch; zero where it is not known."""
    for one in () if track.bias_removed else flight.biases:
        known = (one.t <= own.t[-1]) & np.isfinite(one.gyro).all(axis=1)
        if one.imu_instance == track.instance and known.any():
            return np.asarray(one.gyro[known][-1])
    return np.zeros(3)


def _slope(t: Array, readings: Array) -> tuple[float, float]:
    """How fast a reading (N, 3) grows on its steepest axis, and the 1σ of it, a second: a line through block means."""
    block = ((t - t[0]) / num.AVERAGED_S).astype(np.intp)
    count = np.bincount(block)
    full = count >= max(1, int(np.median(count)) // 2)
    means = block_means(block, readings)[full]
    at = np.flatnonzero(full) * num.AVERAGED_S
    at = at - at.mean()
    slope = (at[:, None] * means).sum(axis=0) / (at**2).sum()
    left = means - means.mean(axis=0) - at[:, None] * slope
    sigma = np.sqrt((left**2).sum(axis=0) / max(len(at) - 2, 1) / (at**2).sum())
    axis = int(np.argmax(np.abs(slope)))
    return abs(float(slope[axis])), float(sigma[axis])


def _accelerometer(flight: Flight, track: ImuTrack, own: Measured) -> Iterator[Check]:
    """Size against gravity, direction against the autopilot's attitude."""
    mean, spread, attitude = own.mean["accel"], float(length(own.sigma["accel"])), flight.attitude
    size, sigma = float(length(mean)), float(np.hypot(spread, healthy.LOCAL_GRAVITY / num.SIGMAS))
    off, note = abs(size - STANDARD_GRAVITY), f"reads {size:.2f} m/s² at rest"
    yield _judged(flight, "accel_size", track.source, off, sigma, _accel_limit(), "m/s²", note)
    if not size or attitude is None or not (near := (attitude.t >= own.t[0]) & (attitude.t <= own.t[-1])).any():
        return
    down = quaternion.rotate(quaternion.conjugate(attitude.q_ned_frd[near]), np.tile([0.0, 0.0, -1.0], (near.sum(), 1)))
    newest = down[-max(1, len(down) // 4) :].mean(axis=0)
    angle, tilted = _angle(newest, mean), float(np.hypot(spread / max(size, 1.0), healthy.AP_MIN_SIGMA))
    yield _judged(flight, "accel_direction", track.source, angle, tilted, harm.AP_ERROR["tilt"], "rad")


def _angle(a: Array, b: Array) -> float:
    """Between two vectors (3,), rad."""
    return float(np.arccos(np.clip(a @ b / (length(a) * length(b)), -1.0, 1.0)))


def compass_checks(flight: Flight, standing: Standing, imu: Measured | None) -> Iterator[Check]:
    """Each compass: strength, inclination and heading against the world model, and each against the others.

    imu: whose gravity the inclination is against; None for no inclination.
    """
    iron = healthy.USUAL_IRON / num.MICROTESLA
    read = ((one, one.field[standing.covers(one.t) & np.isfinite(one.field).all(axis=1)]) for one in flight.compasses)
    fields = [(one, *_mean(field, standing)) for one, field in read if len(field) > 1]
    earth = field_at(flight.origin, flight.epoch)
    calibrated = [(one, field, sigma) for one, field, sigma in fields if one.calibrated]
    headings = [] if earth is None else [*_headings(flight, standing, calibrated, earth.ned)]
    for one, field, sigma in calibrated:
        if earth is None:
            break
        size, expected = float(length(field)), float(length(earth.ned))
        known_to, note = float(np.hypot(sigma, earth.sigma[0])), f"{size * 1e6:.1f} µT, {expected * 1e6:.1f} expected"
        yield _judged(flight, "compass_field", one.source, abs(size - expected), known_to, iron, "T", note)
        if imu is not None:  # against gravity as the accelerometer feels it
            down = -imu.mean["accel"] / length(imu.mean["accel"])
            dip = float(np.arcsin(np.clip(field @ down / length(field), -1.0, 1.0)))
            usual = float(np.arctan2(earth.ned[2], length(earth.ned[:2])))
            limit = float(np.arcsin(iron / max(size, iron)))
            note = f"{np.degrees(dip):.1f}°, {np.degrees(usual):.1f}° expected"
            off, anomaly = abs(dip - usual), healthy.FIELD_ANOMALY
            yield _judged(flight, "compass_inclination", one.source, off, anomaly, limit, "rad", note)
        yield from (made for made in headings if made.sensor == one.source)
    yield from (made for made in headings if made.sensor not in {one.source for one, *_ in fields})
    for (one, field, sigma), (other, other_field, other_sigma) in combinations(calibrated, 2):
        least = min(float(length(field)), float(length(other_field)))
        limit = 2.0 * float(np.arcsin(min(iron / max(least, 1e-12), 1.0)))
        known_to = float(np.hypot(sigma / length(field), other_sigma / length(other_field)))
        pair, angle = f"{one.source}, {other.source}", _angle(field, other_field)
        yield _judged(flight, "compass_difference", pair, angle, known_to, limit, "rad")


def _mean(field: Array, standing: Standing) -> tuple[Array, float]:
    """Mean of fields (N, 3) and the 1σ of it, T: of readings that follow one another, noise may last for seconds."""
    return field.mean(axis=0), float(length(field.std(axis=0)) / np.sqrt(max(standing.end - standing.start, 1.0)))


def _headings(
    flight: Flight, standing: Standing, fields: Sequence[tuple[CompassTrack, Array, float]], earth: Array
) -> Iterator[Check]:
    """Each compass against the autopilot's heading; or, where more than half of three or more agree against that, both
    against theirs: the autopilot then follows the one that is wrong."""
    attitude = flight.attitude
    if attitude is None or not fields or not (near := standing.covers(attitude.t)).any():
        return
    q = attitude.q_ned_frd[near][-1]
    ned = quaternion.rotate(np.broadcast_to(q, (len(fields), 4)), np.array([field for _, field, _ in fields]))
    turns = wrapped(np.arctan2(ned[:, 1], ned[:, 0]) - np.arctan2(earth[1], earth[0]))
    limit = float(np.arcsin(min(healthy.USUAL_IRON / num.MICROTESLA / max(float(length(earth[:2])), 1e-9), 1.0)))
    limit = min(limit, harm.COMPASS_HEADING_RAD)
    alike = np.abs(wrapped(turns[:, None] - turns)) < limit
    most = int(np.argmax(alike.sum(axis=1)))
    sources = [one.source for one, *_ in fields]
    if len(fields) > 2 and 2 * alike[most].sum() > len(fields) and abs(turns[most]) > limit:
        sources, turns = [*sources, attitude.source], wrapped(np.append(turns, 0.0) - turns[most])
    for source, turn in zip(sources, np.abs(turns).tolist(), strict=True):
        yield _judged(flight, "compass_heading", source, turn, healthy.MAGNETIC_HEADING_RAD, limit, "rad")


def barometer_checks(flight: Flight, standing: Standing) -> Iterator[Check]:
    """How far each wanders, and whether it is as warm as it is made for."""
    low, high = healthy.BAROMETER_DEGC
    for one in flight.barometers:
        inside = standing.covers(one.t) & np.isfinite(one.altitude)
        if inside.sum() < num.REST_READ_MIN_SAMPLES:
            continue
        parts, celsius = np.array_split(one.altitude[inside], 4), one.temperature[inside]
        wander, sigma = float(np.ptp([part.mean() for part in parts])), float(parts[0].std() / np.sqrt(len(parts[0])))
        limit = healthy.AP_SIGMA["height"]
        yield _judged(flight, "barometer_wander", one.source, wander, max(sigma, 1e-3), limit, "m")
        if np.isfinite(celsius).any():
            middle, note = float(np.nanmedian(celsius)), f" °C, made for {low:.0f} to {high:.0f}"
            beyond, limit = abs(middle - 0.5 * (low + high)), 0.5 * (high - low)
            yield _judged(flight, "barometer_temperature", one.source, beyond, 1.0, limit, "°C", f"{middle:.0f}{note}")


def gps_checks(flight: Flight, standing: Standing) -> Iterator[Check]:
    """Each receiver: satellites, its own accuracies, a speed that is none, how far the position wanders."""
    for one in flight.gps:
        inside = standing.covers(one.t)
        newest = np.flatnonzero(inside)[-max(1, int(inside.sum()) // 4) :]
        if not len(newest):
            continue
        fix = float(np.median(one.fix_type[newest]))
        yield _judged(flight, "gps_fix", one.source, check.FIX_3D - fix, 0.1, 0.5, "", f"fix type {fix:.0f}")
        if np.isfinite(one.satellites[newest]).any():
            seen = float(np.nanmedian(one.satellites[newest]))
            lacking, note = harm.GPS_SATELLITES - seen, f"{seen:.0f} satellites, {harm.GPS_SATELLITES} needed"
            yield _judged(flight, "gps_satellites", one.source, lacking, 0.1, 0.5, "", note)
        for name, limit in harm.GPS_POOR.items():
            values = getattr(one, name)[newest]
            if np.isfinite(values).any():
                size, unit = float(np.nanmedian(values)), "m/s" if name.startswith("speed") else "m"
                yield _judged(flight, f"gps_{name}", one.source, size, 0.05 * limit, limit, unit)
        fixed = newest[one.fix_type[newest] >= check.FIX_3D]
        speed = length(one.velocity[fixed, :2])
        if np.isfinite(speed).any():
            sigma = float(np.nanmedian(one.speed_sigma[fixed])) if np.isfinite(one.speed_sigma[fixed]).any() else 0.1
            moves, note = float(np.nanmedian(speed)), "while it stands"
            yield _judged(flight, "gps_speed", one.source, moves, min(sigma, 0.1), healthy.REST_MPS, "m/s", note)


@dataclass(frozen=True, slots=True)
class Ageing:
    """A check against the same vehicle's own earlier ones."""

    check: Check
    before: float  # median of the earlier ones: of the sensor's own, not less what an estimator takes off
    spread: float  # 1σ of those about it, of one
    times: int
    changed: bool  # whether it differs by more than 3 σ of both


def ageing(now: Preflight, before: Sequence[Sequence[Check]]) -> tuple[Ageing, ...]:
    """Each check that was made before three flights or more, beside what it was then."""
    made = []
    for one in now.checks:
        earlier = np.array([c.own for checks in before for c in checks if (c.name, c.sensor) == (one.name, one.sensor)])
        if len(earlier) < num.MIN_WINDOWS:
            continue
        middle = median(earlier)
        low, high = (percentile(earlier, share) for share in (25.0, 75.0))
        spread = max((high - low) / num.QUARTILES_SIGMA, one.sigma)
        changed = abs(one.own - middle) > num.SIGMAS * float(np.hypot(spread, one.sigma))
        made.append(Ageing(one, middle, spread, len(earlier), changed))
    return tuple(made)
