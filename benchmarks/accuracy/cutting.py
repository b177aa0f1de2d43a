"""Flights cut in time, thinned in rate, and their tracks read at other times."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from companion.model import (
    Array,
    CompassTrack,
    Flight,
    GpsTrack,
    ImuTrack,
    PositionTrack,
    Track,
    ned_from_geodetic,
    rows,
    with_tracks,
)
from companion.simulate import LOOP_US, low_pass
from companion.strapdown import quaternion

_EARTH_M = 6_371_000.0
_FILTER_HZ = 20.0  # ArduPilot's INS_GYRO_FILTER
_TWIN = (1e-3, 0.02)  # rad/s, m/s²: 1σ of a sample, at least


def cut(flight: Flight, begin: float, end: float) -> Flight:
    """What lies between two times of the boot clock, s."""

    def inside(track: Track) -> Track:
        return rows(track, slice(*np.searchsorted(track.t, [begin, end]).tolist()))

    return replace(
        with_tracks(flight, inside),
        start=begin,
        duration=end - begin,
        biases=tuple(map(inside, flight.biases)),
        control=None if flight.control is None else inside(flight.control),
        actuators=None if flight.actuators is None else inside(flight.actuators),
        truth=None if flight.truth is None else inside(flight.truth),
        series={name: inside(series) for name, series in flight.series.items()},
        events=tuple(e for e in flight.events if begin <= e.t < end),
        texts=tuple(s for s in flight.texts if begin <= s.t < end),
        resets=tuple(r for r in flight.resets if begin <= r.t < end),
        parameter_changes=tuple(p for p in flight.parameter_changes if begin <= p.t < end),
    )


def every_imu(flight: Flight, change: Callable[[ImuTrack], ImuTrack], instance: int | None = None) -> Flight:
    """The flight with the tracks of one IMU changed (its messages all at once), or of all of them."""
    imus = {
        name: change(track) if instance is None or track.instance == instance else track
        for name, track in flight.imus.items()
    }
    return replace(flight, imus=imus)


def alone(flight: Flight) -> Flight:
    """The flight as of a vehicle that has no IMU but the one that is integrated."""
    instance = flight.imu().instance
    return replace(flight, imus={name: track for name, track in flight.imus.items() if track.instance == instance})


def with_twin(flight: Flight) -> Flight:
    """The flight with one IMU more, that reads what the one that is integrated does, and its own noise.

    As much as that has from one sample to the next, and in the same whole steps, cut towards zero.
    """
    own, rng = flight.imu(), np.random.default_rng(1)

    def noisy(readings: Array, least: float, step: float) -> Array:
        change = np.median(np.abs(np.diff(readings, axis=0)), axis=0)  # of motion seldom
        new = readings + np.maximum(1.05 * change, least) * rng.normal(size=readings.shape)  # σ √2 Φ⁻¹(3/4) = 0.95 σ
        return np.asarray(np.trunc(new / step) * step if step else new)

    twin = replace(
        own,
        source="TWIN",
        instance=1 + max(track.instance for track in flight.imus.values()),
        device_id=None,
        gyro=noisy(own.gyro, _TWIN[0], own.gyro_step),
        accel=noisy(own.accel, _TWIN[1], own.accel_step),
    )
    return replace(flight, imus={**flight.imus, "TWIN": twin})


def thinned(flight: Flight, rate_hz: float) -> Flight:
    """Its IMUs as an autopilot logs them at a lower rate: point samples of what its low-pass lets through.

    ArduPilot's readings have been through its filter; PX4's raw ones go through the same here.
    """
    filtered = flight.vehicle.autopilot == "ARDUPILOTMEGA"

    def thin(track: ImuTrack) -> ImuTrack:
        every = round(track.rate_hz / rate_hz)
        if every < 2:
            return track
        if not filtered and track.rate_hz > 2.0 * _FILTER_HZ:  # else it lets all of it through
            corner = _FILTER_HZ * 1e6 / LOOP_US / track.rate_hz  # `low_pass` counts in steps of the simulator's loop
            track = replace(track, gyro=low_pass(track.gyro, corner), accel=low_pass(track.accel, corner))
        return replace(track[::every], interval=None)

    return every_imu(flight, thin)


def at(times: Array, t: Array, values: Array) -> Array:
    """Columns (N, k) linearly interpolated at other times, (M, k); held at the ends."""
    return np.column_stack([np.interp(times, t, column) for column in values.T])


def attitude_at(times: Array, t: Array, q: Array) -> Array:
    """Attitudes (N, 4) of continuous sign at other times, (M, 4)."""
    return quaternion.normalize(at(times, t, q))


def gps_ned(gps: GpsTrack, reference: GpsTrack, position: PositionTrack, latency: float = 0.0) -> Array:
    """A receiver's positions (N, 3) NED in the frame of a position track; NaN without a fix.

    The frame is laid through the fixes of `reference`, the receiver of the healthy flight, by their median.
    """
    good = np.flatnonzero(np.isfinite(reference.latitude + reference.height))
    origin = tuple(float(column[good[0]]) for column in (reference.latitude, reference.longitude, reference.height))
    assert len(origin) == 3
    theirs = ned_from_geodetic(reference.latitude, reference.longitude, reference.height, origin)
    ours = at(reference.t - latency, position.t, position.position)
    offset = np.nanmedian(theirs - ours, axis=0)
    return np.asarray(ned_from_geodetic(gps.latitude, gps.longitude, gps.height, origin) - offset)


def gps_moved(gps: GpsTrack, away: Array) -> GpsTrack:
    """A receiver whose fixes lie by so many metres (N, 2) further north and east."""
    return replace(
        gps,
        latitude=gps.latitude + away[:, 0] / _EARTH_M,
        longitude=gps.longitude + away[:, 1] / (_EARTH_M * np.cos(gps.latitude)),
    )


def field_ned(compass: CompassTrack, t: Array, q: Array) -> Array:
    """A compass's field turned into the world by attitudes (N, 4) at times t: (M, 3)."""
    return quaternion.rotate(attitude_at(compass.t, t, q), compass.field)
