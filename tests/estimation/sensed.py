"""Simulated flights with known truth, and every aiding sensor that the smoother hears as typed tracks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from companion.estimation import BestEstimate
from companion.estimation.earth_field import field_at
from companion.estimation.model import States
from companion.estimation.setup import Setup, first_guess
from companion.model import (
    PITCH_270,
    Array,
    AttitudeTrack,
    BarometerTrack,
    CompassTrack,
    Epoch,
    Event,
    Flight,
    GpsTrack,
    ImuTrack,
    Origin,
    RangeTrack,
    Vehicle,
    geodetic_from_ned,
)
from companion.simulate.true_flight import square
from companion.strapdown import ImuModel, Motion, Sensor, motions, quaternion, simulate

PLACE = (np.radians(47.4), np.radians(8.5), 500.0)
EPOCH = Epoch(1.75e9, "SYSTEM_TIME")
LATENCY = 0.1  # s, of the GPS
BIASES = (np.array([0.006, -0.004, 0.005]), np.array([0.05, -0.04, 0.06]))
NOISE = (5e-4, 5e-3)  # rad/s/√Hz, m/s²/√Hz

PATHS: dict[str, Callable[[Array], Motion]] = {
    "square": square,
    "circle": partial(motions.circle, heave=0.5, frequency=0.1),
    "heave": partial(motions.circle, heave=1.0, frequency=0.5),
    "rest": motions.rest,
    "coning": partial(motions.coning, frequency=1.5, angle=0.4),
}


def sensed(
    duration: float = 120.0,
    path: str = "square",
    *,
    seed: int = 0,
    rate: float = 100.0,
    fixes_hz: float = 2.5,
    place: tuple[float, float, float] = PLACE,
    biases: tuple[Array, Array] = BIASES,
    noise: tuple[float, float] = NOISE,
) -> tuple[Flight, Motion]:
    """A flight with a GPS, compass and barometer at 10 Hz, and its truth."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, 1.0 / rate)
    truth = PATHS[path](t)
    model = ImuModel(gyro=Sensor(noise[0], bias=biases[0]), accel=Sensor(noise[1], bias=biases[1]))
    imu = replace(simulate(truth.imu, model, rng), source="RAW_IMU")
    flight = Flight(
        vehicle=Vehicle(1, 1, "ARDUPILOTMEGA", "QUADROTOR"),
        boot=1,
        start=0.0,
        duration=duration,
        imus={"RAW_IMU": imu},
        attitude=AttitudeTrack(t, truth.q_ned_frd, truth.gyro, "ATTITUDE"),
        origin=Origin(*place),
        epoch=EPOCH,
        events=(Event(0.0, "disarmed", ""), Event(5.5, "armed", "")),
        gps=(gps_of(truth, rng, place, rate=fixes_hz),),
        compasses=(compass_of(truth, rng, place),),
        barometers=(barometer_of(truth, rng),),
    )
    return flight, truth


def gps_of(
    truth: Motion,
    rng: np.random.Generator,
    place: tuple[float, float, float] = PLACE,
    *,
    latency: float = LATENCY,
    rate: float = 2.5,
) -> GpsTrack:
    """0.4 m, 0.6 m and 0.1 m/s of white noise."""
    t = np.arange(truth.t[0] + 0.5, truth.t[-1], 1.0 / rate)
    then = t - latency
    count = len(t)
    position = at(then, truth.t, truth.position) + rng.normal(size=(count, 3)) * [0.4, 0.4, 0.6]
    velocity = at(then, truth.t, truth.velocity) + rng.normal(size=(count, 3)) * 0.1
    where = geodetic_from_ned(position, place)
    return GpsTrack(
        t, where[:, 0], where[:, 1], where[:, 2], velocity, np.full(count, 0.4), np.full(count, 0.6),
        np.full(count, 0.1), np.full(count, 3.0), np.full(count, 12.0), "GPS_RAW_INT",
    )  # fmt: skip


