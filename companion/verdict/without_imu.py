"""A flight whose IMU cannot be judged: what its autopilot, its GPS and its compass still say of one another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.comparison import (
    Limits,
    flight_of,
    in_control,
    judged_parts,
    known_at,
    length,
    phases,
    reference_at,
    spans,
    within_any,
    wrapped,
)
from companion.constants import check, healthy
from companion.estimation import CONSTANTS, receiver_of
from companion.model import Array, BoolArray, Flight, GpsTrack, IntArray, interpolated, ned_from_geodetic
from companion.strapdown import quaternion
from companion.verdict.deviations import at_first, beyond_the_sphere, least_deviation
from companion.verdict.fault_interval import DEVIATION_UNITS
from companion.verdict.finding import Finding, are_near, by_severity
from companion.verdict.findings.detect import autopilot_findings, with_reports
from companion.verdict.verdict import Verdict, decide_without_imu


@dataclass(frozen=True, slots=True, eq=False)
class _Apart:
    """By how much the autopilot is off an aiding sensor."""

    quantity: str  # of healthy.AP_SIGMA
    sensor: str  # "GPS", "compass"
    source: str
    t: Array  # (N,) s
    off: Array  # (N,) rad, m/s, m; NaN where it is not known
    least: Array  # (N,) from which on it is more than both may be off by


def verdict_without_imu(flight: Flight, why: str, limits: Limits) -> Verdict | None:
    """Resets, jumps, a lost position, GPS against position and compass against heading; None where there is nothing.

    why: the IMU is not judged, in a sentence or two.
    """
    flight, own = autopilot_findings(flight, limits)
    apart = [one for one in (*_off_gps(flight, limits), *_off_compass(flight, limits)) if np.isfinite(one.off).any()]
    disagreeing = [with_reports(finding, flight) for one in apart for finding in _disagreements(one)]
    if not apart and not own and flight.position is None and not flight.gps:
        return None
    findings = by_severity([*(_confirmed(f, disagreeing) for f in own), *disagreeing])
    agreed = [words for one in apart if (words := _agreement(one))]
    told = [(one.fix_type >= check.FIX_3D) & np.isfinite(one.velocity[:, 0]) for one in flight.gps]
    if any(fixes.sum() >= check.FIX_JUMPS_MIN for fixes in told) and all(
        not f.kind.startswith("gps") for f in findings
    ):
        agreed.append("the GPS moves as its own velocity says")
    beside = f" ({', '.join(agreed)})" if agreed else ""
    compared = bool(apart) or flight.position is not None
    agreement = "no fault of the autopilot was found" if compared else "the autopilot's estimate could not be checked"
    return decide_without_imu(findings, agreement + beside, why)


def _confirmed(jump: Finding, disagreeing: Sequence[Finding]) -> Finding:
    """A jump of the position after it was off the GPS is the autopilot's; of others nobody tells what was right."""
    gps = [f for f in disagreeing if f.kind == "gps_disagrees"]
    if jump.severity != "error" or (jump.kind == "position_jump" and are_near(gps, jump.start_s)):
        return jump
    words = f"{jump.evidence}; without an IMU it cannot be told whether it was wrong before or is after it"
    return replace(jump, severity="warning", evidence=words, undecided=True)


