"""The errors of simulated sensors, found again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from companion.comparison import (
    GENERIC,
    NAMES,
    PARTS,
    Calibration,
    Correction,
    ReferenceSpec,
    calibrate,
    compare,
    drift_over,
    windows,
)
from companion.comparison.calibrate import Known
from companion.model import ImuTrack
from companion.strapdown import ImuModel, Motion, Sensor, motions, quaternion, simulate
from tests.flights import flight_of, seconds

pytestmark = pytest.mark.slow

CLOSE = ReferenceSpec(tilt=1e-4, heading=1e-4, attitude_noise=5e-4, velocity=0.01, position=0.02)


def lively() -> Motion:
    """Turns about every axis and swings by metres: everything can be seen."""
    return motions.coning(seconds(90, 100), angle=0.5, frequency=0.15, amplitude=(6.0, 5.0, 3.0))


def fit(motion: Motion, track: ImuTrack, figures: ReferenceSpec = CLOSE, **options: Any) -> Calibration:
    flight = flight_of(motion)
    found = calibrate(compare(flight, track=track), GENERIC, figures, **options)
    assert found
    return found


def outside(found: Calibration, part: str, truth: np.ndarray) -> tuple[int, int]:
    """How many observable figures of a part are further from the truth than three standard errors, and of how many."""
    place = PARTS[part]
    seen = np.array(found.observable[place])
    wrong = np.abs(found.values[place] - truth) > 3 * found.sigma[place]
    return int((wrong & seen).sum()), int(seen.sum())


def test_figures_are_found_within_three_standard_errors() -> None:
    """Of an IMU that is off in every way, in 20 draws: at most 1 % of the figures are further off."""
    motion = motions.coning(seconds(60, 50), angle=0.5, frequency=0.15, amplitude=(6.0, 5.0, 3.0))
    tally = dict.fromkeys(("gyro_bias", "accel_bias", "gyro_scale", "accel_scale"), (0, 0))
    for seed in range(20):
        rng = np.random.default_rng(seed)
        gyro, accel = rng.normal(0, 5e-3, 3), rng.normal(0, 0.1, 3)
        gyro_scale, accel_scale = rng.normal(0, GENERIC.gyro.scale, 3), rng.normal(0, GENERIC.accel.scale, 3)
        model = ImuModel(
            gyro=Sensor(GENERIC.gyro.noise_density, bias=gyro, matrix=np.diag(1 / (1 + gyro_scale))),
            accel=Sensor(GENERIC.accel.noise_density, bias=accel, matrix=np.diag(1 / (1 + accel_scale))),
        )
        found = fit(motion, simulate(motion.imu, model, seed))
        for part, truth in (
            ("gyro_bias", gyro),
            ("accel_bias", accel),
            ("gyro_scale", gyro_scale),
            ("accel_scale", accel_scale),
        ):
            tally[part] = tuple(np.add(tally[part], outside(found, part, truth)))
        assert found.score("gyro_bias")
    assert sum(wrong for wrong, _ in tally.values()) <= 0.01 * sum(seen for _, seen in tally.values()), tally
    assert tally["gyro_bias"][1] == 60
    assert tally["accel_bias"][1] > 40
    assert tally["gyro_scale"][1] >= 40


def test_truncated_readings_do_not_pretend_to_be_exact() -> None:
    """Whole milli-units that keep their sign are half a step short for ever: no number of windows averages that out."""
    motion = motions.rest(seconds(90, 50))
    bias = np.array([4.6e-3, -3.3e-3, 2.5e-3])
    model = ImuModel(gyro=Sensor(1e-5, bias=bias, step=1e-3), accel=Sensor(1e-3))
    assert outside(fit(motion, simulate(motion.imu, model, 1)), "gyro_bias", bias) == (0, 3)


def test_a_lag_is_found() -> None:
    motion = lively()
    late = replace(motion.imu, t=motion.t + 0.012)
    found = fit(motion, late)
    assert found.score("time_offset")
    assert found.correction.time_offset == pytest.approx(0.012, abs=5e-4)


def test_a_board_that_is_mounted_askew_is_found() -> None:
    """True readings are (1 + [r]x) times those of a board that is turned by r: what AHRS_TRIM says of it."""
    motion = lively()
    askew = np.array([0.02, -0.03, 0.015])
    turn = quaternion.exp(askew)
    gyro, accel = (quaternion.rotate(quaternion.conjugate(turn), x) for x in (motion.gyro, motion.accel))
    found = fit(motion, replace(motion.imu, gyro=gyro, accel=accel))
    assert found.values[PARTS["mounting"]] == pytest.approx(askew, abs=5e-3)
    assert all(found.observable[PARTS["mounting"]])


def test_a_lever_arm_is_found() -> None:
    """An IMU that is not where the position is feels the turns: its readings are those of the point r from there."""
    motion = motions.coning(seconds(60, 100), angle=0.6, frequency=0.37, amplitude=(3.0, 2.0, 1.0))
    arm = np.array([0.3, -0.2, 0.1])
    angular = np.gradient(motion.gyro, motion.t, axis=0, edge_order=2)
    felt = motion.accel + np.cross(angular, arm) + np.cross(motion.gyro, np.cross(motion.gyro, arm))
    found = fit(motion, replace(motion.imu, accel=felt))
    assert found.score("lever_arm")
    assert found.values[PARTS["lever_arm"]] == pytest.approx(arm, abs=0.02)
    assert outside(found, "lever_arm", arm)[0] == 0
    assert outside(found, "accel_bias", np.zeros(3))[0] == 0


def test_axes_that_are_not_square_are_found() -> None:
    motion = motions.coning(seconds(60, 100), angle=0.6, frequency=0.37, amplitude=(3.0, 2.0, 1.0))
    axes = np.array([0.01, -0.012, 0.008, 0.006, -0.009, 0.011])
    spoilt = np.linalg.inv(Correction(gyro_misalignment=axes).apply(_unit()).gyro.T)
    found = fit(motion, replace(motion.imu, gyro=motion.gyro @ spoilt.T))
    assert found.score("gyro_misalignment")
    wrong, seen = outside(found, "gyro_misalignment", axes)
    assert seen >= 3
    assert wrong == 0


def _unit() -> ImuTrack:
    """Three samples whose readings are the three axes."""
    return ImuTrack(np.arange(3.0), np.eye(3), np.eye(3))


def test_a_hover_cannot_tell_an_accelerometer_bias_from_a_tilt_or_a_scale() -> None:
    motion = motions.rest(seconds(90, 100))
    model = ImuModel(
        gyro=Sensor(noise_density=1e-4, bias=np.array([3e-3, 0, 0])),
        accel=Sensor(noise_density=1e-3, bias=np.array([0.1, 0.0, 0.0]), matrix=np.diag([1.0, 1.0, 1.001])),
    )
    found = fit(motion, simulate(motion.imu, model, 3), ReferenceSpec())
    assert all(found.observable[PARTS["gyro_bias"]])
    assert found.observable[PARTS["accel_bias"]] == (False, False, True)
    assert found.confounded[3:5] == ("mounting_y", "mounting_x")
    assert not any(found.score(part) for part in ("mounting", "time_offset", "gyro_scale", "accel_scale", "lever_arm"))
    value, sigma = found.level_force
    assert value == pytest.approx(-0.0098, abs=3 * sigma)
    assert sigma < 0.006
    assert found.assumed[3:5] == (True, True)
    assert found.correction.accel_bias[:2] == pytest.approx([0.1, 0.0], abs=3 * found.assumed_sigma[3])


def test_a_bias_that_is_switched_on_is_that_of_most_windows() -> None:
    """What was before is an outlier, and does not pull."""
    motion = lively()
    begun = motion.t > motion.t[0] + 20
    found = fit(motion, replace(motion.imu, gyro=motion.gyro + 0.02 * begun[:, None]))
    assert found.values[PARTS["gyro_bias"]] == pytest.approx([0.02] * 3, abs=5e-4)


def test_the_correction_holds_on_windows_that_were_not_fitted() -> None:
    motion = lively()
    model = ImuModel(gyro=Sensor(noise_density=1e-4, bias=np.array([0.01, -0.015, 0.008])))
    track = simulate(motion.imu, model, 4)
    middle = float(np.mean(track.t[[0, -1]]))
    half = fit(motion, track, until=middle)
    assert half.windows == 8
    later = track[int(np.searchsorted(track.t, middle)) :]
    flight = flight_of(motion)
    both = (compare(flight, track=track) for track in (later, half.correction.apply(later)))
    before, after = (drift_over(one, [windows(one, 5.0)]).rows[0].position_m for one in both)
    assert before
    assert after
    assert after.median < before.median / 10


def test_readings_after_the_last_window_do_not_count() -> None:
    motion = lively()
    track = simulate(motion.imu, ImuModel(gyro=Sensor(noise_density=1e-4, bias=np.array([0.01, -0.015, 0.008]))), 4)
    middle = float(np.mean(track.t[[0, -1]]))
    spoilt = replace(track, gyro=np.where((track.t > middle + 0.1)[:, None], track.gyro + 0.5, track.gyro))
    of_both = [fit(motion, one, until=middle) for one in (track, spoilt)]
    np.testing.assert_allclose(of_both[1].values, of_both[0].values, rtol=0, atol=1e-9)


def test_what_the_best_estimate_tells_is_taken_and_the_rest_follows() -> None:
    """It counts alone, with its own standard error, and what the windows cannot tell from it moves with it."""
    motion = lively()
    bias = np.array([0.01, -0.015, 0.008])
    track = simulate(motion.imu, ImuModel(gyro=Sensor(noise_density=1e-4, bias=bias)), 4)
    alone = fit(motion, track)
    told = np.zeros(len(NAMES), np.bool_)
    told[PARTS["gyro_bias"]] = True
    values, covariance = np.zeros(len(NAMES)), np.zeros((len(NAMES), len(NAMES)))
    values[:3], covariance[:3, :3] = alone.values[:3] + 0.002, np.diag([1e-4, 2e-4, 3e-4]) ** 2
    found = fit(motion, track, known=Known(values, covariance, told))
    np.testing.assert_allclose(found.values[:3], values[:3])
    np.testing.assert_allclose(found.sigma[:3], [1e-4, 2e-4, 3e-4])
    assert found.from_best == tuple(told.tolist())
    assert found.observed_by_best("gyro_bias")
    assert not found.observed_by_best("accel_bias")
    scale = PARTS["gyro_scale"]
    assert np.abs(found.values[scale] - alone.values[scale]).max() > 0.2 * alone.sigma[scale].min()
    assert (found.sigma[scale] > 0.0).all()


def test_no_window_no_calibration() -> None:
    motion = motions.rest(seconds(3, 100))
    flight = flight_of(motion)
    assert calibrate(compare(flight, track=motion.imu), GENERIC, CLOSE) is None
