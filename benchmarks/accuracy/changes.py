"""What makes no different flight: fewer samples, more noise, another clock, another heading, another place.

Each is a change of a whole flight. What turns or moves it takes the ground with it, and its magnetic field: so nothing
that any sensor reads is different but by that.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from typing import Any
from unittest import mock

import numpy as np

from benchmarks.accuracy.cutting import cut, every_imu, with_twin
from companion.estimation import setup
from companion.estimation.earth_field import EarthField, field_at
from companion.model import (
    Array,
    Epoch,
    Flight,
    GpsTrack,
    ImuTrack,
    Origin,
    geodetic_from_ned,
    ned_from_geodetic,
    rows,
    with_tracks,
)
from companion.strapdown import quaternion

_CUT_S = 5.0
_LATER_S = 1000.0
_AWAY_M = 500e3
_EARTH_M = 6_371_000.0
_FASTER = 1.5  # times a rate, from which on an IMU can be thinned to it


@dataclass(frozen=True, slots=True)
class Change:
    """One change."""

    of: Callable[[Flight], Flight | None]  # None: this flight cannot be changed so
    world: Callable[[], AbstractContextManager[None]] = nullcontext  # in which it is judged


def _louder(flight: Flight) -> Flight:
    """A tenth more of the scatter from one sample to the next."""
    rng = np.random.default_rng(0)

    def louder(track: ImuTrack) -> ImuTrack:
        more = {
            name: read
            + np.sqrt(1.1**2 - 1.0) * np.diff(read, axis=0).std(axis=0) / np.sqrt(2.0) * rng.normal(size=read.shape)
            for name, read in (("gyro", track.gyro), ("accel", track.accel))
        }
        return replace(track, gyro=more["gyro"], accel=more["accel"])

    return every_imu(flight, louder)


def _every_second(flight: Flight) -> Flight:
    return every_imu(flight, lambda track: rows(track, slice(None, None, 2)))


def slower_imu(flight: Flight, hz: float) -> Flight | None:
    """Its IMUs as they would have been logged at a lower rate; None where that is hardly lower.

    Readings of an instant are left out. Means over intervals become those over longer ones, so that nothing is lost.
    """
    if not flight.imus or flight.imu().rate_hz < _FASTER * hz:
        return None

    def slower(track: ImuTrack) -> ImuTrack:
        every = round(track.rate_hz / hz)
        return track if every < 2 else _averaged(track, every) if track.covered > 0.5 else track[::every]

    return every_imu(flight, slower)


def _averaged(track: ImuTrack, every: int) -> ImuTrack:
    """Means over `every` intervals that follow each other."""
    assert track.interval is not None
    count = len(track) // every
    lasts = np.nan_to_num(track.interval, nan=float(np.nanmedian(track.interval)))[: count * every]
    share = lasts.reshape(count, every)
    total = share.sum(axis=1)

    def mean(values: Array) -> Array:
        return np.asarray((share[..., None] * values[: count * every].reshape(count, every, -1)).sum(axis=1))

    end = (track.t[: count * every] + 0.5 * lasts).reshape(count, every)[:, -1]
    return replace(
        track,
        t=end - 0.5 * total,
        gyro=mean(track.gyro) / total[:, None],
        accel=mean(track.accel) / total[:, None],
        interval=total,
    )


def slower_attitude(flight: Flight, hz: float) -> Flight | None:
    """The autopilot's attitude at a lower rate; None where it has no higher one."""
    if flight.attitude is None:
        return None
    every = round((len(flight.attitude) - 1) / max(np.ptp(flight.attitude.t), 1e-9) / hz)
    return None if every < 2 else replace(flight, attitude=rows(flight.attitude, slice(None, None, every)))


def _half_attitude(flight: Flight) -> Flight | None:
    if flight.attitude is None:
        return None
    return replace(flight, attitude=rows(flight.attitude, slice(None, None, 2)))


def _slow_gps(flight: Flight) -> Flight | None:
    """One fix a second."""
    slow = tuple(rows(one, np.flatnonzero(np.diff(np.floor(one.t), prepend=-1.0) > 0)) for one in flight.gps)
    return replace(flight, gps=slow) if flight.gps else None


def later(flight: Flight, seconds: float) -> Flight:
    """The same with a boot clock that has been running for longer."""

    def shift(one: Any) -> Any:
        return None if one is None or one.t is None else replace(one, t=one.t + seconds)

    truth = shift(flight.truth)
    return replace(
        with_tracks(flight, shift),
        start=flight.start + seconds,
        origin=shift(flight.origin) or flight.origin,
        home=shift(flight.home) or flight.home,
        epoch=None if flight.epoch is None else Epoch(flight.epoch.unix_s - seconds, flight.epoch.source),
        series={name: shift(one) for name, one in flight.series.items()},
        events=tuple(map(shift, flight.events)),
        texts=tuple(map(shift, flight.texts)),
        resets=tuple(map(shift, flight.resets)),
        parameter_changes=tuple(map(shift, flight.parameter_changes)),
        biases=tuple(map(shift, flight.biases)),
        control=shift(flight.control),
        actuators=shift(flight.actuators),
        truth=None if truth is None else replace(truth, faults=tuple(f + seconds for f in truth.faults)),
        imu_in_use=shift(flight.imu_in_use),
        aiding_in_use={name: shift(one) for name, one in flight.aiding_in_use.items()},
    )


