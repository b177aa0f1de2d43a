"""The best estimate's figures of an IMU's lasting errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.comparison import GENERIC, NAMES, PARTS, Correction, compare, drift_over, known_from, windows
from companion.comparison.calibrate import _to_figures
from companion.estimation import smooth
from companion.model import ImuTrack
from companion.verdict.constant_faults import beside_best
from tests.estimation.sensed import BIASES, sensed, with_imu


def test_figures_and_matrices_say_the_same_of_a_reading() -> None:
    """But for a turn of the IMU's axes, which both sensors have alike, and for what is of second order."""
    rng = np.random.default_rng(1)
    errors = rng.normal(size=24) * np.repeat([1e-2, 1e-1, 1e-4, 1e-4], [3, 3, 9, 9])
    place = np.concatenate([np.arange(len(NAMES))[PARTS[part]] for part in PARTS if part not in _OTHERS])
    values = np.zeros(len(NAMES))
    values[place] = _to_figures() @ errors
    read = ImuTrack(np.arange(50.0), rng.normal(size=(50, 3)), 9.8 * rng.normal(size=(50, 3)))
    ours = Correction.of(values).apply(read)
    gyro, accel = (np.eye(3) - errors[i : i + 9].reshape(3, 3) for i in (6, 15))
    turns = [
        np.linalg.lstsq(one, other @ matrix.T, rcond=None)[0].T
        for one, other, matrix in (
            (ours.gyro, read.gyro - errors[:3], gyro),
            (ours.accel, read.accel - errors[3:6], accel),
        )
    ]
    np.testing.assert_allclose(turns[0], turns[1], atol=1e-6)
    np.testing.assert_allclose(turns[0] + turns[0].T, 2.0 * np.eye(3), atol=1e-6)


_OTHERS = ("mounting", "time_offset", "lever_arm")


@pytest.mark.slow
def test_what_the_flight_shows_is_told_and_true() -> None:
    """Turns to and fro tell the biases, and by how much a gyro turns too much, within what is said."""
    flight, _ = sensed(120.0, "square", seed=4)
    imu = flight.imu()
    scale = np.array([0.01, -0.012, 0.008])
    flight = with_imu(flight, replace(imu, gyro=(imu.gyro - BIASES[0]) / (1.0 + scale) + BIASES[0]))
    known = known_from(smooth(flight).errors, GENERIC, flight.imu())
    sigma = np.sqrt(np.diag(known.covariance))
    truth = np.zeros(len(NAMES))
    truth[PARTS["gyro_bias"]], truth[PARTS["accel_bias"]], truth[PARTS["gyro_scale"]] = *BIASES, scale
    off = np.abs(known.values - truth) / np.where(sigma > 0.0, sigma, 1.0)
    assert known.observable[PARTS["gyro_bias"]].all()
    assert known.observable[PARTS["gyro_scale"]].any()
    assert (off[known.observable] < 3.0).all()
    assert not any(known.observable[PARTS[part]].any() for part in _OTHERS)


def test_the_best_estimate_judges_a_correction() -> None:
    """Of its own biases the drift beside it nearly ends; windows that it does not cover are left out."""
    flight, _ = sensed(60.0, "square")
    best = smooth(flight)
    own = compare(flight)
    beside, chosen = beside_best(own, best, windows(own, 5.0))
    assert len(chosen.start) >= 10
    of_it = Correction(gyro_bias=best.errors.values[:3], accel_bias=best.errors.values[3:6])
    both = beside, beside.of(of_it.apply(own.track))
    raw, corrected = (drift_over(one, [windows(one, 5.0)]).rows[0] for one in both)
    for attribute in ("attitude_deg", "position_m"):
        before, after = getattr(raw, attribute), getattr(corrected, attribute)
        assert after.median < 0.3 * before.median
    later = best.index[-1] + 1
    outside = chosen.only(np.zeros(len(chosen.start), np.bool_))
    outside = replace(outside, start=np.array([best.index[0]]), end=np.array([later]))
    assert not len(beside_best(own, best, outside)[1].start)
