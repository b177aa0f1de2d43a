"""Whether a vehicle that stands is fit to fly: each sensor against its limit, the others, gravity and the field.

A line is no-go where its size is beyond the limit with 95 % probability, go where it is within with as much, and
cannot be told in between. Limits are what healthy vehicles stay within (`constants/healthy`) or what an estimator needs
(`constants/harm`); those of the autopilots' own pre-arm checks stand beside them, and are wider.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.analysis.alignment import power_at_rest
from companion.analysis.finding import runs
from companion.analysis.findings.stuck import unchanged
from companion.analysis.imu_spec import ImuSpec
from companion.analysis.phases import in_the_air
from companion.analysis.preflight_aiding import (
    Check,
    Measured,
    Outcome,
    Standing,
    barometer_checks,
    compass_checks,
    gps_checks,
    judged,
)
from companion.analysis.reference import length
from companion.constants import check, harm, healthy, num
from companion.model import STANDARD_GRAVITY, Array, DataError, Flight, ImuTrack, median, percentile
from companion.strapdown import quaternion


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
    checks += compass_checks(flight, standing, known.get(tracks[0].source))
    checks += barometer_checks(flight, standing)
    checks += gps_checks(flight, standing)
    missing = [f"{name}: no IMU" for name in ("gyro", "accelerometer") if not known]
    missing += [
        f"{name}: none in the log"
        for name, there in (("compass", flight.compasses), ("barometer", flight.barometers), ("GPS", flight.gps))
        if not there
    ]
    against = ("prearm", "arm:", "preflight fail")
    said = [one for one in flight.texts if standing.start <= one.t <= standing.end]
    refusals = [one for one in said if one.text.lower().startswith(against)]
    armed = any(one.kind == "armed" and one.t > standing.start for one in flight.events)
    refuses = not armed and any(one.t > standing.end - check.PREARM_REPEATED_S for one in refusals)
    reports = tuple(dict.fromkeys(one.text for one in refusals))
    return Preflight(standing.start, standing.end, standing.motors_off, tuple(checks), reports, tuple(missing), refuses)


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
    raise DataError(
        f"the vehicle does not stand still for {check.REST_MIN_S:g} s before it takes off: let it stand for 20 to 60 s "
        "while the log or the link is recorded (ArduPilot logs before arming with LOG_DISARMED 1)."
    )


def _may_be_armed(flight: Flight, start: float, end: float) -> bool:
    armed = flight.armed(np.array([start]), np.array([end - check.REST_BLOCK_S]))
    if armed is None:  # no change: the first heartbeat would have told of an armed vehicle
        return "HEARTBEAT" not in flight.messages
    return bool(armed[0])


def _quiet(track: ImuTrack, start: float, end: float) -> tuple[float, float]:
    """The longest stretch, s, in which an IMU neither shakes more than a bench does nor turns from second to second."""
    inside = (track.t >= start) & (track.t < end)
    block = ((track.t[inside] - start) / check.REST_BLOCK_S).astype(np.intp)
    if not len(block):
        return start, start
    count = np.bincount(block).astype(np.float64)
    still = count >= 2
    for readings, most, change in zip(
        (track.gyro[inside], track.accel[inside]), healthy.REST_SPREAD, healthy.REST_CHANGE, strict=True
    ):
        sums = np.column_stack([np.bincount(block, column) for column in readings.T])
        squares = np.column_stack([np.bincount(block, column**2) for column in readings.T])
        mean = sums / np.maximum(count, 1.0)[:, None]
        spread = np.sqrt(np.maximum(squares / np.maximum(count, 1.0)[:, None] - mean**2, 0.0)).max(axis=1)
        still &= spread < most
        still[1:] &= np.abs(np.diff(mean, axis=0)).max(axis=1) < change
    first, last = max(runs(np.asarray(still)), key=lambda run: run[1] - run[0], default=(0, -1))
    begin = start + float(first) * check.REST_BLOCK_S
    return begin, min(start + float(last + 1) * check.REST_BLOCK_S, end)


def _means(track: ImuTrack, standing: Standing) -> Measured | None:
    """What an IMU reads on average, with the 1σ of its slow wander by blocks and of its steps."""
    inside = standing.covers(track.t)
    if inside.sum() < num.REST_READ_MIN_SAMPLES:
        return None
    t, gyro, accel = track.t[inside], track.gyro[inside], track.accel[inside]
    return Measured(
        t, gyro, accel, gyro.mean(axis=0), _sigma(t, gyro, track.gyro_step),
        accel.mean(axis=0), _sigma(t, accel, track.accel_step),
    )  # fmt: skip


def _sigma(t: Array, readings: Array, step: float) -> Array:
    """(3,) 1σ of a mean of readings (N, 3): of block means, which noise that lasts does not make smaller, and steps."""
    block = ((t - t[0]) / num.AVERAGED_S).astype(np.intp)
    count = np.maximum(np.bincount(block), 1)
    means = np.column_stack([np.bincount(block, column) for column in readings.T]) / count[:, None]
    scatter = means[np.bincount(block) > 0].std(axis=0) / math.sqrt(max(len(means) - 1, 1))
    return np.asarray(np.hypot(scatter, 0.5 * step))


def _of_imus(
    flight: Flight, tracks: Sequence[ImuTrack], means: dict[str, Measured], spec_of: Callable[[str], ImuSpec]
) -> Iterator[Check]:
    alone: list[Check] = []
    for track in tracks:
        if (own := means.get(track.source)) is not None:
            alone += [*_gyro(flight, track, own, spec_of(track.source)), *_accelerometer(flight, track, own)]
    yield from _of_which_leans(alone)
    known = [(track, means[track.source]) for track in tracks if track.source in means]
    for i, (track, own) in enumerate(known):
        for other_track, other in known[i + 1 :]:
            pair = f"{track.source}, {other_track.source}"
            for sensor, limit in (("gyro", healthy.USUAL_BIAS["gyro"]), ("accel", _accel_limit())):
                apart = getattr(own, f"{sensor}_mean") - getattr(other, f"{sensor}_mean")
                sigma = np.hypot(getattr(own, f"{sensor}_sigma"), getattr(other, f"{sensor}_sigma"))
                unit = "rad/s" if sensor == "gyro" else "m/s²"
                text, theirs = _consistency(flight, sensor)
                size, known_to = float(length(apart)), float(length(sigma))
                made = judged(f"{sensor}_difference", pair, size, known_to, limit * math.sqrt(2.0), unit)
                yield replace(made, autopilot=text, autopilot_limit=theirs)


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


def _accel_limit() -> float:
    """m/s²: a bias as in calibrated parts together with a scale as in those."""
    return float(np.hypot(healthy.USUAL_BIAS["accel"], healthy.USUAL_SCALE * STANDARD_GRAVITY))


def _gyro(flight: Flight, track: ImuTrack, own: Measured, spec: ImuSpec) -> Iterator[Check]:
    """Bias less what the estimator has learned of it, how it drifts, noise against the part."""
    believed = _believed(flight, track, own)
    bias = own.gyro_mean - believed
    made = judged(
        "gyro_bias", track.source, float(np.abs(bias).max()), float(own.gyro_sigma.max()), healthy.USUAL_BIAS["gyro"],
        "rad/s",
    )  # fmt: skip
    if believed.any():
        learned = f"the estimator takes {length(believed) * 1e3:.1f} mrad/s off already"
        made = replace(made, note=learned, uncorrected=float(np.abs(own.gyro_mean).max()))
    yield replace(made, autopilot="Gyros not calibrated" if _ardupilot(flight) else "High Gyro Bias")
    if own.t[-1] - own.t[0] >= check.WARMING_TOLD_S:
        slope, sigma = _slope(own.t, own.gyro)
        within = harm.WARMING_S * np.array([slope, sigma])
        limit = healthy.USUAL_BIAS["gyro"]
        if num.SIGMAS * within[1] < limit:  # else the stretch is too short
            yield judged("gyro_warming", track.source, float(within[0]), float(within[1]), limit, "rad/s")
    for sensor, readings in (("gyro", own.gyro), ("accel", own.accel)):
        step = getattr(track, f"{sensor}_step")
        same = unchanged(readings).all(axis=0) & (step == 0.0)
        if same.any():
            axes = " and ".join(name for name, stands in zip("xyz", same, strict=True) if stands)
            note = f"{'it' if same.all() else axes} reads the same"
            yield Check(f"{sensor}_frozen", track.source, 0.0, 0.0, 0.0, "", "no_go", 1.0, note=note)
            continue
        rate = (len(own.t) - 1) / (own.t[-1] - own.t[0])
        power = power_at_rest(readings, step, rate, num.REST_READ_MIN_SAMPLES)
        if power is not None and track.rate_hz >= num.NOISE_RATE_HZ:
            noise, limit = math.sqrt(power), healthy.NOISE_OVER_DATA_SHEET * getattr(spec, sensor).noise_density
            unit = "rad/s/√Hz" if sensor == "gyro" else "m/s²/√Hz"
            yield judged(f"{sensor}_noise", track.source, noise, noise / math.sqrt(2.0 * len(readings)), limit, unit)


def _believed(flight: Flight, track: ImuTrack, own: Measured) -> Array:
    """(3,) rad/s that an estimator takes off this gyro at the end of the stretch; zero where it is not known."""
    if track.bias_removed:
        return np.zeros(3)
    for one in flight.biases:
        known = (one.t <= own.t[-1]) & np.isfinite(one.gyro).all(axis=1)
        if one.imu_instance == track.instance and known.any():
            return np.asarray(one.gyro[known][-1])
    return np.zeros(3)


def _slope(t: Array, readings: Array) -> tuple[float, float]:
    """How fast a reading (N, 3) grows on its steepest axis, and the 1σ of it, a second: a line through block means."""
    block = ((t - t[0]) / num.AVERAGED_S).astype(np.intp)
    count = np.bincount(block)
    full = count >= max(1, int(np.median(count)) // 2)
    means = np.column_stack([np.bincount(block, column) for column in readings.T])[full] / count[full, None]
    at = np.flatnonzero(full) * num.AVERAGED_S
    at = at - at.mean()
    slope = (at[:, None] * means).sum(axis=0) / (at**2).sum()
    left = means - means.mean(axis=0) - at[:, None] * slope
    sigma = np.sqrt((left**2).sum(axis=0) / max(len(at) - 2, 1) / (at**2).sum())
    axis = int(np.argmax(np.abs(slope)))
    return abs(float(slope[axis])), float(sigma[axis])


def _accelerometer(flight: Flight, track: ImuTrack, own: Measured) -> Iterator[Check]:
    """Size against gravity, direction against the autopilot's attitude."""
    size = float(length(own.accel_mean))
    sigma = float(np.hypot(length(own.accel_sigma), healthy.LOCAL_GRAVITY / num.SIGMAS))
    text = "Accels not calibrated" if _ardupilot(flight) else "High Accelerometer Bias"
    made = judged("accel_size", track.source, abs(size - STANDARD_GRAVITY), sigma, _accel_limit(), "m/s²")
    yield replace(made, autopilot=text, note=f"reads {size:.2f} m/s² at rest")
    attitude = flight.attitude
    if attitude is None or not (near := (attitude.t >= own.t[0]) & (attitude.t <= own.t[-1])).any():
        return
    down = quaternion.rotate(quaternion.conjugate(attitude.q_ned_frd[near]), np.tile([0.0, 0.0, -1.0], (near.sum(), 1)))
    newest = down[-max(1, len(down) // 4) :].mean(axis=0)
    angle = float(np.arccos(np.clip(newest @ own.accel_mean / (length(newest) * size), -1.0, 1.0)))
    tilted = float(length(own.accel_sigma)) / max(size, 1.0)
    made = judged("accel_direction", track.source, angle, float(np.hypot(tilted, healthy.AP_MIN_SIGMA)),
                  harm.AP_ERROR["tilt"], "rad")  # fmt: skip
    yield replace(made, autopilot="Roll/Pitch inconsistent" if _ardupilot(flight) else "EKF attitude")


def _consistency(flight: Flight, sensor: str) -> tuple[str, float]:
    """The autopilot's own check of two IMUs and its limit: ArduPilot `AP_Arming.cpp`, PX4 `imuConsistencyCheck.cpp`."""
    if _ardupilot(flight):
        if sensor == "gyro":
            return "Gyros inconsistent", check.PREARM_ARDUPILOT["gyro"]
        return "Accels inconsistent", flight.parameters.get("ARMING_ACCTHRESH", check.PREARM_ARDUPILOT["accel"])
    name = "COM_ARM_IMU_GYR" if sensor == "gyro" else "COM_ARM_IMU_ACC"
    return name, flight.parameters.get(name, check.PREARM_PX4[sensor])


def _ardupilot(flight: Flight) -> bool:
    return flight.vehicle.autopilot == "ARDUPILOTMEGA"


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
