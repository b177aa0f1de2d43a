"""Findings about readings of aiding sensors that cannot be: the same again and again, or fixes that leap about.

Such readings are taken out, and the rest is judged as before.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from companion.analysis.finding import Cause, Finding, run_edges
from companion.analysis.phases import phases
from companion.analysis.reference import BoolArray, length
from companion.model import (
    Array,
    BarometerTrack,
    CompassTrack,
    Flight,
    GpsTrack,
    ImuTrack,
    Series,
    ned_from_geodetic,
    of_kind,
    rows,
)
from companion.strapdown import preintegrate, quaternion

_FROZEN_S = 2.0  # an estimator that gets nothing new for less has hardly moved
_CHANCE = 1e-3  # of a stretch like it anywhere in the record of a sensor in order
_BLOCK, _FEWEST = 20, 10  # readings; blocks outside of such stretches that tell how often one is repeated
_SELDOM = 0.5  # above it one repetition makes the next likelier, and chance is not told by their share
_STEPS = 10.0  # of the coarsest sensor, that a reading has to have changed by
_COARSEST = {"compass": 4.35e-7, "barometer": 0.55, "gps": 0.02}
"""tesla (HMC5883L data sheet: 4.35 mG), m (MS5611 data sheet: 0.065 mbar, at sea level), m (1e-7° of latitude)."""
_LENGTH = 1e-6  # of a field: a length that is the same to this, of three components that are not, is made up
_MOVES = 1.0  # m/s by GPS: a gyro that reads a turn at rest is off itself
_BIAS = 0.1  # rad/s: of an even turn so much may be the gyro's bias
_JUMPS = 10.0  # m, beyond what velocities say: far more than what two fixes of a receiver in order differ by
_LEAPS, _SOONEST_S = 60.0, 0.05  # m/s²: no vehicle that these autopilots fly
_OFTEN, _TOGETHER_S = 4, 5.0
_UNVERIFIED_S = 5.0  # without a GPS that can be believed, an autopilot's position may be anything
_SPREAD = 1.5  # m, 1σ: how far the heights of a GPS in order wander meanwhile

_Track = CompassTrack | BarometerTrack | GpsTrack


@dataclass(frozen=True, slots=True, eq=False)
class _Sensor:
    """One aiding sensor, as a test of it needs it."""

    kind: str  # "compass", "barometer", "gps"
    source: str
    t: Array  # (N,) s
    same: BoolArray  # (N-1,) whether a reading is the one before
    reads: str  # in words, what a stretch of them is


def screened_aiding(flight: Flight, imu: ImuTrack) -> tuple[Flight, list[Finding]]:
    """The flight without readings of aiding sensors that cannot be, and a finding for each such stretch.

    In flight alone. A stretch of n repetitions is frozen where a sensor in order would not repeat its readings so
    often: by chance, a share p of repetitions in any block of the flight outside of it, N readings show it
    N pⁿ times, and less than 1e-3 is no chance. Or where another sensor says that ten steps of the coarsest sensor of
    its kind were to be read: the gyro of a compass, GPS of a barometer, its own velocity of a GPS.
    """
    aloft = [(part.start, part.end) for part in phases(flight) if part.kind == "flight"]
    faults: list[Finding] = []

    def without(track: _Track, sensor: _Sensor) -> _Track:
        kept = np.ones(len(track), np.bool_)
        for first, last in _frozen(sensor, aloft, flight, imu, track):
            kept[first + 1 : last + 1] = False
            faults.append(_finding(sensor, float(track.t[first]), float(track.t[last])))
        for first, last in _contradicting(track) if isinstance(track, GpsTrack) else ():
            kept[first : last + 1] = False
            faults.append(_inconsistent(track.source, float(track.t[first]), float(track.t[last])))
        return track if kept.all() else rows(track, kept)

    left_out = [one for one in _constant(flight) if not any(one.source == c.source for c in flight.compasses)]
    faults += [
        _finding(_compass(one), float(one.t[0]), float(one.t[-1]))
        for one in left_out
        if any(_frozen(_compass(one), aloft, flight, imu, one))
    ]
    tracks: dict[str, Any] = {
        "compasses": tuple(without(one, _compass(one)) for one in flight.compasses),
        "barometers": tuple(without(one, _barometer(one)) for one in flight.barometers),
        "gps": tuple(without(one, _gps(one)) for one in flight.gps),
    }
    return (replace(flight, **tracks) if faults else flight), faults


def _constant(flight: Flight) -> Iterator[CompassTrack]:
    """Compasses of which all readings are the same: no track is made of these."""
    for one in of_kind(flight.series, "magnetometer"):
        if (
            isinstance(one, Series)
            and len(one.t) > _BLOCK
            and one.values.any()
            and not np.ptp(one.values, axis=0).any()
        ):
            yield CompassTrack(one.t, one.values, one.source, one.instance)


def _compass(track: CompassTrack) -> _Sensor:
    size = length(track.field)
    same = (np.diff(track.field, axis=0) == 0.0).all(axis=1) | (np.abs(np.diff(size)) < _LENGTH * size[1:])
    return _Sensor("compass", track.source, track.t, np.asarray(same), "one field, or one of exactly the same length")


def _barometer(track: BarometerTrack) -> _Sensor:
    readings = track.altitude if np.isnan(track.pressure).all() else track.pressure
    return _Sensor("barometer", track.source, track.t, np.diff(readings) == 0.0, "one pressure")


def _gps(track: GpsTrack) -> _Sensor:
    told = np.column_stack([track.latitude, track.longitude, track.height, track.velocity])
    same = (told[1:] == told[:-1]) | (np.isnan(told[1:]) & np.isnan(told[:-1]))
    fixed = (track.fix_type >= 3) & np.isfinite(track.latitude)
    return _Sensor("gps", track.source, track.t, np.asarray(same.all(axis=1) & fixed[1:] & fixed[:-1]), "one fix")


def _frozen(
    sensor: _Sensor, aloft: Sequence[tuple[float, float]], flight: Flight, imu: ImuTrack, track: _Track
) -> Iterator[tuple[int, int]]:
    """First and last reading of the stretches in flight in which a sensor is frozen."""
    t = sensor.t
    for begin, end in aloft:
        i, j = (int(at) for at in np.searchsorted(t, (begin, end)))
        same = sensor.same[i : max(j - 1, i)]
        first, last = run_edges(np.asarray(same))
        long = np.flatnonzero(t[i + last + 1] - t[i + first] > _FROZEN_S) if len(first) else first
        for one in long:
            a, b = i + int(first[one]), i + int(last[one]) + 1
            p = _share(np.delete(same, slice(a - i, b - i)))
            no_chance = p < _SELDOM and np.log(len(same)) + (b - a) * np.log(p) < np.log(_CHANCE)
            if no_chance or _should_have_changed(sensor.kind, track, slice(a, b + 1), flight, imu):
                yield a, b


def _contradicting(track: GpsTrack) -> Iterator[tuple[int, int]]:
    """First and last fix of stretches in which positions do not move as the velocities say, or these leap, often.

    One jump is a step of the position, which the estimate explains; a receiver that is jammed leaps with every fix.
    """
    fixed = np.flatnonzero((track.fix_type >= 3) & np.isfinite(track.latitude) & np.isfinite(track.velocity[:, 0]))
    if len(fixed) < _OFTEN:
        return
    t, velocity = track.t[fixed], track.velocity[fixed, :2]
    latitude, longitude = track.latitude[fixed], track.longitude[fixed]
    place = ned_from_geodetic(latitude, longitude, np.zeros(len(t)), (float(latitude[0]), float(longitude[0]), 0.0))
    apart = np.diff(t)[:, None]
    off = length(np.diff(place[:, :2], axis=0) - 0.5 * (velocity[1:] + velocity[:-1]) * apart)
    leaps = length(np.diff(velocity, axis=0)) > _LEAPS * np.maximum(apart[:, 0], _SOONEST_S)
    bad = np.flatnonzero((apart[:, 0] < _TOGETHER_S) & ((off > _JUMPS) | leaps))
    for group in np.split(bad, np.flatnonzero(np.diff(t[bad]) > _TOGETHER_S) + 1):
        if len(group) >= _OFTEN:
            yield int(fixed[group[0]]), int(fixed[group[-1] + 1])


def _inconsistent(source: str, begin: float, end: float) -> Finding:
    return Finding(
        "gps_inconsistent",
        "data",
        "warning",
        begin,
        end,
        f"the GPS ({source}) contradicts itself from {begin:.1f} to {end:.1f} s: its positions do not move as "
        "its velocities say; left out there, position and velocity could not be verified",
        "Jamming, reflected signals or a receiver that fails: look at its signal strengths and at transmitters nearby.",
        undecided=end - begin > _UNVERIFIED_S,
    )


def _share(same: BoolArray) -> float:
    """The greatest share of repetitions in a block of readings, by Laplace's rule of succession; 1 for too few blocks.

    A sensor whose noise is below its steps, or that is sent more often than it reads, has some in which it repeats
    most.
    """
    blocks = len(same) // _BLOCK
    if blocks < _FEWEST:
        return 1.0
    return float((same[: blocks * _BLOCK].reshape(blocks, _BLOCK).sum(axis=1).max() + 1.0) / (_BLOCK + 2.0))


def _should_have_changed(kind: str, track: _Track, part: slice, flight: Flight, imu: ImuTrack) -> bool:
    """Whether another sensor says that the readings had to change by many steps in a stretch."""
    begin, end = float(track.t[part][0]), float(track.t[part][-1])
    if isinstance(track, GpsTrack):
        speed = float(np.nan_to_num(length(np.nan_to_num(track.velocity[part])))[0])
        return speed > _MOVES and speed * (end - begin) > _STEPS * _COARSEST[kind]
    fixes = [(one, (one.t >= begin) & (one.t <= end) & (one.fix_type >= 3)) for one in flight.gps]
    if isinstance(track, BarometerTrack):
        heights = [one.height[at][np.isfinite(one.height[at])] for one, at in fixes]
        least = _STEPS * _COARSEST[kind] + 3.0 * _SPREAD
        return any(len(h) > 2 and float(np.subtract(*np.percentile(h, [90, 10]))) > least for h in heights)
    moves = [np.nanmedian(length(one.velocity[at][:, :2])) for one, at in fixes if at.any()]
    return any(speed > _MOVES for speed in moves) and _turned(track.field[part][0], imu, begin, end) > (
        _STEPS * _COARSEST[kind]
    )


def _turned(field: Array, imu: ImuTrack, begin: float, end: float) -> float:
    """By how much the gyro says that a field (3,) had to change in the body between two times (s), in its unit."""
    during = slice(*np.searchsorted(imu.t, (begin, end)).tolist())
    if during.stop - during.start < 3:
        return 0.0
    rate = imu.gyro[during]  # a bias turns nothing
    steady = np.clip(rate.mean(axis=0), -_BIAS, _BIAS)
    q = preintegrate(replace(imu[during], gyro=rate - steady)).q
    return float(length(quaternion.rotate(quaternion.conjugate(q), np.broadcast_to(field, (len(q), 3))) - field).max())


def _finding(sensor: _Sensor, begin: float, end: float) -> Finding:
    name = "GPS" if sensor.kind == "gps" else sensor.kind
    return Finding(
        f"{sensor.kind}_frozen",
        "data",
        "warning",
        begin,
        end,
        f"the {name} ({sensor.source}) reads {sensor.reads} for {end - begin:.1f} s in flight: left out there",
        "The sensor, its driver or its bus has stopped while its messages go on. Look at its wiring and power.",
    )


_SHOWS = {
    "compass_frozen": ("heading_off", "heading_jump"),
    "barometer_frozen": ("height_off",),
    "gps_frozen": ("position_off", "velocity_off", "position_jump"),
    "gps_inconsistent": ("position_off", "velocity_off", "position_jump"),
}
_FOLLOWS_S = 20.0  # after a sensor reads anew its estimator may still be setting itself right


def misled_by_frozen(findings: Sequence[Finding]) -> list[Finding]:
    """The findings, where a frozen sensor misled the autopilot with that as the cause, and its own as consequences."""
    out = list(findings)
    for i, one in enumerate(findings):
        led = [
            f
            for f in findings
            if f.kind in _SHOWS.get(one.kind, ())
            and f.side == "autopilot"
            and f.severity == "error"
            and one.start_s <= f.start_s <= one.end_s + _FOLLOWS_S
        ]
        if led:
            sensor = one.kind.partition("_")[0]
            words = tuple(f.headline or f.evidence for f in led)
            cause = Cause(one.kind, "autopilot", one.start_s, one.end_s, sensor=sensor, consequences=words)
            said = f"{one.evidence}; the autopilot was misled by it: {words[0]}"
            out[i] = replace(one, side="autopilot", severity="error", evidence=said, headline=one.evidence, cause=cause)
    return out
