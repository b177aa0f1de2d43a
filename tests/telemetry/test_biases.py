"""Whether two messages speak of one sensor, on readings that are made up: how a sensor is published decides."""

from __future__ import annotations

import numpy as np
import pytest

from companion.model import ImuTrack
from companion.telemetry.biases import same_sensor

PERIOD_S = 0.004  # of the sensor
GYRO_STEP, ACCEL_STEP = 1e-3, 9.80665e-3  # of SCALED_IMU


def readings(seed: int, *, noise: float = 1.0) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """20 s of gyro and accelerometer, (N, 6)."""
    t = PERIOD_S * np.arange(5000)[:, None]
    motion = 0.1 * np.sin(2 * np.pi * np.array([0.7, 1.1, 1.3, 0.5, 0.9, 1.7]) * t)
    scale = noise * np.array([0.02, 0.02, 0.02, 0.2, 0.2, 0.2])
    return motion + scale * np.random.default_rng(seed).normal(size=motion.shape)


def track(values: np.ndarray[tuple[int, int], np.dtype[np.float64]], every: int, first: int, delay: float) -> ImuTrack:
    """Every so many readings, stamped so late; in whole steps where that is later than they were sampled."""
    index = np.arange(first, len(values), every)
    scaled = delay > 0
    steps = np.repeat([GYRO_STEP, ACCEL_STEP], 3)
    told = np.trunc(values[index] / steps) * steps if scaled else values[index]
    return ImuTrack(
        t=np.round(PERIOD_S * index + max(delay, 0.0), 3),
        gyro=told[:, :3],
        accel=told[:, 3:],
        source="SCALED_IMU" if scaled else "HIGHRES_IMU",
        gyro_step=GYRO_STEP if scaled else 0.0,
        accel_step=ACCEL_STEP if scaled else 0.0,
    )


@pytest.mark.parametrize("delay", [1e-9, 0.001, 0.003, 0.004, 0.008])
def test_one_sensor_is_one_however_late_its_readings_are_published(delay: float) -> None:
    """With 4 and 8 ms the stamps are those of other readings."""
    one = readings(1)
    highres = one - np.array([0.01, -0.02, 0.0, 0.3, 0.0, -0.1])  # less the estimator's biases
    assert same_sensor(track(one, 3, 0, delay), track(highres, 2, 1, 0.0)) is True


@pytest.mark.parametrize("delay", [1e-9, 0.004, 0.008])
def test_another_sensor_is_another_at_every_delay(delay: float) -> None:
    assert same_sensor(track(readings(1), 3, 0, delay), track(readings(2), 2, 1, 0.0)) is False


def test_nothing_is_told_where_no_reading_is_in_both_messages() -> None:
    one = readings(1)
    assert same_sensor(track(one, 10, 0, 0.004), track(one, 10, 5, 0.0)) is None


def test_nothing_is_told_by_what_does_not_move() -> None:
    """Two quiet sensors read the same to a step."""
    still = np.zeros((5000, 6))
    one, other = (still + 1e-5 * readings(seed) for seed in (1, 2))
    assert same_sensor(track(one, 3, 0, 1e-9), track(other, 2, 1, 0.0)) is None
