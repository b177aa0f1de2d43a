"""The preflight checks of compass, barometer and GPS while the vehicle stands; and what one check is.

A check is one line: a size with its σ against a limit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from statistics import NormalDist
from typing import Literal

import numpy as np
import numpy.typing as npt

from companion.analysis.reference import BoolArray, IntArray, length, wrapped
from companion.constants import check, harm, healthy, num, priors
from companion.estimation import field_at
from companion.model import Array, BarometerTrack, CompassTrack, Flight, GpsTrack
from companion.strapdown import quaternion

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

    def covers(self, t: Array) -> npt.NDArray[np.bool_]:
        """(N,) which times lie in it."""
        return np.asarray((t >= self.start) & (t <= self.end))


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """An IMU's readings while the vehicle stands, and their means (3,) with 1σ."""

    t: Array  # (N,) s
    gyro: Array  # (N, 3) rad/s
    accel: Array  # (N, 3) m/s²
    gyro_mean: Array
    gyro_sigma: Array
    accel_mean: Array
    accel_sigma: Array


def judged(name: str, sensor: str, size: float, sigma: float, limit: float, unit: str) -> Check:
    """No-go where a size is beyond its limit with 95 %, go where it is within with as much."""
    z = (size - limit) / max(sigma, 1e-300)
    p = NormalDist().cdf(z)
    outcome: Outcome = "unknown"
    if p >= priors.ACCUSED:
        outcome = "no_go"
    elif p <= 1.0 - priors.ACCUSED:
        outcome = "go"
    return Check(name, sensor, size, sigma, limit, unit, outcome, p)


def compass_checks(flight: Flight, standing: Standing, imu: Measured | None) -> Iterator[Check]:
    """Each compass: strength, inclination and heading against the world model, and each against the others."""
    iron = healthy.USUAL_IRON / num.MICROTESLA
    fields = [(one, *_mean(one, standing)) for one in flight.compasses if standing.covers(one.t).sum() >= 2]
    earth = field_at(flight.origin, flight.epoch)
    calibrated = [(one, field) for one, field, _ in fields if one.calibrated]
    headings = [] if earth is None else [*_headings(flight, standing, calibrated, earth.ned)]
    for one, field, sigma in fields:
        size = float(length(field))
        if one.calibrated and earth is not None:
            expected, anomaly = float(length(earth.ned)), float(earth.sigma[0])
            made = judged("compass_field", one.source, abs(size - expected), float(np.hypot(sigma, anomaly)), iron, "T")
            yield replace(made, autopilot="Check mag field", note=f"{size * 1e6:.1f} µT, {expected * 1e6:.1f} expected")
            yield from _inclination(imu, one, field, earth.ned)
            yield from (made for made in headings if made.sensor == one.source)
    yield from (made for made in headings if made.sensor not in {one.source for one, *_ in fields})
    for (one, field, sigma), (other, other_field, other_sigma) in combinations(fields, 2):
        if one.calibrated and other.calibrated:
            angle = _between(field, other_field)
            least = min(float(length(field)), float(length(other_field)))
            limit = 2.0 * float(np.arcsin(min(iron / max(least, 1e-12), 1.0)))
            known = float(np.hypot(sigma / length(field), other_sigma / length(other_field)))
            made = judged("compass_difference", f"{one.source}, {other.source}", angle, known, limit, "rad")
            yield replace(made, autopilot="Compasses inconsistent", autopilot_limit=_COMPASSES[_px4(flight)])


_COMPASSES = (check.PREARM_ARDUPILOT["compass"], check.PREARM_PX4["compass"])


def _px4(flight: Flight) -> bool:
    return flight.vehicle.autopilot == "PX4"


def _mean(one: CompassTrack, standing: Standing) -> tuple[Array, float]:
    """Mean field (3,) and the 1σ of it, T: of readings that follow one another, noise may last for seconds."""
    field = one.field[standing.covers(one.t)]
    return field.mean(axis=0), float(length(field.std(axis=0)) / np.sqrt(max(standing.end - standing.start, 1.0)))


def _inclination(imu: Measured | None, one: CompassTrack, field: Array, earth: Array) -> Iterator[Check]:
    """Against gravity as the accelerometer feels it."""
    if imu is None:
        return
    size = max(float(length(field)), healthy.USUAL_IRON / num.MICROTESLA)
    down = -imu.accel_mean / length(imu.accel_mean)
    dip = float(np.arcsin(np.clip(field @ down / length(field), -1.0, 1.0)))
    expected = float(np.arctan2(earth[2], length(earth[:2])))
    limit = float(np.arcsin(healthy.USUAL_IRON / num.MICROTESLA / size))
    made = judged("compass_inclination", one.source, abs(dip - expected), healthy.FIELD_ANOMALY, limit, "rad")
    yield replace(made, note=f"{np.degrees(dip):.1f}°, {np.degrees(expected):.1f}° expected")


