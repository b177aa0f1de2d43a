"""What is known of the autopilot's own estimate: how far it was off, and the biases that it takes off the readings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from companion.analysis.fault_interval import BIAS_UNITS, SENSORS
from companion.analysis.finding import Finding
from companion.analysis.reference import Limits, attitude_error, length, reference_at
from companion.constants import harm, healthy, num
from companion.estimation import ATTITUDE, POSITION, VELOCITY, BestEstimate
from companion.model import Array, Flight, ImuTrack, interpolated
from companion.strapdown import preintegrate


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
    sums = [np.bincount(block[slow], (gyro - rates)[slow, axis], minlength=len(count))[full] for axis in range(3)]
    means = np.column_stack(sums) / count[full, None]
    newest = means[-max(num.AP_BIAS_MIN_BLOCKS, round(num.AP_BIAS_NEWEST * len(means))) :]
    used = full[-len(newest) :]
    middle = np.median(newest, axis=0)
    scatter = 1.4826 * np.median(np.abs(newest - middle), axis=0)
    return AutopilotBias(
        gyro=middle,
        sigma=np.hypot(scatter, 0.5 * track.gyro_step),
        start_s=float(t[0] + used[0] * num.AVERAGED_S),
        end_s=float(min(t[0] + (used[-1] + 1) * num.AVERAGED_S, t[-1])),
    )


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


def autopilot_error(
    flight: Flight,
    best: BestEstimate,
    limits: Limits = Limits(),  # noqa: B008  (frozen)
) -> tuple[AutopilotError, ...]:
    """The autopilot's estimate less the best estimate, at the keyframes at which the autopilot tells its state.

    Velocity and position need a GPS. Positions are compared from where both begin: their zeros need not be one place.
    Empty where the flight has no estimate of the autopilot's.
    """
    if flight.attitude is None or len(flight.attitude) < 2:
        return ()
    reference = reference_at(flight.attitude, flight.position, best.t, limits)
    turned = attitude_error(reference.q_ned_frd, best.q_ned_frd)
    between = reference.interpolation_error(np.arange(len(best.t)), preintegrate(best.imu))
    attitude = np.hypot(best.sigma(ATTITUDE), between.attitude[:, None])
    velocity = np.hypot(best.sigma(VELOCITY), between.velocity[:, None])
    position = np.hypot(best.sigma(POSITION), between.position[:, None])
    tilt, heading = attitude[:, :2], attitude[:, 2:]
    rows = [
        ("tilt", "rad", length(turned[:, :2]), tilt, reference.attitude_known),
        ("heading", "rad", np.abs(turned[:, 2]), heading, reference.attitude_known),
    ]
    known = reference.position_known
    if "gps_position" in best.residuals and known.any():
        moved = reference.position - best.position
        begin = np.flatnonzero(known)[: max(5, int(num.POSITION_ORIGIN_SHARE * known.sum()))]
        rows.append(("velocity", "m/s", length(reference.velocity - best.velocity), velocity, known))
        rows.append(("position", "m", length(moved - np.median(moved[begin], axis=0)), position, known))
    return tuple(
        _summary(name, unit, best.t[known], size[known], length(sigma[known]))
        for name, unit, size, sigma, known in rows
        if known.any()
    )


def _summary(name: str, unit: str, t: Array, size: Array, sigma: Array) -> AutopilotError:
    worst = int(np.argmax(size))
    return AutopilotError(
        quantity=name,
        unit=unit,
        samples=len(size),
        median=float(np.median(size)),
        p95=float(np.percentile(size, 95.0)),
        worst=float(size[worst]),
        worst_s=float(t[worst]),
        sigma=float(sigma[worst]),
        typical_sigma=float(np.median(sigma)),
    )


def known_biases(flight: Flight, best: BestEstimate) -> Iterator[Finding]:
    """Where the best estimate and an estimator of the vehicle find the same large bias in the IMU that was judged."""
    own = [b for b in flight.biases if b.imu_instance == best.imu.instance and len(b)]
    if not own:
        return
    held = own[0]
    begin, end = float(best.t[0]), float(best.t[-1])
    since = end - num.AP_BIAS_NEWEST * (end - begin)
    late, newest = held.t >= since, best.t >= since
    for sensor, large in harm.AP_BIAS.items():
        values: Array = getattr(held, sensor)[late]
        estimate: Array = getattr(best.states, f"{sensor}_bias")[newest]
        if not len(values) or not np.isfinite(values).all():
            continue
        theirs, ours = np.median(values, axis=0), np.median(estimate, axis=0)
        sigma = np.hypot(
            np.nan_to_num(np.median(getattr(held, f"{sensor}_sigma")[late], axis=0)),
            np.median(getattr(best, f"{sensor}_bias_sigma")[newest], axis=0),
        )
        sigma = np.maximum(sigma, healthy.AP_BIAS_MIN_SIGMA[sensor])
        if float(length(ours)) < large or (np.abs(ours - theirs) > num.SIGMAS * sigma).any():
            continue
        axis = int(np.argmax(np.abs(ours)))
        if abs(theirs[axis]) < 0.5 * abs(ours[axis]):
            continue  # it does not know it: it is only unsure
        name, (unit, factor, decimals) = SENSORS[sensor], BIAS_UNITS[sensor]
        reads, takes = (f"{v[axis] * factor:.{decimals}f}" for v in (ours, theirs))
        yield Finding(
            f"{sensor}_bias_known",
            "data",
            "info",
            begin,
            end,
            f"{name} {'xyz'[axis]} bias {reads} {unit}; the autopilot's estimator takes {takes} off ({held.source})",
            "No fault: the estimator knows it and removes it. A calibration at rest would spare it the work.",
        )
