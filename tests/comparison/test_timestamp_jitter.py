"""Time stamps that are off, and what that does to a reckoning."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import chdtri

from companion.comparison import GENERIC, ReferenceSpec, compare, windows
from companion.comparison.budget import budget, nees, shares_of, stacked
from companion.comparison.windows import stamp_jitter
from companion.model import ImuTrack
from companion.strapdown import motions
from tests.flights import flight_of, seconds

MOTION = motions.coning(seconds(40, 100), angle=0.4, frequency=0.4)
PERFECT = replace(
    GENERIC,
    gyro=replace(GENERIC.gyro, noise_density=0.0, bias_walk=0.0, residual_bias=0.0, scale=0.0),
    accel=replace(GENERIC.accel, noise_density=0.0, bias_walk=0.0, residual_bias=0.0, scale=0.0),
)
CERTAIN = ReferenceSpec(0, 0, 1e-7, 1e-6, 1e-6, 0, 0, 0)


def stamped(t: np.ndarray, **changes: float) -> ImuTrack:
    return ImuTrack(t, MOTION.gyro[: len(t)], MOTION.accel[: len(t)], source="RAW_IMU", **changes)  # type: ignore[arg-type]


def test_jitter_is_found_and_gaps_are_none() -> None:
    rng = np.random.default_rng(1)
    t = MOTION.t + rng.normal(0, 4e-4, len(MOTION.t))
    assert stamp_jitter(stamped(t)) == pytest.approx(4e-4, rel=0.1)
    kept = rng.uniform(size=len(t)) > 0.2
    assert stamp_jitter(stamped(MOTION.t[kept])) == pytest.approx(0.0, abs=1e-9)


def test_ticks_of_a_loop_are_no_jitter() -> None:
    """PX4 sends HIGHRES_IMU 8 or 12 ms apart: whole ticks of 4 ms, at the right times."""
    intervals = np.where(np.arange(2000) % 2, 0.008, 0.012)
    assert stamp_jitter(stamped(10 + np.cumsum(intervals))) == pytest.approx(0.0, abs=1e-9)


def test_whole_milliseconds_are_a_uniform_error() -> None:
    t = 10 + np.arange(3000) * 0.0074
    rounded = np.floor(t * 1e3) / 1e3
    assert stamp_jitter(stamped(rounded, t_step=1e-3)) == pytest.approx(1e-3 / np.sqrt(12), rel=0.35)
    assert stamp_jitter(stamped(MOTION.t, t_step=1e-3)) == pytest.approx(1e-3 / np.sqrt(12))


def test_errors_of_late_stamps_are_as_large_as_the_budget_says() -> None:
    """Mean NEES of 9 states over 60 draws, one window of each, with nothing wrong but the stamps."""
    flight = flight_of(MOTION)
    normalised = []
    for seed in range(60):
        late = MOTION.t + np.random.default_rng(seed).normal(0, 4e-4, len(MOTION.t))
        comparison = compare(flight, track=stamped(late))
        chosen = windows(comparison, 5.0)
        allowed = budget(comparison, chosen, PERFECT, CERTAIN)
        normalised.append(nees(stacked(comparison, chosen), allowed.total)[1])
    low, high = (float(chdtri(9 * 60, 1 - p)) / 60 for p in (0.005, 0.995))
    assert 0.8 * low < np.mean(normalised) < 1.2 * high
    assert min(shares_of(allowed.power(slice(i, i + 3)))["time_jitter"] for i in (0, 6)) > 0.6