def _headings(
    flight: Flight, standing: Standing, fields: Sequence[tuple[CompassTrack, Array]], earth: Array
) -> Iterator[Check]:
    """Each compass against the autopilot's heading; or, where more than half of three or more agree against that, both
    against theirs: the autopilot then follows the one that is wrong."""
    attitude = flight.attitude
    if attitude is None or not fields or not (near := standing.covers(attitude.t)).any():
        return
    q = attitude.q_ned_frd[near][-1]
    ned = quaternion.rotate(np.broadcast_to(q, (len(fields), 4)), np.array([field for _, field in fields]))
    turns = wrapped(np.arctan2(ned[:, 1], ned[:, 0]) - np.arctan2(earth[1], earth[0]))
    limit = float(np.arcsin(min(healthy.USUAL_IRON / num.MICROTESLA / max(float(length(earth[:2])), 1e-9), 1.0)))
    limit = min(limit, harm.COMPASS_HEADING_RAD)
    alike = np.abs(wrapped(turns[:, None] - turns)) < limit
    most = int(np.argmax(alike.sum(axis=1)))
    sources = [one.source for one, _ in fields]
    if len(fields) > 2 and 2 * alike[most].sum() > len(fields) and abs(turns[most]) > limit:
        sources, turns = [*sources, attitude.source], wrapped(np.append(turns, 0.0) - turns[most])
    for source, turn in zip(sources, np.abs(turns).tolist(), strict=True):
        made = judged("compass_heading", source, turn, healthy.MAGNETIC_HEADING_RAD, limit, "rad")
        yield replace(made, autopilot="heading inconsistent" if not _px4(flight) else "COM_ARM_EKF_YAW")


def _between(a: Array, b: Array) -> float:
    return float(np.arccos(np.clip(a @ b / (length(a) * length(b)), -1.0, 1.0)))


def barometer_checks(flight: Flight, standing: Standing) -> Iterator[Check]:
    """How far each wanders, and whether it is as warm as it is made for."""
    for one in flight.barometers:
        inside = standing.covers(one.t) & np.isfinite(one.altitude)
        if inside.sum() < num.REST_READ_MIN_SAMPLES:
            continue
        altitude, t = one.altitude[inside], one.t[inside]
        parts = np.array_split(np.arange(len(t)), 4)
        means = np.array([altitude[part].mean() for part in parts])
        sigma = float(altitude[parts[0]].std() / np.sqrt(max(len(parts[0]), 1)))
        limit = healthy.AP_SIGMA["height"]
        made = judged("barometer_wander", one.source, float(np.ptp(means)), max(sigma, 1e-3), limit, "m")
        yield replace(made, autopilot="Altitude disparity" if not _px4(flight) else "height estimate error")
        yield from _temperature(one, inside)


def _temperature(one: BarometerTrack, inside: BoolArray) -> Iterator[Check]:
    celsius = one.temperature[inside]
    if np.isfinite(celsius).any():
        low, high = healthy.BAROMETER_DEGC
        middle = float(np.nanmedian(celsius))
        beyond = abs(middle - 0.5 * (low + high))
        made = judged("barometer_temperature", one.source, beyond, 1.0, 0.5 * (high - low), "°C")
        yield replace(made, note=f"{middle:.0f} °C, made for {low:.0f} to {high:.0f}")


def gps_checks(flight: Flight, standing: Standing) -> Iterator[Check]:
    """Each receiver: satellites, its own accuracies, a speed that is none, how far the position wanders."""
    for one in flight.gps:
        inside = standing.covers(one.t)
        newest = np.flatnonzero(inside)[-max(1, int(inside.sum()) // 4) :]
        if not len(newest):
            continue
        yield from _receiver(flight, one, newest)
        fixed = newest[one.fix_type[newest] >= check.FIX_3D]
        speed = length(one.velocity[fixed, :2])
        if np.isfinite(speed).any():
            sigma = float(np.nanmedian(one.speed_sigma[fixed])) if np.isfinite(one.speed_sigma[fixed]).any() else 0.1
            made = judged("gps_speed", one.source, float(np.nanmedian(speed)), min(sigma, 0.1), healthy.REST_MPS, "m/s")
            yield replace(made, note="while it stands")


_REQUIRED = {"horizontal_sigma": "EKF2_REQ_EPH", "vertical_sigma": "EKF2_REQ_EPV", "speed_sigma": "EKF2_REQ_SACC"}


def _receiver(flight: Flight, one: GpsTrack, newest: IntArray) -> Iterator[Check]:
    fix = float(np.median(one.fix_type[newest]))
    text = "need 3D fix" if not _px4(flight) else "GPS fix too low"
    yield replace(judged("gps_fix", one.source, check.FIX_3D - fix, 0.1, 0.5, ""), autopilot=text,
                  note=f"fix type {fix:.0f}")  # fmt: skip
    satellites = float(np.nanmedian(one.satellites[newest]))
    made = judged("gps_satellites", one.source, harm.GPS_SATELLITES - satellites, 0.1, 0.5, "")
    yield replace(made, autopilot="EKF: GPS numsats" if not _px4(flight) else "EKF2_REQ_NSATS",
                  note=f"{satellites:.0f} satellites, {harm.GPS_SATELLITES} needed")  # fmt: skip
    for name, limit in harm.GPS_POOR.items():
        values = getattr(one, name)[newest]
        if np.isfinite(values).any():
            unit = "m/s" if name.startswith("speed") else "m"
            made = judged(f"gps_{name}", one.source, float(np.nanmedian(values)), 0.05 * limit, limit, unit)
            px4 = flight.parameters.get(_REQUIRED[name])
            yield replace(made, autopilot=_REQUIRED[name] if _px4(flight) else "EKF: GPS accuracy",
                          autopilot_limit=px4 if _px4(flight) else limit)  # fmt: skip
