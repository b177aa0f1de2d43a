"""Flights with known truth, made from closed-form motions."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from companion.comparison import GENERIC
from companion.model import (
    STANDARD_GRAVITY,
    AttitudeTrack,
    BarometerTrack,
    CompassTrack,
    Event,
    Flight,
    GpsTrack,
    ImuTrack,
    Origin,
    PositionTrack,
    Vehicle,
    geodetic_from_ned,
)
from companion.simulate import GPS_SIGMA, HOME, aiding_readings, pressure
from companion.strapdown import ImuModel, Motion, Sensor, motions, quaternion, simulate

VEHICLE = Vehicle(1, 1, "ARDUPILOTMEGA", "QUADROTOR")
GOOD = ImuModel(
    gyro=Sensor(noise_density=GENERIC.gyro.noise_density, bias=np.array([1e-3, -1e-3, 5e-4]), step=1e-3),
    accel=Sensor(
        noise_density=GENERIC.accel.noise_density, bias=np.array([0.05, 0.02, -0.05]), step=STANDARD_GRAVITY * 1e-3
    ),
)


def flight_of(motion: Motion, *, every: int = 1, **changes: Any) -> Flight:
    """An ideal IMU at the motion's times, and an autopilot that knows the truth at every `every`-th of them."""
    parts: dict[str, Any] = {
        "vehicle": VEHICLE,
        "boot": 1,
        "start": float(motion.t[0]),
        "duration": float(motion.t[-1] - motion.t[0]),
        "imus": {"RAW_IMU": ImuTrack(motion.t, motion.gyro, motion.accel, source="RAW_IMU")},
        "attitude": AttitudeTrack(motion.t[::every], motion.q_ned_frd[::every], motion.gyro[::every], "ATTITUDE"),
        "position": PositionTrack(
            motion.t[::every], motion.position[::every], motion.velocity[::every], "LOCAL_POSITION_NED"
        ),
    }
    return Flight(**(parts | changes))


def aided(flight: Flight, motion: Motion, *, seed: int = 1, glitch: Any = None, fixes_hz: float = 2.5) -> Flight:
    """The flight with a GPS receiver, 5 Hz at most, a compass at 20 Hz and a barometer at 10 Hz that saw the motion.

    glitch: times (N,) s → (N, 3) m NED, by how much the receiver's position is off then.
    """
    seen, every = aiding_readings(motion, seed), slice(None, None, round(5.0 / fixes_hz))
    fixed, velocity = seen.fixed[every], seen.velocity[every]
    place = seen.place[every] if glitch is None else seen.place[every] + glitch(fixed)
    latitude, longitude, height = geodetic_from_ned(place, HOME).T
    rate = (len(motion.t) - 1) / (motion.t[-1] - motion.t[0])
    slow, quick = (slice(None, None, max(1, round(rate / hz))) for hz in (10.0, 20.0))
    count = len(fixed)
    down_unknown = velocity * [1.0, 1.0, np.nan]
    horizontal, vertical, speed = (np.full(count, sigma) for sigma in GPS_SIGMA)
    gps = GpsTrack(
        fixed, latitude, longitude, height, down_unknown, horizontal, vertical, speed, np.full(count, 3.0),
        np.full(count, 14.0), "GPS_RAW_INT",
    )  # fmt: skip
    air = seen.height[slow]
    return replace(
        flight,
        origin=Origin(*HOME),
        gps=(gps,),
        compasses=(CompassTrack(motion.t[quick], seen.fields[0][quick], "RAW_IMU"),),
        barometers=(BarometerTrack(motion.t[slow], pressure(air), air, np.full(len(air), 25.0), "SCALED_PRESSURE"),),
    )


def seconds(duration: float, rate_hz: float, start: float = 10.0) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Sample times."""
    return start + np.arange(round(duration * rate_hz) + 1) / rate_hz


def lively(duration: float) -> Motion:
    """Turns and pulls about every axis, so many s."""
    t = seconds(duration, 50)
    return motions.coning(t, angle=0.25, frequency=0.25, amplitude=(6.0, 5.0, 2.0), swing=(0.07, 0.11, 0.1))


LIVELY = lively(50.0)
CIRCLE = motions.circle(seconds(50, 50), radius=25.0, speed=6.0, bank=0.15)


def flown(motion: Motion = LIVELY, *, glitch: Any = None, fixes_hz: float = 2.5, **changes: Any) -> Flight:
    """A flight from 10 s on with a good IMU, a good autopilot and every aiding sensor, but for the changes.

    glitch, fixes_hz: as of `aided`; the autopilot follows the receiver.
    """
    flight = flight_of(motion, every=4, imus={"RAW_IMU": replace(simulate(motion.imu, GOOD, 1), source="RAW_IMU")})
    position = flight.position
    if glitch is not None and position is not None:
        flight = replace(flight, position=replace(position, position=position.position + glitch(position.t)))
    armed = Event(flight.start, "armed", "armed")
    return replace(aided(flight, motion, glitch=glitch, fixes_hz=fixes_hz), **({"events": (armed,)} | changes))


def moved_north(gps: GpsTrack, metres: Any) -> GpsTrack:
    """The fixes so many metres further north, the same or (N,) for each."""
    return replace(gps, latitude=gps.latitude + metres / 6.37e6)


def without_aiding(flight: Flight) -> Flight:
    """The same with IMU and autopilot alone."""
    return replace(flight, gps=(), compasses=(), barometers=())


def with_imu(flight: Flight, **changes: Any) -> Flight:
    """The flight with other readings of its IMU."""
    return replace(flight, imus={"RAW_IMU": replace(flight.imu("RAW_IMU"), **changes)})


def turned(flight: Flight, turn: Any) -> Flight:
    """The autopilot's attitude turned by rotation vectors in NED, its own rates as they were."""
    attitude = flight.require_attitude()
    q = quaternion.multiply(quaternion.exp(np.asarray(turn)), attitude.q_ned_frd)
    return replace(flight, attitude=replace(attitude, q_ned_frd=q))


def drifting(flight: Flight, axis: tuple[float, float, float], begin: float = 30.0, lasts: float = 15.0) -> Flight:
    """The autopilot's attitude turns away at 1°/s for a while."""
    t = flight.require_attitude().t
    return turned(flight, np.radians(1.0) * np.clip(t - begin, 0, lasts)[:, None] * np.array(axis))
