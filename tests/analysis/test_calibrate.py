"""The errors of simulated sensors, found again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.analysis import GENERIC, Calibration, Correction, ReferenceFigures, calibrate, compare, drift_of
from companion.analysis.calibrate import ACCEL_BIAS, GYRO_BIAS, MOUNTING, TIME_OFFSET
from companion.strapdown import ImuModel, Motion, Sensor, motions, simulate
from companion.tracks import ImuTrack
from tests.flights import flight_of, seconds

CLOSE = ReferenceFigures(tilt=1e-4, heading=1e-4, attitude_noise=5e-4, velocity=0.01, position=0.02)


def lively() -> Motion:
    """Turns about every axis and swings by metres: everything can be seen."""
    return motions.coning(seconds(90, 100), angle=0.5, frequency=0.15, amplitude=(6.0, 5.0, 3.0))


def fit(motion: Motion, track: ImuTrack, figures: ReferenceFigures = CLOSE, **options: slice) -> Calibration:
    flight = flight_of(motion)
    found = calibrate(track, lambda t: compare(flight, track=t), GENERIC, figures, **options)  # type: ignore[arg-type]
    assert found
    return found


def test_biases_are_found_within_three_standard_errors() -> None:
    motion, outside = lively(), 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        gyro, accel = rng.normal(0, 5e-3, 3), rng.normal(0, 0.1, 3)
        model = ImuModel(
            gyro=Sensor(noise_density=GENERIC.gyro.noise_density, bias=gyro),
            accel=Sensor(noise_density=GENERIC.accel.noise_density, bias=accel),
        )
        found = fit(motion, simulate(motion.imu, model, seed))
        outside += int((np.abs(found.values[GYRO_BIAS] - gyro) > 3 * found.sigma[GYRO_BIAS]).sum())
        seen = np.array(found.observable[ACCEL_BIAS])
        outside += int((np.abs(found.values[ACCEL_BIAS] - accel) > 3 * found.sigma[ACCEL_BIAS])[seen].sum())
        assert all(found.observable[GYRO_BIAS])
    assert outside <= 1, "of 120 figures"


def test_a_lag_is_found() -> None:
    motion = lively()
    late = replace(motion.imu, t=motion.t + 0.012)
    found = fit(motion, late)
    assert found.observable[TIME_OFFSET]
    assert found.values[TIME_OFFSET] == pytest.approx(0.012, abs=5e-4)


def test_a_board_that_is_mounted_askew_is_found() -> None:
    """The true readings are (1 + [r]x) times the measured ones: the IMU's axes are turned by -r."""
    motion = lively()
    askew = np.array([0.02, -0.03, 0.015])
    measured = Correction(np.zeros(3), np.zeros(3), -askew, 0.0).apply(motion.imu)
    found = fit(motion, measured)
    assert found.values[MOUNTING] == pytest.approx(askew, abs=2e-3)


def test_a_hover_cannot_tell_an_accelerometer_bias_from_a_tilt() -> None:
    motion = motions.rest(seconds(90, 100))
    model = ImuModel(gyro=Sensor(noise_density=1e-4, bias=np.array([3e-3, 0, 0])), accel=Sensor(noise_density=1e-3))
    found = fit(motion, simulate(motion.imu, model, 3), ReferenceFigures())
    assert all(found.observable[GYRO_BIAS])
    assert found.observable[ACCEL_BIAS] == (False, False, True)
    assert not any(found.observable[MOUNTING])
    assert not found.observable[TIME_OFFSET]


def test_the_correction_holds_on_windows_that_were_not_fitted() -> None:
    motion = lively()
    model = ImuModel(gyro=Sensor(noise_density=1e-4, bias=np.array([0.01, -0.015, 0.008])))
    track = simulate(motion.imu, model, 4)
    half = fit(motion, track, fitted=slice(0, None, 2))
    flight = flight_of(motion)
    before = drift_of(compare(flight, track=track), (5,)).rows[0].position_m
    after = drift_of(compare(flight, track=half.correction.apply(track)), (5,)).rows[0].position_m
    assert before
    assert after
    assert after.median < before.median / 10


def test_no_window_no_calibration() -> None:
    motion = motions.rest(seconds(3, 100))
    flight = flight_of(motion)
    assert calibrate(motion.imu, lambda t: compare(flight, track=t), GENERIC, CLOSE) is None
