"""Spectra: scipy's Welch is the oracle, Parseval's theorem the law."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.signal
from hypothesis import given
from hypothesis import strategies as st

from companion.analysis import Limits, imu_spectrum, vibration, welch
from companion.tracks import ImuTrack


@given(st.integers(2, 300), st.integers(0, 700), st.floats(1.0, 2000.0), st.integers(0, 99))
def test_welch_is_scipys(length: int, more: int, rate: float, seed: int) -> None:
    values = np.random.default_rng(seed).normal(3.0, 2.0, (length + more, 3))
    frequency, density = welch(values, rate, length)
    f, p = scipy.signal.welch(values, rate, nperseg=length, axis=0)
    np.testing.assert_allclose(frequency, f, rtol=1e-12)
    np.testing.assert_allclose(density, p, rtol=1e-9, atol=1e-12 * p.max())


def test_a_segment_has_to_fit() -> None:
    with pytest.raises(ValueError, match="does not fit"):
        welch(np.zeros(10), 1.0, 11)


def noise(seconds: float, rate: float, density: float) -> ImuTrack:
    """White noise of a density, u/√Hz, on both sensors."""
    n = round(seconds * rate)
    values = np.random.default_rng(1).normal(0.0, density * np.sqrt(rate / 2), (2, n, 3))
    return ImuTrack(np.arange(n) / rate, values[0], values[1])


def test_white_noise_has_its_density_at_every_frequency() -> None:
    spectrum = imu_spectrum(noise(300, 100, 2e-3), Limits())
    assert spectrum is not None
    assert spectrum.segments > 100
    np.testing.assert_allclose(np.sqrt(spectrum.gyro[1:-1].mean(axis=0)), 2e-3, rtol=0.03)
    assert spectrum.frequency_hz[-1] == pytest.approx(50.0)


def test_no_segment_lies_across_a_hole() -> None:
    whole = noise(60, 100, 1e-3)
    kept = np.flatnonzero((whole.t < 20) | (whole.t > 31))
    broken = ImuTrack(whole.t[kept], whole.gyro[kept] + 5.0 * (whole.t[kept] > 25)[:, None], whole.accel[kept])
    spectrum = imu_spectrum(broken, Limits())
    assert spectrum is not None
    assert spectrum.gyro.max() < 1e-5  # the step of 5 rad/s over the hole is in no segment
    assert imu_spectrum(whole[:20], Limits()) is None


def test_vibration_leaves_the_flown_motion_out() -> None:
    t = np.arange(6000) / 200
    accel = np.zeros((len(t), 3))
    accel[:, 0] = 5.0 * np.sin(2 * np.pi * 0.3 * t)
    accel[:, 2] = -9.80665 + 3.0 * np.sqrt(2) * np.sin(2 * np.pi * 37.0 * t)
    found = vibration(ImuTrack(t, np.zeros_like(accel), accel), Limits())
    assert found is not None
    assert found.accel[:, 0].max() < 0.1
    np.testing.assert_allclose(found.accel[:, 2], 3.0, rtol=0.05)
    assert found.t[0] < 1.5
    assert found.t[-1] > 28
    assert vibration(ImuTrack(t[::20], accel[::20], accel[::20]), Limits()) is None
