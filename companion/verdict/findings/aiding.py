"""Findings about readings of aiding sensors that cannot be: the same again and again, or fixes that leap about.

Such readings are taken out, and the rest is judged as before.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from companion.comparison import (
    ON_THE_GROUND,
    Span,
    ends_of,
    grouped,
    in_the_air,
    length,
    standing_still,
    window,
    within,
)
from companion.constants import check, harm, healthy, priors
from companion.model import (
    BarometerTrack,
    BoolArray,
    CompassTrack,
    Flight,
    GpsTrack,
    ImuTrack,
    ned_from_geodetic,
    of_kind,
    rows,
)
from companion.strapdown import preintegrate, quaternion
from companion.verdict.finding import Finding

_Track = CompassTrack | BarometerTrack | GpsTrack

_KINDS: Mapping[type[_Track], str] = {CompassTrack: "compass", BarometerTrack: "barometer", GpsTrack: "gps"}

_READS = {"compass": "one field, or one of exactly the same length", "barometer": "one pressure", "gps": "one fix"}
"""What a stretch of readings that do not change is, in words."""


def screened_aiding(flight: Flight, imu: ImuTrack | None) -> tuple[Flight, list[Finding]]:
    """The flight without readings of aiding sensors that cannot be, and a finding for each such stretch.

    In flight alone. A stretch of n repetitions is frozen where a sensor in order would not repeat its readings so
    often: by chance, a share p of repetitions in any block of the flight outside of it, N readings show it
    N pⁿ times, and less than 1e-3 is no chance. Or where another sensor says that ten steps of the coarsest sensor of
    its kind were to be read: the gyro of a compass, GPS of a barometer, its own velocity of a GPS.
    """
    aloft = [(part.start, part.end) for part in in_the_air(flight)]
    faults: list[Finding] = []

    def without(track: _Track) -> _Track:
        kept = np.ones(len(track), np.bool_)
        for first, last in _frozen(track, aloft, flight, imu):
            kept[first + 1 : last + 1 + _goes_on(track, last)] = False
            faults.append(_finding(track, float(track.t[first]), float(track.t[last])))
        if isinstance(track, BarometerTrack):
            coldest, hottest = healthy.BAROMETER_DEGC
            out = np.asarray((track.temperature < coldest) | (track.temperature > hottest))
            kept &= ~out
            faults.extend(_out_of_range(track, out))
        for first, last in _contradicting(track) if isinstance(track, GpsTrack) else ():
            kept[first : last + 1] = False
            faults.append(_inconsistent(track.source, float(track.t[first]), float(track.t[last])))
        return track if kept.all() else rows(track, kept)

    known = {one.source for one in flight.compasses}
    left_out = [one for one in _constant(flight) if one.source not in known]
    faults += [_finding(one, *ends_of(one.t)) for one in left_out if any(_frozen(one, aloft, flight, imu))]
    tracks: dict[str, Any] = {"compasses": tuple(map(without, flight.compasses))}
    tracks["barometers"] = tuple(filter(len, map(without, flight.barometers)))
    tracks["gps"] = tuple(filter(len, map(without, flight.gps)))
    return (replace(flight, **tracks) if faults else flight), faults


def _constant(flight: Flight) -> Iterator[CompassTrack]:
    """Compasses of which all readings are the same: no track is made of these."""
    for one in of_kind(flight.series, "magnetometer"):
        if len(one.t) > check.REPEATS_BLOCK and one.values.any() and not np.ptp(one.values, axis=0).any():
            yield CompassTrack(one.t, one.values, one.source, one.instance)


def _unchanged(track: _Track) -> BoolArray:
    """(N-1,) whether a reading is the one before."""
    if isinstance(track, CompassTrack):
        size = length(track.field)
        same = (np.diff(track.field, axis=0) == 0.0).all(axis=1)
        return np.asarray(same | (np.abs(np.diff(size)) < check.SYNTHETIC_FIELD * size[1:]))
    if isinstance(track, BarometerTrack):
        return np.asarray(np.diff(track.altitude if np.isnan(track.pressure).all() else track.pressure) == 0.0)
    fixes = np.column_stack([track.latitude, track.longitude, track.height, track.velocity])
    same = (fixes[1:] == fixes[:-1]) | (np.isnan(fixes[1:]) & np.isnan(fixes[:-1]))
    fixed = (track.fix_type >= 3) & np.isfinite(track.latitude)
    return np.asarray(same.all(axis=1) & fixed[1:] & fixed[:-1])


def _frozen(track: _Track, aloft: Sequence[Span], flight: Flight, imu: ImuTrack | None) -> Iterator[tuple[int, int]]:
    """First and last reading of the stretches in flight in which a sensor is frozen.

    Of a vehicle on the ground a receiver may hold its fix while it stands (u-blox: static hold).
    """
    t, whole = track.t, _unchanged(track)
    holds = isinstance(track, GpsTrack) and flight.vehicle.type in ON_THE_GROUND
    for begin, end in aloft:
        i, j = (int(at) for at in np.searchsorted(t, (begin, end)))
        same = whole[i : max(j - 1, i)]
        for a, b in standing_still(same, t[i:], healthy.EKF_UNFED_S):
            p = _share(np.delete(same, slice(a, b)))
            by_chance = np.log(len(same)) + (b - a) * np.log(p) >= np.log(priors.FALSE_ALARM)
            no_chance = p < check.REPEATS_SELDOM and not by_chance and not holds
            if no_chance or _should_have_changed(track, slice(i + a, i + b + 1), flight, imu):
                yield i + a, i + b


def _goes_on(track: _Track, last: int) -> int:
    """How many readings after one are the same still: what is frozen in flight is no reading after it either."""
    same = _unchanged(track)[last:]
    return int(np.argmin(np.append(same, False)))


def _contradicting(track: GpsTrack) -> Iterator[tuple[int, int]]:
    """First and last fix of stretches in which positions do not move as the velocities say, or these leap, often.

    One jump is a step of the position, which the estimate explains; a receiver that is jammed leaps with every fix.
    """
    fixed = np.flatnonzero((track.fix_type >= 3) & np.isfinite(track.latitude) & np.isfinite(track.velocity[:, 0]))
    if len(fixed) < check.FIX_JUMPS_MIN:
        return
    t, velocity = track.t[fixed], track.velocity[fixed, :2]
    latitude, longitude = track.latitude[fixed], track.longitude[fixed]
    place = ned_from_geodetic(latitude, longitude, np.zeros(len(t)), (float(latitude[0]), float(longitude[0]), 0.0))
    apart = np.diff(t)[:, None]
    off = length(np.diff(place[:, :2], axis=0) - 0.5 * (velocity[1:] + velocity[:-1]) * apart)
    interval = np.maximum(apart[:, 0], check.FIX_MIN_INTERVAL_S)
    leaps = length(np.diff(velocity, axis=0)) > healthy.MAX_MPS2 * interval
    bad = np.flatnonzero((apart[:, 0] < check.FIX_JUMPS_GROUPED_S) & ((off > harm.FIX_JUMP_M) | leaps))
    for group in grouped(t, bad, check.FIX_JUMPS_GROUPED_S):
        if len(group) >= check.FIX_JUMPS_MIN:
            yield int(fixed[group[0]]), int(fixed[group[-1] + 1])


def _out_of_range(track: BarometerTrack, out: BoolArray) -> Iterator[Finding]:
    """Some readings are damage, and no more is said of these."""
    t, warm, height = track.t[out], track.temperature[out], track.altitude[out]
    if len(t) < 2 or t[-1] - t[0] < healthy.EKF_UNFED_S:
        return
    reads = f"the barometer ({track.source}) reads {warm.min():.0f} to {warm.max():.0f} °C, which none is made for"
    evidence = f"{reads}, and heights of {height.min():.0f} to {height.max():.0f} m: left out there"
    advice = "The sensor, its bus or its calibration is damaged: replace it. No autopilot can hold a height with it."
    yield Finding("barometer_out_of_range", "data", "warning", *ends_of(t), evidence, advice)


def _inconsistent(source: str, begin: float, end: float) -> Finding:
    itself = f"the GPS ({source}) contradicts itself from {begin:.1f} to {end:.1f} s"
    left_out = "left out there, position and velocity could not be verified"
    evidence = f"{itself}: its positions do not move as its velocities say; {left_out}"
    look = "look at its signal strengths and at transmitters nearby"
    advice = f"Jamming, reflected signals or a receiver that fails: {look}."
    unsure = end - begin > harm.GPS_OUTAGE_S
    return Finding("gps_inconsistent", "data", "warning", begin, end, evidence, advice, undecided=unsure)


def _share(same: BoolArray) -> float:
    """The greatest share of repetitions in a block of readings, by Laplace's rule of succession; 1 for too few blocks.

    A sensor whose noise is below its steps, or that is sent more often than it reads, has some in which it repeats
    most.
    """
    size = check.REPEATS_BLOCK
    blocks = len(same) // size
    if blocks < check.REPEATS_MIN_BLOCKS:
        return 1.0
    return float((same[: blocks * size].reshape(blocks, size).sum(axis=1).max() + 1.0) / (size + 2.0))


def _should_have_changed(track: _Track, part: slice, flight: Flight, imu: ImuTrack | None) -> bool:
    """Whether another sensor says that the readings had to change by many steps in a stretch."""
    (begin, end), steps = ends_of(track.t[part]), check.FROZEN_STEPS * healthy.COARSEST_STEP[_KINDS[type(track)]]
    if isinstance(track, GpsTrack):
        speed = float(np.nan_to_num(length(np.nan_to_num(track.velocity[part])))[0])
        return speed > harm.FROZEN_MPS and speed * (end - begin) > steps
    fixes = [(one, within(one.t, (begin, end)) & (one.fix_type >= 3)) for one in flight.gps]
    if isinstance(track, BarometerTrack):
        heights = [one.height[at][np.isfinite(one.height[at])] for one, at in fixes]
        least = steps + 3.0 * healthy.GPS_HEIGHT_WANDER_M
        return any(len(h) > 2 and float(np.subtract(*np.percentile(h, [90, 10]))) > least for h in heights)
    moves = [np.nanmedian(length(one.velocity[at][:, :2])) for one, at in fixes if at.any()]
    return any(speed > harm.FROZEN_MPS for speed in moves) and _turned(track, imu, begin, end) > steps


def _turned(track: CompassTrack, imu: ImuTrack | None, begin: float, end: float) -> float:
    """By how much the gyro says that the field had to change in the body between two times (s), in its unit."""
    if imu is None:
        return 0.0
    field = track.field[np.searchsorted(track.t, begin)]
    during = window(imu.t, begin, end)
    if during.stop - during.start < 3:
        return 0.0
    rate = imu.gyro[during]  # a bias turns nothing
    steady = np.clip(rate.mean(axis=0), -healthy.GYRO_BIAS_RPS, healthy.GYRO_BIAS_RPS)
    q = preintegrate(replace(imu[during], gyro=rate - steady)).q
    return float(length(quaternion.rotate(quaternion.conjugate(q), np.broadcast_to(field, (len(q), 3))) - field).max())


def _finding(track: _Track, begin: float, end: float) -> Finding:
    kind = _KINDS[type(track)]
    who = f"the {'GPS' if kind == 'gps' else kind} ({track.source})"
    evidence = f"{who} reads {_READS[kind]} for {end - begin:.1f} s in flight: left out there"
    advice = "The sensor, its driver or its bus has stopped while its messages go on. Look at its wiring and power."
    return Finding(f"{kind}_frozen", "data", "warning", begin, end, evidence, advice)