def _place(flight: Flight) -> tuple[float, float, float] | None:
    """Where on Earth it was: its origin, else its first fix."""
    if flight.origin is not None:
        return flight.origin.latitude, flight.origin.longitude, flight.origin.height
    for gps in flight.gps:
        fixed = np.flatnonzero(np.isfinite(gps.latitude + gps.longitude + gps.height))
        if len(fixed):
            return float(gps.latitude[fixed[0]]), float(gps.longitude[fixed[0]]), float(gps.height[fixed[0]])
    return None


def turned(flight: Flight, angle: float) -> Flight:
    """Everything turned about the vertical through its origin by an angle, rad, clockwise from above."""
    turn = quaternion.exp(np.array([[0.0, 0.0, angle]]))
    place = _place(flight)

    def attitude(q: Array) -> Array:
        return quaternion.continuous_sign(quaternion.multiply(np.tile(turn, (len(q), 1)), q))

    def vectors(values: Array) -> Array:
        c, s = np.cos(angle), np.sin(angle)
        north, east = values[:, 0], values[:, 1]
        return np.column_stack([c * north - s * east, s * north + c * east, values[:, 2:]])

    def around(latitude: Array, longitude: Array) -> tuple[Array, Array]:
        if place is None:
            return latitude, longitude
        ned = vectors(ned_from_geodetic(latitude, longitude, np.full_like(latitude, place[2]), place))
        new = geodetic_from_ned(ned, place)
        return new[:, 0], new[:, 1]

    def gps(one: GpsTrack) -> GpsTrack:
        latitude, longitude = around(one.latitude, one.longitude)
        return replace(one, latitude=latitude, longitude=longitude, velocity=vectors(one.velocity))

    def origin(one: Origin | None) -> Origin | None:
        if one is None:
            return None
        latitude, longitude = around(np.array([one.latitude]), np.array([one.longitude]))
        return replace(one, latitude=float(latitude[0]), longitude=float(longitude[0]))

    own, position, truth, control = flight.attitude, flight.position, flight.truth, flight.control
    return replace(
        flight,
        attitude=None if own is None else replace(own, q_ned_frd=attitude(own.q_ned_frd)),
        position=None if position is None else replace(
            position, position=vectors(position.position), velocity=vectors(position.velocity)
        ),
        truth=None if truth is None else replace(
            truth, q_ned_frd=attitude(truth.q_ned_frd), velocity=vectors(truth.velocity),
            position=vectors(truth.position),
        ),
        control=None if control is None else replace(control, q_ned_frd=attitude(control.q_ned_frd)),
        gps=tuple(map(gps, flight.gps)),
        home=origin(flight.home),
        declination=flight.declination + angle if flight.declination else 0.0,
    )  # fmt: skip


@contextlib.contextmanager
def _field(change: Callable[[EarthField], EarthField], place: Callable[[Origin], Origin]) -> Iterator[None]:
    """The model of the Earth's field changed, in this process, for a ground that was turned or moved."""

    def changed(origin: Origin | None, epoch: Epoch | None) -> EarthField | None:
        field = field_at(None if origin is None else place(origin), epoch)
        return None if field is None else change(field)

    with mock.patch.object(setup, "field_at", changed):
        yield


def turned_ground(angle: float) -> AbstractContextManager[None]:
    """In which a flight is judged that was `turned`."""
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return _field(
        lambda field: replace(field, ned=matrix @ field.ned, declination=field.declination + angle), lambda one: one
    )


def moved(flight: Flight, metres: float) -> Flight | None:
    """The whole flight further east: along a parallel nothing is different but the longitude. None without a place."""
    place = _place(flight)
    if place is None:
        return None
    away = metres / (_EARTH_M * np.cos(place[0]))
    return replace(
        flight,
        gps=tuple(replace(one, longitude=one.longitude + away) for one in flight.gps),
        origin=_further(flight.origin, away),
        home=_further(flight.home, away),
    )


def _further(one: Origin | None, away: float) -> Origin | None:
    return None if one is None else replace(one, longitude=one.longitude + away)


def moved_ground(metres: float) -> AbstractContextManager[None]:
    """In which a flight is judged that was `moved`."""

    def back(origin: Origin) -> Origin:
        return replace(origin, longitude=origin.longitude - metres / (_EARTH_M * np.cos(origin.latitude)))

    return _field(lambda field: field, back)


def _turn(degrees: float) -> Change:
    angle = float(np.radians(degrees))
    return Change(lambda flight: turned(flight, angle), lambda: turned_ground(angle))


TWIN = "a twin as second IMU"

CHANGES: Mapping[str, Change] = {
    "as it is": Change(lambda flight: flight),
    "without its first 5 s": Change(lambda f: cut(f, f.start + _CUT_S, f.start + f.duration + 1.0)),
    "without its last 5 s": Change(lambda f: cut(f, f.start, f.start + f.duration - _CUT_S)),
    "1000 s later": Change(lambda f: later(f, _LATER_S)),
    "turned by 90°": _turn(90.0),
    "turned by 37°": _turn(37.0),
    "500 km further east": Change(lambda f: moved(f, _AWAY_M), lambda: moved_ground(_AWAY_M)),
    "every second IMU sample": Change(_every_second),
    "IMU at 200 Hz": Change(lambda f: slower_imu(f, 200.0)),
    "IMU at 100 Hz": Change(lambda f: slower_imu(f, 100.0)),
    "a tenth more noise": Change(_louder),
    "attitude at half its rate": Change(_half_attitude),
    "attitude at 5 Hz": Change(lambda f: slower_attitude(f, 5.0)),
    "attitude at 2 Hz": Change(lambda f: slower_attitude(f, 2.0)),
    "attitude at 1 Hz": Change(lambda f: slower_attitude(f, 1.0)),
    "GPS at 1 Hz": Change(_slow_gps),
    TWIN: Change(with_twin),
}