def compass_of(
    truth: Motion, rng: np.random.Generator, place: tuple[float, float, float] = PLACE, *, averaged: int = 1
) -> CompassTrack:
    """10 Hz, 0.8 µT of white noise, an Earth that is as the model has it; the mean of the last so many samples."""
    earth = field_at(Origin(*place), EPOCH)
    t = np.arange(truth.t[0], truth.t[-1], 0.1)
    field = np.array([20e-6, 1e-6, 43e-6]) if earth is None else earth.ned
    i = np.unique(np.searchsorted(truth.t, t))
    i = i[i >= averaged - 1]
    then = i[:, None] - np.arange(averaged)
    body = quaternion.rotate(quaternion.conjugate(truth.q_ned_frd[then]), np.tile(field, (*then.shape, 1))).mean(axis=1)
    return CompassTrack(truth.t[i], body + rng.normal(size=body.shape) * 8e-7, "RAW_IMU")


def barometer_of(truth: Motion, rng: np.random.Generator) -> BarometerTrack:
    """10 Hz, 0.2 m of white noise, zero somewhere else."""
    t = np.arange(truth.t[0], truth.t[-1], 0.1)
    up = -at(t, truth.t, truth.position)[:, 2] + 3.0 + 0.2 * rng.normal(size=len(t))
    return BarometerTrack(t, 101325.0 - 12.0 * up, up, np.full(len(t), 20.0), "SCALED_PRESSURE")


def range_of(truth: Motion, rng: np.random.Generator, ground: Callable[[Array], Array] | None = None) -> RangeTrack:
    """10 Hz, 0.05 m of white noise along the body's down axis, to ground at such heights at times (N,), or level."""
    t = np.arange(truth.t[0], truth.t[-1], 0.1)
    down = quaternion.to_matrix(truth.q_ned_frd[np.searchsorted(truth.t, t - 1e-9)])[:, 2, 2]
    above = -at(t, truth.t, truth.position)[:, 2] + 2.0 - (0.0 if ground is None else ground(t))
    distance = above / down + 0.05 * rng.normal(size=len(t))
    unknown = np.full(len(t), np.nan)
    return RangeTrack(t, distance, unknown, unknown, PITCH_270, 0.1, 40.0, "DISTANCE_SENSOR")


def at(t: Array, times: Array, values: Array) -> Array:
    """Columns of values interpolated."""
    return np.column_stack([np.interp(t, times, column) for column in values.T])


def true_states(setup: Setup, flight: Flight, truth: Motion) -> States:
    """What the estimate should be at the keyframes, all constants nominal."""
    return replace(
        first_guess(setup, flight),
        q_ned_frd=truth.q_ned_frd[np.searchsorted(truth.t, setup.t - 1e-9)],
        velocity=at(setup.t, truth.t, truth.velocity),
        position=at(setup.t, truth.t, truth.position),
    )


def with_imu(flight: Flight, imu: ImuTrack) -> Flight:
    """The flight with another IMU track."""
    return replace(flight, imus={imu.source: imu})


def errors(found: BestEstimate, truth: Motion) -> Array:
    """(K, 9) attitude (rad, NED), velocity and position, truth minus estimate, at the keyframes."""
    i = found.index
    angle = quaternion.log(quaternion.multiply(truth.q_ned_frd[i], quaternion.conjugate(found.q_ned_frd)))
    return np.concatenate(
        (angle, truth.velocity[i] - found.velocity, truth.position[i] - found.position), axis=1
    )  # fmt: skip


def nees(found: BestEstimate, error: Array, block: slice) -> float:
    """Mean normalised estimation error squared of a block of the error; its dimension where σ is honest."""
    inverse = np.linalg.inv(found.covariance[:, block, block])
    return float(np.einsum("ki,kij,kj->k", error[:, block], inverse, error[:, block]).mean())