def _off_gps(flight: Flight, limits: Limits) -> Iterator[_Apart]:
    """Position, height and velocity against the receiver with the most fixes, the first two as each flight began."""
    position = flight.position
    if position is None or len(position) < 2 or (gps := receiver_of(flight, position.t)) is None:
        return
    late = CONSTANTS["gps_latency"][1]
    t, place, known = gps.t, _place(gps), known_at(position.t, gps.t, limits.longest_step(position.t))
    known &= (gps.fix_type >= check.FIX_3D) & np.isfinite(place).all(axis=1)
    which, judged = _judged(flight, t)
    if (known & judged).sum() < check.FIX_JUMPS_MIN:
        return
    own, speed = (interpolated(t, position.t, values) for values in (position.position, position.velocity))
    moved = own - place
    moved, gone = (values - at_first(values, known & judged, which) for values in (moved, own))
    moved[:, :2] = beyond_the_sphere(moved[:, :2], gone, flight.origin)
    moved = np.where((known & judged)[:, None], moved, np.nan)
    swift = length(speed[:, :2])
    pull = np.interp(t, position.t, length(np.gradient(position.velocity[:, :2], position.t, axis=0)))  # m/s²
    faster = np.where(known & judged, length(speed[:, :2] - gps.velocity[:, :2]), np.nan)
    for quantity, off, reported, wanders in (
        ("position", length(moved[:, :2]), gps.horizontal_sigma, late * swift),
        ("height", np.abs(moved[:, 2]), gps.vertical_sigma, np.full(len(t), healthy.GPS_HEIGHT_WANDER_M)),
        ("velocity", faster, gps.speed_sigma, late * pull),
    ):
        least = least_deviation(quantity, np.hypot(np.nan_to_num(reported), wanders))
        yield _Apart(quantity, "GPS", gps.source, t, off, least)


def _off_compass(flight: Flight, limits: Limits) -> Iterator[_Apart]:
    """Heading against the first calibrated compass, by the declination where that is known, else as it began."""
    compass, attitude = next((one for one in flight.compasses if one.calibrated), None), flight.attitude
    if compass is None or attitude is None or len(attitude) < 2 or not len(compass):
        return
    reference = reference_at(attitude, None, compass.t, limits)
    which, judged = _judged(flight, compass.t)
    judged &= reference.attitude_known & np.isfinite(compass.field).all(axis=1)
    if judged.any():
        field = quaternion.rotate(reference.q_ned_frd, compass.field)
        off = np.arctan2(field[:, 1], field[:, 0])
        off[judged] = np.unwrap(off[judged])
        off -= flight.declination or at_first(off, judged, which)
        value = np.where(judged, np.abs(wrapped(off)), np.nan)
        least = least_deviation("heading", np.full(len(value), healthy.MAGNETIC_HEADING_RAD))
        yield _Apart("heading", "compass", compass.source, compass.t, value, least)


def _judged(flight: Flight, t: Array) -> tuple[IntArray, BoolArray]:
    """(N,) which flight of the log each time is of, and whether it is in the air and in control then.

    On a bench where nothing says that it flew.
    """
    parts = phases(flight)
    inside = within_any(t, [(part.start, part.end) for part in judged_parts(parts)])
    return flight_of(parts, t), inside & within_any(t, in_control(parts))


def _place(gps: GpsTrack) -> Array:
    """(N, 3) NED, m, about the first fix; NaN without a fix."""
    first = int(np.argmax(np.isfinite(gps.latitude) & np.isfinite(gps.height)))
    about = float(gps.latitude[first]), float(gps.longitude[first]), float(gps.height[first])
    return ned_from_geodetic(gps.latitude, gps.longitude, gps.height, about)


def _disagreements(one: _Apart) -> Iterator[Finding]:
    _, unit, scale = DEVIATION_UNITS[one.quantity]
    for begin, end in spans(one.t, np.asarray(one.off > one.least)):
        if end - begin >= healthy.DEVIATION_S[one.quantity]:
            most = scale * float(one.off[(one.t >= begin) & (one.t <= end)].max())
            evidence = (
                f"the autopilot's {one.quantity} is up to {most:.1f}{unit} off the {one.sensor}, "
                f"from {begin:.1f} to {end:.1f} s ({one.source})"
            )
            advice = "Without an IMU it cannot be told which of the two is wrong: have the IMU logged as well."
            kind = f"{one.sensor.lower()}_disagrees"
            yield Finding(kind, "autopilot", "warning", begin, end, evidence, advice, undecided=True)


def _agreement(one: _Apart) -> str:
    """How far the two agree, in words; "" where they do not."""
    _, unit, scale = DEVIATION_UNITS[one.quantity]
    most = float(np.nanpercentile(one.off, check.AGREES_PERCENTILE))
    agree = f"{one.quantity} within {scale * most:.1f}{unit} of the {one.sensor}"
    return agree if most < np.median(one.least) else ""
